"""Balanced conditions of the task morning_coffee.

Every word occurs with every slot, and scenes have one or two mugs. The scenes of training and of the variations L1 to
L4 contain only the two mugs in the two slots. In the balanced conditions, a can in a third slot makes the scene
different from a test scene, while only the words determine the target.
"""

from betterbench.tasks import authoring as a
from betterbench.tasks.condition import Condition
from betterbench.tasks.suite.morning_coffee import (
    BLUE,
    BLUE_MUG,
    BOTTOM,
    FAR,
    LAYOUT_1,
    LAYOUT_2,
    MACHINE,
    NEAR,
    RED,
    RED_CAN,
    RED_MUG,
    STAND,
    TOP,
)

CROSSED = (
    "both mugs are present, in either order, and each of the four words occurs with each such scene",
    "the mug that a color names is near or far equally often, and so is the mug next to it",
    "the mug that a position names is red or blue equally often",
    "one, two or three objects at the start",
)
BLUE_CAN = a.distractor("blue_can", category="can", color="blue")
IN_FRONT = a.Slot("in_front", 0.71, 0.0, yaw=-1.5708)
ASIDE = (IN_FRONT,)


def balanced_morning_coffee() -> list[Condition]:
    """Return conditions for each word: first with both mugs and a can, then with one mug, alone or with a can."""
    found = []
    for layout in (LAYOUT_1, LAYOUT_2):
        for can in (RED_CAN, BLUE_CAN):
            found += [a.condition({**layout, can: IN_FRONT}, asked) for asked in (RED, BLUE, TOP, BOTTOM)]
    for mug, color, can in ((RED_MUG, RED, BLUE_CAN), (BLUE_MUG, BLUE, RED_CAN)):
        for at, position, elsewhere in ((NEAR, BOTTOM, FAR), (FAR, TOP, NEAR)):
            for others in ({}, {can: elsewhere}):
                alone = {mug: at, **others, MACHINE: STAND}
                found += [a.condition(alone, color), a.condition(alone, position)]
    return found
