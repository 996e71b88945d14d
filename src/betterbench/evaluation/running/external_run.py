"""External runs, in which the user's own evaluation loop controls the trials and betterbench records them."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from betterbench.argument_types import checked_arguments
from betterbench.episodes import POLICY_BOUNDARY, Question, Reply
from betterbench.errors import InvalidInputError, PolicyError, PolicyUnavailableError, RunConflictError
from betterbench.evaluation.planning.manifest import run_context, same_policy
from betterbench.evaluation.planning.plan import Plan
from betterbench.evaluation.planning.schedule import Schedule
from betterbench.evaluation.running.lost import reopen_lost
from betterbench.evaluation.trials.given_policy import kind_of_callers, needs_in_run
from betterbench.evaluation.trials.trial import TrialRunner, TrialSteps, WorkerSettings
from betterbench.interface import EpisodeStart, Observation, PolicyInfo
from betterbench.jobs.conflict import require_same
from betterbench.jobs.durable import on_disk
from betterbench.policies.description import describe_policy
from betterbench.policies.factory import PolicyFactory
from betterbench.records import Journal, JournalEntry, Outcome, RunFolder
from betterbench.tasks import TrialId
from betterbench.tasks.trial import Trial

LOCK_PATIENCE_S = 60.0
"""Maximum time to wait for another process of the same run [s]. A process locks the journal only to write a line."""

_RETRY_S = 0.05
_STARTS = 20  # number of attempts to open the run, because another process may still be creating it
_NOTHING = np.empty(0)


class ExternalRun:
    """Run whose trials are controlled by the user's own evaluation loop. It writes the same records as ``better eval``.

    Several processes may run different trials of one run at the same time, because the run folder is locked only while
    a line is written. Use this class as a context manager.

    Attributes:
        start: :class:`EpisodeStart` of the current episode, or None.
        entry: Journal entry of the episode that ended last, or None.
    """

    @checked_arguments
    def __init__(
        self,
        plan: Plan,
        out: Path | str,
        *,
        needs_images: bool = True,
        metadata: Mapping[str, str] | None = None,
        engine: str = "external",
    ) -> None:
        """Create a run. If the folder already contains a run with the same plan, resume that run.

        The report shows the policy under the name in the plan. If ``needs_images`` is False, no images are rendered.
        ``metadata`` contains further facts about the policy, such as its checkpoint and revision. Values that are JSON
        text are parsed. ``engine`` is the name of the user's loop, which is stored in the manifest.

        Raises:
            InvalidInputError: If the policy name is reserved for a built-in policy.
            RunConflictError: If the folder contains a different run, or a run of a different policy.
            StorageError: If the disk is full.
        """
        if not needs_in_run(plan.policy).thread:
            raise InvalidInputError(
                "policy",
                f"the name {plan.policy!r} is reserved for a built-in policy",
                "Choose another name for your policy",
            )
        out = Path(out)
        info = PolicyInfo(plan.policy, plan.action_space, needs_images=needs_images, metadata=dict(metadata or {}))
        declared = describe_policy(plan.policy, info)
        context = run_context(plan, policy=declared, engine={"name": engine, "workers": 1, "envs": 1})
        with on_disk(out):
            self.folder = same_policy(_opened(out, plan, context), declared, allow_changed=False)
            with _locked(self.folder) as journal:
                reopen_lost(self.folder, journal)
        self.plan = plan
        self.start: EpisodeStart | None = None
        self.entry: JournalEntry | None = None
        self._trial_runner = TrialRunner(WorkerSettings.of(plan, out), policies=_Declared(info))
        self._steps: TrialSteps | None = None
        self._asked = 0.0

    def waiting(self) -> Iterator[Trial]:
        """Yield the trials that are not finished, in the order of the plan.

        Trials that other processes finish in the meantime are skipped. If the plan has ``until_decided``, the next
        round of trials is yielded when all trials of the previous round are finished.
        """
        for trials in Schedule(self.plan, is_done=self._is_done, succeeded=self.folder.succeeded).rounds():
            for trial in trials:
                if not self.is_done(trial):
                    yield trial

    def is_done(self, trial: Trial) -> bool:
        """Return whether a trial is finished."""
        return self._is_done(trial.id)

    def _is_done(self, trial: TrialId) -> bool:
        return any(e.status == "done" and e.key == trial for e in self.folder.entries())

    def outcome(self, trial: Trial) -> Outcome:
        """Return the outcome of a finished trial. Raises RecordError if the trial's record is missing or unreadable."""
        return self.folder.read_brief(trial.id).outcome

    def play(self, trial: Trial, act: Callable[[Observation], npt.ArrayLike]) -> JournalEntry:
        """Run a complete trial in which a function acts as the policy. Return the journal entry of the trial.

        ``act`` maps an observation to one action (dim,) or to a chunk (horizon, dim). If ``act`` raises an exception,
        the trial ends as ``policy_error``, and the run can continue. Raises the same errors as :meth:`begin` and
        :meth:`act`.
        """
        seen: Observation | None = self.begin(trial)
        while seen is not None:
            try:
                with POLICY_BOUNDARY:
                    actions = np.asarray(act(seen))
            except PolicyError as problem:
                self.fail(str(problem))
                break
            seen = self.act(actions)
        if self.entry is None:
            raise AssertionError("unreachable: an episode that has ended has a journal entry")
        return self.entry

    def begin(self, trial: Trial) -> Observation:
        """Begin the episode of a trial in the plan, and return the first observation.

        If another episode is still running, it is abandoned.

        Raises:
            PolicyError: If the trial failed with an error. The journal contains the reason.
            PremiseError: If the scene violates an assumption of the instruction. The run must stop.
            StorageError: If the disk is full. The run must stop.
        """
        self.abandon("the external loop began another episode")
        self._steps, self.entry = self._trial_runner.steps(trial), None
        self._advance(None)
        seen = None if self.start is None else self._advance(Reply(_NOTHING, 0.0))
        if seen is None:
            raise PolicyError(f"{trial.task}/{trial.condition} seed {trial.seed} ended with an error: {self._reason()}")
        return seen

    def act(self, actions: np.ndarray) -> Observation | None:
        """Execute one action (dim,) or a complete chunk (horizon, dim).

        An invalid action ends the trial as ``policy_error``; the record of the trial contains the reason.

        Returns:
            Next observation, or None if the episode has ended. :attr:`entry` is then set.

        Raises:
            InvalidInputError: If there is no current episode.
            StorageError: If the disk is full. The run must stop.
        """
        if self._steps is None:
            raise InvalidInputError("act", "there is no current episode", "Call begin first")
        return self._advance(Reply(np.asarray(actions), time.perf_counter() - self._asked))

    def fail(self, reason: str) -> None:
        """End the current episode as ``policy_error``, because the policy has failed. The trial is not repeated."""
        if self._steps is not None:
            self._advance(PolicyError(reason))

    def abandon(self, reason: str) -> None:
        """End the current episode, if there is one, without a result. The trial is repeated when the run is resumed.

        ``reason`` is written to the journal.
        """
        if self._steps is not None:
            self._advance(PolicyUnavailableError(f"{reason}. Start the same run again to repeat the trial"))

    def close(self) -> None:
        """Abandon the current episode and close the renderers."""
        self.abandon("the external loop ended during the episode")
        self._trial_runner.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _advance(self, reply: Reply | PolicyError | None) -> Observation | None:
        """Continue the episode until it needs actions or ends."""
        steps = self._steps
        if steps is None:
            raise AssertionError("unreachable: there is a current episode")
        try:
            if isinstance(reply, PolicyError):
                question: Question | None = steps.throw(reply)
            else:
                question = steps.send(reply)
        except StopIteration as end:
            self._steps = None
            self._keep(end.value)
            return None
        except BaseException:
            self._steps = self.start = None
            raise
        if question is None:
            raise AssertionError("unreachable: without early requests, each pause is a request")
        self._asked = time.perf_counter()
        if isinstance(question.seen, EpisodeStart):
            self.start = question.seen
            return None
        return question.seen  # type: ignore[return-value] # only privileged policies are shown the state

    def _keep(self, entry: JournalEntry) -> None:
        self.entry, self.start = entry, None
        with on_disk(self.folder.path), _locked(self.folder) as journal:
            if not (self.folder.path / "run.json").exists():  # the folder was removed or moved during the run
                self.folder.restore()
            if not journal.is_done(entry.key):
                journal.append(entry)

    def _reason(self) -> str:
        return "unknown reason" if self.entry is None else str(self.entry.message)


class _Declared(PolicyFactory):
    """Policy factory that only provides the description of a policy, which the user's own evaluation loop calls."""

    def __init__(self, info: PolicyInfo) -> None:
        super().__init__(info.name, kind=kind_of_callers(info.name))
        self._info = info


def _opened(out: Path, plan: Plan, context: Mapping[str, Any]) -> RunFolder:
    """Open the run or create it. Several processes may do this at the same time.

    An existing run is opened without a lock, because locking would remove incomplete records that another process may
    be writing at that moment.
    """
    form = json.loads(json.dumps(plan.to_json()))
    for left in reversed(range(_STARTS)):
        if (out / "run.json").exists():
            break
        try:
            return RunFolder.start(out, form, context=context)
        except RunConflictError:
            if not left:
                raise
            time.sleep(_RETRY_S)
    run = RunFolder.open(out)
    require_same(out, run.plan, form, "run", where="plan", cure="Use the same settings to resume it")
    return run


@contextmanager
def _locked(run: RunFolder) -> Iterator[Journal]:
    """Context manager that opens the journal to write one line. Other processes wait until the journal is closed."""
    until = time.monotonic() + LOCK_PATIENCE_S
    while True:
        try:
            journal = run.journal()
        except RunConflictError:
            if time.monotonic() > until:
                raise
            time.sleep(_RETRY_S)
            continue
        with journal:
            yield journal
        return
