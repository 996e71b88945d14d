"""A calibration as text."""

from __future__ import annotations

from betterbench.cli.console import OUT, print_table
from betterbench.diagnosis import Calibration
from betterbench.diagnosis.power_matrix import PowerMatrix
from betterbench.report.calibration_page import KINDS, label_name, rate_text
from betterbench.report.power_page import power_sentences, power_tables

WRONG_SHOWN = 12
"""Wrong labels that the terminal lists; the page has them all."""


def print_calibration(found: Calibration) -> None:
    """Print how well each label is found and the first wrong labels."""
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
    print_table(["true label", "kind", "found", "right when given", "otherwise taken for"], rows, title="calibration")
    for j in found.wrong[:WRONG_SHOWN]:
        OUT.print(f"• {j.policy} {j.trial}: {j.truth.value} was labeled {j.label.value}. {j.text}", markup=False)
    if len(found.wrong) > WRONG_SHOWN:
        OUT.print(f"  and {len(found.wrong) - WRONG_SHOWN} more on the page", markup=False)
    OUT.print(
        f"right       {rate_text(found.overall)} of all trials, {rate_text(found.failed)} of the failed ones",
        markup=False,
    )
    OUT.print(
        f"reasoning taken for execution, or execution for reasoning: {rate_text(found.crossed_rate)}", markup=False
    )


def print_power(found: PowerMatrix) -> None:
    """Print what every pretender reaches over the suite, and what the matrix says about the suite."""
    table = power_tables(found)[0]
    rows = [[cell.replace("`", "") for cell in row] for row in table.rows]
    print_table(list(table.columns), rows, title="power matrix: success, %")
    for sentence in power_sentences(found):
        OUT.print(f"• {sentence}", markup=False)


def _taken_for(found: Calibration, label: object) -> str:
    others = {g: n for (t, g), n in found.counts.items() if t is label and g is not t}
    return ", ".join(f"{label_name(g)} {n}" for g, n in sorted(others.items(), key=lambda item: -item[1]))
