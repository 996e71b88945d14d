"""Balanced conditions of the task fruit_lunch.

Fruits lie in every order, and the apple is first, second or not requested.
"""

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
    "the orange and the lemon come first, second or alone",
    "three fruits at the start, or one less that is not requested",
)
ORANGE_APPLE = pack("the orange into the lunchbox, then the apple", ORANGE, APPLE)
LEMON_APPLE = pack("the lemon into the lunchbox, then the apple", LEMON, APPLE)
ORANGE_ALONE, LEMON_ALONE = (
    pack("the orange into the lunchbox", ORANGE),
    pack("the lemon into the lunchbox", LEMON),
)
ASKED = (
    (APPLE_ORANGE, LEMON),
    (APPLE_LEMON, ORANGE),
    (ORANGE_APPLE, LEMON),
    (LEMON_APPLE, ORANGE),
    (ORANGE_ALONE, LEMON),
    (LEMON_ALONE, ORANGE),
)


def balanced_fruit_lunch() -> list[Condition]:
    """Return six layouts, each with six instructions.

    Every fourth condition lacks a fruit that is not requested.

    In most conditions, the other fruits are present, so that only the words determine the fruit. "Orange, then lemon"
    is the instruction of the test R1. If only "lemon, then orange" were used instead, this order would become a new
    confound. A lunch without an apple therefore has only one of the two fruits. The initial scene of the test L1 occurs
    only with a fruit missing.
    """
    found = []
    for number, slots in enumerate(itertools.permutations((FIRST, SECOND, THIRD))):
        for which, (asked, unasked) in enumerate(ASKED):
            layout = dict(zip((APPLE, ORANGE, LEMON), slots, strict=True))
            if (number + which) % 4 == 2:
                del layout[unasked]
            found.append(a.condition({**layout, LUNCHBOX: STAND}, asked))
    return found
