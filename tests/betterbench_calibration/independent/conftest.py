"""Episodes of the independent family, run once and looked at by many tests."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import pytest

from betterbench.geometry import Pose
from betterbench.interface.actions import EE_DELTA
from betterbench.sim.scenes import Scene
from betterbench.sim.scenes.stage import quality_preset
from betterbench.tasks import GoalTracker
from betterbench.tasks.interventions import resolve_condition
from betterbench_calibration.independent import make_independent
from betterbench_calibration.independent.agent import IndependentAgent


@dataclass(frozen=True)
class Played:
    success: bool
    agent: IndependentAgent
    actions: tuple[bytes, ...]
    stated: dict[str, str]
    tools: tuple[Pose, ...]

    def tool(self, most: int) -> Pose:
        """Where the tool was in the last state that the agent saw of the first ``most`` steps."""
        return self.tools[min(most, len(self.tools)) - 1]


def make_scene(task: str, condition: str, seed: int = 0) -> Scene:
    found = resolve_condition(task, condition)
    return Scene(found.task, found.condition, seed=seed, action_space=EE_DELTA, quality=quality_preset("fast"))


def play_once(policy: str, task: str, condition: str, seed: int = 0, most: int = 10_000) -> Played:
    scene = make_scene(task, condition, seed)
    state = scene.reset()
    agent = make_independent(f"independent:{policy}", scene)
    stated = agent.ground_truth
    tracker = GoalTracker(scene.condition, scene.info, template=scene.task.template, control_rate_hz=20.0)
    truth = tracker.update(state)
    actions, tools = [], []
    while state.step < min(most, scene.task.step_limit(scene.condition)) and not truth.success:
        action = agent.act_on_state(state)
        actions.append(action.tobytes())
        tools.append(agent.body.state.ee_pose)
        scene.step(action)
        state = scene.state()
        truth = tracker.update(state)
    return Played(truth.success, agent, tuple(actions), stated, tuple(tools))


@pytest.fixture(scope="session")
def play():
    return functools.cache(play_once)


@pytest.fixture(scope="session")
def scene_of():
    """Scenes that are made once and shared: whoever asks for one resets it."""
    return functools.lru_cache(maxsize=8)(make_scene)
