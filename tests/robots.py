"""One task per robot, for laws that hold for every robot; a new robot joins them when a task is laid out for it."""

from __future__ import annotations

import numpy as np

from betterbench.interface.actions import EE_DELTA, ActionSpace, action_space
from betterbench.sim.robots import robot, robot_names
from betterbench.tasks import all_tasks, get_task

ROBOTS = robot_names()

QUICK = ("morning_coffee", "fruit_basket")
"""Tasks with few objects and steps, preferred for their robot."""


def task_of(name: str) -> str:
    """Return a task that is laid out for a robot."""
    own = [t.id for t in all_tasks() if t.robot == name]
    assert own, f"no task is laid out for the robot {name!r}"
    return next((task for task in own if task in QUICK), own[0])


def usual_space(task_id: str) -> ActionSpace:
    """Return the usual action space of the robot that a task is laid out for."""
    return action_space(robot(get_task(task_id).robot).action_spaces[0])


def still_in(task_id: str, joints: np.ndarray, opening_m: float) -> np.ndarray:
    """Return an action that holds the arm still in its usual action space, (dim,) float32."""
    space, known = usual_space(task_id), robot(get_task(task_id).robot)
    if space == EE_DELTA:
        return np.array([0.0] * 6 + [-1.0], dtype=np.float32)
    return np.array(known.positions_in(space, joints.tolist(), opening_m), dtype=np.float32)


def moves_in(space: ActionSpace, still: np.ndarray, seed: int, steps: int) -> np.ndarray:
    """Return random actions near a still one, (steps, dim) float32, within the bounds of the action space."""
    share = 1.0 if space.is_delta else 0.05
    half = share * 0.5 * (np.array(space.high) - np.array(space.low))
    noise = half * np.random.default_rng(seed).uniform(-1.0, 1.0, (steps, space.dim))
    base = 0.0 if space.is_delta else still
    return np.clip(base + noise, space.low, space.high).astype(np.float32)
