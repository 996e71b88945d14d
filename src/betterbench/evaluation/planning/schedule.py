"""Order in which the trials of a plan are run. There is one round, or several until every variation has a verdict."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

from betterbench.evaluation.planning.plan import Plan
from betterbench.statistics import Decisions, Question, decide
from betterbench.tasks import TrialId
from betterbench.tasks.trial import Trial


class Schedule:
    """Order in which the trials of a plan are run. It depends only on the plan and on the outcomes so far.

    Attributes:
        plan: Plan of the run.
    """

    def __init__(self, plan: Plan, *, is_done: Callable[[TrialId], bool], succeeded: Callable[[TrialId], bool]) -> None:
        """Create the schedule.

        Args:
            plan: Plan of the run.
            is_done: Function that returns whether a trial is finished. A trial that ended with an error is not
                finished.
            succeeded: Function that returns whether a finished trial succeeded. It is called once per trial.
        """
        self.plan, self._is_done, self._succeeded = plan, is_done, succeeded
        self._trials = {(_name(t.task, t.condition), t.seed): t for t in plan.trials}
        self._outcomes: dict[TrialId, bool] = {}
        varied = [t for t in plan.trials if t.variation is not None]
        twins = {_name(t.task, t.condition): _name(t.task, str(t.base_condition)) for t in varied if not t.ambiguous}
        self._unasked = tuple(dict.fromkeys(_name(t.task, t.condition) for t in varied if t.ambiguous))
        self._questions = [Question(condition, twin) for condition, twin in twins.items()]
        self._seeds = sorted({t.seed for t in varied})
        self._decisions: Decisions | None = None
        self._waiting: list[TrialId] = []  # trials of the current round that were not finished at the last check

    @property
    def decisions(self) -> Decisions | None:
        """Verdicts on the variations after the last complete round, or None for a plan that runs all trials."""
        if self.plan.until_decided is None:
            return None
        while self._waiting and self._is_done(self._waiting[-1]):
            self._waiting.pop()
        if self._decisions is None or not self._waiting:
            rule, unasked = self.plan.until_decided, self._unasked
            self._decisions = decide(self._questions, self._seeds, self._outcome, rule=rule, unasked=unasked)
            self._waiting = [self._trials[key].id for key in self._decisions.waiting]
        waiting = tuple(key for key in self._decisions.waiting if not self._is_done(self._trials[key].id))
        return replace(self._decisions, waiting=waiting)

    def rounds(self) -> Iterator[list[Trial]]:
        """Yield the trials of each round that are not finished.

        Request the next round only after all trials of the previous round have ended. If a trial of a round ended
        without a record, the schedule stops after this round. To repeat the trial and continue, run the same command
        again.
        """
        if self.plan.until_decided is None:
            yield [t for t in self.plan.trials if not self._is_done(t.id)]
            return
        given: set[TrialId] = set()
        while (decisions := self.decisions) is not None and decisions.waiting:
            waiting = [self._trials[key] for key in decisions.waiting]
            if not given.isdisjoint(t.id for t in waiting):
                return
            given.update(t.id for t in waiting)
            yield waiting

    def _outcome(self, condition: str, seed: int) -> bool | None:
        trial = self._trials[condition, seed].id
        if trial not in self._outcomes:
            if not self._is_done(trial):
                return None
            self._outcomes[trial] = self._succeeded(trial)
        return self._outcomes[trial]


def _name(task: str, condition: str) -> str:
    return f"{task}/{condition}"
