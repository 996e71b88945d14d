"""``better audit-paper``: consistency checks of published numbers, and statistical tests of claims."""

from __future__ import annotations

from pathlib import Path

from betterbench.cli.console import print_json


def audit_command(*, json: bool = False, tables: Path | None = None) -> None:
    """Recompute the numbers in the paper's tables, and test whether its claims are statistically supported.

    Example: better audit-paper

    Args:
        json: Print one JSON document instead of text.
        tables: File to audit instead of the packaged tables from the benchmark's paper, in the same format.
    """
    from betterbench_calibration.audit import audit_source, load_tables, paper_tables
    from betterbench_calibration.cli.audit_output import print_audit

    audit = audit_source(paper_tables() if tables is None else load_tables(tables))
    if json:
        print_json(audit.to_json())
    else:
        print_audit(audit)
