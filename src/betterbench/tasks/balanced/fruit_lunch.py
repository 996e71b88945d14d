"""Fruit lunch, balanced: every fruit in every slot, the apple first or second."""

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
    "each fruit lies in each slot equally often",
    "the apple comes first or second",
    "three fruits at the start, or the two that are asked for",
)
ORANGE_APPLE = pack("the orange into the lunchbox, then the apple", ORANGE, APPLE)
LEMON_APPLE = pack("the lemon into the lunchbox, then the apple", LEMON, APPLE)
ASKED = ((APPLE_ORANGE, LEMON), (APPLE_LEMON, ORANGE), (ORANGE_APPLE, LEMON), (LEMON_APPLE, ORANGE))
SLOTS = (FIRST, SECOND, THIRD)


def balanced_fruit_lunch() -> list[Condition]:
    """Return three cyclic layouts with four orders each; the unasked fruit is left out of every other one."""
    found = []
    for turn in range(3):
        for number, (asked, unasked) in enumerate(ASKED):
            things = (APPLE, ORANGE, LEMON)
            layout = {thing: SLOTS[(place + turn) % 3] for place, thing in enumerate(things)}
            if (turn + number) % 2:
                del layout[unasked]
            found.append(a.condition({**layout, LUNCHBOX: STAND}, asked))
    return found
