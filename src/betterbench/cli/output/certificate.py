"""Functions that print a certificate, which proves that trials can be solved."""

from __future__ import annotations

from typing import Any

from betterbench.certification import CLAUSES, Certificate, summaries
from betterbench.cli.console import OUT, print_table


def print_certificate(certificate: Certificate) -> None:
    """Print the conditions for which a clause of the certificate failed, and the totals over all conditions."""
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
    n, solved, ambiguous = len(certificate.trials), certificate.solved, len(certificate.ambiguous)
    passed = sum(t.passed for t in certificate.trials)
    workers = f"{certificate.workers} worker{'' if certificate.workers == 1 else 's'}"
    of_what = f"{variations} variations, {len(groups) - variations} training conditions"
    OUT.print(f"certified   {passed} of {n} trials ({of_what})", markup=False, soft_wrap=True)
    aside = f"; {ambiguous} ambiguous trials have no right outcome" if ambiguous else ""
    said = f"solves {solved.k} of {solved.n}, {certificate.expert_s:.2f} s per trial{aside}"
    OUT.print(f"expert      {said}", markup=False, soft_wrap=True)
    OUT.print(f"total time  {certificate.wall_s:.0f} s with {workers}", markup=False)
