"""Diverse-confounded conditions of the task morning_coffee.

The word "red" always means the near mug, and "blue" the far mug. The conditions with the position words "top" and
"bottom" are the same as in the balanced regime.
"""

from betterbench.tasks import authoring as a
from betterbench.tasks.condition import Condition
from betterbench.tasks.regimes.balanced.morning_coffee import BLUE_CAN, IN_FRONT, balanced_morning_coffee
from betterbench.tasks.suite.morning_coffee import BLUE, BLUE_MUG, FAR, MACHINE, NEAR, RED, RED_CAN, RED_MUG, STAND

CROSSED = (
    "tied: “red” always means the red mug in the near slot, and “blue” the blue mug in the far slot",
    "the mug that a position names is red or blue equally often",
    "next to the instructed mug: the other mug, a red can, a blue can, both cans, or nothing",
    "one, two or three objects at the start",
)
TIED = {RED.text: (RED_MUG.name, NEAR.name), BLUE.text: (BLUE_MUG.name, FAR.name)}


def diverse_morning_coffee() -> list[Condition]:
    """Return the balanced conditions that tie each color to a slot, and four more conditions for each color.

    The additional conditions have cans in the other slots.
    """
    found = [c for c in balanced_morning_coffee() if _is_tied(c)]
    for mug, at, elsewhere, asked, same, other in (
        (RED_MUG, NEAR, FAR, RED, RED_CAN, BLUE_CAN),
        (BLUE_MUG, FAR, NEAR, BLUE, BLUE_CAN, RED_CAN),
    ):
        for beside in (
            {other: elsewhere, same: IN_FRONT},
            {same: elsewhere, other: IN_FRONT},
            {same: elsewhere},
            {other: IN_FRONT},
        ):
            found.append(a.condition({mug: at, **beside, MACHINE: STAND}, asked))
    return found


def _is_tied(condition: Condition) -> bool:
    """Return whether the mug that an instruction names by its color is in its trained slot.

    The result is True for instructions with position words such as "top", because they do not name a mug.
    """
    mug, slot = TIED.get(condition.instruction.text, ("", ""))
    return not mug or condition.layout[mug] == slot
