"""Fruit lunch, balanced: every order of the fruits in the slots, the apple first, second or not at all."""

import itertools

from betterbench.tasks import authoring as a
from betterbench.tasks.condition import Condition
from betterbench.tasks.suite.fruit_lunch import (
    APPLE,
    APPLE_LEMON,
    APPLE_ORANGE,
    FIRST,
    LEMON,
    LUNCHBOX,
    ORANGE,
    SECOND,
    STAND,
    THIRD,
    pack,
)

CROSSED = (
    "the three fruits lie in the three slots in every order",
    "the apple comes first, second or not at all",
    "three fruits at the start, or the two that are asked for",
)
ORANGE_APPLE = pack("the orange into the lunchbox, then the apple", ORANGE, APPLE)
LEMON_APPLE = pack("the lemon into the lunchbox, then the apple", LEMON, APPLE)
LEMON_ORANGE = pack("the lemon into the lunchbox, then the orange", LEMON, ORANGE)
ASKED = (
    (APPLE_ORANGE, LEMON),
    (APPLE_LEMON, ORANGE),
    (ORANGE_APPLE, LEMON),
    (LEMON_APPLE, ORANGE),
    (LEMON_ORANGE, APPLE),
)


def balanced_fruit_lunch() -> list[Condition]:
    """Return six layouts with five instructions each; the unasked fruit is left out of one in four.

    So the other fruit is mostly there, and only the words tell which ones are meant. Of the six orders of two fruits
    only that of R1 is never asked for. The start of L1 is among those that are left incomplete.
    """
    found = []
    for number, slots in enumerate(itertools.permutations((FIRST, SECOND, THIRD))):
        for which, (asked, unasked) in enumerate(ASKED):
            layout = dict(zip((APPLE, ORANGE, LEMON), slots, strict=True))
            if (number + which) % 4 == 2:
                del layout[unasked]
            found.append(a.condition({**layout, LUNCHBOX: STAND}, asked))
    return found
