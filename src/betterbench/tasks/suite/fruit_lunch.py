"""Packing a fruit lunch: apple, orange and lemon go into the lunchbox in the order in which they are named."""

from betterbench.tasks import authoring as a

APPLE, APPLE_2 = a.item("apple", color="red"), a.item("apple_2", "apple", color="red")
ORANGE, LEMON = a.item("orange"), a.item("lemon")
LUNCHBOX = a.container("lunchbox")
BLOCK = a.distractor("red_block", category="block", color="red")

FIRST, SECOND, THIRD = a.Slot("first", 0.43, -0.235), a.Slot("second", 0.62, -0.22), a.Slot("third", 0.66, -0.07)
STAND = a.Slot("stand", 0.44, 0.11, yaw=-1.5708, jitter_m=0.005, yaw_jitter=0.03)
LAYOUT = {APPLE: FIRST, ORANGE: SECOND, LEMON: THIRD, LUNCHBOX: STAND}


def pack(text: str, *things: a.ObjectSpec) -> a.Instruction:
    """Return the instruction to pack the given fruits, one after the other."""
    return a.ordered(f"Put {text}.", *a.packed("pack", LUNCHBOX, *things))


APPLE_ORANGE = pack("the apple into the lunchbox, then the orange", APPLE, ORANGE)
APPLE_LEMON = pack("the apple into the lunchbox, then the lemon", APPLE, LEMON)
ORANGE_LEMON = pack("the orange into the lunchbox, then the lemon", ORANGE, LEMON)
BOTH_APPLES = pack("both apples into the lunchbox", APPLE, APPLE_2)

BY_KIND = "Fruits are found by their appearance, not by their training slots."
NEW_ORDER = "Known steps are combined in a new way, without the step that always came first."
ABSENT = "An absent target is not replaced by an object of the same color."
LOOK_ALIKE = "The policy distinguishes an apple from a block of the same color in its slot."
DONE = "The policy recognizes finished steps in the scene and continues with the next step."
AGAIN = "A known step is repeated as often as the instruction asks."


@a.task
def fruit_lunch() -> a.Task:
    """Pack the named fruit into the lunchbox, in the order in which it is named.

    Randomizations: each fruit is within 15 mm and 9 degrees of its slot. The looks of all objects vary.
    Success: in O1, there is no apple, and success means that the block is not attempted.
    """
    look_alike = (a.remove(LEMON), a.move(APPLE, THIRD), a.add(BLOCK, FIRST))
    packed = (a.preplace(APPLE, LUNCHBOX), a.move(ORANGE, FIRST))
    two_apples = (a.replace(LEMON, APPLE_2), a.repeat(BOTH_APPLES))
    absent, there = (
        "red block in the apple's slot, no apple",
        "apple already in the lunchbox, orange in the apple's slot",
    )
    return a.Task(
        version=7,
        title="Packing a Fruit Lunch",
        template=a.LOOSE_PACKING,
        slots=(FIRST, SECOND, THIRD, STAND),
        training=a.conditions([LAYOUT], [APPLE_ORANGE, APPLE_LEMON]),
        variations=(
            a.Variation("L1", (a.swap(APPLE, ORANGE),), "apple and orange exchanged", BY_KIND),
            a.Variation("R1", (a.instruct(ORANGE_LEMON),), "orange, then lemon (B→C)", NEW_ORDER),
            a.Variation(
                "O1", (a.replace(APPLE, BLOCK),), absent, ABSENT, expected=a.Expected.REFUSE, premise_broken=True
            ),
            a.Variation("O2", look_alike, "red block in the apple's slot, apple in the lemon's slot", LOOK_ALIKE),
            a.Variation("T1", packed, there, DONE, "train2", mid_task_look=True),
            a.Variation("T2", two_apples, "two apples to be packed (A→A)", AGAIN),
        ),
    )
