"""Morning coffee, balanced: the mug that is meant in either slot, alone or beside a white mug or a can.

The complete cross of words and layouts is what the variations L1 to L4 test, so it is made with other objects.
"""

from betterbench.tasks import authoring as a
from betterbench.tasks.condition import Condition
from betterbench.tasks.suite.morning_coffee import (
    BLUE,
    BLUE_MUG,
    BOTTOM,
    FAR,
    MACHINE,
    NEAR,
    RED,
    RED_CAN,
    RED_MUG,
    STAND,
    TOP,
)

CROSSED = (
    "the mug that a color names stands near or far equally often",
    "the mug that a position names is red or blue equally often",
    "words of color and of position occur in the same scenes",
    "one thing or two at the start",
)
WHITE_MUG = a.distractor("white_mug", category="mug", color="white")
BLUE_CAN = a.distractor("blue_can", category="can", color="blue")


def balanced_morning_coffee() -> list[Condition]:
    """Return either mug in either slot, alone or with another thing, with the color and with the position."""
    found = []
    for mug, color, can in ((RED_MUG, RED, BLUE_CAN), (BLUE_MUG, BLUE, RED_CAN)):
        for at, position, elsewhere in ((NEAR, BOTTOM, FAR), (FAR, TOP, NEAR)):
            for others in ({}, {WHITE_MUG: elsewhere}, {can: elsewhere}):
                layout = {mug: at, **others, MACHINE: STAND}
                found += [a.condition(layout, color), a.condition(layout, position)]
    return found
