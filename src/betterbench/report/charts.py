"""Charts as data for the page: what stands in which row, and at which share of the width."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from betterbench.diagnosis.verdict import RunDiagnosis
from betterbench.report.legend import AXIS_NAMES
from betterbench.report.outcomes import ConditionRow, task_title, training_rows, variation_rows
from betterbench.report.wording import Figure, minus
from betterbench.statistics import round_half_up

GRID = 0.25
"""Distance of the grid lines of a chart, as a fraction."""


@dataclass(frozen=True, slots=True)
class Scale:
    """The horizontal scale of a chart, from ``low`` to ``high`` (fractions); positions are in percent of the width."""

    low: float
    high: float

    def at(self, value: float) -> str:
        """Return the position of a value, for an SVG attribute."""
        share = (min(max(value, self.low), self.high) - self.low) / (self.high - self.low)
        return f"{100 * share:.2f}%"

    def span(self, low: float, high: float) -> str:
        """Return the width of a range."""
        return f"{100 * max(0.0, high - low) / (self.high - self.low):.2f}%"

    @property
    def ticks(self) -> tuple[tuple[str, str], ...]:
        """Position and text of every grid line."""
        count = round((self.high - self.low) / GRID)
        values = [self.low + GRID * i for i in range(count + 1)]
        return tuple((self.at(v), minus(round_half_up(100 * v, 0))) for v in values)


UNIT = Scale(0.0, 1.0)


@dataclass(frozen=True, slots=True)
class GapGroup:
    """The illusion gaps of all policies within one scope: a title and one (policy, figure) pair per policy."""

    title: str
    rows: tuple[tuple[str, Figure], ...]


@dataclass(frozen=True, slots=True)
class GapChart:
    """Illusion gaps over all variations and per axis."""

    scale: Scale
    groups: tuple[GapGroup, ...]

    @property
    def measured(self) -> bool:
        """Whether there is any gap to show."""
        return any(not figure.missing for group in self.groups for _, figure in group.rows)


@dataclass(frozen=True, slots=True)
class ConditionGroup:
    """One variation, or the training conditions of a task, with one (policy, row) pair per policy that ran it."""

    first: ConditionRow
    rows: tuple[tuple[str, ConditionRow], ...]


@dataclass(frozen=True, slots=True)
class TaskGroup:
    """One task with its conditions, the training conditions first."""

    task: str
    title: str
    training: ConditionGroup | None
    variations: tuple[ConditionGroup, ...]

    @property
    def conditions(self) -> tuple[ConditionGroup, ...]:
        """All conditions, the training ones first."""
        return self.variations if self.training is None else (self.training, *self.variations)


def gap_chart(diagnoses: Sequence[RunDiagnosis]) -> GapChart:
    """Return the illusion gaps over all variations and per axis that any run has.

    Args:
        diagnoses: The runs.
    """
    groups = []
    for scope, title in (("overall", "All variations"), *((f"axis:{a}", name) for a, name in AXIS_NAMES.items())):
        rows = tuple(
            (d.policy, Figure.of(d.metric("illusion_gap", scope), difference=True, noun="pairs")) for d in diagnoses
        )
        if any(not figure.missing for _, figure in rows):
            groups.append(GapGroup(title, rows))
    ends = [
        end for group in groups for _, f in group.rows for end in (f.value, f.low, f.high) if end is not None
    ]  # fmt: skip
    low = math.floor(min([0.0, *ends]) / GRID + 1e-9) * GRID
    high = math.ceil(max([GRID, *ends]) / GRID - 1e-9) * GRID
    return GapChart(Scale(low, high), tuple(groups))


def task_groups(diagnoses: Sequence[RunDiagnosis]) -> tuple[TaskGroup, ...]:
    """Return tasks with their conditions and how every policy did on them.

    Args:
        diagnoses: The runs.
    """
    by_id: dict[str, list[tuple[str, ConditionRow]]] = {}
    for diagnosis in diagnoses:
        for row in (*training_rows(diagnosis), *variation_rows(diagnosis)):
            by_id.setdefault(row.id, []).append((diagnosis.policy, row))
    tasks: dict[str, list[ConditionGroup]] = {}
    for rows in by_id.values():
        tasks.setdefault(rows[0][1].task, []).append(ConditionGroup(rows[0][1], tuple(rows)))
    return tuple(
        TaskGroup(
            task,
            task_title(task),
            next((group for group in groups if group.first.variation is None), None),
            tuple(group for group in groups if group.first.variation is not None),
        )
        for task, groups in sorted(tasks.items())
    )
