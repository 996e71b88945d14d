"""Balanced conditions of the task desk_meeting.

Every object occurs in every slot, with both positions of the laptop. The mug goes only to the left and to the right of
the laptop. Because of its handle, it does not fit behind the laptop.
"""

from betterbench.tasks import authoring as a
from betterbench.tasks.condition import Condition
from betterbench.tasks.suite.desk_meeting import (
    DESK_LEFT,
    DESK_RIGHT,
    FRONT_1,
    FRONT_2,
    FRONT_3,
    FRONT_4,
    FRONT_5,
    FRONT_6,
    LAPTOP,
    MOUSE,
    MUG,
    SPEAKER,
    put,
)

CROSSED = (
    "each object lies in each slot, with the laptop at either position",
    "the mouse goes to every side, the mug left or right, the speaker left or behind; each first or second",
    "three objects at the start, or the two requested ones",
)
OBJECTS = (MOUSE, MUG, SPEAKER)
PAIRS = (
    ((MOUSE, "right"), (MUG, "left")),
    ((MOUSE, "behind"), (MUG, "right")),
    ((MOUSE, "right"), (SPEAKER, "left")),
    ((MOUSE, "left"), (SPEAKER, "behind")),
    ((MOUSE, "behind"), (SPEAKER, "left")),
    ((MUG, "right"), (SPEAKER, "behind")),
    ((MUG, "left"), (SPEAKER, "behind")),
)
NEAR, FAR = (FRONT_1, FRONT_2, FRONT_3), (FRONT_4, FRONT_5, FRONT_6)
STARTS = ((NEAR, DESK_RIGHT, 1), (NEAR, DESK_LEFT, -1), (FAR, DESK_LEFT, 1), (FAR, DESK_RIGHT, -1))
"""Slots, position of the laptop, and direction in which the objects rotate through the slots."""


def balanced_desk_meeting() -> list[Condition]:
    """Return conditions for each pair of objects, in both orders and with two layouts for each order."""
    found = []
    for number, pair in enumerate(PAIRS):
        for steps in (pair, pair[::-1]):
            for start in (number % 2, 2 + number % 2) if steps is pair else (1 - number % 2, 3 - number % 2):
                slots, desk, way = STARTS[start]
                turn = (number + start) % 3
                layout = {thing: slots[(way * place + turn) % 3] for place, thing in enumerate(OBJECTS)}
                if (number + start) % 3 == 0:
                    asked = [thing for thing, _ in pair]
                    del layout[next(thing for thing in OBJECTS if thing not in asked)]
                found.append(a.condition({**layout, LAPTOP: desk}, put(*steps)))
    return found
