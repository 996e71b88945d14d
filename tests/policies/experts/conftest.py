"""Scenes by name, and episodes that are run once and looked at by many tests."""

from __future__ import annotations

import functools
from collections.abc import Callable

import pytest

from betterbench.episodes import TrialContext, run_episode
from betterbench.interface.actions import EE_DELTA
from betterbench.policies.experts import make_expert
from betterbench.records import Record
from betterbench.sim.scenes import Scene
from betterbench.sim.scenes.stage import quality_preset
from betterbench.tasks import get_task
from betterbench.tasks.interventions import vary


def make_scene(task_id: str, name: str, seed: int = 0) -> Scene:
    task = get_task(task_id)
    condition = task.train(name) if name.startswith("train") else vary(task, task.variation(name))[0]
    return Scene(task, condition, seed=seed, action_space=EE_DELTA, quality=quality_preset("fast"))


@functools.cache
def run_once(policy: str, task_id: str, name: str, seed: int = 0) -> Record:
    scene = make_scene(task_id, name, seed)
    return run_episode(scene, make_expert(policy, scene), context=TrialContext(policy)).record


@pytest.fixture
def scene() -> Callable[..., Scene]:
    return make_scene


@pytest.fixture
def episode() -> Callable[..., Record]:
    """Record of (policy, task, condition, seed), run at most once per session."""
    return run_once
