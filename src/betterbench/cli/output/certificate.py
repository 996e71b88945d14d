"""A certificate as text."""

from __future__ import annotations

from typing import Any

from betterbench.certification import CLAUSES, Certificate, summaries
from betterbench.cli.console import OUT, print_table


def print_certificate(certificate: Certificate) -> None:
    """Print the conditions for which a clause of the certificate fails, and the totals."""
    groups = summaries(certificate.trials)
    short = [s for s in groups if s.passed < s.n]
    if short:
        rows: list[list[Any]] = [
            [f"{s.task}/{s.condition}", f"{s.passed}/{s.n}", *(str(s.clauses[letter]) for letter in CLAUSES)]
            for s in short
        ]
        print_table(
            ["condition", "passed", *(f"({letter})" for letter in CLAUSES)],
            rows,
            title="conditions with a failed clause",
        )
    else:
        OUT.print("all clauses hold for every trial", markup=False)
    variations = sum(not s.training for s in groups)
    n, solved = len(certificate.trials), sum(t.clauses["a"].passed for t in certificate.trials)
    passed = sum(t.passed for t in certificate.trials)
    workers = f"{certificate.workers} worker{'' if certificate.workers == 1 else 's'}"
    of_what = f"{variations} variations, {len(groups) - variations} training conditions"
    OUT.print(f"certified   {passed} of {n} trials ({of_what})", markup=False, soft_wrap=True)
    OUT.print(f"expert      solves {solved} of {n}, {certificate.expert_s:.2f} s per trial", markup=False)
    OUT.print(f"total time  {certificate.wall_s:.0f} s with {workers}", markup=False)
