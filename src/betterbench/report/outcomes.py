"""Outcome counts per variation and per task, for the charts of a report."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

from betterbench.diagnosis.failure_mode import FailureMode
from betterbench.diagnosis.verdict import RunDiagnosis, TrialDiagnosis
from betterbench.errors import UnknownNameError
from betterbench.report.legend import EXPECTED_NAMES, LEGEND
from betterbench.report.wording import Figure
from betterbench.statistics import Rate
from betterbench.tasks import Task, Variation, get_task
from betterbench.tasks.worlds.facts import facts_of_task
from betterbench.tasks.worlds.libero import CHANGES
from betterbench.tasks.worlds.libero_plus import AXES as PLUS_AXES


@dataclass(frozen=True, slots=True)
class Segment:
    """Segment of an outcome bar: a failure mode or a success, with its number of trials."""

    mode: FailureMode
    count: int


@dataclass(frozen=True, slots=True)
class ConditionRow:
    """Outcomes of one policy on one variation, or on all training conditions of a task.

    Attributes:
        id: "fast_food/T1", or "fast_food/training".
        variation: Variation name, or None for the training conditions.
        hypothesis: Hypothesis that the variation tests, or an empty string if the task is unknown.
        expected: Correct behavior, in words.
        instruction: The instruction, or the first of several.
        twin_instruction: Instruction of the training condition from which a variation is derived.
        support: Whether the poses are inside the training distribution, or an empty string.
        twin: Success rate of the counterfactual twins in the run's pairs.
        segments: Non-empty outcomes in stacking order.
        verdict: For a run until decided, the verdict in words; otherwise an empty string.
    """

    id: str
    task: str
    variation: str | None
    axis: str | None
    title: str
    hypothesis: str
    expected: str
    instruction: str
    twin_instruction: str
    support: str
    trial: Figure
    twin: Figure
    gap: Figure
    segments: tuple[Segment, ...]
    verdict: str = ""

    def count_of(self, family: str) -> int:
        """Return the number of trials in a color family."""
        return sum(segment.count for segment in self.segments if segment.mode.family == family)


_CHANGES = {**CHANGES, **PLUS_AXES}
"""Descriptions of the changes in LIBERO-PRO and LIBERO-Plus suites, by name of the change."""


def task_of(name: str) -> Task | None:
    """Return a task of the suite, or None if this version has no task with that name."""
    try:
        return get_task(name)
    except UnknownNameError:
        return None


def is_abroad(diagnosis: RunDiagnosis) -> bool:
    """Return whether a run is in another world. Other worlds have no matrices, pretenders or certificates."""
    return bool(diagnosis.trials) and not any(facts_of_task(trial.task).measured for trial in diagnosis.trials)


def task_title(name: str) -> str:
    """Return a task's title, or its id."""
    task = task_of(name)
    return name if task is None else task.title


def variation_rows(diagnosis: RunDiagnosis) -> list[ConditionRow]:
    """Return one row per variation in a run, in suite order."""
    groups: dict[tuple[str, str], list[TrialDiagnosis]] = {}
    for trial in diagnosis.trials:
        if trial.variation is not None:
            groups.setdefault((trial.task, trial.pool), []).append(trial)
    twins = {trial.key: trial for trial in diagnosis.trials if trial.variation is None}
    return [
        _variation_row(diagnosis, task, name, groups[task, name], twins)
        for task, name in sorted(groups, key=lambda key: (key[0], suite_rank(*key)))
    ]


def training_rows(diagnosis: RunDiagnosis) -> list[ConditionRow]:
    """Return one row per task with the outcomes of all its training conditions."""
    groups: dict[str, list[TrialDiagnosis]] = {}
    for trial in diagnosis.even_trials:
        if trial.variation is None:
            groups.setdefault(trial.task, []).append(trial)
    return [
        ConditionRow(
            f"{task}/training", task, None, None, "training conditions", "", EXPECTED_NAMES["succeed"],
            trials[0].instruction, trials[0].instruction, "", _rate(diagnosis, f"{task}/training", trials), Figure(),
            Figure(), segments_of(trials),
        )
        for task, trials in sorted(groups.items())
    ]  # fmt: skip


def segments_of(trials: list[TrialDiagnosis]) -> tuple[Segment, ...]:
    """Return the outcomes of trials in stacking order."""
    counts = Counter(trial.label for trial in trials)
    return tuple(Segment(mode, counts[mode.label]) for mode in LEGEND.values() if counts[mode.label])


def suite_rank(task: str, variation: str) -> tuple[int, str]:
    """Return the rank of a variation in its task's table; unknown names come last, sorted."""
    known = task_of(task)
    names = [v.name for v in known.variations] if known is not None else []
    return (names.index(variation) if variation in names else len(names), variation)


def _variation_row(
    diagnosis: RunDiagnosis, task: str, name: str, trials: list[TrialDiagnosis], twins: dict[str, TrialDiagnosis]
) -> ConditionRow:
    known = _variation(task, name)
    found = [twins[key] for t in trials if (key := t.twin_key) is not None and key in twins]
    decided = diagnosis.until_decided
    answer = None if decided is None else decided.answer(f"{task}/{name}")
    return ConditionRow(
        f"{task}/{name}",
        task,
        name,
        trials[0].axis,
        known.title if known is not None else "" if facts_of_task(task).measured else _CHANGES.get(name, ""),
        known.hypothesis if known is not None else "",
        EXPECTED_NAMES.get(trials[0].expected, trials[0].expected),
        trials[0].instruction,
        _twin_instruction(trials[0], found),
        known.support.value if known is not None else "",
        _rate(diagnosis, f"{task}/{name}", trials),
        Figure.of(diagnosis.metric("twin_success_rate", f"{task}/{name}"), noun="pairs"),
        Figure.gap(diagnosis, f"{task}/{name}"),
        segments_of(trials),
        "" if answer is None else answer.verdict.words,
    )


def _twin_instruction(trial: TrialDiagnosis, twins: list[TrialDiagnosis]) -> str:
    """Return the instruction of a variation trial's training condition, from the task or else from a twin."""
    known = task_of(trial.task)
    told = next((c.instruction.text for c in known.training if c.name == trial.condition), "") if known else ""
    return told or (twins[0].instruction if twins else trial.instruction)


def _variation(task: str, name: str) -> Variation | None:
    known = task_of(task)
    if known is None:
        return None
    return next((v for v in known.variations if v.name == name), None)


def _rate(diagnosis: RunDiagnosis, scope: str, trials: list[TrialDiagnosis]) -> Figure:
    """Return the success rate from the run metrics, or counted from the trials if it is missing there."""
    metric = diagnosis.metric("success_rate", scope)
    if metric is not None:
        return Figure.of(metric)
    trials = [t for t in trials if not t.ambiguous]
    return Figure.of_rate(Rate(sum(t.success for t in trials), len(trials)))
