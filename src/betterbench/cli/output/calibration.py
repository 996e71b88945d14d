"""Functions that print a calibration, which tests the diagnosis on policies with known faults."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from betterbench.cli.console import OUT, print_item, print_table, progress_bar, say
from betterbench.diagnosis import Calibration, Judged
from betterbench.diagnosis.measures.power_matrix import PowerMatrix
from betterbench.errors import MissingDependencyError
from betterbench.evaluation import render_strips
from betterbench.records import RunFolder
from betterbench.report.pages.calibration_page import KINDS, calibration_summary, label_name, rate_text
from betterbench.report.pages.power_page import power_sentences, power_tables

WRONG_SHOWN = 12
"""Maximum number of wrong labels that are printed. The page lists all of them."""


def print_calibration(found: Calibration) -> None:
    """Print a table of labels, and examples of wrong labels.

    For each label, the table shows the recall (the fraction of trials with this true label that get the label) and the
    precision (the fraction of trials with the assigned label for which it is correct).
    """
    rows = [
        [
            label_name(s.label),
            KINDS[s.label.kind],
            rate_text(s.recall),
            rate_text(s.precision),
            _taken_for(found, s.label),
        ]
        for s in found.scores()
    ]
    print_table(
        ["true label", "kind", "found", "correct if assigned", "otherwise labeled as"], rows, title="calibration"
    )
    for j in found.wrong[:WRONG_SHOWN]:
        print_item(f"• {j.policy} {j.trial}: {j.truth.value} was labeled {j.label.value}. {j.text}")
    if len(found.wrong) > WRONG_SHOWN:
        OUT.print(f"  and {len(found.wrong) - WRONG_SHOWN} more on the page", markup=False)
    OUT.print(calibration_summary(found), markup=False)


def film_strips(wrong: Sequence[Judged], out: Path) -> dict[tuple[str, str], bytes]:
    """Return a film strip (JPEG) for each wrong label, by policy and trial.

    The frames come from the runs in ``out``.
    """
    strips: dict[tuple[str, str], bytes] = {}
    if not wrong:
        return strips
    runs = {run.plan["policy"]: run for run in map(RunFolder.open, sorted(p.parent for p in out.glob("*/run.json")))}
    with progress_bar("film strips", len(wrong), stays=False) as (bar, task):
        for policy in dict.fromkeys(j.policy for j in wrong):
            keys = {_trial(j.trial): j.trial for j in wrong if j.policy == policy}
            try:
                images = render_strips(runs[policy], list(keys))
            except MissingDependencyError as error:
                say(f"no film strips: {error}")
                return {}
            strips |= {(policy, keys[trial]): image for trial, image in images.items()}
            bar.update(task, completed=len(strips))
    return strips


def _trial(key: str) -> tuple[str, str, int]:
    task, condition, seed = key.split("/")
    return task, condition, int(seed)


def print_power(found: PowerMatrix) -> None:
    """Print the success rates of all pretenders (simulated faulty policies), and a summary of the power matrix."""
    table = power_tables(found)[0]
    rows = [[cell.replace("`", "") for cell in row] for row in table.rows]
    print_table(list(table.columns), rows, title="power matrix: success, %")
    for sentence in power_sentences(found):
        print_item(f"• {sentence}")


def _taken_for(found: Calibration, label: object) -> str:
    others = {g: n for (t, g), n in found.counts.items() if t is label and g is not t}
    return ", ".join(f"{label_name(g)} {n}" for g, n in sorted(others.items(), key=lambda item: -item[1]))
