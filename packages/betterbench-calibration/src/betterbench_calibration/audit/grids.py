"""Check that percentages of n trials are among the n + 1 possible values."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from decimal import Decimal

from betterbench_calibration.audit.counts import (
    count_behind,
    nearest_count,
    smallest_multiple,
    with_dropped,
    with_percentage,
)
from betterbench_calibration.audit.fields import ColumnNames, RowNames, WholeNumber, exact_fields
from betterbench_calibration.audit.finding import AuditFinding, Verdict
from betterbench_calibration.audit.table import AuditedTable, blindness, cached_by_digits, decimals


@exact_fields
@dataclass(frozen=True, slots=True)
class Grid:
    """Rule that each cell in the given rows and columns is a fraction of the same number of trials.

    By default, the rule applies to all rows and columns.
    """

    trials: WholeNumber
    rows: RowNames = ()
    columns: ColumnNames = ()

    def findings(self, table: AuditedTable, paper: Mapping[str, AuditedTable]) -> Iterator[AuditFinding]:  # noqa: ARG002 - see AuditRule
        """Yield one finding per cell, or a single finding if every printed percentage is possible."""
        rows, columns = self.rows or table.row_names, self.columns or table.columns
        cells = [(r, c, n) for r in rows for c in columns if (n := table.cell(r, c)) is not None]
        telling = [cell for cell in cells if self.trials < 100 * 10 ** decimals(cell[2])]
        if cells and not telling:
            yield self._mute(table, cells[0][2])
        for row, column, printed in telling:
            yield self._judge(table, row, column, printed)

    def _mute(self, table: AuditedTable, example: Decimal) -> AuditFinding:
        digits = decimals(example)
        written = f"{digits} decimal{'s' * (digits != 1)}"
        why = f"Every percentage with {written} is a k/{self.trials}, so this check cannot find a misprint."
        cell = ", ".join(self.columns or table.columns)
        return AuditFinding(table.name, "grid", "", cell, written, f"k/{self.trials}", Verdict.UNKNOWN, why)

    def _judge(self, table: AuditedTable, row: str, column: str, printed: Decimal) -> AuditFinding:
        count = count_behind(printed, self.trials)
        digits = decimals(printed)
        cell = (row, column)
        unnoticed, possible = _unnoticed(printed, self.trials)
        if count is not None:
            why = f"{printed} is {count}; {unnoticed} of {possible} wrong digits would be on the grid too."
            found, verdict = str(count), Verdict.HOLDS
        else:
            found, verdict = with_percentage(nearest_count(printed, self.trials), digits), Verdict.BROKEN
            why = f"{printed} is not a k/{self.trials}{self._explain(printed)}."
        return AuditFinding(
            table.name, "grid", row, column, str(printed), found, verdict, why, (cell,), unnoticed, possible
        )

    def _explain(self, printed: Decimal) -> str:
        parts = []
        fewer = with_dropped(printed, self.trials)
        if fewer is not None:
            missing = self.trials - fewer.n
            parts.append(f"with {missing} trial{'s' * (missing > 1)} missing it would be {fewer}")
        more = smallest_multiple(printed, self.trials)
        if more is not None:
            parts.append(f"{more} is the smallest multiple of the trials that gives it exactly")
        return f"; {', and '.join(parts)}" if parts else ", nor with up to 12 trials missing"


@cached_by_digits
def _unnoticed(printed: Decimal, trials: int) -> tuple[int, int]:
    """Return the number of misprints of one digit that are possible percentages too, and of all such misprints."""
    return blindness((printed,), lambda _, wrong: count_behind(wrong, trials) is not None)
