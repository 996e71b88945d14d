"""Report section about each task: the results of every policy, findings and film strips."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from betterbench.diagnosis.verdict import RunDiagnosis, TrialDiagnosis
from betterbench.report.figures.charts import twin_figure
from betterbench.report.headline import Failure, leading_failure
from betterbench.report.outcomes import ConditionRow, Segment, segments_of, task_title, training_rows, variation_rows
from betterbench.report.wording import Figure
from betterbench.tasks.worlds.facts import facts_of_task


@dataclass(frozen=True, slots=True)
class ConditionGroup:
    """Variation, or the training conditions of a task, with the results of each policy as a pair (policy, row)."""

    first: ConditionRow
    rows: tuple[tuple[str, ConditionRow], ...]


@dataclass(frozen=True, slots=True)
class TaskLine:
    """Results of one policy on the variations of a task and on the training trials that they are derived from."""

    policy: str
    training: Figure
    variation: Figure
    gap: Figure
    grasps: Figure
    needless: Figure
    segments: tuple[Segment, ...]
    failure: Failure | None
    findings: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class TaskView:
    """One task with its conditions. Training conditions come first."""

    task: str
    title: str
    lines: tuple[TaskLine, ...]
    training: ConditionGroup | None
    variations: tuple[ConditionGroup, ...]

    @property
    def conditions(self) -> tuple[ConditionGroup, ...]:
        """All conditions. Training conditions come first."""
        return self.variations if self.training is None else (self.training, *self.variations)

    @property
    def anchor(self) -> str:
        """Identifier of the task on the page and in the URL."""
        return f"task={self.task}"


def task_views(diagnoses: Sequence[RunDiagnosis]) -> tuple[TaskView, ...]:
    """Return one view per task of the given runs, with its conditions and the results of every policy."""
    by_id: dict[str, list[tuple[str, ConditionRow]]] = {}
    for diagnosis in diagnoses:
        for row in (*training_rows(diagnosis), *variation_rows(diagnosis)):
            by_id.setdefault(row.id, []).append((diagnosis.policy, row))
    tasks: dict[str, list[ConditionGroup]] = {}
    for rows in by_id.values():
        tasks.setdefault(rows[0][1].task, []).append(ConditionGroup(rows[0][1], tuple(rows)))
    return tuple(
        TaskView(
            task,
            _title(task, groups),
            _lines(diagnoses, task),
            next((group for group in groups if group.first.variation is None), None),
            tuple(group for group in groups if group.first.variation is not None),
        )
        for task, groups in sorted(tasks.items())
    )


def _title(task: str, groups: Sequence[ConditionGroup]) -> str:
    """Return the title of a task. For a task from another simulated world, return its instruction."""
    return task_title(task) if facts_of_task(task).measured else groups[0].first.twin_instruction


def _lines(diagnoses: Sequence[RunDiagnosis], task: str) -> tuple[TaskLine, ...]:
    lines = []
    for d in diagnoses:
        mine = [t for t in d.even_trials if t.task == task]
        if mine:
            lines.append(_line(d, task, [t for t in mine if t.variation is not None]))
    return tuple(lines)


def _line(d: RunDiagnosis, task: str, varied: list[TrialDiagnosis]) -> TaskLine:
    about = re.compile(rf" trials of {re.escape(task)} ")
    training = twin_figure(d, task)
    return TaskLine(
        d.policy,
        Figure.of(d.metric("success_rate", f"{task}/training")) if training.missing else training,
        Figure.of(d.metric("success_rate", task)),
        Figure.gap(d, task),
        Figure.of(d.metric("distractor_grasp_rate", task), noun="grasps"),
        Figure.of(d.metric("success_with_a_needless_step", task)),
        segments_of(varied),
        leading_failure(varied),
        tuple(sentence for sentence in d.findings if about.search(sentence)),
    )
