"""Replay of a record: the recorded actions are simulated again, and all results are compared bit for bit."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np

from betterbench.episodes import TrialContext, append_row, describe
from betterbench.errors import InvalidActionError, RecordError
from betterbench.interface.actions import action_space
from betterbench.records import Outcome, Record, RecordBuilder, RunFolder, read_record, subgoal_segments
from betterbench.sim.robots import robot, robot_names
from betterbench.sim.scenes import Scene, engine_version
from betterbench.sim.scenes.stage import QUALITIES, quality_preset
from betterbench.tasks import GoalTracker, Truth
from betterbench.tasks.interventions import ResolvedCondition, resolve_condition

VERDICTS = ("predicates", "subgoals", "goal", "forbidden")
"""Columns of a record that the goal tracker computes."""

MOST_DEVIATIONS = 6.0
"""Maximum plausible noise of an executed action, in standard deviations."""

_NOT_DERIVED = ("package_version", "suite_version", "schema_version", "engine")
"""Fields of the metadata that depend on installed versions. Differences in these fields are not errors."""


@dataclass(frozen=True, slots=True)
class ReplayCheck:
    """Result of a replay.

    Attributes:
        rows: Number of rows that were compared.
        first_difference: Index of the first row whose state differs, or None if all states are equal.
        largest_difference: Largest difference in a position or angle [m, rad].
        verdict_agrees: Whether the goal tracker computes the recorded values again, and whether the recorded outcome
            follows from them.
        notes: Possible reasons for a difference.
        differing: Descriptions of the fields that differ. If a field is a single value, its description contains both
            values.
        fields: Number of fields that were compared.
    """

    rows: int
    first_difference: int | None
    largest_difference: float
    verdict_agrees: bool
    notes: tuple[str, ...]
    differing: tuple[str, ...] = ()
    fields: int = 0

    @property
    def identical(self) -> bool:
        """Whether all states, predicates and other fields are identical."""
        return self.first_difference is None and self.verdict_agrees and not self.differing


def check_record(path: Path) -> ReplayCheck:
    """Simulate the actions of a record again, and compare all results.

    All columns, the outcome, and all metadata except the versions are compared. A record in a run folder is also
    compared with the plan and the journal of the run.

    Raises:
        RecordError: If the record or the scene cannot be read, or if the record contradicts the plan or the journal.
    """
    record = read_record(path)
    run = _run_of(path, record)
    meta = record.metadata
    notes = []
    if meta.engine.get("mujoco") != engine_version():
        notes.append(f"recorded with MuJoCo {meta.engine.get('mujoco')}, replayed with {engine_version()}")
    found = resolve_condition(meta.task, meta.condition)
    if found.task.version != meta.task_version:
        notes.append(f"recorded with version {meta.task_version} of {meta.task}, replayed with {found.task.version}")
    scene = _scene(record, found, {} if run is None else run.plan)
    if scene.data.qpos.shape[0] != record.qpos.shape[1]:
        raise RecordError(
            f"{path}: the scene has changed since the recording ({', '.join(notes) or 'same versions'}). "
            "Record the trial again."
        )
    try:
        again, truth, met = _simulate(scene, record, found)
    except InvalidActionError as problem:
        raise RecordError(
            f"{path}: the recorded actions cannot be executed ({problem}). Record the trial again."
        ) from problem
    return _compare(record, again, tuple(notes), outcome=_outcome(scene, record, truth, met))


def _scene(record: Record, found: ResolvedCondition, plan: Mapping[str, object]) -> Scene:
    """Create the scene of a record.

    The robot is taken from the plan, and the rendering quality from the record or the plan. If one of them is not
    known, all candidates are tried until the scene matches the record.
    """
    meta, planned = record.metadata, plan.get("quality")
    named = meta.render_quality or (planned.get("name") if isinstance(planned, dict) else None)
    qualities = [named] if isinstance(named, str) and named in QUALITIES else [*QUALITIES]
    joints = record.joint_positions.shape[1]
    robots = [name for name in robot_names() if len(robot(name).arm_joints) == joints]
    if not robots:
        raise RecordError(f"{meta.task}/{meta.condition} seed {meta.seed}: no available robot has {joints} arm joints.")
    if (used := plan.get("robot")) in robots:
        robots = [str(used)]
    *others, last = itertools.product(robots, qualities)

    def made(pair: tuple[str, str]) -> Scene:
        return Scene(
            found.task,
            found.condition,
            seed=meta.seed,
            action_space=action_space(meta.action_space),
            quality=quality_preset(pair[1]),
            looks=meta.looks,
            robot_name=pair[0],
        )

    fitting = (s for s in map(made, others) if s.compiled.content_hash == meta.scene_hash)
    return next(fitting, None) or made(last)


def _run_of(path: Path, record: Record) -> RunFolder | None:
    """Return the run that contains a record, or None if the record is not in a run.

    Raises RecordError if the record contradicts the plan or the journal of the run, or if it is not stored at the path
    for its trial.
    """
    place = path.absolute()
    if len(place.parents) < 4 or not (place.parents[3] / "run.json").is_file():
        return None
    run = RunFolder.open(place.parents[3])
    meta = record.metadata
    task, condition = place.parts[-3:-1]
    if run.record_path(task, condition, meta.seed) == place:
        run.read_record(task, condition, meta.seed)
        return run
    raise RecordError(
        f"{path}: this file is the record of {meta.task}/{meta.condition} seed {meta.seed}, but its path in the run is "
        "that of another trial. Move the file to the path of its trial."
    )


def _simulate(scene: Scene, record: Record, found: ResolvedCondition) -> tuple[Record, Truth, int | None]:
    """Replay the actions of a record in a scene.

    Return the new record, the final values of the predicates, and the first row at which the goal is reached (or None).
    """
    meta = record.metadata
    tracker = GoalTracker(
        scene.condition, scene.info, template=scene.task.template, control_rate_hz=scene.control_rate_hz
    )
    of_variation = found.variation is not None
    context = TrialContext(
        policy=meta.policy,
        variation=meta.condition if of_variation else None,
        axis=found.axis,
        base_condition=found.base if of_variation else None,
        interventions=() if found.variation is None else tuple(str(i) for i in found.variation.interventions),
        camera_preset=meta.camera_preset,
        demonstrator=meta.demonstrator,
    )
    # If noise was added, ``action`` is the action that the demonstrator chose, and ``applied`` is the action with
    # noise, which was executed and is therefore replayed.
    executed = record.action if meta.demonstrator is None or not meta.demonstrator.action_noise else record.applied
    builder = RecordBuilder(describe(scene, tracker, context))
    state = scene.reset()
    truth = tracker.update(state)
    met = 0 if truth.success else None
    append_row(builder, scene, state, truth, action=None, applied=None)
    for row in range(1, len(record)):
        # The result is not used, but an invalid action raises an error.
        scene.action_space.clip(record.action[row])
        applied = scene.step(executed[row])
        state = scene.state()
        truth = tracker.update(state)
        append_row(builder, scene, state, truth, action=record.action[row], applied=applied)
        met = row if met is None and truth.success else met
    again = builder.finish(termination="step_limit", success=False)
    if meta.demonstrator is not None:
        again = replace(again, metadata=replace(again.metadata, segments=subgoal_segments(again, scene.condition)))
    return again, truth, met


def _outcome(scene: Scene, record: Record, truth: Truth, met: int | None) -> Iterator[str]:
    """Yield the differences between the recorded outcome and the outcome of the replay, as text."""
    told, steps = record.outcome, record.n_steps
    limit = scene.task.step_limit(scene.condition)
    if truth.success:
        due: tuple[str, ...] = ("success",)
    else:
        due = ("step_limit",) if steps >= limit else ("policy_error", "interrupted")
    if told.termination not in due:
        yield f"outcome.termination is {told.termination!r} but the replay gives {' or '.join(map(repr, due))}"
    broken = told.termination in ("policy_error", "interrupted")
    error = told.error or ""
    wanted = Outcome(
        told.termination,
        truth.success and not broken,
        told.error if broken else None,
        scene.action_space.count_clipped(record.action[1:]),
        int(told.termination == "policy_error" and error.startswith("InvalidActionError")),
    )
    for name in ("success", "error", "clipped_actions", "invalid_actions"):
        if getattr(told, name) != getattr(wanted, name):
            yield f"outcome.{name} is {getattr(told, name)!r} but the replay gives {getattr(wanted, name)!r}"
    noise = 0.0 if record.metadata.demonstrator is None else record.metadata.demonstrator.action_noise
    if noise and float(np.abs(record.applied[1:] - record.action[1:]).max(initial=0.0)) > MOST_DEVIATIONS * noise:
        yield f"action differs from applied by more than noise of {noise:g} can explain"
    if broken and not error:
        yield f"outcome.error is missing for {told.termination!r}"
    if steps > limit or (met is not None and met < steps):
        yield f"the episode ends after row {steps} instead of row {limit if met is None else met}"


def _compare(record: Record, again: Record, notes: tuple[str, ...], *, outcome: Iterator[str]) -> ReplayCheck:
    differing = list(_metadata(record, again))
    ends = list(outcome)
    first: int | None = None
    for name, ours in again.arrays().items():
        theirs = record.arrays()[name]
        if ours.shape != theirs.shape or ours.dtype != theirs.dtype:
            differing.append(f"{name} has the shape {theirs.shape} but the replay gives {ours.shape}")
            continue
        rows = _rows(ours, theirs)
        if len(rows):
            differing.append(f"{name} from row {rows[0]} on")
            if name not in VERDICTS:
                first = int(rows[0]) if first is None else min(first, int(rows[0]))
    same_contacts = record.bodies == again.bodies and all(
        np.array_equal(getattr(record.contacts, name), getattr(again.contacts, name))
        for name in ("offsets", "bodies", "forces")
    )
    if not same_contacts:
        differing.append("contacts")
    verdicts = not ends and all(np.array_equal(getattr(record, n), getattr(again, n)) for n in VERDICTS)
    largest = float(np.abs(again.qpos - record.qpos).max())
    count = len(again.arrays()) + 1 + len(fields(record.metadata)) - len(_NOT_DERIVED) + len(fields(record.outcome))
    return ReplayCheck(len(record), first, largest, verdicts, notes, (*ends, *differing), count)


def _rows(ours: np.ndarray, theirs: np.ndarray) -> np.ndarray:
    """Return the indices of the rows in which two columns are not bit-identical."""
    a, b = (np.ascontiguousarray(x).reshape(len(x), -1) for x in (ours, theirs))
    if a.shape[1] == 0:
        return np.empty(0, dtype=np.intp)
    return np.flatnonzero((a.view(np.uint8) != b.view(np.uint8)).any(axis=1))


def _metadata(record: Record, again: Record) -> Iterator[str]:
    """Yield the metadata that differ between the record and the replay."""
    for field in fields(record.metadata):
        told, due = getattr(record.metadata, field.name), getattr(again.metadata, field.name)
        if field.name == "render_quality" and record.metadata.camera_preset is not None:
            continue  # the quality of the images is a setting of the run and does not follow from the replay
        if field.name not in _NOT_DERIVED and told != due:
            shown = [str(value) if len(str(value)) <= 60 else f"{str(value)[:57]}..." for value in (told, due)]
            yield f"metadata.{field.name} is {shown[0]} but the replay gives {shown[1]}"
    if record.metadata.engine.get("model") != again.metadata.engine.get("model"):
        yield "metadata.engine.model"
