"""Sums and means: totals of a row or a column, averages, differences, and how they were rounded."""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction

from betterbench.audit.finding import AuditFinding, Cell, Verdict
from betterbench.audit.form import Form
from betterbench.audit.table import AuditedTable, blindness, decimals, misprints, replaced
from betterbench.statistics import round_half_up

Terms = tuple[tuple[Fraction, Decimal], ...]
"""Weight and printed number of each part."""


@dataclass(frozen=True, slots=True)
class Combination:
    """One number is a weighted sum of others.

    Attributes:
        kind: Name of the rule ("mean", "sum", "delta", "total").
        rounded: True if the parts were rounded before they were printed, so that the result may differ a little.
        unit: How many of the parts' units make one of the result's (1,000,000 for "47.69M").
    """

    kind: str
    rounded: bool = False
    unit: int = 1

    def judge(
        self,
        table: AuditedTable,
        row: str,
        cell: str,
        target: tuple[Cell, Decimal],
        parts: Mapping[Cell, tuple[Fraction, Decimal]],
    ) -> AuditFinding:
        """Return the finding about one result.

        Args:
            table: The table.
            row: Row the finding is about.
            cell: Column the finding is about.
            target: Place of the result, and the result as printed.
            parts: Weight and printed number of each part.
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
            why += f": {printed} was cut off and not rounded."
        else:
            why += f", not {printed}."
        covers = (*parts, place)
        shown = str(printed), str(recomputed)
        return AuditFinding(table.name, self.kind, row, cell, *shown, verdict, why, covers, unnoticed, possible)

    def value(self, terms: Terms) -> Fraction:
        """Return the exact result of weighted parts."""
        return sum((weight * Fraction(number) for weight, number in terms), Fraction(0)) / self.unit

    def slack(self, terms: Terms) -> Fraction:
        """Return how far the result may be off because the parts were rounded."""
        return sum((abs(weight) * _half_a_digit(number) for weight, number in terms), Fraction(0)) / self.unit


@functools.lru_cache(maxsize=1024)
def _unnoticed(combination: Combination, terms: Terms, printed: Decimal) -> tuple[int, int]:
    """Return how many wrong digits of parts and result would not show, of how many there could be."""
    weights = tuple(weight for weight, _ in terms)
    numbers = (*(number for _, number in terms), printed)

    def holds(at: int, wrong: Decimal) -> bool:
        *parts, result = replaced(numbers, at, wrong)
        value = combination.value(tuple(zip(weights, parts, strict=True)))
        return round_half_up(value, decimals(result)) == result

    return blindness(numbers, holds)


def _half_a_digit(number: Decimal) -> Fraction:
    """Return half of the last printed digit's unit."""
    return Fraction(1, 2 * 10 ** decimals(number))


@dataclass(frozen=True, slots=True)
class RowSum:
    """In each row, one column is a combination of others.

    Attributes:
        rows: Rows it is promised for.
        target: Column of the result.
        weights: Weight of each part's column.
        combination: How the result is judged.
    """

    rows: tuple[str, ...]
    target: str
    weights: tuple[tuple[str, Fraction], ...]
    combination: Combination

    @classmethod
    def read_mean(cls, form: Form, table: AuditedTable) -> RowSum:
        """Return the rule that the target is the mean of the parts."""
        parts = form.names("parts", table.columns)
        return cls._read(form, table, "mean", {p: Fraction(1, len(parts)) for p in parts})

    @classmethod
    def read_sum(cls, form: Form, table: AuditedTable) -> RowSum:
        """Return the rule that the target is the sum of the parts, divided by ``divisor`` if given."""
        divisor = form.count("divisor", 1)
        return cls._read(form, table, "sum", {p: Fraction(1, divisor) for p in form.names("parts", table.columns)})

    @classmethod
    def read_delta(cls, form: Form, table: AuditedTable) -> RowSum:
        """Return the rule that the target is the novel condition minus the mean of the seen ones."""
        novel, seen = form.name("novel", table.columns), form.names("seen", table.columns)
        return cls._read(form, table, "delta", {novel: Fraction(1)} | {s: Fraction(-1, len(seen)) for s in seen})

    @classmethod
    def _read(cls, form: Form, table: AuditedTable, kind: str, weights: Mapping[str, Fraction]) -> RowSum:
        rows = form.names("rows", table.row_names, table.row_names)
        combination = Combination(kind, rounded=form.flag("rounded_parts"))
        return cls(rows, form.name("target", table.columns), tuple(weights.items()), combination)

    def findings(self, table: AuditedTable, paper: Mapping[str, AuditedTable]) -> Iterator[AuditFinding]:  # noqa: ARG002 - see AuditRule
        """Yield one finding per row."""
        for row in self.rows:
            printed = table.cell(row, self.target)
            parts = {(row, c): (w, n) for c, w in self.weights if (n := table.cell(row, c)) is not None}
            if printed is None:
                continue
            if len(parts) < len(self.weights):
                yield missing_parts(table, self.combination.kind, row, self.target, printed)
                continue
            yield self.combination.judge(table, row, self.target, ((row, self.target), printed), parts)


@dataclass(frozen=True, slots=True)
class Total:
    """In each column, one row is the sum of all others.

    Attributes:
        row: Row of the total.
        column: The column.
        combination: How the result is judged.
    """

    row: str
    column: str
    combination: Combination

    @classmethod
    def read(cls, form: Form, table: AuditedTable) -> Total:
        """Return the rule that a form describes."""
        combination = Combination("total", rounded=form.flag("rounded_parts"), unit=form.count("unit", 1))
        return cls(form.name("row", table.row_names), form.name("column", table.columns), combination)

    def findings(self, table: AuditedTable, paper: Mapping[str, AuditedTable]) -> Iterator[AuditFinding]:  # noqa: ARG002 - see AuditRule
        """Yield the finding about the total."""
        printed = table.cell(self.row, self.column)
        rest = [row for row in table.row_names if row != self.row]
        parts = {(r, self.column): (Fraction(1), n) for r in rest if (n := table.cell(r, self.column)) is not None}
        if printed is None:
            return
        if len(parts) < len(rest):
            yield missing_parts(table, "total", self.row, self.column, printed)
            return
        yield self.combination.judge(table, self.row, self.column, ((self.row, self.column), printed), parts)


def missing_parts(table: AuditedTable, rule: str, row: str, column: str, printed: Decimal) -> AuditFinding:
    """Return the finding about a result whose parts are not printed."""
    why = f"The parts of {printed} are not printed."
    possible = len(tuple(misprints(printed)))
    cell = (row, column)
    return AuditFinding(table.name, rule, *cell, str(printed), "", Verdict.UNKNOWN, why, (cell,), possible, possible)


def _exactly(value: Fraction) -> str:
    """Return a fraction as a decimal: all digits if they end soon, otherwise the first six."""
    for digits in range(7):
        if value * 10**digits == int(value * 10**digits):
            return str(round_half_up(value, digits))
    return f"{round_half_up(value, 6)}..."


def _truncated(value: Fraction, digits: int) -> Decimal:
    """Return a value with its further decimals cut off."""
    whole = int(abs(value) * 10**digits)
    return Decimal(whole if value >= 0 else -whole).scaleb(-digits)
