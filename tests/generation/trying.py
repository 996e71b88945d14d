"""Certification of a generated task without files: a few demonstrations, then single trials."""

from __future__ import annotations

import json
from contextlib import contextmanager
from dataclasses import replace

from betterbench.certification import TrialCertificate
from betterbench.certification.demonstrations import demonstrate, planned_demonstrations, summed_up
from betterbench.certification.examine import examine_condition
from betterbench.tasks import Task, task_from_json, task_to_json
from betterbench.tasks.authoring import registry
from betterbench.tasks.demonstrated import Demonstrated, measured_so_far
from betterbench.tasks.interventions import vary


def finished(task: Task, name: str) -> Task:
    """Return a generated task with an id, as its JSON form reads it."""
    return task_from_json(json.dumps(task_to_json(replace(task, id=name))))


@contextmanager
def registered(task: Task):
    """Register a task for a while."""

    def build() -> Task:
        return task

    build.__name__ = build.__qualname__ = task.id
    build.__doc__ = task.description
    registry.task(build)
    try:
        yield registry.get_task(task.id)
    finally:
        del registry._BUILDERS[task.id]


def measured(task: Task, number: int) -> tuple[Demonstrated, list[str]]:
    """Return the measurements of some demonstrations of a registered task, and what failed."""
    found = []
    so_far = None
    for turn in planned_demonstrations(task, number):
        found += [demonstrate(trial, so_far) for trial in turn]
        so_far = summed_up(task, found)
    return so_far, [f"{d.condition} seed {d.seed}: {d.problem}" for d in found if d.problem]


def certified(task: Task, demonstrations: int, seeds=(0,), names=None) -> tuple[list[TrialCertificate], list[str]]:
    """Return the certificates of all conditions of a task, and the demonstrations that failed."""
    with registered(task) as known:
        found, failed = measured(known, demonstrations)
        with measured_so_far(known.id, found):
            trials = [(c, True) for c in known.training] + [(vary(known, v)[0], False) for v in known.variations]
            made = [
                examine_condition(known, condition, seed, training=training)
                for condition, training in trials
                for seed in seeds
                if names is None or condition.name in names
            ]
    return made, failed
