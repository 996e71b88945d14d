"""Balanced conditions of the task office_drawer.

Stapler and tape occur in every slot, with both positions of the cabinet. "The stapler into the lower drawer" on its own
is the instruction of a test. In the balanced conditions, it occurs only together with the tape.
"""

from betterbench.tasks import authoring as a
from betterbench.tasks.condition import Condition
from betterbench.tasks.suite.office_drawer import (
    CABINET,
    CABINET_BACK,
    CABINET_FRONT,
    LEFT_BACK,
    LEFT_FRONT,
    LOWER,
    OPEN_M,
    RIGHT_BACK,
    RIGHT_FRONT,
    STAPLER,
    TAPE,
    UPPER,
    load,
)

CROSSED = (
    "stapler and tape lie in each slot, with the cabinet at either position",
    "stapler and tape go into either drawer, and either comes first",
    "both objects on the table, or without the object that the instruction does not name",
)
LAYOUTS = (
    {STAPLER: LEFT_BACK, TAPE: LEFT_FRONT, CABINET: CABINET_BACK},
    {STAPLER: RIGHT_FRONT, TAPE: RIGHT_BACK, CABINET: CABINET_FRONT},
    {STAPLER: LEFT_FRONT, TAPE: LEFT_BACK, CABINET: CABINET_FRONT},
    {STAPLER: RIGHT_BACK, TAPE: RIGHT_FRONT, CABINET: CABINET_BACK},
)


def balanced_office_drawer() -> list[Condition]:
    """Return conditions with four layouts.

    One object goes into a closed or an open drawer, or both objects go into drawers. If both objects are requested,
    each goes into the drawer that training uses for the other object.
    """
    found = []
    for layout in LAYOUTS:
        for thing, other, into in ((STAPLER, TAPE, UPPER), (TAPE, STAPLER, LOWER)):
            alone = {o: slot for o, slot in layout.items() if o is not other}
            found.append(_asked(layout, (thing, into)))
            found.append(_asked(alone, (thing, into), opened={into: OPEN_M}))
        found.append(_asked(layout, (STAPLER, LOWER), (TAPE, UPPER)))
        found.append(_asked(layout, (TAPE, UPPER), (STAPLER, LOWER)))
    return found


def _asked(
    layout: a.SlotLayout, *steps: tuple[a.ObjectSpec, a.ObjectSpec], opened: dict[a.ObjectSpec, float] | None = None
) -> Condition:
    return a.condition(layout, load(*steps), UPPER, LOWER, opened=opened)
