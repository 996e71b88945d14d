"""Small policies in the simulator, each with one way of closing the gripper, and their recorded runs."""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass

import numpy as np

from betterbench.episodes import TrialContext, run_episode
from betterbench.geometry import Pose
from betterbench.interface.actions import EE_DELTA
from betterbench.interface.state import WorldState
from betterbench.policies.experts.motion import FREE, close_gripper, follow, hold
from betterbench.records import Record
from betterbench.sim.scenes import Scene
from betterbench.sim.scenes.stage import quality_preset
from betterbench.tasks.interventions.resolve import resolve_condition

DOWN = (0.0, 1.0, 0.0, 0.0)
RATE_S = 0.05
REST_STEPS = 100
"""Control steps after the end of a script until the episode ends, longer than any threshold of a halt."""
Script = Generator[np.ndarray, WorldState, WorldState]


@dataclass
class Scripted:
    """A policy that plays a script of states, stays where it is, and ends the episode before its many idle steps."""

    script: Script
    scene: Scene
    name: str = "scripted"
    begun: bool = False
    ends_at: int | None = None

    def act_on_state(self, state: WorldState) -> np.ndarray:
        self.scene.over = self.ends_at is not None and state.step >= self.ends_at
        try:
            if self.begun:
                return self.script.send(state)
            self.begun = True
            return next(self.script)
        except StopIteration:
            self.ends_at = state.step + REST_STEPS
            self.script = hold(state, 100_000, gripper=-1.0)
            return next(self.script)


def play(task: str, name: str, act: Callable[[Scene, WorldState], Script], *, seed: int = 0) -> Record:
    """Return the record of a small policy; ``act`` is given the scene and the state at reset."""
    found = resolve_condition(task, name)
    scene = Scene(found.task, found.condition, seed=seed, action_space=EE_DELTA, quality=quality_preset("fast"))
    varied = found.variation
    context = TrialContext(
        "scripted",
        variation=None if varied is None else varied.name,
        axis=found.axis,
        base_condition=None if varied is None else varied.base,
    )
    state = scene.reset()
    return run_episode(scene, Scripted(act(scene, state), scene), context=context).record


def go_down(state: WorldState, x: float, y: float, z: float) -> Script:
    """Go over a point with open fingers, and down to it."""
    high = max(0.3, z)
    up = Pose((*state.commanded_pose.position[:2], high), DOWN)
    way = (up, Pose((x, y, high), DOWN), Pose((x, y, z), DOWN))
    return (yield from follow(state, way, gripper=-1.0, pace=FREE, period_s=RATE_S))


def rise_and_open(state: WorldState, *, gripper: float = -1.0) -> Script:
    """Open the fingers, rise, and go back to a place high over the table."""
    x, y, _ = state.commanded_pose.position
    state = yield from hold(state, 10, gripper=gripper)
    way = (Pose((x, y, 0.3), DOWN), Pose((0.35, 0.0, 0.45), DOWN))
    return (yield from follow(state, way, gripper=gripper, pace=FREE, period_s=RATE_S))


def closing_at(x: float, y: float, z: float, *, times: int = 1) -> Callable[[Scene, WorldState], Script]:
    """Return a policy that closes its gripper at a point, lifts, opens and rests."""

    def act(_: Scene, state: WorldState) -> Script:
        for _ in range(times):
            state = yield from go_down(state, x, y, z)
            state = yield from close_gripper(state)
            state = yield from rise_and_open(state)
        return state

    return act
