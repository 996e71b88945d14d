"""Check that a quoted number equals the number in the table from which it is quoted."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from betterbench.errors import UnknownNameError
from betterbench_calibration.audit.fields import ColumnName, NonEmptyText, RowName, exact_fields
from betterbench_calibration.audit.finding import AuditFinding, Verdict
from betterbench_calibration.audit.table import AuditedTable, misprints


@exact_fields
@dataclass(frozen=True, slots=True)
class Quoted:
    """Rule that a number is quoted from another table.

    Attributes:
        row: Row of the number.
        column: Column of the number.
        table: Name of the table from which the number is quoted.
        at_row: Row in that table.
        at_column: Column in that table.
    """

    row: RowName
    column: ColumnName
    table: NonEmptyText
    at_row: NonEmptyText
    at_column: NonEmptyText

    def findings(self, table: AuditedTable, paper: Mapping[str, AuditedTable]) -> Iterator[AuditFinding]:
        """Yield one finding. Raises UnknownNameError if the quoted table, row or column does not exist."""
        if self.table not in paper:
            raise UnknownNameError("table", self.table, paper)
        printed, source = table.cell(self.row, self.column), paper[self.table].cell(self.at_row, self.at_column)
        if printed is None:
            return
        where = f"{self.table}, {self.at_row}, {self.at_column}"
        right = printed == source
        # A misprint is not detected if it does not change the value of the number.
        unnoticed = [wrong for wrong in misprints(printed) if wrong == source] if right else []
        verdict, why = (Verdict.HOLDS, "the same number") if right else (Verdict.BROKEN, str(source))
        cell, shown = (self.row, self.column), (str(printed), "nothing" if source is None else str(source))
        blind = len(unnoticed), len(tuple(misprints(printed))) if right else 0
        yield AuditFinding(table.name, "quoted", *cell, *shown, verdict, f"{where} contains {why}.", (cell,), *blind)
