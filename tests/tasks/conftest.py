"""Real scenes whose states are posed by hand: what predicates and goals are asked about."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable

import pytest

from betterbench.geometry import Pose
from betterbench.interface.actions import EE_DELTA
from betterbench.interface.state import Contact, WorldState
from betterbench.sim.scenes import Scene
from betterbench.sim.scenes.stage import quality_preset
from betterbench.tasks import get_task
from betterbench.tasks.interventions import vary


@functools.cache
def initial(task_id: str, name: str) -> WorldState:
    task = get_task(task_id)
    condition = task.train(name) if name.startswith("train") else vary(task, task.variation(name))[0]
    scene = Scene(task, condition, seed=0, action_space=EE_DELTA, quality=quality_preset("fast"))
    return scene.reset(check_premise=False)


def change(
    state: WorldState,
    *,
    poses: dict[str, Pose] | None = None,
    speeds: dict[str, float] | None = None,
    turning: dict[str, float] | None = None,
    contacts: tuple[tuple[str, str], ...] | None = None,
    **fields: object,
) -> WorldState:
    """Returns the state with some objects posed anew; what is posed touches nothing unless a contact says so."""
    positions, quaternions = list(state.positions), list(state.quaternions)
    linear, angular = list(state.linear_speeds), list(state.angular_speeds)
    kept = tuple(c for c in state.contacts if not {c.a, c.b} & set(poses or {}))
    for name, pose in (poses or {}).items():
        i = state.info.index(name)
        positions[i], quaternions[i] = pose.position, pose.quaternion
    for name, speed in (speeds or {}).items():
        linear[state.info.index(name)] = speed
    for name, speed in (turning or {}).items():
        angular[state.info.index(name)] = speed
    added = tuple(Contact(a, b, 1.0) for a, b in contacts or ())
    return dataclasses.replace(
        state,
        positions=tuple(positions),
        quaternions=tuple(quaternions),
        linear_speeds=tuple(linear),
        angular_speeds=tuple(angular),
        contacts=kept + added,
        **fields,
    )


@pytest.fixture
def at_reset() -> Callable[[str, str], WorldState]:
    """State of a condition at reset, seed 0."""
    return initial


@pytest.fixture
def posed() -> Callable[..., WorldState]:
    """A state with some objects posed anew."""
    return change
