"""Numbers of the running text: each must be the number of the table that it speaks of."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from betterbench.audit.fields import Column, Row, Text, exact_fields
from betterbench.audit.finding import AuditFinding, Verdict
from betterbench.audit.table import AuditedTable, misprints
from betterbench.errors import UnknownNameError


@exact_fields
@dataclass(frozen=True, slots=True)
class Quoted:
    """A number is quoted from another table.

    Attributes:
        row: Row of the quotation.
        column: Column of the quotation.
        table: Name of the table that is quoted.
        at_row: Row there.
        at_column: Column there.
    """

    row: Row
    column: Column
    table: Text
    at_row: Text
    at_column: Text

    def findings(self, table: AuditedTable, paper: Mapping[str, AuditedTable]) -> Iterator[AuditFinding]:
        """Yield the finding about the quotation.

        Raises:
            UnknownNameError: If the table quoted, its row or its column does not exist.
        """
        if self.table not in paper:
            raise UnknownNameError("table", self.table, paper)
        printed, source = table.cell(self.row, self.column), paper[self.table].cell(self.at_row, self.at_column)
        if printed is None:
            return
        where = f"{self.table}, {self.at_row}, {self.at_column}"
        right = printed == source
        # A zero appended or left out does not change a number; any other wrong digit does.
        unnoticed = [wrong for wrong in misprints(printed) if wrong == source] if right else []
        yield AuditFinding(
            table.name,
            "quoted",
            self.row,
            self.column,
            str(printed),
            "nothing" if source is None else str(source),
            Verdict.HOLDS if right else Verdict.BROKEN,
            f"{where} says {'the same' if right else source}.",
            ((self.row, self.column),),
            len(unnoticed),
            len(tuple(misprints(printed))) if right else 0,
        )
