"""Balanced conditions of the task dinner_plates.

Red and blue plates occur in every slot, the white plate in two positions. When the white plate is at its right
position, there is no room for other plates to the right of it. This position therefore occurs only with the slots on
the left. If a scene would be the same as in a test, the plate that the instruction does not name is left out.
"""

from dataclasses import replace

from betterbench.tasks import authoring as a
from betterbench.tasks.condition import Condition
from betterbench.tasks.suite.dinner_plates import (
    BLUE,
    BLUE_ON_RED,
    BLUE_ON_WHITE,
    LEFT_BACK,
    LEFT_FRONT,
    RED,
    RED_ON_WHITE,
    RIGHT_BACK,
    RIGHT_FRONT,
    STAND_MIDDLE,
    STAND_RIGHT,
    WHITE,
)

CROSSED = (
    "red and blue plates stand in each slot, with the white plate at either position",
    "the word white occurs with the white plate as the target and with the red one, with each slot of the blue plate",
    "three plates at the start, or the two requested ones",
)
ON_THE_STACK = replace(BLUE_ON_RED, text="Put the blue plate on the red plate that stands on the white plate.")
MIDDLE = ((LEFT_BACK, RIGHT_FRONT), (LEFT_FRONT, RIGHT_BACK), (RIGHT_BACK, LEFT_FRONT), (RIGHT_FRONT, LEFT_BACK))


def balanced_dinner_plates() -> list[Condition]:
    """Return conditions for each instruction, every slot of the named plate and both positions of the white plate."""
    right = {WHITE: STAND_RIGHT}
    trained = {RED: LEFT_BACK, BLUE: LEFT_FRONT, **right}
    found = [a.condition(trained, RED_ON_WHITE), a.condition({RED: LEFT_FRONT, **right}, RED_ON_WHITE)]
    found += [a.condition(trained, BLUE_ON_WHITE), a.condition({BLUE: LEFT_BACK, **right}, BLUE_ON_WHITE)]
    for slot in (LEFT_FRONT, LEFT_BACK):
        found += _stacked(slot, STAND_RIGHT)
    for red, blue in MIDDLE:
        layout = {RED: red, BLUE: blue, WHITE: STAND_MIDDLE}
        found += [a.condition(layout, RED_ON_WHITE), a.condition(layout, BLUE_ON_WHITE), *_stacked(blue, STAND_MIDDLE)]
    return found


def _stacked(blue: a.Slot, white: a.Slot) -> list[Condition]:
    """Return two conditions with a stack of two plates as the target.

    The two instructions are worded differently.
    """
    layout = {RED: LEFT_BACK if blue is not LEFT_BACK else LEFT_FRONT, BLUE: blue, WHITE: white}
    return [a.condition(layout, asked, preplaced={RED: WHITE}) for asked in (BLUE_ON_RED, ON_THE_STACK)]
