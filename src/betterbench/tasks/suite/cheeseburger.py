"""Assembling a cheeseburger: layers go onto the bottom bun in the named order."""

from betterbench.tasks import authoring as a

PATTY, PATTY_2 = a.item("patty"), a.item("patty_2", "patty")
CHEESE, LETTUCE = a.item("cheese", category="cheese_slice"), a.item("lettuce", category="lettuce_leaf")
TOP = a.item("top_bun", category="bun_top")
BASE = a.container("bottom_bun", category="bun_bottom")
SPONGE = a.distractor("sponge")

FIRST, SECOND = a.Slot("first", 0.48, -0.21), a.Slot("second", 0.64, -0.19)
THIRD, FOURTH = a.Slot("third", 0.48, -0.06), a.Slot("fourth", 0.64, -0.05)
STAND = a.Slot("stand", 0.52, 0.14, jitter_m=0.005, yaw_jitter=0.0)
LAYOUT = {PATTY: FIRST, CHEESE: SECOND, LETTUCE: THIRD, TOP: FOURTH, BASE: STAND}


def stack(*things: a.ObjectSpec) -> a.Instruction:
    """Return the instruction to stack the given layers on the bottom bun, from the lowest to the highest."""
    names = [f"the {t.kind}" for t in things]
    if names[0] == names[1]:
        names[1] = f"another {things[1].kind}"
    steps = (
        a.subgoal(f"layer_{i}_{t.kind.replace(' ', '_')}", a.LAYER, t, BASE, str(i), word=t.kind)
        for i, t in enumerate(things, start=1)
    )
    return a.ordered(f"Put {names[0]} on the bottom bun, then {', then '.join(names[1:])}.", *steps)


BY_KIND = "Layers are found by their appearance, not by their training slots."
WITHOUT_FIRST = "Known steps are combined in a new way, without the step that always came first."
NEW_ORDER = "Known steps are executed in an order that does not occur in training."
LOOK_ALIKE = "The policy distinguishes cheese from a sponge of the same color and shape in its slot."
DONE = "The policy recognizes finished steps in the scene and continues with the next step."
AGAIN = "A known step is repeated as often as the instruction asks."


@a.task
def cheeseburger() -> a.Task:
    """Stack the named layers on the bottom bun, in the order in which they are named.

    Randomizations: each layer is within 15 mm and 9 degrees of its slot. The looks of all objects vary.
    """
    look_alike = (a.remove(LETTUCE), a.move(CHEESE, THIRD), a.add(SPONGE, SECOND))
    two_patties = (a.replace(CHEESE, PATTY_2), a.swap(PATTY, LETTUCE), a.repeat(stack(PATTY, PATTY_2, TOP)))
    begun, there = (
        (a.preplace(PATTY, BASE, "1"), a.move(LETTUCE, FIRST)),
        "patty already on the bun, lettuce in the patty's slot",
    )
    no_patty, cheese_first = a.instruct(stack(CHEESE, LETTUCE, TOP)), a.instruct(stack(CHEESE, PATTY, TOP))
    return a.Task(
        version=6,
        title="Assembling a Cheeseburger",
        template=a.LOGICAL_ASSEMBLY,
        slots=(FIRST, SECOND, THIRD, FOURTH, STAND),
        training=a.conditions([LAYOUT], [stack(PATTY, CHEESE, TOP), stack(PATTY, LETTUCE, TOP)]),
        variations=(
            a.Variation("L1", (a.swap(PATTY, CHEESE),), "patty and cheese exchanged", BY_KIND),
            a.Variation("R1", (no_patty,), "cheese, lettuce, top bun (B→C)", WITHOUT_FIRST, "train2"),
            a.Variation("R2", (cheese_first,), "cheese, patty, top bun", NEW_ORDER),
            a.Variation("O1", look_alike, "yellow sponge in the cheese's slot", LOOK_ALIKE),
            a.Variation("T1", begun, there, DONE, mid_task_look=True),
            a.Variation("T2", two_patties, "patty, patty, top bun; lettuce in the patty's slot", AGAIN),
        ),
    )
