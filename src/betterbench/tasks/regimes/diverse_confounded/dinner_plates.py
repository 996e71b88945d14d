"""Diverse-confounded conditions of the task dinner_plates.

Red plates are always at the back and blue plates in front. As in the balanced regime, each of these slots occurs with
each position of the white plate.
"""

from betterbench.tasks import authoring as a
from betterbench.tasks.condition import Condition
from betterbench.tasks.regimes.balanced.dinner_plates import ON_THE_STACK, balanced_dinner_plates
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
    "tied: the red plate is always in one of the back slots, and the blue plate in one of the front slots",
    "red and blue plates occur in each of their two slots, with the white plate in either position",
    "the word white occurs with the white plate as the target and with the red one",
    "three plates at the start, or the two requested ones",
)
PLACES = {RED.name: (LEFT_BACK.name, RIGHT_BACK.name), BLUE.name: (LEFT_FRONT.name, RIGHT_FRONT.name)}


def diverse_dinner_plates() -> list[Condition]:
    """Return the balanced conditions with plates in their trained slots, and additional conditions of the same kind.

    With the additional conditions, each instruction is as frequent as in the balanced regime.
    """
    found = [c for c in balanced_dinner_plates() if _is_tied(c)]
    apart = {RED: LEFT_BACK, BLUE: RIGHT_FRONT, WHITE: STAND_RIGHT}
    right = {RED: RIGHT_BACK, BLUE: RIGHT_FRONT, WHITE: STAND_MIDDLE}
    found += [a.condition(layout, asked) for layout in (apart, right) for asked in (RED_ON_WHITE, BLUE_ON_WHITE)]
    found += [a.condition(apart, asked, preplaced={RED: WHITE}) for asked in (BLUE_ON_RED, ON_THE_STACK)]
    for plate, slot, white, asked in (
        (RED, LEFT_BACK, STAND_RIGHT, RED_ON_WHITE),
        (BLUE, LEFT_FRONT, STAND_RIGHT, BLUE_ON_WHITE),
        (RED, LEFT_BACK, STAND_MIDDLE, RED_ON_WHITE),
        (RED, RIGHT_BACK, STAND_MIDDLE, RED_ON_WHITE),
        (BLUE, LEFT_FRONT, STAND_MIDDLE, BLUE_ON_WHITE),
        (BLUE, RIGHT_FRONT, STAND_MIDDLE, BLUE_ON_WHITE),
    ):
        found.append(a.condition({plate: slot, WHITE: white}, asked))
    return found


def _is_tied(condition: Condition) -> bool:
    """Return whether each plate on the table is in one of its trained slots."""
    return all(condition.layout.get(plate, slots[0]) in slots for plate, slots in PLACES.items())
