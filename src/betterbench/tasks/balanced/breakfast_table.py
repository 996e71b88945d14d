"""Breakfast table, balanced: every piece in every slot and at every side, with the plate at either position."""

import itertools

from betterbench.tasks import authoring as a
from betterbench.tasks.condition import Condition
from betterbench.tasks.suite.breakfast_table import (
    BACK,
    BACK_LEFT,
    BOWL,
    CUP,
    EGG,
    FORK,
    FRONT,
    FRONT_LEFT,
    FRONT_RIGHT,
    JAM,
    LEFT_CORNER,
    LEFT_EDGE,
    PLATE,
    RIGHT_CORNER,
    RIGHT_EDGE,
    SALT,
    SPOON,
    TABLE_LEFT,
    TABLE_RIGHT,
)

CROSSED = (
    "each piece lies in each slot equally often, with the plate at either position",
    "each piece goes to each side equally often, and comes first or second",
    "bowl, salt and jam exchange their places, or the egg cup is missing",
)
PIECES, SIDES = (FORK, CUP, SPOON), ("left", "upper_right", "right")
SLOTS = ((LEFT_EDGE, FRONT, RIGHT_EDGE), (LEFT_CORNER, FRONT_RIGHT, RIGHT_CORNER))
AROUND = (
    {BOWL: BACK_LEFT, SALT: BACK, JAM: FRONT_LEFT},
    {BOWL: BACK, SALT: FRONT_LEFT, JAM: BACK_LEFT},
    {BOWL: BACK_LEFT, SALT: FRONT_LEFT, JAM: BACK},
    {BOWL: BACK, SALT: BACK_LEFT, JAM: FRONT_LEFT},
)
"""Places of the other tableware; the bowl would be in the way in front of the plate."""


def conditions() -> list[Condition]:
    """Return every ordered pair of pieces at sides that no test asks for, each in two layouts."""
    found = []
    for shift in range(3):
        side = {piece: SIDES[(place + shift) % 3] for place, piece in enumerate(PIECES)}
        for number, pair in enumerate(itertools.permutations(PIECES, 2)):
            if {(piece.name, side[piece]) for piece in pair} == {("spoon", "left"), ("cup", "right")}:
                continue
            for row in range(2):
                turn = (number + row + shift) % 3
                layout = {piece: SLOTS[row][(place + turn) % 3] for place, piece in enumerate(PIECES)}
                layout |= AROUND[(number + 2 * row + shift + 0) % 4]
                if (number + row) % 2:
                    layout[EGG] = FRONT if row else FRONT_RIGHT
                layout[PLATE] = (TABLE_RIGHT, TABLE_LEFT)[(number // 2 + row) % 2]
                found.append(a.condition(layout, a.arranged(PLATE, *((p, side[p]) for p in pair))))
    return found
