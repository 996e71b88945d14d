"""Variety of demonstrations, measured as the mean difference between corresponding motions.

For two demonstrations of the same condition, the motions with the same subgoal and skill are compared. The random
positions of objects in their slots are removed first, so that copies of the same path count as zero variety even if
they begin at different initial states. Paths are compared by their offset from the straight line between their end
points. Grasps and approaches are compared in the frame of the object. Every value is a mean over pairs of
demonstrations, so it does not depend on the number of demonstrations.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from betterbench.demonstrations.making.sources import region_frame
from betterbench.geometry import Pose
from betterbench.jobs import OnCount
from betterbench.quoting import markdown_table, markdown_text
from betterbench.records import Record, RunFolder, SkillWindow, subgoal_segments
from betterbench.tasks import TrialId
from betterbench.tasks.interventions import resolve_condition

SAMPLES = 40
"""Number of points at which two paths are compared, at equal fractions of their length."""
APPROACH_M = 0.05
"""Length of the final part of a path that determines the approach direction [m]."""
MOST_COMPARED = 200
"""Maximum number of demonstrations per condition that are compared.

The demonstrations with the smallest seeds are used.
"""

_SAID = (
    "Mean difference between two demonstrations of a condition in the same motion. Slot jitter is removed. Paths are "
    "compared by their offset from the straight line between their end points. Approaches and grasps are compared in "
    "the frame of the object."
)

MovedKind = Literal["pick", "place", "slide"]


@dataclass(frozen=True, slots=True)
class Spread:
    """Mean difference between two demonstrations in the same motion.

    Attributes:
        path_cm: Distance between the tool paths at equal fractions of their length, after removing the effect of the
            random positions of objects in their slots [cm].
        height_cm: Difference between the maximum heights of the tool [cm].
        side_cm: Difference between the mean sideways offsets from the straight line between the end points, in the
            middle half of the paths [cm].
        approach_deg: Angle between the directions of the last 5 cm of the paths, in the frame of the object or target
            region [deg].
        duration_s: Difference between the durations of the motion [s].
        grasp_cm: Distance between the tool centers when the gripper closes, in the frame of the object [cm]; None if
            there is no grasp.
        grasp_deg: Rotation between the tool orientations when the gripper closes [deg]; None if there is no grasp.
    """

    path_cm: float
    height_cm: float
    side_cm: float
    approach_deg: float
    duration_s: float
    grasp_cm: float | None
    grasp_deg: float | None


SPREADS: Mapping[str, str] = {
    "path_cm": "path [cm]",
    "height_cm": "height [cm]",
    "side_cm": "side [cm]",
    "approach_deg": "approach [°]",
    "duration_s": "duration [s]",
    "grasp_cm": "grasp [cm]",
    "grasp_deg": "turn [°]",
}
"""Column heading of each field of :class:`Spread`."""


@dataclass(frozen=True, slots=True)
class MotionVariety:
    """Variety of one motion in the demonstrations of a condition.

    A motion ends with a grasp, or leads from a grasp to the release.

    Attributes:
        condition: Condition name.
        subgoal: Subgoal name.
        skill: Kind of the skill at the end of the motion.
        demonstrations: Number of demonstrations that were compared, at least two.
        spread: Mean difference between two of these demonstrations.
    """

    condition: str
    subgoal: str
    skill: MovedKind
    demonstrations: int
    spread: Spread


@dataclass(frozen=True, slots=True)
class TaskVariety:
    """Variety of the demonstrations of a task.

    Attributes:
        task: Task name.
        spread: Mean difference between two demonstrations, averaged over all motions.
        motions: Variety of each motion, for conditions with at least two demonstrations.
    """

    task: str
    spread: Spread
    motions: tuple[MotionVariety, ...]


@dataclass(frozen=True, slots=True, eq=False)
class _Motion:
    """Motion in one demonstration.

    Attributes:
        off: (SAMPLES, 3) offset of the path from the straight line between its end points [m].
        height_m: Maximum height of the tool [m].
        side_m: Mean offset to the left of the straight line, as seen from above, in the middle half of the path [m].
        approach: Direction of the final approach as a unit vector, in the frame of the object or target region.
        duration_s: Duration of the motion [s].
        grasp: Tool pose in the frame of the object when the gripper closes; None if the motion ends with a release.
    """

    off: npt.NDArray[np.float64]
    height_m: float
    side_m: float
    approach: npt.NDArray[np.float64]
    duration_s: float
    grasp: Pose | None


class VarietyMeter:
    """Accumulator for the variety of a set of demonstrations. Records are added one at a time."""

    def __init__(self) -> None:
        self._found: dict[tuple[str, str], dict[tuple[str, MovedKind], list[_Motion]]] = {}
        self._compared: Counter[tuple[str, str]] = Counter()

    def add(self, record: Record) -> None:
        """Add the record of a demonstration.

        Only the first :data:`MOST_COMPARED` successful demonstrations of each condition are used.
        """
        of = (record.metadata.task, record.metadata.condition)
        if not record.outcome.success or self._compared[of] >= MOST_COMPARED:
            return
        self._compared[of] += 1
        motions = self._found.setdefault(of, {})
        for key, motion in _motions(record).items():
            motions.setdefault(key, []).append(motion)

    def tasks(self) -> tuple[TaskVariety, ...]:
        """Return the variety of the demonstrations of each task.

        The result is empty if no condition has two demonstrations.
        """
        found: dict[str, list[MotionVariety]] = {}
        for (task, condition), motions in sorted(self._found.items()):
            for (subgoal, skill), same in motions.items():
                if len(same) > 1:
                    compared = MotionVariety(condition, subgoal, skill, len(same), _spread(same))
                    found.setdefault(task, []).append(compared)
        return tuple(TaskVariety(t, mean_spread([m.spread for m in ms]), tuple(ms)) for t, ms in found.items())


def variety_of_run(
    run: RunFolder, tasks: Iterable[str] | None = None, *, on_progress: OnCount | None = None
) -> tuple[TaskVariety, ...]:
    """Return the variety of the successful demonstrations in a run, for each task.

    Args:
        run: Folder of the run.
        tasks: Tasks to include; None for all tasks.
        on_progress: Called with the number of records read so far and the total number.

    Raises:
        RecordError: If a record cannot be read.
    """
    chosen = None if tasks is None else set(tasks)
    done = sorted(e.key for e in run.entries() if e.status == "done" and (chosen is None or e.task in chosen))
    counts: Counter[tuple[str, str]] = Counter()
    compared: list[TrialId] = []
    for trial in done:
        counts[trial.task, trial.condition] += 1
        if counts[trial.task, trial.condition] <= MOST_COMPARED:
            compared.append(trial)
    meter = VarietyMeter()
    for number, trial in enumerate(compared, start=1):
        meter.add(run.read_record(trial.task, trial.condition, trial.seed))
        if on_progress is not None:
            on_progress(number, len(compared))
    return meter.tasks()


def mean_spread(spreads: Sequence[Spread]) -> Spread:
    """Return the mean of one or more spreads.

    The grasp values are averaged only over the spreads that have grasp values.
    """
    means: dict[str, float | None] = {}
    for name in SPREADS:
        values = [v for v in (getattr(spread, name) for spread in spreads) if v is not None]
        means[name] = round(float(np.mean(values)), 3) if values else None
    return Spread(**means)  # type: ignore[arg-type] # only those of grasps are None, as in the spreads themselves


def variety_lines(variety: Sequence[TaskVariety], sources: Sequence[TaskVariety]) -> list[str]:
    """Return the variety of a demonstration set as Markdown lines.

    For each task, the variety of the source demonstrations is listed above the variety of the set.
    """
    if not variety:
        return ["## Variety", "", "No condition has two demonstrations that could be compared."]
    cells = [tuple(map(markdown_text, row)) for row in variety_rows(variety, sources)]
    return ["## Variety", "", _SAID, "", *markdown_table(("task", "of", *SPREADS.values()), cells)]


def variety_rows(variety: Sequence[TaskVariety], sources: Sequence[TaskVariety]) -> list[tuple[str, ...]]:
    """Return the rows of the variety table.

    Each row contains the task, the word "sources" or "set", and the values of the spread. A task has one row for the
    set and, if there are source demonstrations, one row for them.
    """
    of_sources = {t.task: t for t in sources}
    rows: list[tuple[str, ...]] = []
    for t in variety:
        if t.task in of_sources:
            rows.append((t.task, "sources", *_cells(of_sources[t.task].spread)))
        rows.append((t.task, "set", *_cells(t.spread)))
    return rows


def _cells(spread: Spread) -> tuple[str, ...]:
    values = (getattr(spread, name) for name in SPREADS)
    return tuple("–" if value is None else f"{value:.2f}" for value in values)


def _motions(record: Record) -> dict[tuple[str, MovedKind], _Motion]:
    """Return the motions of a demonstration by subgoal and skill.

    If a motion is repeated, the last repetition is kept.
    """
    meta = record.metadata
    condition = resolve_condition(meta.task, meta.condition).condition
    segments = subgoal_segments(record, condition)
    found: dict[tuple[str, MovedKind], _Motion] = {}
    begin, start = 0, record.ee_position[0]
    for segment in segments:
        for window in segment.skills:
            if window.kind == "miss":
                continue  # a missed grasp is part of the transit to the next grasp
            goal = _goal_of(record, window)
            if segment.subgoal and window.change - begin > 1:
                found[segment.subgoal, window.kind] = _motion(record, window, begin, start, goal)
            begin = window.change if window.kind != "slide" else max(window.change, window.stop - 1)
            start = np.asarray(goal.position) if window.kind != "slide" else record.ee_position[begin]
    return found


def _goal_of(record: Record, window: SkillWindow) -> Pose:
    """Return the reference frame at the end of a motion: the frame of the object or of the target region."""
    state = record.state(window.change - 1)
    if window.kind == "place" and window.target:
        return region_frame(state, window)
    return state.pose(window.object)


def _motion(record: Record, window: SkillWindow, begin: int, start: npt.NDArray[np.float64], goal: Pose) -> _Motion:
    rows = slice(begin, window.change)
    path = record.ee_position[rows]
    shares = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    at = np.linspace(0.0, 1.0, SAMPLES)
    even = np.stack([np.interp(at * shares[-1], shares, path[:, k]) for k in range(3)], axis=1)
    end = np.asarray(goal.position)
    off = even - (start + at[:, None] * (end - start))
    along = (end - start)[:2]
    length = float(np.linalg.norm(along))
    left = np.array([-along[1], along[0]]) / length if length > 1e-6 else np.zeros(2)
    middle = off[SAMPLES // 4 : -(SAMPLES // 4), :2]
    away = np.flatnonzero(np.linalg.norm(path - path[-1], axis=1) >= APPROACH_M)
    last = path[-1] - path[away[-1] if len(away) else 0]
    approach = np.asarray(Pose((0.0, 0.0, 0.0), goal.quaternion).inverse().apply(last.tolist()))
    row = window.change - 1
    tool = Pose(tuple(record.ee_position[row].tolist()), tuple(record.ee_quaternion[row].tolist()))
    return _Motion(
        off=off,
        height_m=float(path[:, 2].max()),
        side_m=float((middle @ left).mean()),
        approach=approach / max(1e-9, float(np.linalg.norm(approach))),
        duration_s=float(record.time[window.change - 1] - record.time[begin]),
        grasp=None if window.kind == "place" else goal.inverse() @ tool,
    )


def _spread(motions: Sequence[_Motion]) -> Spread:
    grasps = [m.grasp for m in motions if m.grasp is not None]
    centers = np.array([g.position for g in grasps])
    return Spread(
        path_cm=_rounded(100.0 * _apart(np.array([m.off for m in motions]))),
        height_cm=_rounded(100.0 * _apart(np.array([m.height_m for m in motions])[:, None, None])),
        side_cm=_rounded(100.0 * _apart(np.array([m.side_m for m in motions])[:, None, None])),
        approach_deg=_rounded(_angle_apart(np.array([m.approach for m in motions]))),
        duration_s=_rounded(_apart(np.array([m.duration_s for m in motions])[:, None, None])),
        grasp_cm=_rounded(100.0 * _apart(centers[:, None, :])) if grasps else None,
        grasp_deg=_rounded(_turn_apart(np.array([g.quaternion for g in grasps]))) if grasps else None,
    )


def _rounded(value: float) -> float:
    return round(value, 3)


def _apart(paths: npt.NDArray[np.float64]) -> float:
    """Return the mean distance between paths, averaged over all pairs of paths.

    ``paths`` has the shape (paths, points, 3).
    """
    sums = [np.linalg.norm(paths[i + 1 :] - paths[i], axis=2).mean(axis=1).sum() for i in range(len(paths) - 1)]
    return float(sum(sums)) / _pairs(len(paths))


def _angle_apart(vectors: npt.NDArray[np.float64]) -> float:
    """Return the angle between unit vectors, averaged over all pairs of vectors [deg].

    ``vectors`` has the shape (n, 3).
    """
    angles = np.degrees(np.arccos(np.clip(vectors @ vectors.T, -1.0, 1.0)))
    return float(np.triu(angles, 1).sum()) / _pairs(len(vectors))


def _turn_apart(quaternions: npt.NDArray[np.float64]) -> float:
    """Return the rotation between orientations, averaged over all pairs of quaternions (n, 4) [deg]."""
    turns = np.degrees(2.0 * np.arccos(np.clip(np.abs(quaternions @ quaternions.T), 0.0, 1.0)))
    return float(np.triu(turns, 1).sum()) / _pairs(len(quaternions))


def _pairs(number: int) -> int:
    return number * (number - 1) // 2
