"""Store of teleoperated demonstrations.

The store is an ordinary run folder. It also tracks the initial states that have not been demonstrated yet.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from betterbench.demonstrations.making.attempt import TELEOPERATED, DemonstrationAttempt
from betterbench.demonstrations.making.failure import FailureKind
from betterbench.demonstrations.making.production import Method
from betterbench.demonstrations.making.starts import Start, planned_starts
from betterbench.errors import InvalidInputError
from betterbench.evaluation.planning.manifest import run_context
from betterbench.evaluation.planning.plan import Plan
from betterbench.evaluation.running.lost import reopen_lost
from betterbench.interface.actions import EE_DELTA
from betterbench.jobs.durable import on_disk
from betterbench.json_form import file_digest
from betterbench.records import Journal, JournalEntry, RunFolder
from betterbench.sim.scenes import Scene
from betterbench.sim.scenes.stage import quality_preset
from betterbench.tasks import Expected, get_task
from betterbench.tasks.trial import Trial

FIRST_TELEOPERATED_SEED = 500_000_000
"""Default first seed of teleoperated demonstrations, which is far from the seeds of other demonstrators."""
ADVICE: tuple[FailureKind, ...] = ("outside support",)
"""Kinds of failure with which a human demonstration can still be saved. The journal then contains the failure."""


@dataclass(frozen=True, slots=True)
class TeleopPlan:
    """Demonstrations that a teleoperation session should record.

    Attributes:
        tasks: Names of the tasks.
        demos: Demonstrations per training condition.
        condition: Training condition to demonstrate; None for all of them.
        first_seed: Smallest seed that may be used for initial states.
        quality: Render preset of the stored scenes.
    """

    tasks: tuple[str, ...]
    demos: int = 1
    condition: str | None = None
    first_seed: int = FIRST_TELEOPERATED_SEED
    quality: str = "standard"

    def starts(self) -> tuple[Start, ...]:
        """Return the planned initial states, alternating between the training conditions.

        Raises:
            InvalidInputError: If a number is out of range, or a task does not have the condition.
            UnknownNameError: If a task does not exist.
        """
        tasks = [get_task(name) for name in dict.fromkeys(self.tasks)]
        if not tasks:
            raise InvalidInputError("--tasks", "no task is given", "Name at least one task (see `better list tasks`)")
        if self.condition is not None:
            for task in tasks:
                task.train(self.condition)
        found = [s for task in tasks for s in planned_starts(task, self.demos, first_seed=self.first_seed)]
        kept = [s for s in found if self.condition in (None, s.condition)]
        return tuple(sorted(kept, key=lambda s: s.number))


class DemonstrationStore:
    """Run folder for human demonstrations. It is locked while it is open.

    Raises:
        InvalidInputError: If a number is out of range.
        UnknownNameError: If a task or condition does not exist.
        RunConflictError: If the folder contains another run, or another process writes to it.
        StorageError: If the disk is full.
    """

    def __init__(self, out: Path, wanted: TeleopPlan) -> None:
        """Open the run, or create it if it does not exist."""
        self.wanted = wanted
        self._starts = wanted.starts()
        plan, context = _plan(wanted, self._starts)
        with on_disk(out), ExitStack() as stack:
            self.run = RunFolder.start(out, plan, context=context)
            self._journal: Journal = stack.enter_context(self.run.journal())
            reopen_lost(self.run, self._journal)
            self._open = stack.pop_all()
        self._put_off: list[Start] = []

    def __enter__(self) -> Self:
        """Return the store."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Release the folder."""
        self._open.close()

    @property
    def planned(self) -> int:
        """Number of planned demonstrations."""
        return len(self._starts)

    @property
    def saved(self) -> int:
        """Number of saved demonstrations."""
        return sum(self._journal.is_done(s.trial) for s in self._starts)

    def due(self) -> Start | None:
        """Return the next initial state to demonstrate.

        Postponed initial states come last. The result is None if all initial states have been demonstrated.
        """
        left = [s for s in self._starts if not self._journal.is_done(s.trial)]
        first = [s for s in left if s not in self._put_off]
        if not first:
            self._put_off = []
        return next(iter(first or left), None)

    def put_off(self, start: Start) -> None:
        """Postpone an initial state until all others have been demonstrated."""
        self._put_off.append(start)

    def scene(self, start: Start) -> Scene:
        """Create the scene of an initial state."""
        task = get_task(start.task)
        quality = quality_preset(self.wanted.quality)
        return Scene(task, task.train(start.condition), seed=start.seed, action_space=EE_DELTA, quality=quality)

    def save(self, start: Start, scene: Scene, attempt: DemonstrationAttempt, wall: dict[str, float]) -> Path:
        """Write a demonstration durably, and return the path of its record.

        Raises:
            InvalidInputError: If the demonstration did not succeed.
            StorageError: If the disk is full. The demonstration is not lost and can be saved again.
        """
        note = attempt.note
        if not can_keep(attempt):
            raise InvalidInputError(
                str(start.trial), f"it cannot be saved: {note.reason}", "Undo some steps and try again"
            )
        with on_disk(self.run.path):
            path = self.run.write_record(attempt.record)
            stored = self.run.keep_scene(scene)
            message = f"{note.failure}: {note.reason}" if note.failure else None
            digest = file_digest(path)
            self._journal.append(
                JournalEntry(start.task, start.condition, None, start.seed, "done", message, wall, {}, digest, stored)
            )
        return path


def can_keep(attempt: DemonstrationAttempt) -> bool:
    """Return whether a demonstration can be saved.

    The demonstration must have reached the goal, and the goal must still be met afterward.
    """
    return attempt.record.outcome.success and (attempt.note.accepted or attempt.note.failure in ADVICE)


def _plan(wanted: TeleopPlan, starts: Sequence[Start]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the plan and the context of a run, which are stored in ``run.json``."""
    order = sorted(starts, key=lambda s: (s.task, s.condition, s.number))
    trials = tuple(Trial(s.task, s.condition, None, None, None, s.seed, Expected.SUCCEED.value) for s in order)
    robot = get_task(order[0].task).robot
    plan = Plan(TELEOPERATED, trials, EE_DELTA.name, "state_only", wanted.quality, robot)
    policy = {"address": TELEOPERATED, "name": TELEOPERATED, "needs_images": False}
    engine = {"name": "local", "workers": 1, "envs": 1}
    method = Method(TELEOPERATED, wanted.first_seed, 1, quality=wanted.quality, robot=robot)
    return {**plan.to_json(), "demonstrations": method.to_json()}, run_context(plan, policy=policy, engine=engine)
