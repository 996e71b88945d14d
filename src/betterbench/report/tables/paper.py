"""The two tables of the BeTTER paper in their original layout, with the rows of the paper and one row per run."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any

from betterbench.diagnosis.verdict import RunDiagnosis
from betterbench.report.tables.table import Scalar, Table
from betterbench.report.wording import Figure
from betterbench.statistics import Rate, delta_success_rate

GUESS = 0.5
"""Chance level of the first grasp if two mugs are on the table (stated in the paper's table on the coffee task)."""


@dataclass(frozen=True, slots=True)
class PaperGroup:
    """Heading over several columns: its title, and the number of columns."""

    title: str
    span: int


@dataclass(frozen=True, slots=True)
class PaperColumn:
    """Column: the name that identifies its condition in CSV files ("L1"), and its title."""

    name: str
    title: str


@dataclass(frozen=True, slots=True)
class PaperRow:
    """Row: the name of the policy, the source of the numbers ("chance", "run" or "paper"), and the numbers."""

    name: str
    source: str
    figures: tuple[Figure, ...]


@dataclass(frozen=True, slots=True)
class PaperTable:
    """Table of the BeTTER paper, filled with the results of runs.

    ``groups`` contains the headings over several columns, and ``name`` is the file name without extension.
    """

    name: str
    title: str
    caption: str
    groups: tuple[PaperGroup, ...]
    columns: tuple[PaperColumn, ...]
    rows: tuple[PaperRow, ...]

    @property
    def measured(self) -> bool:
        """Whether the runs have results for at least one cell."""
        return any(not figure.missing for row in self.rows if row.source == "run" for figure in row.figures)


@cache
def paper_facts() -> dict[str, Any]:
    """Return the numbers that are printed in the BeTTER paper, with their source."""
    text = resources.files("betterbench.report").joinpath("paper.json").read_text(encoding="utf-8")
    facts: dict[str, Any] = json.loads(text)
    return facts


def coffee_table(diagnoses: Sequence[RunDiagnosis]) -> PaperTable:
    """Return the table of intention accuracy by instruction on the coffee task, with one row per run."""
    names = ("L1", "L2", "L3", "L4")
    rows = [PaperRow("Random guess", "chance", tuple(Figure(GUESS) for _ in names))]
    rows += [
        PaperRow(
            d.policy, "run", tuple(Figure.of(d.metric("intention_accuracy", f"morning_coffee/{n}")) for n in names)
        )
        for d in diagnoses
    ]
    n = paper_facts()["trials_per_cell"]
    for name, counts in paper_facts()["coffee"]["rows"].items():
        rows.append(PaperRow(name, "paper", tuple(Figure.of_rate(Rate(k, n)) for k in counts)))
    return PaperTable(
        "coffee",
        "Preparing morning coffee: the mug that is grasped first",
        "Intention accuracy: share of trials whose first grasp attempt is at the instructed mug, with 95 % intervals. "
        "In training, place words occurred only in layout 2 and color words only in layout 1.",
        (PaperGroup("Spatial instruction (layout 1)", 2), PaperGroup("Semantic instruction (layout 2)", 2)),
        tuple(PaperColumn(n, t) for n, t in zip(names, ("“top”", "“bottom”", "“red”", "“blue”"), strict=True)),
        tuple(rows),
    )


def composition_table(diagnoses: Sequence[RunDiagnosis]) -> PaperTable:
    """Return the table of success rates for seen and novel compositions of the fast-food task.

    The last column, ΔSR, is the success rate on novel compositions minus the mean success rate on seen compositions.
    """
    names = ("train1", "train2", "R1")
    rows = []
    for diagnosis in diagnoses:
        figures = [Figure.of(diagnosis.metric("success_rate", f"fast_food/{name}")) for name in names]
        delta = Figure.of(diagnosis.metric("delta_sr", "fast_food/R1"), difference=True)
        rows.append(PaperRow(diagnosis.policy, "run", (*figures, delta)))
    n = paper_facts()["trials_per_cell"]
    for name, counts in paper_facts()["composition"]["rows"].items():
        first, second, novel = (Rate(k, n) for k in counts)
        found = delta_success_rate(novel, (first, second))
        delta = Figure(found.value, found.low, found.high, None, n, difference=True)
        rows.append(
            PaperRow(name, "paper", (Figure.of_rate(first), Figure.of_rate(second), Figure.of_rate(novel), delta))
        )
    return PaperTable(
        "composition",
        "Packing a fast food order: can seen steps be recombined?",
        "Success rates with 95 % intervals. A is the burger, B the fries, C the drink; in training, a burger always "
        "came first. ΔSR is the novel composition minus the mean of the seen compositions, in percentage points.",
        (PaperGroup("Seen compositions", 2), PaperGroup("Novel composition", 1), PaperGroup("Difference", 1)),
        (
            PaperColumn("train1", "A→B"),
            PaperColumn("train2", "A→C"),
            PaperColumn("R1", "B→C"),
            PaperColumn("delta_sr", "ΔSR"),
        ),
        tuple(rows),
    )


def plain_paper_table(table: PaperTable) -> Table:
    """Return a table of the BeTTER paper as a plain table.

    Value, ends of the interval, and counts are in separate columns.
    """
    columns = ["model", "source"]
    for column in table.columns:
        columns += [f"{column.name}{suffix}" for suffix in ("", "_low", "_high", "_k", "_n")]
    rows: list[tuple[Scalar, ...]] = []
    for row in table.rows:
        cells: list[Scalar] = [row.name, row.source]
        for f in row.figures:
            cells += [f.value, f.low, f.high, f.k, f.n]
        rows.append(tuple(cells))
    return Table(table.name, table.caption, tuple(columns), tuple(rows))
