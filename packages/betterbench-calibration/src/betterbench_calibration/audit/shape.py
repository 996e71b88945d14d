"""Checks that rates never increase along columns, and that rows are not copies of other rows."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from decimal import Decimal

from betterbench_calibration.audit.fields import ColumnName, ColumnNames, exact_fields
from betterbench_calibration.audit.finding import AuditFinding, TableCell, Verdict
from betterbench_calibration.audit.table import AuditedTable, blindness, cached_by_digits, replaced


@exact_fields
@dataclass(frozen=True, slots=True)
class Falling:
    """Rule that the rates in a row never increase along the columns.

    For example, a policy that solves five successive tasks has also solved four.
    """

    columns: ColumnNames

    def findings(self, table: AuditedTable, paper: Mapping[str, AuditedTable]) -> Iterator[AuditFinding]:  # noqa: ARG002 - see AuditRule
        """Yield one finding per row."""
        for row in table.row_names:
            numbers: dict[TableCell, Decimal] = {
                (row, c): n for c in self.columns if (n := table.cell(row, c)) is not None
            }
            row_numbers = tuple(numbers.values())
            rises = [f"{a} before {b}" for a, b in itertools.pairwise(row_numbers) if b > a]
            listed = ", ".join(map(str, row_numbers))
            cell = f"{self.columns[0]} to {self.columns[-1]}"
            verdict, blind = (Verdict.BROKEN, (0, 0)) if rises else (Verdict.HOLDS, _unnoticed_rises(row_numbers))
            why = f"The rates rise: {', '.join(rises)}." if rises else "The rates never rise."
            yield AuditFinding(table.name, "falling", row, cell, listed, "", verdict, why, tuple(numbers), *blind)


@cached_by_digits
def _unnoticed_rises(numbers: tuple[Decimal, ...]) -> tuple[int, int]:
    """Return the number of misprints of one digit with which the rates still never increase, and of all misprints."""

    def holds(at: int, wrong: Decimal) -> bool:
        return all(b <= a for a, b in itertools.pairwise(replaced(numbers, at, wrong)))

    return blindness(numbers, holds)


@exact_fields
@dataclass(frozen=True, slots=True)
class Measured:
    """Rule that each row was measured separately in the given columns.

    Two rows that differ in other columns must therefore not be equal in all of these columns.
    """

    columns: ColumnNames

    def findings(self, table: AuditedTable, paper: Mapping[str, AuditedTable]) -> Iterator[AuditFinding]:  # noqa: ARG002 - see AuditRule
        """Yield one finding per row that repeats an earlier row, or a single finding if there is no such row."""
        others = [c for c in table.columns if c not in self.columns]
        cell = f"{self.columns[0]} to {self.columns[-1]}"
        repeated = False
        for first, second in itertools.combinations(table.row_names, 2):
            here = [table.cell(second, c) for c in self.columns]
            same = None not in here and here == [table.cell(first, c) for c in self.columns]
            differing = sum(table.cell(first, c) != table.cell(second, c) for c in others)
            if not same or not differing:
                continue
            repeated = True
            why = (
                f"All {len(here)} numbers equal those of {first}, although {differing}/{len(others)} other "
                "columns differ. It was not measured again, or the change does not affect this benchmark."
            )
            listed = "/".join(map(str, here))
            covers = tuple((row, c) for row in (first, second) for c in self.columns)
            yield AuditFinding(table.name, "measured", second, cell, listed, listed, Verdict.BROKEN, why, covers)
        if not repeated:
            why = "No two rows agree in all these columns."
            yield AuditFinding(table.name, "measured", "", cell, f"{len(table.rows)} rows", "", Verdict.HOLDS, why)


@exact_fields
@dataclass(frozen=True, slots=True)
class Shares:
    """Rule that computes the shares of a mixture of which only the weights are printed."""

    column: ColumnName

    def findings(self, table: AuditedTable, paper: Mapping[str, AuditedTable]) -> Iterator[AuditFinding]:  # noqa: ARG002 - see AuditRule
        """Yield one finding per weight. It contains the share, which cannot be checked."""
        weights = {row: n for row in table.row_names if (n := table.cell(row, self.column)) is not None}
        total = sum(weights.values())
        for row, weight in weights.items():
            share = f"{weight}/{total} = {(100 * weight / total).normalize():f} %" if total else ""
            why = "Only the weight is printed; no share to compare it with."
            cell = (row, self.column)
            yield AuditFinding(table.name, "shares", *cell, str(weight), share, Verdict.UNKNOWN, why, (cell,), 1, 1)
