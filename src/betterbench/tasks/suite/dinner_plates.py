"""Stacking dinner plates: red and blue plates go onto the white plate or onto each other."""

from betterbench.tasks import authoring as a

WHITE = a.item("white_plate", category="serving_plate", color="white")
RED = a.item("red_plate", category="dinner_plate", color="red")
BLUE = a.item("blue_plate", category="dinner_plate", color="blue")
BOWL = a.distractor("red_bowl", category="shallow_bowl", color="red")

LEFT_BACK, LEFT_FRONT = a.Slot("left_back", 0.48, -0.19), a.Slot("left_front", 0.67, -0.10)
RIGHT_BACK, RIGHT_FRONT = a.Slot("right_back", 0.48, 0.19), a.Slot("right_front", 0.67, 0.10)
STAND_RIGHT = a.Slot("stand_right", 0.42, 0.17, jitter_m=0.010)
STAND_MIDDLE = a.Slot("stand_middle", 0.37, 0.0, jitter_m=0.010)
LAYOUTS = (
    {RED: LEFT_BACK, BLUE: LEFT_FRONT, WHITE: STAND_RIGHT},
    {RED: RIGHT_BACK, BLUE: RIGHT_FRONT, WHITE: STAND_MIDDLE},
)


def onto(*steps: tuple[a.ObjectSpec, a.ObjectSpec]) -> a.Instruction:
    """Return the instruction to put plates on other plates, starting with the lowest."""
    parts = [f"the {upper.kind} on the {lower.kind}" for upper, lower in steps]
    goals = (a.subgoal(f"{u.name}_on_{lo.name}", a.ON_PLATE, u, lo, word=u.kind.split()[0]) for u, lo in steps)
    return a.ordered(f"Put {', then '.join(parts)}.", *goals)


RED_ON_WHITE, BLUE_ON_WHITE, BLUE_ON_RED = onto((RED, WHITE)), onto((BLUE, WHITE)), onto((BLUE, RED))
WHOLE_STACK = onto((RED, WHITE), (BLUE, RED))

BY_KIND = "Plates are found by their appearance, not by their training slots."
BY_TARGET = "A plate is placed on the white plate, not at the white plate's position in training."
BY_COLOR = "The target plate is chosen by its color, not by its slot."
LOOK_ALIKE = "The policy distinguishes a plate from a bowl of the same color in its slot."
LONGER = "The policy completes a sequence of known steps that is longer than any in training."
DONE = "The policy recognizes finished steps in the scene and completes the stack."


@a.task
def dinner_plates() -> a.Task:
    """Put the named plate on the named plate or stack.

    Randomizations: each plate is within 15 mm of its slot, the white plate within 10 mm. The looks of all objects vary.
    Premise: in training, a red plate may already be on the white plate.
    """
    stacked = (a.condition(layout, BLUE_ON_RED, preplaced={RED: WHITE}) for layout in LAYOUTS)
    single = (a.conditions([layout], [RED_ON_WHITE, BLUE_ON_WHITE]) for layout in LAYOUTS)
    around = (a.move(RED, STAND_MIDDLE), a.move(BLUE, LEFT_BACK), a.move(WHITE, LEFT_FRONT))
    look_alike = (a.move(BLUE, RIGHT_FRONT), a.move(RED, LEFT_FRONT), a.add(BOWL, LEFT_BACK))
    moved, on_red = "white plate at its other position", "blue on red, with the red plate in a white plate's slot"
    whole = a.chain(WHOLE_STACK)
    elsewhere = (a.move(WHITE, STAND_MIDDLE), a.move(BLUE, LEFT_BACK))
    finish = "whole stack requested, red already on white, white plate at its other position"
    return a.Task(
        version=6,
        title="Stacking Dinner Plates",
        template=a.RECURSIVE_STACKING,
        slots=(LEFT_BACK, LEFT_FRONT, RIGHT_BACK, RIGHT_FRONT, STAND_RIGHT, STAND_MIDDLE),
        training=tuple(c for plates, stack in zip(single, stacked, strict=True) for c in (*plates, stack)),
        variations=(
            a.Variation("L1", (a.swap(RED, BLUE),), "red and blue plate exchanged", BY_KIND),
            a.Variation("L2", (a.move(WHITE, STAND_MIDDLE),), moved, BY_TARGET, "train2"),
            a.Variation("R1", (*around, a.instruct(BLUE_ON_RED)), on_red, BY_COLOR, "train2"),
            a.Variation("O1", look_alike, "red bowl in the red plate's slot", LOOK_ALIKE),
            a.Variation("T1", (whole,), "stack of three from single plates", LONGER),
            a.Variation("T2", (*elsewhere, whole), finish, DONE, "train3", mid_task_look=True),
        ),
    )
