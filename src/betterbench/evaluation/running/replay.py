"""Replaying a record: its actions are simulated again and every state is compared bit for bit."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from betterbench.errors import RecordError
from betterbench.interface.actions import action_space
from betterbench.interventions import resolve_condition
from betterbench.recording import Record, read_record
from betterbench.scenes import Scene, engine_version
from betterbench.tasks import GoalTracker


@dataclass(frozen=True, slots=True)
class ReplayCheck:
    """The result of a replay.

    Attributes:
        rows: Rows compared.
        first_difference: First row whose state differs, or None if all are equal.
        largest_difference: Largest difference of a position or angle [m, rad].
        verdict_agrees: Whether the goal tracker gives the same truth again.
        notes: What may explain a difference.
    """

    rows: int
    first_difference: int | None
    largest_difference: float
    verdict_agrees: bool
    notes: tuple[str, ...]

    @property
    def identical(self) -> bool:
        """Whether every state and every verdict is the same."""
        return self.first_difference is None and self.verdict_agrees


def check_record(path: Path) -> ReplayCheck:
    """Simulate a record's actions again and compare; RecordError if the record or its scene cannot be read."""
    record = read_record(path)
    meta = record.metadata
    notes = []
    if meta.engine.get("mujoco") != engine_version():
        notes.append(f"recorded with MuJoCo {meta.engine.get('mujoco')}, replayed with {engine_version()}")
    found = resolve_condition(meta.task, meta.condition)
    if found.task.version != meta.task_version:
        notes.append(f"recorded with version {meta.task_version} of {meta.task}, replayed with {found.task.version}")
    scene = Scene(
        found.task, found.condition, seed=meta.seed, action_space=action_space(meta.action_space), looks=meta.looks
    )
    if scene.data.qpos.shape[0] != record.qpos.shape[1]:
        raise RecordError(
            f"{path}: the scene has changed since ({', '.join(notes) or 'same versions'}). Record it again."
        )
    return _compare(scene, record, tuple(notes))


def _compare(scene: Scene, record: Record, notes: tuple[str, ...]) -> ReplayCheck:
    tracker = GoalTracker(
        scene.condition, scene.info, template=scene.task.template, control_rate_hz=scene.control_rate_hz
    )
    state = scene.reset()
    first: int | None = None
    largest, agrees = 0.0, True
    for row in range(len(record)):
        if row:
            scene.step(record.applied[row])
            state = scene.state()
        truth = tracker.update(state)
        agrees = agrees and truth.goal == bool(record.goal[row])
        agrees = agrees and truth.relations == tuple(bool(p) for p in record.predicates[row])
        same = np.array_equal(scene.data.qpos, record.qpos[row]) and np.array_equal(scene.data.qvel, record.qvel[row])
        largest = max(largest, float(np.abs(scene.data.qpos - record.qpos[row]).max()))
        if not same and first is None:
            first = row
    return ReplayCheck(len(record), first, largest, agrees, notes)
