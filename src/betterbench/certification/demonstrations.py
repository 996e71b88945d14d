"""Measurement of demonstrations: the points at which objects are released, and the poses in which they come to rest."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from betterbench.certification.examine import watch_expert
from betterbench.certification.handling import Preplaced, Put
from betterbench.geometry import yaw_of
from betterbench.interface.actions import EE_DELTA
from betterbench.json_form import strict_form
from betterbench.sim.scenes import Scene, engine_version
from betterbench.sim.scenes.stage import QUALITIES
from betterbench.tasks import SUITE_VERSION, Task, TrialId, get_task
from betterbench.tasks.demonstrated import (
    Demonstrated,
    FinalPose,
    FinalPoses,
    FlatPose,
    JointPoses,
    LeaningPose,
    Releases,
    measured_so_far,
)
from betterbench.tasks.randomness import FIRST_DEMONSTRATION_SEED
from betterbench.tasks.relations import RELATIONS

MOST_POSES = 12
"""Largest number of final poses that are kept per asset and target region. Later poses are dropped."""


@strict_form
@dataclass(frozen=True, slots=True)
class DemonstratedPut:
    """Placement of an object in a demonstration. Lengths are in millimeters and angles in degrees."""

    slot: str
    relation: str
    region: str
    level: int
    height_mm: float
    point_mm: tuple[int, int]
    kind: str
    asset: str
    target_kind: str
    target_asset: str
    pose: FlatPose


@strict_form
@dataclass(frozen=True, slots=True)
class Demonstration:
    """Measurements made in one demonstration of the expert.

    Attributes:
        problem: Reason why the demonstration failed. Empty if it succeeded.
        puts: Every placement of an object in the demonstration.
        together: Final poses of the objects, for each target on or in which several objects were placed.
    """

    task: str
    condition: str
    seed: int
    problem: str
    puts: tuple[DemonstratedPut, ...]
    together: tuple[JointPoses, ...] = ()

    @property
    def key(self) -> TrialId:
        """ID of the trial that was demonstrated."""
        return TrialId(self.task, self.condition, self.seed)


def planned_demonstrations(task: Task, number: int) -> tuple[tuple[TrialId, ...], tuple[TrialId, ...]]:
    """Return the demonstrations of a task that are to be measured. The training conditions are used in turn.

    Returns:
        Two tuples: the demonstrations that start with no object at a target, and those that start with some objects
        already at a target. The initial poses of these objects are final poses that were measured in the demonstrations
        of the first tuple.
    """
    conditions = [task.training[i % len(task.training)] for i in range(number)]
    trials = [(c, TrialId(task.id, c.name, FIRST_DEMONSTRATION_SEED + i)) for i, c in enumerate(conditions)]
    first = tuple(trial for c, trial in trials if not c.preplaced)
    return first, tuple(trial for c, trial in trials if c.preplaced)


def demonstrate(trial: TrialId, so_far: Demonstrated | None = None, *, robot: str | None = None) -> Demonstration:
    """Run one demonstration of the expert, and measure the placements in it.

    Args:
        trial: Training condition, with a seed for demonstrations.
        so_far: Measurements made so far. They determine the initial poses of objects that are already at a target.
        robot: Name of the robot. By default, it is the robot for which the task is made.
    """
    task = get_task(trial.task)
    with measured_so_far(task.id, so_far):
        scene = Scene(
            task,
            task.train(trial.condition),
            seed=trial.seed,
            action_space=EE_DELTA,
            quality=QUALITIES["fast"],
            robot_name=robot,
        )
        watched = watch_expert(scene)
    puts = tuple(_noted(p) for p in watched.primitives if isinstance(p, Put) and p.relation and p.slot)
    together = _together(watched.left, task.template.relation)
    return Demonstration(trial.task, trial.condition, trial.seed, watched.problem, puts, together)


def _together(left: Sequence[Preplaced], relation: str) -> tuple[JointPoses, ...]:
    """Return the final poses of the objects, for each target on or in which several objects were placed."""
    places: dict[tuple[str, str, str], list[FinalPose]] = {}
    for p in left:
        places.setdefault(p.place, []).append(FinalPose(p.kind, p.asset, LeaningPose.of(p.pose)))
    return tuple(
        JointPoses(kind, asset, relation, region, tuple(sorted(objects)))
        for (kind, asset, region), objects in sorted(places.items())
        if len(objects) > 1
    )


def _noted(put: Put) -> DemonstratedPut:
    at_rest = put.target_pose.inverse() @ put.pose
    height, x, y = (1000.0 * value for value in put.release)
    return DemonstratedPut(
        slot=put.slot or "",
        relation=put.relation or "",
        region=put.region,
        level=put.level,
        height_mm=round(height, 1),
        point_mm=(round(x), round(y)),
        kind=put.kind,
        asset=put.asset,
        target_kind=put.target_kind,
        target_asset=put.target_asset,
        pose=FlatPose(
            round(1000.0 * at_rest.position[0], 1),
            round(1000.0 * at_rest.position[1], 1),
            round(math.degrees(yaw_of(at_rest.quaternion)), 1),
        ),
    )


def summed_up(task: Task, demonstrations: Sequence[Demonstration]) -> Demonstrated:
    """Combine the measurements from several demonstrations of a task. Demonstrations that failed are ignored."""
    solved = [d for d in demonstrations if not d.problem]
    puts = [put for d in solved for put in d.puts]
    places: dict[tuple[str, str, str, int], list[DemonstratedPut]] = {}
    left: dict[tuple[str, str, str, str, str, str], list[FlatPose]] = {}
    for put in puts:
        places.setdefault((put.slot, put.relation, put.region, put.level), []).append(put)
        if RELATIONS[put.relation].surface is not None:  # objects may be at this target from the start
            what = (put.kind, put.asset, put.target_kind, put.target_asset, put.relation, put.region)
            left.setdefault(what, []).append(put.pose)
    return Demonstrated(
        SUITE_VERSION,
        engine_version(),
        task.version,
        len(solved),
        tuple(
            Releases(*place, _apart(p.height_mm for p in there), tuple(sorted({p.point_mm for p in there})))
            for place, there in sorted(places.items())
        ),
        tuple(FinalPoses(*what, tuple(poses[:MOST_POSES])) for what, poses in sorted(left.items())),
        tuple(joint for d in solved for joint in d.together),
    )


def _apart(heights_mm: Iterable[float]) -> tuple[float, ...]:
    """Return the heights in ascending order. A height that is at most 0.5 mm above the previous one is left out."""
    kept: list[float] = []
    for height in sorted(heights_mm):
        if not kept or height > kept[-1] + 0.5:
            kept.append(height)
    return tuple(kept)
