"""A part of a thing is in a box or it is not: the quick answer is that of every point that is looked at."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest

from betterbench.geometry import Pose, normalize
from betterbench.interface.actions import EE_DELTA
from betterbench.interface.state import Contact, WorldState
from betterbench.sim.scenes import Scene
from betterbench.sim.scenes.stage import FAST
from betterbench.tasks import get_task
from betterbench.tasks.interventions import vary
from betterbench.tasks.relations.loose import OVERLAP, reaches_into, rests_on

FRACTIONS = (-1.0, -0.5, 0.0, 0.5, 1.0)


def _in_full(state: WorldState, name: str, space: Pose, half_size: tuple[float, ...]) -> bool:
    """Looks at all 125 points of a thing, wherever it is."""
    sx, sy, sz = (0.5 * v for v in state.info.object(name).size_m)
    to_space = space.inverse() @ state.pose(name)
    points = (to_space.apply((fx * sx, fy * sy, sz + fz * sz)) for fx, fy, fz in itertools.product(FRACTIONS, repeat=3))
    return any(all(abs(v) <= max(h - OVERLAP, 0.0) for v, h in zip(p, half_size, strict=True)) for p in points)


@pytest.mark.parametrize("number", [1000, pytest.param(3000, marks=pytest.mark.slow)])
def test_whatever_the_postures_a_thing_reaches_into_a_box_by_one_of_its_points(number: int) -> None:
    task = get_task("fast_food")
    scene = Scene(task, task.training[0], seed=3, action_space=EE_DELTA, quality=FAST)
    state, random = scene.reset(), np.random.default_rng(11)
    counts = {True: 0, False: 0}
    for _ in range(number):
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
    assert min(counts.values()) > number // 6


def test_a_thin_plate_under_a_bowl_does_not_lie_on_it() -> None:
    """However thin it is: here its floor is 3 mm above the table, less than what counts as leaning."""
    task = get_task("dinner_plates")
    condition = vary(task, task.variation("O1"))[0]
    state = Scene(task, condition, seed=0, action_space=EE_DELTA, quality=FAST).reset()
    plate, bowl = state.info.index("white_plate"), state.info.index("red_bowl")
    x, y, z = state.positions[plate]
    positions = list(state.positions)
    positions[bowl] = (x, y, z + 0.003)
    moved = dataclasses.replace(
        state, positions=tuple(positions), contacts=(*state.contacts, Contact("red_bowl", "white_plate", 1.0))
    )
    assert rests_on(moved, "red_bowl", "white_plate")
    assert not rests_on(moved, "white_plate", "red_bowl")
