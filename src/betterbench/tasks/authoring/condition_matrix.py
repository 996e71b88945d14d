"""Diagnostic matrices of a task. They arrange its conditions by the initial states of two objects.

Each cell also contains the result that the paper reports for it.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from betterbench.errors import InvalidInputError


class State(StrEnum):
    """State of an object at the start of a trial."""

    TABLE = "on the table"
    TARGET = "at the target"
    ABSENT = "absent"


class Horizon(StrEnum):
    """Diagnostic matrix that a condition belongs to, one of the two in the paper."""

    SHORT = "short"
    LONG = "long"


@dataclass(frozen=True, slots=True)
class MatrixCell:
    """One cell of a diagnostic matrix.

    Attributes:
        row: State of the first object.
        column: State of the second object.
        conditions: Names of the conditions in the cell.
        paper: Outcome of the paper's policy in the cell, as stated in the paper's table.
    """

    row: State
    column: State
    conditions: tuple[str, ...]
    paper: str


@dataclass(frozen=True, slots=True)
class ConditionMatrix:
    """Matrix of a task's conditions, arranged by the initial states of two objects.

    Attributes:
        horizon: Matrix of the paper to which this matrix corresponds.
        rows: Object that defines the rows by its states.
        columns: Object that defines the columns by its states.
        cells: One cell for each pair of states, row by row in the order of :class:`State`.
    """

    horizon: Horizon
    rows: str
    columns: str
    cells: tuple[MatrixCell, ...]

    def __post_init__(self) -> None:
        """Check that there is one cell for each pair of states, in order, and that no condition is in two cells."""
        where = f"{self.horizon.value}-horizon matrix"
        pairs = [(row, column) for row in State for column in State]
        if [(cell.row, cell.column) for cell in self.cells] != pairs:
            cure = "List one cell for each pair of states, row by row"
            raise InvalidInputError(
                where, f"the matrix has {len(self.cells)} cells that do not match the nine pairs of states", cure
            )
        names = [name for cell in self.cells for name in cell.conditions]
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:
            raise InvalidInputError(where, f"the condition {twice!r} is in two cells", "List each condition once")

    def cell_of(self, condition: str) -> MatrixCell | None:
        """Return the matrix cell that contains a condition, or None if no cell does."""
        return next((cell for cell in self.cells if condition in cell.conditions), None)
