"""Placement of another robot's base in a task, and the objects that it can grasp from there.

All positions of a task are in the base frame of the robot that it is laid out for. For another robot, the base is moved
to the position from which the robot reaches the most slots; the slots do not move. The result is a separate task with
its own name, version, demonstrations and certificate.
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
"""Distance between tried base positions [m]."""
FARTHEST_M = 0.8
"""Largest tried displacement of the base along each axis [m]."""
OBJECT_HEIGHT_M = 0.03
"""Height of a grasp above the table for which the ring of reach is computed [m]."""
MARGIN_M = 0.01
"""Distance of a slot from the edges of the ring of reach, for its jitter [m]."""
WIDEST_RAD = math.radians(100.0)
"""Largest angle between a slot and the robot's forward direction [rad]."""


@dataclass(frozen=True, slots=True)
class Placed:
    """A task laid out for another robot.

    Attributes:
        task: The task; its name consists of the original task's name and the robot's name, with "placed" after them if
            a packaged task has that name.
        base_m: Position of the robot's base, in the base frame of the original's robot [m].
        outside: Names of the slots that are out of reach from there.
    """

    task: Task
    base_m: tuple[float, float]
    outside: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class GraspCount:
    """Planned grasps of one object.

    Attributes:
        name: Name of the object.
        planned: Number of trials with a planned grasp.
        trials: Number of trials in which the object is to be grasped.
        reason: The most frequent reason why no grasp was found; empty if every grasp was planned.
    """

    name: str
    planned: int
    trials: int
    reason: str


@dataclass(frozen=True, slots=True)
class Feasibility:
    """Feasibility of a task for its robot, measured on its training conditions.

    Attributes:
        solved: Number of trials that the expert solved.
        trials: Number of trials.
        grasps: Planned grasps from the start, by object.
        problem: The most frequent problem of the expert, empty if there is none.
    """

    solved: int
    trials: int
    grasps: tuple[GraspCount, ...]
    problem: str


def ring_of(spec: RobotSpec) -> tuple[float, float]:
    """Return the smallest and the largest horizontal distance from the center of its reach at which a robot grasps [m].

    The tool points down.
    """
    limits = spec.steering
    up = OBJECT_HEIGHT_M + limits.back_m - limits.center[2]
    far = math.sqrt(max(0.0, limits.longest_m**2 - up**2))
    return limits.nearest_m + MARGIN_M, far - MARGIN_M


def place_task(task: Task, spec: RobotSpec) -> Placed:
    """Return a task laid out for another robot, with the base where the fewest slots are out of its reach.

    Among equally good positions, the one with the slots nearest to the middle of the robot's reach is chosen.

    Raises InvalidInputError if the task is laid out for this robot already.
    """
    if task.robot == spec.name:
        problem = f"{task.id} is already laid out for robot {spec.name!r}"
        raise InvalidInputError("--robot", problem, "Give another robot, or use the original task")
    form = task_to_json(task)  # lists the slots of the operations, too
    slots = np.array([(slot["x"], slot["y"]) for slot in form["slots"]])
    near, far = ring_of(spec)
    center = np.array(spec.steering.center[:2])
    steps = np.arange(-FARTHEST_M, FARTHEST_M + 0.5 * GRID_M, GRID_M)
    best: tuple[tuple[int, float], tuple[float, float], np.ndarray] | None = None
    for x, y in itertools.product(steps.tolist(), steps.tolist()):
        flat = slots - (x, y) - center
        radii = np.hypot(flat[:, 0], flat[:, 1])
        out = (radii < near) | (radii > far) | (np.abs(np.arctan2(flat[:, 1], flat[:, 0])) > WIDEST_RAD)
        cost = (int(out.sum()), float(np.abs(radii - 0.5 * (near + far)).sum()))
        if best is None or cost < best[0]:
            best = cost, (round(x, 2), round(y, 2)), out
    if best is None:
        raise AssertionError("the grid of places is not empty")
    _, (x, y), out = best
    name = f"{task.id}_{spec.name}"
    if suite_of(name) is not None:
        name += "_placed"
    there = laid_out(task, name, robot=spec.name, robot_title=spec.title, base_m=(x, y))
    outside = tuple(slot["name"] for slot, is_out in zip(form["slots"], out, strict=True) if is_out)
    return Placed(there, (x, y), outside)


def measure_feasibility(task: Task, *, seeds: int, on_trial: Callable[[], None] = lambda: None) -> Feasibility:
    """Plan the grasps from the start and let the expert act, in each training condition with each of the first seeds.

    ``on_trial`` is called after each trial.
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
        except BetterError as error:  # such as poses of pre-placed objects that were never measured
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
