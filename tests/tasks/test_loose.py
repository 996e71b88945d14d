"""A part of a thing is in a box or it is not: the quick answer is that of every point that is looked at."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np

from betterbench.geometry import Pose, normalize
from betterbench.interface.actions import EE_DELTA
from betterbench.interface.state import WorldState
from betterbench.sim.scenes import Scene
from betterbench.sim.scenes.stage import FAST
from betterbench.tasks import get_task
from betterbench.tasks.relations.loose import OVERLAP, reaches_into

FRACTIONS = (-1.0, -0.5, 0.0, 0.5, 1.0)


def _in_full(state: WorldState, name: str, space: Pose, half_size: tuple[float, ...]) -> bool:
    """Looks at all 125 points of a thing, wherever it is."""
    sx, sy, sz = (0.5 * v for v in state.info.object(name).size_m)
    to_space = space.inverse() @ state.pose(name)
    points = (to_space.apply((fx * sx, fy * sy, sz + fz * sz)) for fx, fy, fz in itertools.product(FRACTIONS, repeat=3))
    return any(all(abs(v) <= max(h - OVERLAP, 0.0) for v, h in zip(p, half_size, strict=True)) for p in points)


def test_whatever_the_postures_a_thing_reaches_into_a_box_by_one_of_its_points() -> None:
    task = get_task("fast_food")
    scene = Scene(task, task.training[0], seed=3, action_space=EE_DELTA, quality=FAST)
    state, random = scene.reset(), np.random.default_rng(11)
    counts = {True: 0, False: 0}
    for _ in range(3000):
        name = str(random.choice([o.name for o in state.info.objects]))
        size = state.info.object(name).size_m
        half_size = tuple(random.uniform(0.01, 0.12, 3).tolist())
        q = normalize(random.normal(size=4).tolist())
        space = Pose(tuple(random.uniform(-0.5, 0.5, 3).tolist()), normalize(random.normal(size=4).tolist()))
        # About as far from the middle of the box as the two are large together: touching, half in, just beside.
        far = random.uniform(0.2, 1.2) * (float(np.linalg.norm(size)) / 2 + float(np.linalg.norm(half_size)))
        way = random.normal(size=3)
        position = space.apply((far * way / np.linalg.norm(way)).tolist())
        i = state.info.index(name)
        posed = dataclasses.replace(
            state,
            positions=(*state.positions[:i], position, *state.positions[i + 1 :]),
            quaternions=(*state.quaternions[:i], q, *state.quaternions[i + 1 :]),
        )
        wanted = _in_full(posed, name, space, half_size)
        assert reaches_into(posed, name, space, half_size) == wanted
        counts[wanted] += 1
    assert min(counts.values()) > 500
