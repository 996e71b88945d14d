"""``better diagnose``: why each trial ended as it did."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Annotated

import tyro

from betterbench.cli.console import OUT, print_json, print_table
from betterbench.diagnosis import Metric, RunDiagnosis, diagnose_run
from betterbench.recording import RunFolder
from betterbench.statistics import percent


def diagnose(run: Annotated[Path, tyro.conf.Positional], *, json: bool = False) -> None:
    """Diagnose every trial of a run from its records alone.

    Example: better diagnose runs/expert

    Args:
        run: Folder of the run.
        json: Print one JSON document instead of tables.
    """
    result = diagnose_run(RunFolder.open(run))
    if json:
        print_json(result.to_json())
        return
    print_diagnosis(result)


def print_diagnosis(result: RunDiagnosis) -> None:
    """Print the outcome of each variation, the metrics and the findings."""
    groups: dict[str, list[str]] = {}
    for trial in result.trials:
        groups.setdefault(f"{trial.task}/{trial.variation or trial.condition}", []).append(trial.label.value)
    rows = []
    for name, labels in groups.items():
        counts = Counter(labels).most_common()
        right = sum(n for label, n in counts if label in ("success", "correct_freeze", "correct_refusal"))
        rest = ", ".join(f"{label} {n}" for label, n in counts)
        rows.append([name, f"{right}/{len(labels)}", f"{percent(right, len(labels))} %", rest])
    print_table(["condition", "k/n", "success", "outcomes"], rows, title=result.policy)
    OUT.print()
    shown = [m for m in result.metrics if m.scope in ("overall", "training") or m.name in ("illusion_gap", "delta_sr")]
    shown = [m for m in shown if m.n and "/" not in m.scope]
    print_table(["metric", "over", "value", "95 % interval", "k/n"], [_metric_row(m) for m in shown])
    for finding in result.findings:
        OUT.print(f"• {finding}", markup=False)
    for note in result.notes:
        OUT.print(f"  {note}", markup=False, style="dim")


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
