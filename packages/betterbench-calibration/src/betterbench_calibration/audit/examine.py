"""Audit of a file of tables: checks the rules of all tables, and lists the numbers that no rule checks."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from betterbench_calibration.audit.finding import AuditFinding, Verdict
from betterbench_calibration.audit.load import PaperSource
from betterbench_calibration.audit.table import AuditedTable, AuditRule, misprints


@dataclass(frozen=True, slots=True)
class TableAudit:
    """Findings on one table, sorted from the worst to the best verdict."""

    table: AuditedTable
    findings: tuple[AuditFinding, ...]

    def count(self, verdict: Verdict) -> int:
        """Return the number of findings with a verdict."""
        return sum(f.verdict is verdict for f in self.findings)


@dataclass(frozen=True, slots=True)
class Audit:
    """Findings on all tables, in the order of the file."""

    source: str
    tables: tuple[TableAudit, ...]

    @property
    def findings(self) -> tuple[AuditFinding, ...]:
        """All findings, table by table."""
        return tuple(f for table in self.tables for f in table.findings)

    def count(self, verdict: Verdict) -> int:
        """Return the number of findings with a verdict."""
        return sum(table.count(verdict) for table in self.tables)

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict."""
        return {
            "source": self.source,
            "summary": {verdict.value: self.count(verdict) for verdict in Verdict},
            "checks": len(self.findings),
            "tables": [
                {"name": a.table.name, "title": a.table.title, "findings": [f.to_json() for f in a.findings]}
                for a in self.tables
            ],
        }


def audit_source(source: PaperSource) -> Audit:
    """Check the rules of all tables. Raises UnknownNameError if a rule names an unknown table, row or column."""
    paper = source.by_name
    return Audit(source.name, tuple(audit_table(table, rules, paper) for table, rules in source.tables))


def audit_table(
    table: AuditedTable, rules: Sequence[AuditRule], paper: Mapping[str, AuditedTable] | None = None
) -> TableAudit:
    """Check the rules of one table."""
    found = [f for rule in rules for f in rule.findings(table, paper or {table.name: table})]
    found += _unread(table, found)
    return TableAudit(table, tuple(sorted(found, key=lambda f: f.verdict.rank)))


def _unread(table: AuditedTable, found: Sequence[AuditFinding]) -> Iterator[AuditFinding]:
    """Yield one finding per number that no rule checks."""
    read = {cell for f in found for cell in f.covers}
    for (row, column), number in table.printed():
        if (row, column) not in read:
            possible = len(tuple(misprints(number)))
            why = "No rule checks this number."
            covers = ((row, column),)
            yield AuditFinding(
                table.name, "unread", row, column, str(number), "", Verdict.UNKNOWN, why, covers, possible, possible
            )
