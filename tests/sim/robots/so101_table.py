"""A table within the reach of the SO-101: a lemon somewhere in front of the arm, and an open box beside it."""

from __future__ import annotations

import math

from betterbench.interface.actions import ActionSpace
from betterbench.sim.scenes import Scene, quality_preset
from betterbench.tasks import authoring as a
from betterbench.tasks.authoring.registry import named_task

LEMON, BOX = a.item("lemon"), a.container("takeaway_box", category="takeaway_box")
FRUIT = a.Slot("fruit", 0.23, 0.06, jitter_m=0.06, yaw_jitter=math.pi)
STAND = a.Slot("stand", 0.19, -0.24, jitter_m=0.01, yaw_jitter=0.05)
PUT = a.ordered("Put the lemon into the box.", *a.packed("put", BOX, LEMON))

TABLE = named_task(
    a.Task(
        version=1,
        title="Lemon and box",
        template=a.LOOSE_PACKING,
        slots=(FRUIT, STAND),
        training=a.conditions([{LEMON: FRUIT, BOX: STAND}], [PUT]),
        variations=(),
    ),
    "so101_table",
    "Put the lemon into the box.",
)


def table(seed: int, space: ActionSpace) -> Scene:
    """Return the scene of a seed with the SO-101."""
    return Scene(
        TABLE, TABLE.training[0], seed=seed, action_space=space, quality=quality_preset("fast"), robot_name="so101"
    )
