"""The two diagnostic matrices of the BeTTER paper: outcomes by the initial states of two objects.

An object is on the table, already at its target, or absent.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from betterbench.diagnosis.verdict import RunDiagnosis, TrialDiagnosis
from betterbench.report.tables.cell_position import CellPosition, cell_of, known_conditions
from betterbench.report.tables.table import Scalar, Table
from betterbench.statistics import Rate
from betterbench.tasks import Condition, Expected
from betterbench.tasks.authoring.condition_matrix import Horizon, State
from betterbench.tasks.interventions.resolve import resolve_condition
from betterbench.tasks.labels import Kind, Label, all_labels
from betterbench.tasks.suite.fruit_basket import LONG_MATRIX, SHORT_MATRIX
from betterbench.tasks.worlds.facts import facts_of_task

PAPER: Mapping[Horizon, tuple[tuple[str, ...], ...]] = {
    matrix.horizon: tuple(tuple(cell.paper for cell in matrix.cells if cell.row is row) for row in State)
    for matrix in (SHORT_MATRIX, LONG_MATRIX)
}
"""Outcomes on the real robot as reported in the paper, by row and column in the order of :class:`State`. The paper does
not give counts.
"""

NO_TRIALS = Rate(0, 0)

SHOWN = 4
"""Maximum number of conditions that the note of an empty cell lists."""

_HEADINGS = {
    Horizon.SHORT: (
        "Short horizon: one target and a distractor",
        (
            "One object is requested. The rows are its initial states, and the columns are the initial states of "
            "another object."
        ),
        ("target", "distractor"),
    ),
    Horizon.LONG: (
        "Long horizon: two targets",
        (
            "Two objects are requested. The rows are the initial states of the first object, and the columns are "
            "those of the second."
        ),
        ("first target", "second target"),
    ),
}


@dataclass(frozen=True, slots=True)
class MatrixSource:
    """Condition ("fruit_lunch/T1") in a cell of a matrix, with the results of its trials.

    Attributes:
        labels: Labels of its trials with their counts, starting with the most frequent.
        needless: Number of successful trials with an unnecessary step.
        twins: Success rate of the training twins (the training trials with the same seeds) that are in the run.
    """

    id: str
    expected: Expected
    success: Rate
    labels: tuple[tuple[Label, int], ...]
    needless: int = 0
    twins: Rate = NO_TRIALS


@dataclass(frozen=True, slots=True)
class Cell:
    """Cell of a matrix, given by the state of the first target and the state of the distractor or second target.

    Attributes:
        sources: Conditions of the run that belong to the cell.
        success: Success rate over all trials of these conditions.
        labels: Labels of the trials with their counts, starting with the most frequent.
        needless: Number of successful trials with an unnecessary step, such as an air grasp at an empty slot.
        note: Reason why the cell is empty; "" if it is not empty.
        paper: Outcome that the paper reports, for reference.
        twins: Success rate of the training twins, i.e. the trials in the unchanged scene with the same seeds, which
            require the same motions. The cell of the training conditions has no training twins.
    """

    row: State
    column: State
    sources: tuple[MatrixSource, ...]
    success: Rate
    labels: tuple[tuple[Label, int], ...]
    note: str
    paper: str
    needless: int = 0
    twins: Rate = NO_TRIALS

    @property
    def ambiguous(self) -> bool:
        """Whether the premise is broken in all conditions of the cell, so that no outcome is right or wrong."""
        return bool(self.sources) and all(source.expected is Expected.AMBIGUOUS for source in self.sources)

    @property
    def empty(self) -> bool:
        """Whether the run has no trial in the cell."""
        return self.success.n == 0


@dataclass(frozen=True, slots=True)
class Matrix:
    """Diagnostic matrix as in the BeTTER paper, filled with the results of a run.

    Attributes:
        caption: Meaning of rows and columns.
        axes: Objects that define the rows and the columns by their states.
        cells: Three rows of three cells, in the order of :class:`State`.
    """

    name: str
    title: str
    caption: str
    policy: str
    axes: tuple[str, str]
    cells: tuple[tuple[Cell, ...], ...]

    @property
    def measured(self) -> bool:
        """Whether the run has results for at least one cell."""
        return any(not cell.empty for row in self.cells for cell in row)

    def cell(self, row: State, column: State) -> Cell:
        """Return the cell with the given states of the two objects."""
        states = list(State)
        return self.cells[states.index(row)][states.index(column)]


def matrices_of(diagnosis: RunDiagnosis) -> tuple[Matrix, Matrix]:
    """Return the short-horizon and the long-horizon matrix of a run.

    If a task defines its own matrices, these list the conditions of each cell. Conditions of other tasks are assigned
    by the initial states of their objects, not by their names. The cell in which all objects are on the table contains
    only training conditions. Every other cell contains all conditions with these initial states. Trials in other
    simulated worlds are left out.

    Raises:
        UnknownNameError: If the task, the variation or the training condition of a trial is unknown.
    """
    trials: dict[str, list[TrialDiagnosis]] = {}
    ended = {t.key: t for t in diagnosis.shown_trials if t.variation is None and t.kind is not Kind.UNFINISHED}
    for trial in diagnosis.shown_trials:
        if facts_of_task(trial.task).measured:
            trials.setdefault(f"{trial.task}/{trial.variation or trial.condition}", []).append(trial)
    groups: dict[CellPosition, list[MatrixSource]] = {}
    for name, members in trials.items():
        setting = resolve_condition(*name.split("/"))
        position = cell_of(setting)
        if position is not None:
            groups.setdefault(position, []).append(_source(name, setting.condition, members, ended))
    return _matrix(diagnosis.policy, Horizon.SHORT, groups), _matrix(diagnosis.policy, Horizon.LONG, groups)


def plain_matrix(matrices: Sequence[Matrix]) -> Table:
    """Return the same matrix of several policies as a plain table.

    There is one row per policy and cell. Rates are fractions.
    """
    rows: list[tuple[Scalar, ...]] = []
    for matrix in matrices:
        for cell in (cell for row in matrix.cells for cell in row):
            rate = cell.success
            ends = (None, None) if cell.empty else (rate.low, rate.high)
            sources = " ".join(source.id for source in cell.sources)
            right = (None, rate.n, None, None, None) if cell.ambiguous else (rate.k, rate.n, rate.value, *ends)
            where = (matrix.policy, cell.row.value, cell.column.value, *right)
            told = (cell.needless, outcomes_text(cell.labels), sources, cell.note, cell.paper)
            rows.append((*where, *told, cell.twins.k, cell.twins.n))
    first = matrices[0] if matrices else None
    axes = ("target", "other") if first is None else tuple(axis.replace(" ", "_") for axis in first.axes)
    columns = (
        "policy",
        *axes,
        "k",
        "n",
        "success_rate",
        "low",
        "high",
        "needless",
        "outcomes",
        "conditions",
        "note",
        "paper",
        "twin_k",
        "twin_n",
    )
    name, caption = ("matrix", "No run.") if first is None else (first.name, first.caption)
    return Table(name, caption, columns, tuple(rows))


def outcomes_text(labels: Sequence[tuple[Label, int]]) -> str:
    """Format outcomes with their counts, e.g. "success 12, early_halt 8"."""
    return ", ".join(f"{label.value} {count}" for label, count in labels)


def _source(
    name: str, condition: Condition, trials: Sequence[TrialDiagnosis], training: Mapping[str, TrialDiagnosis]
) -> MatrixSource:
    """Collect the outcomes of a condition and the success rate of the training trials with the same seeds."""
    success = Rate(sum(t.success for t in trials), len(trials))
    needless = sum(t.success and bool(t.needless) for t in trials)
    twins = [training[key].success for t in trials if (key := t.twin_key) is not None and key in training]
    labels = _ranked(Counter(t.label for t in trials))
    return MatrixSource(name, condition.expected, success, labels, needless, Rate(sum(twins), len(twins)))


def _ranked(counts: Mapping[Label, int]) -> tuple[tuple[Label, int], ...]:
    """Sort labels by frequency. Labels that are equally frequent keep their usual order."""
    order = all_labels()
    return tuple(sorted(counts.items(), key=lambda entry: (-entry[1], order.index(entry[0]))))


def _matrix(policy: str, horizon: Horizon, groups: Mapping[CellPosition, Sequence[MatrixSource]]) -> Matrix:
    title, caption, axes = _HEADINGS[horizon]
    positions = [[CellPosition(horizon, row, column) for column in State] for row in State]
    cells = tuple(
        tuple(_cell(at, groups.get(at, ()), paper) for at, paper in zip(row, seen, strict=True))
        for row, seen in zip(positions, PAPER[horizon], strict=True)
    )
    return Matrix(f"{horizon.value}_horizon_matrix", title, caption, policy, axes, cells)


def _cell(position: CellPosition, sources: Sequence[MatrixSource], paper: str) -> Cell:
    """Collect the trials of all conditions that belong to a cell."""
    success = Rate(sum(s.success.k for s in sources), sum(s.success.n for s in sources))
    labels: Counter[Label] = Counter()
    for source in sources:
        labels.update(dict(source.labels))
    note = "" if sources else _why_empty(position)
    needless = sum(source.needless for source in sources)
    twins = Rate(sum(s.twins.k for s in sources), sum(s.twins.n for s in sources))
    return Cell(position.row, position.column, tuple(sources), success, _ranked(labels), note, paper, needless, twins)


def _why_empty(position: CellPosition) -> str:
    """Return the reason why a cell is empty."""
    known = known_conditions().get(position, ())
    if not known:
        return "No condition of the registered tasks has these initial states."
    more = f" and {len(known) - SHOWN} more" if len(known) > SHOWN else ""
    return f"Not in this run: {', '.join(known[:SHOWN])}{more}."
