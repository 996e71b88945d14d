"""Packing a fast food order: burger, fries and drink go into the takeaway box in the order in which they are named."""

from betterbench.tasks import authoring as a

BURGER, BURGER_2 = a.item("burger_1", "burger"), a.item("burger_2", "burger")
FRIES, DRINK = a.item("fries", category="fries_box"), a.item("drink", category="drink_cup")
BOX = a.container("box", category="takeaway_box")
BLOCK = a.distractor("round_block")

FIRST, SECOND = a.Slot("first", 0.43, -0.238), a.Slot("second", 0.60, -0.227)
THIRD, FOURTH = a.Slot("third", 0.43, -0.11), a.Slot("fourth", 0.60, -0.1063)
STAND = a.Slot("stand", 0.47, 0.1160, jitter_m=0.005, yaw_jitter=0.03)
LAYOUT = {BURGER: FIRST, BURGER_2: SECOND, FRIES: THIRD, DRINK: FOURTH, BOX: STAND}


def order(text: str, *things: a.ObjectSpec) -> a.Instruction:
    """Return the instruction to pack the given food, one item after the other."""
    return a.ordered(f"Put {text}.", *a.packed("pack", BOX, *things))


BURGER_FRIES = order("a burger into the takeaway box, then the fries", BURGER, FRIES)
BURGER_DRINK = order("a burger into the takeaway box, then the drink", BURGER, DRINK)
FRIES_DRINK = order("the fries into the takeaway box, then the drink", FRIES, DRINK)
DRINK_FRIES = order("the drink into the takeaway box, then the fries", DRINK, FRIES)
ALL = order("both burgers into the takeaway box, then the fries, then the drink", BURGER, BURGER_2, FRIES, DRINK)

BY_KIND = "Food is found by its appearance, not by its training slot."
NEW_ORDER = "Known steps are combined in a new way, without the step that always came first."
LOOK_ALIKE = "The policy distinguishes a burger from a block of the same color and shape in its slot."
PROGRESS = "Progress is judged by the finished steps, not by the number of remaining burgers."
LONGER = (
    "The policy completes a sequence of known steps that is longer than any in training and contains one step twice."
)


@a.task
def fast_food() -> a.Task:
    """Pack the ordered food into the takeaway box, in the order in which it is named.

    Randomizations: each item is within 15 mm and 9 degrees of its slot, and its look varies. In training, either burger
    may be packed, and a burger always comes first.

    Success: The drink does not lie on its side in the box: it is tilted by at most 45 degrees.
    """
    one_left = (a.remove(BURGER_2), a.swap(FRIES, DRINK))
    exchanged = (a.swap(FRIES, DRINK), a.chain(ALL))
    left = "one burger at the start, fries and drink exchanged"
    longer = "both burgers, fries and drink (A→A→B→C), fries and drink exchanged"
    return a.Task(
        version=8,
        title="Packing a Fast Food Order",
        template=a.LOOSE_PACKING,
        slots=(FIRST, SECOND, THIRD, FOURTH, STAND),
        training=a.conditions([LAYOUT], [BURGER_FRIES, BURGER_DRINK]),
        variations=(
            a.Variation("L1", (a.swap(BURGER, FRIES),), "burger and fries exchanged", BY_KIND),
            a.Variation("R1", (a.instruct(FRIES_DRINK),), "fries, then drink (B→C)", NEW_ORDER),
            a.Variation("R2", (a.instruct(DRINK_FRIES),), "drink, then fries (C→B)", NEW_ORDER, "train2"),
            a.Variation("O1", (a.replace(BURGER, BLOCK),), "round block in the first burger's slot", LOOK_ALIKE),
            a.Variation("T1", one_left, left, PROGRESS, mid_task_look=True),
            a.Variation("T2", exchanged, longer, LONGER),
        ),
    )
