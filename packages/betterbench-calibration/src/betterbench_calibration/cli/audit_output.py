"""Text output of the audit of printed numbers."""

from __future__ import annotations

from collections import Counter

from rich.table import Table

from betterbench.cli.console import OUT, styled_text
from betterbench_calibration.audit import Audit, AuditFinding, TableAudit, Verdict

_STYLES = {Verdict.BROKEN: "bold red", Verdict.UNSUPPORTED: "yellow", Verdict.UNKNOWN: "dim", Verdict.HOLDS: "green"}
_SUMMARY = {
    Verdict.BROKEN: "do not hold",
    Verdict.UNSUPPORTED: "are not supported by their trials",
    Verdict.UNKNOWN: "cannot be checked",
    Verdict.HOLDS: "hold",
}
_VERDICT_WIDTH = 17
"""Width of the first column, in which "cannot be checked" fits on one line."""


def print_audit(audit: Audit) -> None:
    """Print the findings by table, starting with the table that has most errors, and then a summary."""
    OUT.print(audit.source, markup=False)
    for table in sorted(audit.tables, key=lambda t: [-t.count(verdict) for verdict in Verdict][:-1]):
        OUT.print()
        OUT.print(f"[bold]{styled_text(table.table.name)}[/]  {styled_text(table.table.title)}", markup=True)
        OUT.print(_listing(table), markup=True)
    counts = ", ".join(f"{audit.count(verdict)} {text}" for verdict, text in _SUMMARY.items())
    OUT.print(f"\n{len(audit.findings)} checks: {counts}.", markup=False)


def _listing(audit: TableAudit) -> Table:
    """Return a table with one line per check that does not hold, and the number of checks that hold."""
    listing = Table(box=None, show_header=False, pad_edge=False, padding=(0, 2, 0, 0))
    listing.add_column(width=_VERDICT_WIDTH)
    listing.add_column(overflow="fold")
    for finding in audit.findings:
        if finding.verdict is not Verdict.HOLDS:
            listing.add_row(f"[{_STYLES[finding.verdict]}]{_verdict(finding)}[/]", _line(finding))
    checked = Counter(f.rule for f in audit.findings)
    held = Counter(f.rule for f in audit.findings if f.verdict is Verdict.HOLDS)
    if held:
        shares = ", ".join(f"{rule} {held[rule]}/{n}" for rule, n in checked.items() if held[rule])
        listing.add_row(f"[{_STYLES[Verdict.HOLDS]}]holds[/]", styled_text(shares))
    return listing


def _verdict(finding: AuditFinding) -> str:
    """Return the verdict with "n" replaced by the number of trials."""
    if finding.support is None:
        return finding.verdict.value
    return finding.verdict.value.replace(" n ", f" {min(finding.support.trials)} ")


def _line(finding: AuditFinding) -> str:
    """Return a finding as one line of markup."""
    where = ", ".join(part for part in (finding.row, finding.cell) if part)
    told = finding.support is not None or finding.recomputed in ("", finding.printed)
    recomputed = "" if told else f", recomputed {finding.recomputed}"
    return f"[bold]{styled_text(where)}[/]: {styled_text(f'printed {finding.printed}{recomputed}. {finding.why}')}"
