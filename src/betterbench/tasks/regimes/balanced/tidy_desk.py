"""Balanced conditions of the task tidy_desk.

All trash occurs in all trash slots, and valuables exchange their slots.
"""

from betterbench.tasks import authoring as a
from betterbench.tasks.condition import Condition
from betterbench.tasks.suite.tidy_desk import (
    BIN,
    BOTH,
    CAN,
    CAN_ONLY,
    FLOOR,
    KEYBOARD,
    MOUSE,
    MUG,
    NAPKIN,
    NAPKIN_ONLY,
    PLACE_1,
    PLACE_2,
    PLACE_3,
    TRASH_1,
    TRASH_2,
    TRASH_3,
    TRASH_4,
    throw,
)

CROSSED = (
    "napkin and can lie in each slot of trash equally often",
    "the napkin or the can is named first",
    "mouse, mug and keyboard exchange their places, or the mouse lies in a slot of trash",
    "five things at the start, or without one piece of trash that is not requested",
)
OTHER_ORDER = throw("the crushed can and the crumpled napkin", CAN, NAPKIN)
ASKED = (BOTH, OTHER_ORDER, NAPKIN_ONLY, CAN_ONLY)
TRASH = ((TRASH_1, TRASH_3), (TRASH_3, TRASH_1), (TRASH_2, TRASH_4), (TRASH_4, TRASH_2))
VALUABLES = (
    {MOUSE: PLACE_1, MUG: PLACE_2, KEYBOARD: PLACE_3},
    {MUG: PLACE_1, MOUSE: PLACE_2, KEYBOARD: PLACE_3},
    {KEYBOARD: PLACE_1, MOUSE: PLACE_2, MUG: PLACE_3},
    {KEYBOARD: PLACE_1, MUG: PLACE_2},
)
FREE = (TRASH_4, TRASH_2, TRASH_3, TRASH_1)
"""One free slot for each layout of the trash."""


def balanced_tidy_desk() -> list[Condition]:
    """Return four layouts of the trash, each with four instructions.

    The valuables exchange slots from condition to condition.
    """
    found = []
    for turn, (napkin, can) in enumerate(TRASH):
        for number, asked in enumerate(ASKED):
            layout = {NAPKIN: napkin, CAN: can, **VALUABLES[(turn + number) % 4]}
            layout.setdefault(MOUSE, FREE[turn])
            if turn % 2 and asked in (NAPKIN_ONLY, CAN_ONLY):
                del layout[CAN if asked is NAPKIN_ONLY else NAPKIN]
            found.append(a.condition({**layout, BIN: FLOOR}, asked))
    return found
