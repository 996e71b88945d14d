"""Arithmetic checks of totals, means and differences in a table, which allow for rounding."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction

from betterbench.statistics import round_half_up
from betterbench_calibration.audit.fields import (
    ColumnName,
    ColumnNames,
    Flag,
    RowName,
    RowNames,
    WholeNumber,
    exact_fields,
)
from betterbench_calibration.audit.finding import AuditFinding, TableCell, Verdict
from betterbench_calibration.audit.table import AuditedTable, blindness, cached_by_digits, decimals, misprints, replaced

Terms = tuple[tuple[Fraction, Decimal], ...]
"""Weight and printed number of each part."""


@dataclass(frozen=True, slots=True)
class Combination:
    """Check that a number is a weighted sum of other numbers.

    Attributes:
        kind: Name of the rule.
        rounded: Whether the parts were rounded before they were printed, so that the result may differ slightly.
        unit: Unit of the result, as a multiple of the unit of the parts (1,000,000 for "47.69M").
    """

    kind: str
    rounded: bool = False
    unit: int = 1

    def judge(
        self,
        table: AuditedTable,
        row: str,
        cell: str,
        target: tuple[TableCell, Decimal],
        parts: Mapping[TableCell, tuple[Fraction, Decimal]],
    ) -> AuditFinding:
        """Return the finding on a result.

        Args:
            table: Table that contains the result.
            row: Row of the result.
            cell: Column of the result.
            target: Cell of the result, and the printed result.
            parts: Weight and printed number of each part, by cell.
        """
        place, printed = target
        terms = tuple(parts.values())
        value, digits = self.value(terms), decimals(printed)
        recomputed = round_half_up(value, digits)
        verdict = Verdict.HOLDS if recomputed == printed else Verdict.BROKEN
        unnoticed, possible = _unnoticed(self, terms, printed) if verdict is Verdict.HOLDS else (0, 0)
        why = f"The parts give {_exactly(value)}, rounded half up {recomputed}"
        if verdict is Verdict.HOLDS:
            why += f"; {unnoticed} of {possible} wrong digits would not show."
        elif self.rounded and abs(value - Fraction(printed)) <= self.slack(terms) + _half_a_digit(printed):
            verdict = Verdict.UNKNOWN
            why += f", but the parts were rounded themselves, and unrounded ones could give {printed}."
        elif _truncated(value, digits) == printed:
            why += f": {printed} was truncated instead of rounded."
        else:
            why += f", not {printed}."
        covers = (*parts, place)
        shown = str(printed), str(recomputed)
        return AuditFinding(table.name, self.kind, row, cell, *shown, verdict, why, covers, unnoticed, possible)

    def value(self, terms: Terms) -> Fraction:
        """Return the exact weighted sum of the parts, in the unit of the result."""
        return sum((weight * Fraction(number) for weight, number in terms), Fraction(0)) / self.unit

    def slack(self, terms: Terms) -> Fraction:
        """Return the largest error of the result that rounding of the parts can cause."""
        return sum((abs(weight) * _half_a_digit(number) for weight, number in terms), Fraction(0)) / self.unit


@cached_by_digits
def _unnoticed(combination: Combination, terms: Terms, printed: Decimal) -> tuple[int, int]:
    """Return the number of misprints of one digit that would not be detected, and of all such misprints."""
    weights = tuple(weight for weight, _ in terms)
    numbers = (*(number for _, number in terms), printed)

    def holds(at: int, wrong: Decimal) -> bool:
        *parts, result = replaced(numbers, at, wrong)
        value = combination.value(tuple(zip(weights, parts, strict=True)))
        return round_half_up(value, decimals(result)) == result

    return blindness(numbers, holds)


def _half_a_digit(number: Decimal) -> Fraction:
    """Return half of the place value of the last printed digit."""
    return Fraction(1, 2 * 10 ** decimals(number))


@exact_fields
@dataclass(frozen=True, slots=True, kw_only=True)
class _RowCombination:
    """Rule that, in each row, one column is a weighted sum of other columns.

    The name of the rule is the name of the class in lower case.

    Attributes:
        target: Column of the result.
        rows: Rows to which the rule applies. By default, all rows.
        rounded_parts: Whether the parts were rounded before they were printed.
    """

    target: ColumnName
    rows: RowNames = ()
    rounded_parts: Flag = False

    @property
    def weights(self) -> dict[str, Fraction]:
        """Weight of each part's column."""
        raise NotImplementedError

    def findings(self, table: AuditedTable, paper: Mapping[str, AuditedTable]) -> Iterator[AuditFinding]:  # noqa: ARG002 - see AuditRule
        """Yield one finding per row."""
        combination = Combination(type(self).__name__.lower(), rounded=self.rounded_parts)
        for row in self.rows or table.row_names:
            printed = table.cell(row, self.target)
            parts = {(row, c): (w, n) for c, w in self.weights.items() if (n := table.cell(row, c)) is not None}
            if printed is None:
                continue
            if len(parts) < len(self.weights):
                yield missing_parts(table, combination.kind, row, self.target, printed)
                continue
            yield combination.judge(table, row, self.target, ((row, self.target), printed), parts)


@exact_fields
@dataclass(frozen=True, slots=True, kw_only=True)
class Mean(_RowCombination):
    """Rule that the target is the mean of the parts."""

    parts: ColumnNames

    @property
    def weights(self) -> dict[str, Fraction]:
        """Weight of each part's column."""
        return dict.fromkeys(self.parts, Fraction(1, len(self.parts)))


@exact_fields
@dataclass(frozen=True, slots=True, kw_only=True)
class Sum(_RowCombination):
    """Rule that the target is the sum of the parts, divided by ``divisor``."""

    parts: ColumnNames
    divisor: WholeNumber = 1

    @property
    def weights(self) -> dict[str, Fraction]:
        """Weight of each part's column."""
        return dict.fromkeys(self.parts, Fraction(1, self.divisor))


@exact_fields
@dataclass(frozen=True, slots=True, kw_only=True)
class Delta(_RowCombination):
    """Rule that the target is the rate in the novel condition minus the mean rate in the seen conditions."""

    novel: ColumnName
    seen: ColumnNames

    @property
    def weights(self) -> dict[str, Fraction]:
        """Weight of each part's column."""
        return {self.novel: Fraction(1)} | dict.fromkeys(self.seen, Fraction(-1, len(self.seen)))


@exact_fields
@dataclass(frozen=True, slots=True)
class Total:
    """Rule that, in a column, one row is the sum of all other rows.

    Attributes:
        row: Row of the sum.
        column: Column of the sum and its parts.
        rounded_parts: Whether the parts were rounded before they were printed.
        unit: Unit of the sum, as a multiple of the unit of the parts (1,000,000 for "47.69M").
    """

    row: RowName
    column: ColumnName
    rounded_parts: Flag = False
    unit: WholeNumber = 1

    def findings(self, table: AuditedTable, paper: Mapping[str, AuditedTable]) -> Iterator[AuditFinding]:  # noqa: ARG002 - see AuditRule
        """Yield the finding on the total."""
        printed = table.cell(self.row, self.column)
        rest = [row for row in table.row_names if row != self.row]
        parts = {(r, self.column): (Fraction(1), n) for r in rest if (n := table.cell(r, self.column)) is not None}
        if printed is None:
            return
        if len(parts) < len(rest):
            yield missing_parts(table, "total", self.row, self.column, printed)
            return
        combination = Combination("total", rounded=self.rounded_parts, unit=self.unit)
        yield combination.judge(table, self.row, self.column, ((self.row, self.column), printed), parts)


def missing_parts(table: AuditedTable, rule: str, row: str, column: str, printed: Decimal) -> AuditFinding:
    """Return the finding on a result whose parts are not printed."""
    why = f"The parts of {printed} are not printed."
    possible = len(tuple(misprints(printed)))
    cell = (row, column)
    return AuditFinding(table.name, rule, *cell, str(printed), "", Verdict.UNKNOWN, why, (cell,), possible, possible)


def _exactly(value: Fraction) -> str:
    """Return a fraction as decimal text, which is exact or has six decimals and an ellipsis."""
    for digits in range(7):
        if value * 10**digits == int(value * 10**digits):
            return str(round_half_up(value, digits))
    return f"{round_half_up(value, 6)}..."


def _truncated(value: Fraction, digits: int) -> Decimal:
    """Return a value truncated after ``digits`` decimals."""
    whole = int(abs(value) * 10**digits)
    return Decimal(whole if value >= 0 else -whole).scaleb(-digits)
