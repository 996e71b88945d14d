"""Adaptation of a task to another robot: choice of the base position, and a check of what the robot can grasp there.

All positions of a task are given in the base frame of its original robot. For another robot, the base is moved to the
position from which this robot reaches the most slots, while the slots stay where they are. The result is a separate
task with its own name, version, demonstrations and certificate.
"""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from betterbench.certification.examine import planned_grasps, watch_expert
from betterbench.errors import BetterError, InvalidInputError, one_line
from betterbench.interface.actions import EE_DELTA
from betterbench.sim.robots import RobotSpec
from betterbench.sim.scenes import Scene, quality_preset
from betterbench.tasks import Task, suite_of, task_to_json
from betterbench.tasks.authoring.laid_out import laid_out

GRID_M = 0.01
"""Distance between neighboring candidates for the position of the base [m]."""
FARTHEST_M = 0.8
"""Largest distance by which the base is moved along each axis [m]."""
OBJECT_HEIGHT_M = 0.03
"""Height of grasps above the table for which the reach is computed [m]."""
MARGIN_M = 0.01
"""Minimum distance between a slot and the limits of the reach [m], since objects are placed randomly around the slot.
"""
WIDEST_RAD = math.radians(100.0)
"""Largest angle between the forward direction of the robot and the direction to a slot [rad]."""


@dataclass(frozen=True, slots=True)
class Placed:
    """Task that has been adapted to another robot.

    Attributes:
        task: Adapted task. It is named after the original task and the robot. If a packaged task already has this name,
            "placed" is added to it.
        base_m: Position of the robot's base, in the base frame of the original robot [m].
        outside: Names of the slots that the robot cannot reach from this position.
    """

    task: Task
    base_m: tuple[float, float]
    outside: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class GraspCount:
    """Number of trials in which a grasp of a certain object could be planned.

    Attributes:
        name: Name of the object.
        planned: Number of trials in which a grasp was found.
        trials: Number of trials in which the object must be grasped.
        reason: Most frequent reason why no grasp was found. Empty if a grasp was found in every trial.
    """

    name: str
    planned: int
    trials: int
    reason: str


@dataclass(frozen=True, slots=True)
class Feasibility:
    """Result of checking whether a robot can do the training conditions of a task.

    Attributes:
        solved: Number of trials that the expert solved.
        trials: Number of trials.
        grasps: Results of planning grasps from the initial state, one entry per object.
        problem: Most frequent reason why the expert failed. Empty if it always succeeded.
    """

    solved: int
    trials: int
    grasps: tuple[GraspCount, ...]
    problem: str


def ring_of(spec: RobotSpec) -> tuple[float, float]:
    """Return the smallest and the largest horizontal distance from the center of reach at which a robot can grasp [m].

    The values apply to grasps in which the tool points straight down.
    """
    limits = spec.steering
    up = OBJECT_HEIGHT_M + limits.back_m - limits.center[2]
    far = math.sqrt(max(0.0, limits.longest_m**2 - up**2))
    return limits.nearest_m + MARGIN_M, far - MARGIN_M


def place_task(task: Task, spec: RobotSpec) -> Placed:
    """Adapt a task to another robot. The base is moved to the position from which the fewest slots are out of reach.

    If several positions are equally good, the position is chosen at which the slots are closest to the middle of the
    reach on average. Raises InvalidInputError if the task is already made for this robot.
    """
    if task.robot == spec.name:
        problem = f"{task.id} is already laid out for robot {spec.name!r}"
        raise InvalidInputError("--robot", problem, "Choose another robot, or use the original task")
    form = task_to_json(task)  # includes the slots that operations add
    slots = np.array([(slot["x"], slot["y"]) for slot in form["slots"]])
    near, far = ring_of(spec)
    center = np.array(spec.steering.center[:2])
    steps = np.arange(-FARTHEST_M, FARTHEST_M + 0.5 * GRID_M, GRID_M)
    positions = np.array(list(itertools.product(steps, steps)))
    flat = slots - positions[:, None] - center  # shape (positions, slots, 2)
    radii = np.hypot(flat[..., 0], flat[..., 1])
    out = (radii < near) | (radii > far) | (np.abs(np.arctan2(flat[..., 1], flat[..., 0])) > WIDEST_RAD)
    best = int(np.lexsort((np.abs(radii - 0.5 * (near + far)).sum(axis=1), out.sum(axis=1)))[0])
    x, y = (round(float(value), 2) for value in positions[best])
    name = f"{task.id}_{spec.name}"
    if suite_of(name) is not None:
        name += "_placed"
    there = laid_out(task, name, robot=spec.name, robot_title=spec.title, base_m=(x, y))
    outside = tuple(slot["name"] for slot, is_out in zip(form["slots"], out[best], strict=True) if is_out)
    return Placed(there, (x, y), outside)


def measure_feasibility(task: Task, *, seeds: int, on_trial: Callable[[], None] = lambda: None) -> Feasibility:
    """Check whether a robot can do a task by planning grasps from the initial state and running the expert.

    This is done for each training condition with each seed from 0 to ``seeds - 1``. ``on_trial`` is called after each
    trial.
    """
    solved, total = 0, 0
    tried, planned, problems = Counter[str](), Counter[str](), Counter[str]()
    reasons: dict[str, Counter[str]] = {}
    for condition, seed in itertools.product(task.training, range(seeds)):
        total += 1
        try:
            scene = Scene(task, condition, seed=seed, action_space=EE_DELTA, quality=quality_preset("fast"))
            found, _ = planned_grasps(scene, scene.reset(check_premise=False))
            problem = watch_expert(scene).problem
        except BetterError as error:  # for example, because final poses of demonstrations were not measured
            found, problem = {}, one_line(error)
        for name, reason in found.items():
            tried[name] += 1
            planned[name] += reason is None
            if reason is not None:
                reasons.setdefault(name, Counter())[reason.removeprefix(f"no free grasp of {name}: ")] += 1
        solved += not problem
        if problem:
            problems[problem] += 1
        on_trial()
    grasps = tuple(
        GraspCount(name, planned[name], count, reasons[name].most_common(1)[0][0] if name in reasons else "")
        for name, count in sorted(tried.items())
    )
    return Feasibility(solved, total, grasps, problems.most_common(1)[0][0] if problems else "")
