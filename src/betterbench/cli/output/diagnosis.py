"""Functions that print a diagnosis and the changes since the stored diagnosis."""

from __future__ import annotations

import textwrap
from collections import Counter

from betterbench.cli.console import OUT, passing_bar, print_item, print_table
from betterbench.diagnosis import Metric, RunDiagnosis, diagnose_run
from betterbench.diagnosis.changes import DiagnosisChanges, TrialChange
from betterbench.diagnosis.stored import StoredMetric
from betterbench.records import RunFolder
from betterbench.statistics import percent
from betterbench.tasks import Kind, Label

SHOWN_CHANGES = 20
"""Maximum number of changed trials and of changed metrics to print. The output of ``--json`` contains all of them."""


def diagnosed(run: RunFolder, *, twins_in: RunFolder | None = None) -> RunDiagnosis:
    """Diagnose a run and show a progress bar."""
    with passing_bar(f"diagnosing {run.path.name}") as told:
        return diagnose_run(run, twins_in=twins_in, on_progress=told)


def print_diagnosis(result: RunDiagnosis) -> None:
    """Print the outcomes of each variation, the metrics and the findings."""
    groups: dict[str, list[Label]] = {}
    for trial in result.trials:
        groups.setdefault(f"{trial.task}/{trial.variation or trial.condition}", []).append(trial.label)
    ambiguous = {f"{t.task}/{t.variation}" for t in result.trials if t.ambiguous}
    rows = []
    for name, labels in groups.items():
        counts = Counter(labels).most_common()
        right = sum(n for label, n in counts if label.kind is Kind.NONE)
        rest = ", ".join(f"{label} {n}" for label, n in counts)
        told = (
            ["–", "ambiguous"] if name in ambiguous else [f"{right}/{len(labels)}", f"{percent(right, len(labels))} %"]
        )
        rows.append([name, *told, *_verdict(result, name), rest])
    verdict = [] if result.until_decided is None else ["verdict"]
    print_table(["condition", "k/n", "success", *verdict, "outcomes"], rows, title=result.policy)
    OUT.print()
    beside = ("illusion_gap", "twin_success_rate", "paired_success_rate", "delta_sr")
    shown = [m for m in result.metrics if m.scope in ("overall", "training") or m.name in beside]
    shown = [m for m in shown if m.n and "/" not in m.scope]
    print_table(["metric", "over", "value, %", "95 % interval", "k/n"], [_metric_row(m) for m in shown])
    for finding in result.findings:
        print_item(f"• {finding}")
    for note in result.notes:
        OUT.print(f"  {note}", markup=False, style="dim")


def _verdict(result: RunDiagnosis, name: str) -> list[str]:
    """Return the verdict on a condition as a list of table cells.

    Only a run with ``--until-decided`` has verdicts; for other runs, the list is empty. The cell of a training
    condition is an empty string.
    """
    if result.until_decided is None:
        return []
    answer = result.until_decided.answer(name)
    return ["" if answer is None else answer.verdict.words]


def print_changes(changes: DiagnosisChanges) -> None:
    """Print the changes since the stored diagnosis."""
    OUT.print(f"\n{_headline(changes)}", markup=False, style="bold")
    for t in changes.thresholds:
        OUT.print(f"threshold {t.name}: {_number(t.before)} before, {_number(t.now)} now", markup=False)
    for (before, now), n in changes.counts.items():
        OUT.print(f"{n} × {before} → {now}", markup=False)
    grave, slight = changes.of_sort("label"), changes.of_sort("rule", "evidence")
    for trial in grave[:SHOWN_CHANGES]:
        _print_trial(trial)
    if len(grave) > SHOWN_CHANGES:
        OUT.print(f"… and {len(grave) - SHOWN_CHANGES} more trials; --json lists all", markup=False)
    if slight:
        by_rule = len(changes.of_sort("rule"))
        text = f"{len(slight)} trials keep their label with different evidence ({by_rule} by a different rule)"
        OUT.print(f"{text}; --json lists them", markup=False)
    others = changes.of_sort("record", "new", "gone")
    if others:
        finished = sum(t.before is not None and not t.before.has_record for t in others)
        text = f"{len(others)} trials have a different record or plan now ({finished} of them had no record before)"
        OUT.print(f"{text}; these are not changes of the diagnosis", markup=False)
    metrics = [m for m in changes.metrics if "/" not in m.scope]
    if metrics:
        rows = [[m.name, m.scope, _stored(m.before), _stored(m.now)] for m in metrics[:SHOWN_CHANGES]]
        rows = [[text.replace("axis:", "").replace("_", " ") for text in row] for row in rows]
        print_table(["metric", "over", "before", "now"], rows)
        if len(metrics) > SHOWN_CHANGES:
            OUT.print(f"… and {len(metrics) - SHOWN_CHANGES} more metrics; --json lists all", markup=False)


def _headline(changes: DiagnosisChanges) -> str:
    relabeled = sum(changes.counts.values())
    source = f"version {changes.version_before}"
    if changes.version_before != changes.version_now:
        source += f" (now {changes.version_now})"
    if not changes.trials:
        return f"The stored diagnosis of {source} gives every trial the same label and evidence."
    s = "" if relabeled == 1 else "s"
    return f"Changes since the stored diagnosis of {source}: {relabeled} trial{s} with a different label."


def _print_trial(change: TrialChange) -> None:
    before, now = change.labels
    OUT.print(f"{change.key}: {before} → {now}", markup=False)
    for name, trial in (("before", change.before), ("now", change.now)):
        if trial is not None:
            _print_indented(name, f"{trial.start_s:.2f} s  {trial.rule}: {trial.text}")
    _print_indented("because", "; ".join(change.reasons))


def _print_indented(name: str, text: str) -> None:
    lines = textwrap.wrap(text, max(40, OUT.width - 10))
    for first, line in zip((f"  {name:<7}", *[" " * 9] * len(lines)), lines, strict=False):
        OUT.print(f"{first} {line}", markup=False)


def _stored(metric: StoredMetric | None) -> str:
    if metric is None or metric.value is None:
        return "–"
    count = f"{metric.k}/{metric.n}" if metric.k is not None else f"n = {metric.n}"
    return f"{100 * metric.value:.1f} % ({count})"


def _number(value: float | None) -> str:
    return "none" if value is None else f"{value:g}"


def _metric_row(metric: Metric) -> list[str]:
    def points(value: float | None) -> str:
        return "–" if value is None else f"{100 * value:.1f}"

    count = f"{metric.k}/{metric.n}" if metric.k is not None else f"n = {metric.n}"
    return [
        metric.name.replace("_", " "),
        metric.scope.replace("axis:", "").replace("_", " "),
        points(metric.value),
        f"{points(metric.low)} to {points(metric.high)}",
        count,
    ]
