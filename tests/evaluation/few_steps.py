"""Trials that end after a few steps, here and in workers. Each worker imports this module, so it imports no pytest."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from multiprocessing.connection import Connection

from betterbench.evaluation.trials.trial import WorkerSettings
from betterbench.evaluation.workers import pool
from betterbench.tasks.interventions.resolve import ResolvedCondition
from betterbench.tasks.trial import Trial

WorkerMain = Callable[[WorkerSettings, Connection], None]

_work: WorkerMain = pool.work


def shortened(found: ResolvedCondition, steps: int, *, still: int | None = None) -> ResolvedCondition:
    """Returns a resolved condition whose trials end after a few steps."""
    limits = {"base_steps": steps, "steps_per_subgoal": 0, "still_steps": steps if still is None else still}
    template = dataclasses.replace(found.task.template, **limits)
    return dataclasses.replace(found, task=dataclasses.replace(found.task, template=template))


def in_few_steps(steps: int, *, still: int | None = None) -> Callable[[Trial], ResolvedCondition]:
    """Returns a method that resolves a trial to a task with a short step limit; other processes do not know it."""
    ordinary = Trial.resolve

    def resolve(trial: Trial) -> ResolvedCondition:
        return shortened(ordinary(trial), steps, still=still)

    return resolve


def worker_of_few_steps(steps: int, *, still: int | None = None) -> WorkerMain:
    """Returns the main function of a worker process whose trials are short, in place of ``pool.work``."""
    return functools.partial(_work_in_few_steps, steps, still)


def _work_in_few_steps(steps: int, still: int | None, settings: WorkerSettings, connection: Connection) -> None:
    Trial.resolve = in_few_steps(steps, still=still)  # type: ignore[method-assign]
    _work(settings, connection)
