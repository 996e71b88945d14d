"""Source demonstrations for the amplifier, split into skills relative to objects and target regions."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass

from betterbench.errors import InvalidInputError, RecordError, one_line
from betterbench.geometry import Pose, angle_between, distance, rotate
from betterbench.interface.state import ObjectInfo, SceneInfo, WorldState
from betterbench.policies.experts.planner import turned_grasps
from betterbench.records import Record, RunFolder, SkillWindow, SubgoalSegment, subgoal_segments
from betterbench.sim.assets import Asset
from betterbench.sim.scenes.builder import place_objects
from betterbench.tasks import SUITE_VERSION, TrialId, get_task
from betterbench.tasks.interventions import resolve_condition
from betterbench.tasks.randomness import FIRST_DEMONSTRATION_SEED
from betterbench.tasks.relations import relation
from betterbench.tasks.relations.placing import foot_offset
from betterbench.tasks.user_files import options_for

SAME_GRASP_M = 0.04
"""Maximum distance between a grasp and the annotated grasp that it is matched with [m]."""
SAME_GOAL_M = 0.03
"""Maximum distance between the position of a release and the matching candidate placement of the expert [m]."""
SPOT_M, MOST_SPOTS = 0.012, 16
"""Minimum distance between two alternative goals of a placement [m], and maximum number of goals."""
MOVING_M = 0.001
"""Maximum motion per control step while the tool counts as pausing [m]."""
ROTATION_M = 0.1
"""Weight of a rotation relative to a translation when poses are compared [m/rad].

It equals the length of the gripper.
"""

SkillKey = tuple[str, str, str, str, str]
"""Key for matching skills: the kind of the skill and the kind of the object; for a placement also the relation, the
kind of the target, and the region.

A slide that opens a drawer has the relation "out".
"""


@dataclass(frozen=True, slots=True, eq=False)
class SourceSkill:
    """Skill in a source demonstration, with all values that are needed to transfer it to another scene.

    Attributes:
        key: Key that matching skills of different demonstrations have in common, see :data:`SkillKey`.
        source: Name of the demonstration, "TASK/CONDITION/SEED".
        window: Rows of the demonstration in which the skill is executed.
        object: Object that is picked, released or moved.
        asset: Asset (object model) of this object.
        frame: ``T_world_reference`` at the beginning of the window. The reference is the object or, for a placement,
            the target region.
        object_pose: ``T_world_object`` at the beginning of the window.
        target_pose: ``T_world_target`` at the beginning of the window; the object's pose if the skill is not a
            placement.
        targets: Commanded poses ``T_world_tcp``, one per control step of the window.
        gripper: Gripper command at each of these steps.
        change: Index of the first step at which the gripper opens or closes.
        T_tcp_foot: For a placement, the pose of the object's base in the gripper just before the gripper opens.
        anchor: For a placement, the expert's candidate placement that is nearest to the release, given as the position
            of the object's base in the world frame [m].
        spread_m: For a placement, the difference between the gripper opening and the width of the object [m].
        slid_m: Distance by which a drawer is moved along its own x axis [m].
        width_m: Gripper width at the beginning of the window [m].
        lead_in: Commanded poses ``T_world_tcp`` between the previous skill and the window, one per control step; None
            if the gripper missed a grasp in between.
        tempo_mps: Mean speed of the tool in the transits of the demonstration [m/s].
    """

    key: SkillKey
    source: str
    window: SkillWindow
    object: ObjectInfo
    asset: Asset
    frame: Pose
    object_pose: Pose
    target_pose: Pose
    targets: tuple[Pose, ...]
    gripper: tuple[float, ...]
    change: int
    T_tcp_foot: Pose
    anchor: tuple[float, float, float] | None
    spread_m: float
    slid_m: float
    width_m: float
    lead_in: tuple[Pose, ...] | None
    tempo_mps: float


@dataclass(frozen=True, slots=True, eq=False)
class Source:
    """Source demonstration for the amplifier.

    Attributes:
        trial: Trial of the demonstration.
        segments: Subgoals of the demonstration.
        skills: Skills of the demonstration in order, without missed grasps.
        speed: Speed of the motion style, as a fraction of the expert's speed.
        tempo_mps: Mean speed of the tool in transits, without pauses [m/s]; 0 if unknown.
    """

    trial: TrialId
    segments: tuple[SubgoalSegment, ...]
    skills: tuple[SourceSkill, ...]
    speed: float
    tempo_mps: float

    @property
    def name(self) -> str:
        """Name of the demonstration in records and reports."""
        return str(self.trial)


class Library:
    """All source demonstrations of a task."""

    def __init__(self, sources: Iterable[Source]) -> None:
        self.sources = tuple(sources)
        self._skills: dict[SkillKey, list[SourceSkill]] = {}
        for source in self.sources:
            for skill in source.skills:
                self._skills.setdefault(skill.key, []).append(skill)

    def of_condition(self, condition: str) -> tuple[Source, ...]:
        """Return the source demonstrations of a training condition."""
        return tuple(s for s in self.sources if s.trial.condition == condition)

    def skills(self, key: SkillKey) -> tuple[SourceSkill, ...]:
        """Return the skills of all source demonstrations that have the given key."""
        return tuple(self._skills.get(key, ()))


def key_of(info: SceneInfo, window: SkillWindow, *, out: bool) -> SkillKey:
    """Return the key of a skill. Skills in different demonstrations correspond to each other if their keys are equal.

    Args:
        info: Objects of the scene.
        window: Rows of the skill in its demonstration, with the names of its objects.
        out: True for a slide that opens a drawer.
    """
    kind = info.object(window.object).kind
    if window.kind == "place":
        return ("place", kind, window.relation, info.object(window.target).kind, window.region)
    return (window.kind, kind, "out" if window.kind == "slide" and out else "", "", "")


def load_library(run: RunFolder, task: str) -> Library:
    """Load the successful demonstrations of a task from a run.

    Raises:
        InvalidInputError: If a record has a test seed, or the run has no successful demonstration of the task.
        RecordError: If a record cannot be read, or was made with another version of the suite or the task.
    """
    found = []
    for entry in run.entries():
        if entry.task != task or entry.status != "done":
            continue
        if entry.seed < FIRST_DEMONSTRATION_SEED:
            problem = f"{entry.key} has a test seed, which must not be used for training"
            cure = f"Use demonstrations of `better collect`, with seeds of at least {FIRST_DEMONSTRATION_SEED:,}"
            raise InvalidInputError(str(run.path), problem, cure)
        record = run.read_record(entry.task, entry.condition, entry.seed)
        _require_version(record, str(run.record_path(entry.task, entry.condition, entry.seed)))
        if record.outcome.success:
            found.append(demonstrated_source(record))
    if not found:
        cure = f"Collect demonstrations: better collect{options_for([task])} --tasks {task} --out RUN"
        raise InvalidInputError(str(run.path), f"it contains no successful demonstration of {task}", cure)
    return Library(sorted(found, key=lambda s: s.trial))


def _require_version(record: Record, where: str) -> None:
    """Raise RecordError if a record was made with another version of the suite or the task.

    The objects may be at other positions in another version, so the recorded motions might not fit.
    """
    meta = record.metadata
    versions = (
        ("suite", meta.suite_version, SUITE_VERSION),
        (f"task {meta.task}", meta.task_version, get_task(meta.task).version),
    )
    for what, there, now in versions:
        if there != now:
            raise RecordError(
                f"{where}: it was recorded with version {one_line(there)} of the {what}, but this is version {now}. "
                "Collect the demonstrations again."
            )


def demonstrated_source(record: Record) -> Source:
    """Create a source demonstration from the record of a successful demonstration.

    The skills are computed from the recorded states.
    """
    meta = record.metadata
    trial = TrialId(meta.task, meta.condition, meta.seed)
    condition = resolve_condition(meta.task, meta.condition)
    segments = subgoal_segments(record, condition.condition)
    placed = place_objects(condition.task, condition.condition, meta.seed, shown=meta.looks)
    assets = {p.spec.name: p.asset for p in placed}
    _require_objects(record, assets)
    windows: list[tuple[SkillWindow, tuple[Pose, ...] | None]] = []
    free_from, missed = 1, False
    for window in (w for segment in segments for w in segment.skills):
        if window.kind == "miss":
            missed = True
            continue
        if window.kind != "place" or window.target:
            windows.append((window, None if missed else _targets(record, free_from, window.start)))
        free_from, missed = window.stop, False
    tempo = _tempo_mps(record, [lead_in for _, lead_in in windows if lead_in])
    skills = tuple(_skill_of(record, w, assets[w.object], lead_in=lead_in, tempo_mps=tempo) for w, lead_in in windows)
    speed = 1.0 if meta.demonstrator is None else meta.demonstrator.manner.get("speed", 1.0)
    return Source(trial, segments, skills, min(1.0, max(0.3, float(speed))), tempo)


def _tempo_mps(record: Record, ways: Iterable[Sequence[Pose]]) -> float:
    steps = [distance(a.position, b.position) for way in ways for a, b in itertools.pairwise(way)]
    moving = [step for step in steps if step > MOVING_M]
    if not moving:
        return 0.0
    return sum(moving) / len(moving) * record.n_steps / float(record.time[-1] - record.time[0])


def _targets(record: Record, start: int, stop: int) -> tuple[Pose, ...]:
    """Return the commanded poses in the rows [start, stop) of a record."""
    positions, quaternions = record.commanded_position[start:stop], record.commanded_quaternion[start:stop]
    return tuple(Pose(tuple(p), tuple(q)) for p, q in zip(positions.tolist(), quaternions.tolist(), strict=True))


def _require_objects(record: Record, planned: Collection[str]) -> None:
    """Raise RecordError if a record contains other objects than its condition specifies."""
    meta = record.metadata
    other = sorted({o.name for o in meta.scene.objects} ^ set(planned))
    if other:
        raise RecordError(
            f"{meta.task}/{meta.condition}/{meta.seed}: its objects differ from those of its condition "
            f"({one_line(other[0], most=80)} is in only one of them). Collect the demonstration again."
        )


def _skill_of(
    record: Record, window: SkillWindow, asset: Asset, *, lead_in: tuple[Pose, ...] | None, tempo_mps: float
) -> SourceSkill:
    """Create a source skill from the rows of a record in which the skill is executed.

    Args:
        record: Record of the demonstration.
        window: Rows of the skill.
        asset: Asset of the skill's object.
        lead_in: Commanded poses between the previous skill and this skill; None if the gripper missed a grasp in
            between.
        tempo_mps: Mean speed of the tool in the transits of the demonstration [m/s].
    """
    first = max(1, window.start)
    rows = range(first, max(window.stop, window.change + 1))
    state, let_go = record.state(window.start), record.state(window.change - 1)
    info = state.info.object(window.object)
    held = let_go.ee_pose.inverse() @ let_go.pose(window.object) @ Pose(foot_offset(info))
    is_place = window.kind == "place"
    slid = _slid_m(record, window) if window.kind == "slide" else 0.0
    widths = record.finger_width[rows.start : rows.stop]
    return SourceSkill(
        key=key_of(record.metadata.scene, window, out=slid > 0.0),
        source=str(TrialId(record.metadata.task, record.metadata.condition, record.metadata.seed)),
        window=window,
        object=info,
        asset=asset,
        frame=region_frame(state, window) if is_place else state.pose(window.object),
        object_pose=state.pose(window.object),
        target_pose=state.pose(window.target if is_place else window.object),
        targets=_targets(record, rows.start, rows.stop),
        gripper=tuple(float(v) for v in record.action[rows.start : rows.stop, -1]),
        change=window.change - first,
        T_tcp_foot=held if is_place else Pose(),
        anchor=_anchor(record.state(window.start), let_go, window) if is_place else None,
        spread_m=float(widths.max() - widths[max(0, window.change - first - 1)]) if is_place else 0.0,
        slid_m=slid,
        width_m=state.finger_width_m,
        lead_in=lead_in,
        tempo_mps=tempo_mps,
    )


def region_frame(state: WorldState, window: SkillWindow) -> Pose:
    """Return the pose of the center of a placement's target region, ``T_world_region``."""
    middle = relation(window.relation).middle(state.info.object(window.target), window.region)
    return state.pose(window.target) @ Pose(middle)


def _anchor(state: WorldState, let_go: WorldState, window: SkillWindow) -> tuple[float, float, float] | None:
    foot = let_go.pose(window.object).apply(foot_offset(let_go.info.object(window.object)))
    return nearest_goal(state, window, foot, within_m=SAME_GOAL_M)


def nearest_goal(
    state: WorldState, window: SkillWindow, point: Sequence[float], *, within_m: float
) -> tuple[float, float, float] | None:
    """Return the expert's candidate placement that is nearest to a point, as the position of the object's base [m].

    Unlike a rigid transform of the recorded motion, the candidates take into account the sizes of the objects and the
    objects that are already at the target. Return None if no candidate is within the given distance.
    """
    offset = foot_offset(state.info.object(window.object))
    goals = relation(window.relation).place_goals(state, window.object, window.target, window.region)
    # The rotated offset is computed once per rotation, because hundreds of goals share a few rotations.
    turned = {q: rotate(q, offset) for q in {goal.pose.quaternion for goal in goals}}
    feet = [goal.pose.translated(*turned[goal.pose.quaternion]).position for goal in goals]
    nearest = min(feet, key=lambda foot: distance(foot, point), default=None)
    return nearest if nearest is not None and distance(nearest, point) <= within_m else None


def other_goals(state: WorldState, window: SkillWindow) -> tuple[tuple[float, float, float], ...]:
    """Return the expert's candidate placements as positions of the object's base [m], starting with the best.

    Of several nearly equal placements, only the best is listed.
    """
    offset = foot_offset(state.info.object(window.object))
    found: list[tuple[float, float, float]] = []
    for goal in relation(window.relation).place_goals(state, window.object, window.target, window.region):
        foot = goal.pose.apply(offset)
        if all(distance(foot, other) > SPOT_M for other in found):
            found.append(foot)
    return tuple(found[:MOST_SPOTS])


def _slid_m(record: Record, window: SkillWindow) -> float:
    """Return the distance by which the closed gripper moves a drawer along the drawer's x axis [m]."""
    opened = window.change
    while opened + 1 < len(record) and record.gripper_command[opened + 1] > 0.0:
        opened += 1
    index = record.metadata.scene.index(window.object)
    frame = Pose((0.0, 0.0, 0.0), tuple(record.object_quaternions[window.start, index].tolist()))
    way = record.commanded_position[opened] - record.commanded_position[window.change]
    return float(frame.inverse().apply(way.tolist())[0])


def grasp_shift(source: Asset, T_object_tcp: Pose, other: Asset) -> Pose:
    """Return the transform ``T_object_object`` that turns a grasp on one asset into the same grasp on another asset.

    The annotated grasp nearest to the given grasp is looked up in the first asset, and replaced by the corresponding
    annotated grasp of the other asset. The result is the identity if both assets are the same, or if no annotated grasp
    is close to the given grasp.
    """
    if source is other or source.identity == other.identity or len(source.grasps) != len(other.grasps):
        return Pose()
    near: tuple[float, Pose, Pose] | None = None
    for mine, theirs in zip(source.grasps, other.grasps, strict=True):
        pairs = zip(turned_grasps(Pose(), mine), turned_grasps(Pose(), theirs), strict=False)
        for there, here in pairs:
            off = distance(there.position, T_object_tcp.position)
            if off > SAME_GRASP_M:
                continue
            off += ROTATION_M * angle_between(there.quaternion, T_object_tcp.quaternion)
            if near is None or off < near[0]:
                near = (off, there, here)
    return Pose() if near is None else near[2] @ near[1].inverse()


def moved_along_x(pose: Pose, drawer: Pose, shift_m: float) -> Pose:
    """Translate a pose along the x axis of a drawer by ``shift_m`` [m]."""
    dx, dy, dz = rotate(drawer.quaternion, (shift_m, 0.0, 0.0))
    return pose.translated(dx, dy, dz)
