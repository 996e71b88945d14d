"""Tables of printed numbers, stored as decimals with exactly the printed digits."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from typing import ParamSpec, Protocol, TypeVar

from betterbench.errors import UnknownNameError
from betterbench_calibration.audit.finding import AuditFinding, TableCell

DIGITS = "0123456789"

P = ParamSpec("P")
ResultT = TypeVar("ResultT")


def cached_by_digits(function: Callable[P, ResultT]) -> Callable[P, ResultT]:
    """Cache the results of a function by the digits of its arguments.

    ``functools.cache`` compares decimals by value. It would return the result of 40.6 for 40.60, which has more digits
    and therefore more misprints.
    """
    results: dict[str, ResultT] = {}

    @functools.wraps(function)
    def cached(*args: P.args, **kwargs: P.kwargs) -> ResultT:
        key = repr((args, kwargs))
        if key not in results:
            results[key] = function(*args, **kwargs)
        return results[key]

    return cached


@dataclass(frozen=True, slots=True)
class AuditedTable:
    """Table as printed. Each cell contains a number, or None if the cell is empty."""

    name: str
    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, tuple[Decimal | None, ...]], ...]

    @property
    def row_names(self) -> tuple[str, ...]:
        """Names of the rows, from top to bottom."""
        return tuple(name for name, _ in self.rows)

    def cell(self, row: str, column: str) -> Decimal | None:
        """Return a printed number, or None for an empty cell. Raises UnknownNameError for an unknown row or column."""
        if column not in self.columns:
            raise UnknownNameError(f"column of {self.name}", column, self.columns)
        for name, numbers in self.rows:
            if name == row:
                return numbers[self.columns.index(column)]
        raise UnknownNameError(f"row of {self.name}", row, self.row_names)

    def printed(self) -> Iterator[tuple[TableCell, Decimal]]:
        """Yield every printed number with its row and column."""
        for name, numbers in self.rows:
            for column, number in zip(self.columns, numbers, strict=True):
                if number is not None:
                    yield (name, column), number

    def with_cell(self, row: str, column: str, number: Decimal) -> AuditedTable:
        """Return the table with one number changed."""
        at = self.columns.index(column)
        rows = tuple(
            (name, (*numbers[:at], number, *numbers[at + 1 :]) if name == row else numbers)
            for name, numbers in self.rows
        )
        return replace(self, rows=rows)


class AuditRule(Protocol):
    """Interface of a rule that the numbers of a table must satisfy."""

    def findings(self, table: AuditedTable, paper: Mapping[str, AuditedTable]) -> Iterator[AuditFinding]:
        """Check a table, and yield the findings. ``paper`` contains all tables, for rules that compare tables."""


def decimals(number: Decimal) -> int:
    """Return the number of printed decimals."""
    exponent = number.as_tuple().exponent
    return max(0, -exponent) if isinstance(exponent, int) else 0


def misprints(number: Decimal) -> Iterator[Decimal]:
    """Yield all numbers that differ from a printed number in exactly one digit."""
    text = f"{number:f}"
    for i, old in enumerate(text):
        if old in DIGITS:
            for new in DIGITS:
                if new != old:
                    yield Decimal(text[:i] + new + text[i + 1 :])


def one_digit_apart(first: Decimal, second: Decimal) -> bool:
    """Return whether two printed numbers differ in exactly one digit."""
    a, b = f"{first:f}", f"{second:f}"
    return len(a) == len(b) and sum(x != y for x, y in zip(a, b, strict=True)) == 1


def blindness(numbers: Sequence[Decimal], holds: Callable[[int, Decimal], bool]) -> tuple[int, int]:
    """Return the number of misprints of one digit that a check would not detect, and of all such misprints.

    ``holds`` returns whether the check still passes if the number at a position is replaced by another number.
    """
    tried = [holds(i, wrong) for i, number in enumerate(numbers) for wrong in misprints(number)]
    return sum(tried), len(tried)


def replaced(numbers: Sequence[Decimal], at: int, wrong: Decimal) -> tuple[Decimal, ...]:
    """Return the numbers with the number at position ``at`` replaced by ``wrong``."""
    return (*numbers[:at], wrong, *numbers[at + 1 :])
