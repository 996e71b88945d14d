"""Outcome counts of each variation and each task, for the charts of a report."""

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
    """Segment of an outcome bar.

    It shows the number of trials with one failure mode, or the number of successful trials.
    """

    mode: FailureMode
    count: int


@dataclass(frozen=True, slots=True)
class ConditionRow:
    """Outcomes of one policy on one variation, or on all training conditions of a task.

    Attributes:
        id: "fast_food/T1" for a variation, "fast_food/training" for training conditions.
        variation: Variation name; None for training conditions.
        hypothesis: Hypothesis that the variation tests; "" if the task is unknown.
        expected: Description of the correct behavior.
        instruction: The instruction, or the first of several.
        twin_instruction: Instruction of the training condition that the variation is derived from.
        support: Whether the required poses lie inside the training distribution; "" if unknown.
        trial: Success rate of the trials.
        twin: Success rate of those training twins (training trials with the same seeds) that are in the run.
        gap: Illusion gap: success rate of the training twins minus success rate of the variation trials.
        segments: Outcomes that occurred, in the order in which the chart stacks them.
        verdict: Verdict in words, for a run of ``better eval --until-decided``; "" for other runs.
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
        """Return the number of trials with an outcome of the given family, such as "reasoning"."""
        return sum(segment.count for segment in self.segments if segment.mode.family == family)


_CHANGES = {**CHANGES, **PLUS_AXES}
"""Description of each change in the LIBERO-PRO and LIBERO-Plus suites, by name of the change."""


def task_of(name: str) -> Task | None:
    """Return the task with the given name. Return None if this version of betterbench has no such task."""
    try:
        return get_task(name)
    except UnknownNameError:
        return None


def is_abroad(diagnosis: RunDiagnosis) -> bool:
    """Return whether a run is in a different simulated world, such as LIBERO.

    Runs in these worlds have no diagnostic matrices, reference policies or certificates.
    """
    return bool(diagnosis.worlds) and not any(world.measured for world in diagnosis.worlds)


def task_title(name: str) -> str:
    """Return the title of a task. If the task is unknown, return its name."""
    task = task_of(name)
    return name if task is None else task.title


def variation_rows(diagnosis: RunDiagnosis) -> list[ConditionRow]:
    """Return one row for each variation in a run, in the order of the suite."""
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
    """Return one row for each task with the outcomes of all its training conditions."""
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
    """Return the outcomes of trials, in the order in which the chart stacks them."""
    counts = Counter(trial.label for trial in trials)
    return tuple(Segment(mode, counts[mode.label]) for mode in LEGEND.values() if counts[mode.label])


def suite_rank(task: str, variation: str) -> tuple[int, str]:
    """Return the sort key of a variation in the table of its task. Unknown names come last, in alphabetical order."""
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
    """Return the instruction of the training condition that a variation trial is derived from.

    It is taken from the task or, if the task is unknown, from a training trial with the same seed.
    """
    known = task_of(trial.task)
    told = next((c.instruction.text for c in known.training if c.name == trial.condition), "") if known else ""
    return told or (twins[0].instruction if twins else trial.instruction)


def _variation(task: str, name: str) -> Variation | None:
    known = task_of(task)
    if known is None:
        return None
    return next((v for v in known.variations if v.name == name), None)


def _rate(diagnosis: RunDiagnosis, scope: str, trials: list[TrialDiagnosis]) -> Figure:
    """Return the success rate over a part of the trials, as given in the metrics of the run.

    If the metrics do not contain it, compute it from the trials.
    """
    metric = diagnosis.metric("success_rate", scope)
    if metric is not None:
        return Figure.of(metric)
    trials = [t for t in trials if not t.ambiguous]
    return Figure.of_rate(Rate(sum(t.success for t in trials), len(trials)))
