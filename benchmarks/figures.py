"""One line of the speed table, and how its numbers are shown."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, slots=True)
class Figure:
    """One line of the table.

    Attributes:
        row: Name of the row it belongs to.
        text: What was measured.
        values: Repeats; empty if it could not be measured.
        unit: Unit of the values ("x" for a ratio).
        relation: How the median must compare with the bound.
        bound: Required value, or None if there is no requirement.
        note: Additional information, or the reason why nothing was measured.
    """

    row: str
    text: str
    values: tuple[float, ...]
    unit: str
    relation: Literal["<=", ">="] = "<="
    bound: float | None = None
    note: str = ""

    @property
    def median(self) -> float:
        """Median of the repeats."""
        return statistics.median(self.values)

    @property
    def reached(self) -> bool | None:
        """Whether the median meets the requirement, or None if there is no requirement or nothing was measured."""
        if self.bound is None or not self.values:
            return None
        return self.median <= self.bound if self.relation == "<=" else self.median >= self.bound


def spread(values: Sequence[float]) -> str:
    """Return "median [min-max]" with three digits."""
    return f"{statistics.median(values):.3g} [{min(values):.3g}-{max(values):.3g}]"
