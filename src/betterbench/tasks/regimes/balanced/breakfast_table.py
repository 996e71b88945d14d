"""Balanced conditions of the task breakfast_table.

Every piece occurs in every slot, with both positions of the plate.
"""

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
    laid,
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
"""Slots for the other tableware.

The slot in front of the plate is not used, because the bowl would be in the way there.
"""


def balanced_breakfast_table() -> list[Condition]:
    """Return two layouts for every ordered pair of pieces and their sides, except for pairs that are part of a test."""
    found = []
    for shift in range(3):
        side = {piece: SIDES[(place + shift) % 3] for place, piece in enumerate(PIECES)}
        for number, pair in enumerate(itertools.permutations(PIECES, 2)):
            if {(piece.name, side[piece]) for piece in pair} == {("spoon", "left"), ("cup", "right")}:
                continue
            for row in range(2):
                around = dict(AROUND[(number + 2 * row + shift) % 4])
                if (number + row) % 2:
                    around[EGG] = FRONT if row else FRONT_RIGHT
                steps = [(piece, side[piece]) for piece in pair]
                found.append(a.condition({**_layout(number, row, shift, steps), **around}, laid(*steps)))
    return found


def _layout(number: int, row: int, shift: int, steps: list[tuple[a.ObjectSpec, str]]) -> dict[a.ObjectSpec, a.Slot]:
    """Return the first layout that leaves the target positions free, with the pieces rotated through the slots."""
    plates = (TABLE_RIGHT, TABLE_LEFT) if (number // 2 + row) % 2 else (TABLE_LEFT, TABLE_RIGHT)
    for more in range(3):
        turn = (number + row + shift + more) % 3
        pieces = {piece: SLOTS[row][(place + turn) % 3] for place, piece in enumerate(PIECES)}
        for plate in plates:
            if _has_room(pieces, plate, steps):
                return {**pieces, PLATE: plate}
    raise AssertionError("no rotation of the pieces leaves the target positions free")


def _has_room(layout: dict[a.ObjectSpec, a.Slot], plate: a.Slot, steps: list[tuple[a.ObjectSpec, str]]) -> bool:
    """Return whether the target positions are free.

    The plate covers the space up to the slots on its side of the table.
    """
    outer, slots = ("right", (RIGHT_EDGE, RIGHT_CORNER)) if plate is TABLE_RIGHT else ("left", (LEFT_EDGE, LEFT_CORNER))
    there = next(piece for piece in PIECES if layout[piece] in slots)
    for piece, side in steps:
        if side == outer and piece is not there:
            return False
        if piece is there:
            return True
    return True
