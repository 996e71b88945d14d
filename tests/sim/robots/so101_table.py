"""A table within the reach of the SO-101: a lemon somewhere in front of the arm, and an open box beside it."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from betterbench.interface.actions import ActionSpace
from betterbench.sim.scenes import Scene, quality_preset
from betterbench.tasks import authoring as a
from betterbench.tasks.authoring.registry import named_task

LEMON, BOX = a.item("lemon"), a.container("takeaway_box", category="takeaway_box")
FRUIT = a.Slot("fruit", 0.23, 0.06, jitter_m=0.015, yaw_jitter=math.pi)
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
        robot="so101",
    ),
    "so101_table",
    "Put the lemon into the box.",
)


def places(count: int) -> list[tuple[float, float]]:
    """Return random positions in front of the arm [m]: 13 to 28 cm from its first axis, beside the box."""
    draw = np.random.default_rng(48)
    radii, angles = draw.uniform(0.13, 0.28, count), draw.uniform(-0.1, 1.0, count)
    return [(0.0388 + r * math.cos(a), r * math.sin(a)) for r, a in zip(radii.tolist(), angles.tolist(), strict=True)]


def table(seed: int, space: ActionSpace, *, fruit: tuple[float, float] | None = None) -> Scene:
    """Return the scene of a seed with the SO-101, with the lemon's slot moved to ``fruit`` [m] if given."""
    slots = TABLE.slots if fruit is None else (dataclasses.replace(FRUIT, x=fruit[0], y=fruit[1]), STAND)
    task = dataclasses.replace(TABLE, slots=slots)
    return Scene(
        task, task.training[0], seed=seed, action_space=space, quality=quality_preset("fast"), robot_name="so101"
    )
