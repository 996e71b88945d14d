"""Demonstrations and certificates of a task that has not been written to a file yet."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

from betterbench.certification.certificate import CLAUSES, TrialCertificate
from betterbench.certification.demonstrations import demonstrate, planned_demonstrations, summed_up
from betterbench.certification.examine import examine
from betterbench.evaluation import make_plan
from betterbench.generation.building.result import Failure
from betterbench.tasks import Task, TrialId
from betterbench.tasks.authoring.registry import registered_for_now
from betterbench.tasks.demonstrated import Demonstrated, measured_so_far
from betterbench.tasks.interventions import resolve_condition


@dataclass(frozen=True, slots=True)
class Proof:
    """Demonstrations and certificates of a task.

    Attributes:
        demonstrated: Measurements of the task's demonstrations.
        trials: Certificates of the task's trials, ordered by condition.
    """

    demonstrated: Demonstrated
    trials: tuple[TrialCertificate, ...]

    @property
    def failures(self) -> tuple[Failure, ...]:
        """Conditions with at least one trial that failed its certificate, in order."""
        groups: dict[str, list[TrialCertificate]] = {}
        for trial in self.trials:
            if not trial.passed:
                groups.setdefault(trial.condition, []).append(trial)
        return tuple(
            Failure(
                condition,
                tuple(t.seed for t in failed),
                failed[0].failed[0],
                CLAUSES[failed[0].failed[0]],
                failed[0].clauses[failed[0].failed[0]].text,
            )
            for condition, failed in groups.items()
        )


@contextmanager
def provisional(task: Task) -> Iterator[Task]:
    """Return a context manager that registers a task until the context is left.

    The task's conditions and trials can then be looked up by name.
    """
    with registered_for_now(task) as known:
        resolve_condition.cache_clear()
        try:
            yield known
        finally:
            resolve_condition.cache_clear()


def prove(task: Task, seeds: int, demonstrations: int) -> Proof:
    """Run the demonstrations of a task and examine its trials.

    If a training condition fails, the variations are not examined, because the task cannot be used. Training conditions
    without a solved demonstration are examined first. If they fail, nothing else is examined.

    Args:
        task: Registered task.
        seeds: Number of trials per variation, from seed 0. As in ``better eval --trials``, all training conditions
            together have as many trials as all variations together.
        demonstrations: Number of demonstrations, at least one for each training condition.
    """
    first, later = planned_demonstrations(task, demonstrations)
    found = [demonstrate(trial) for trial in first]
    so_far = summed_up(task, found)
    found += [demonstrate(trial, so_far) for trial in later]
    measured = summed_up(task, found)
    solved = {demonstration.condition for demonstration in found if not demonstration.problem}
    planned = [TrialId(t.task, t.condition, t.seed) for t in make_plan("expert", tasks=[task.id], trials=seeds).trials]
    training = [trial for trial in planned if trial.condition in {c.name for c in task.training}]
    variations = [trial for trial in planned if trial not in set(training)]
    unsolved = [trial for trial in training if trial.condition not in solved]
    certificates: dict[TrialId, TrialCertificate] = {}
    with measured_so_far(task.id, measured):
        for trials in (unsolved, training, variations):
            for trial in trials:
                if trial not in certificates:
                    certificates[trial] = examine(trial)
            if not all(certificate.passed for certificate in certificates.values()):
                break
    return Proof(measured, tuple(certificates.values()))


def without(task: Task, names: Sequence[str]) -> Task:
    """Return a copy of a task without the named variations."""
    return dataclasses.replace(task, variations=tuple(v for v in task.variations if v.name not in names))
