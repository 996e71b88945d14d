"""A calibration as text."""

from __future__ import annotations

from betterbench.cli.console import OUT, print_table
from betterbench.diagnosis import Calibration
from betterbench.report.calibration_page import KINDS, label_name, rate_text, suspicious

WRONG_SHOWN = 12
"""Wrong labels that the terminal lists; the page has them all."""


def print_calibration(found: Calibration) -> None:
    """Print how well each label is found, the first wrong labels and the suspicious probes."""
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
    for c in suspicious(found.probes):
        guess = f"guessing would solve a share of {c.chance:.2f}"
        OUT.print(f"• {c.probe} solves {c.task}/{c.variation} in {c.k}/{c.n} trials; {guess}", markup=False)
    OUT.print(
        f"right       {rate_text(found.overall)} of all trials, {rate_text(found.failed)} of the failed ones",
        markup=False,
    )
    OUT.print(
        f"reasoning taken for execution, or execution for reasoning: {rate_text(found.crossed_rate)}", markup=False
    )


def _taken_for(found: Calibration, label: object) -> str:
    others = {g: n for (t, g), n in found.counts.items() if t is label and g is not t}
    return ", ".join(f"{label_name(g)} {n}" for g, n in sorted(others.items(), key=lambda item: -item[1]))
