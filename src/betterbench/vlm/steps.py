"""Comparison of runs of ``better vlm`` step by step, in the layout of the paper's Table 3.

A row is a model with its eyes and its prompt. A column is a benchmark. Each row is compared with the row above it on
the same items, and a step is supported only if its paired test passes Holm's correction over all steps of the table.
The paper bases such steps on single numbers; for example, EgoPlan-Bench2 falls from 33.38 to 31.95 after co-training.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

from betterbench.errors import InvalidInputError, RunConflictError
from betterbench.statistics import Difference, holm
from betterbench.vlm.pairs import paired_difference, paired_p
from betterbench.vlm.stored import StoredRun, read_static_run

FACTORS = {
    "model": "model",
    "eyes": "eyes",
    "max_tiles": "tiles",
    "prompt": "prompt",
    "coordinates": "coordinates",
    "extractor": "extractor",
    "max_tokens": "longest answer",
}
"""Settings of a run that may explain a difference, with their words."""
_ABOUT_THE_MODEL = ("model", "eyes", "tiles")


@dataclass(frozen=True, slots=True)
class Cell:
    """Headline number of a row on a benchmark.

    Attributes:
        value: Headline number of the benchmark, as a fraction.
        n: Number of items in the headline number.
        run: Folder of the run.
    """

    value: float
    n: int
    run: str


@dataclass(frozen=True, slots=True)
class Row:
    """One combination of model, eyes and prompt, with the headline numbers by benchmark."""

    name: str
    cells: dict[str, Cell]


@dataclass(frozen=True, slots=True)
class Step:
    """Difference between a row and the row above it on one benchmark.

    Attributes:
        upper: Name of the upper row.
        lower: Name of the lower row.
        benchmark: Name of the benchmark.
        difference: Upper minus lower mean score over the counted items, paired, as a fraction.
        p: p-value of the paired test.
        adjusted: The p-value after Holm's correction over all steps of the table.
        test: Name of the test.
        changed: Settings that differ between the two runs.
        is_supported: Whether the adjusted p-value is below ``alpha``.
    """

    upper: str
    lower: str
    benchmark: str
    difference: Difference
    p: float
    adjusted: float
    test: str
    changed: tuple[str, ...]
    is_supported: bool

    @property
    def sentence(self) -> str:
        """The step in words."""
        points = 100 * (self.difference.value or 0.0)
        moved = "the same score as"
        if points != 0:
            moved = f"{abs(points):.1f} points {'less' if points > 0 else 'more'} than"
        low, high = sorted((-self.difference.low_pp, -self.difference.high_pp))
        verdict = "supported" if self.is_supported else "not supported"
        text = f"{self.benchmark}: {self.lower} has {moved} {self.upper} ({low:+.1f} to {high:+.1f}): {verdict}."
        if len(self.changed) > 1:
            text += f" {' and '.join(self.changed)} changed together, so the step does not tell which one explains it."
        elif not self.changed:
            text += " No setting changed, so the two runs repeat each other."
        elif self.changed[0] not in _ABOUT_THE_MODEL:
            text += f" Only the {self.changed[0]} changed, so the step does not compare models."
        return text

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict."""
        return {**asdict(self), "sentence": self.sentence}


@dataclass(frozen=True, slots=True)
class StepTable:
    """Rows, and the steps between neighboring rows.

    Attributes:
        column: Column of the scores: "strict", "parsed" or "extracted".
        alpha: Level of the tests.
        warnings: Differences between runs that limit the comparison.
    """

    column: str
    alpha: float
    benchmarks: tuple[str, ...]
    rows: tuple[Row, ...]
    steps: tuple[Step, ...]
    warnings: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict; all rates are fractions."""
        return {**asdict(self), "steps": [step.to_json() for step in self.steps]}


def step_table(
    paths: Sequence[Path], *, names: Sequence[str] = (), column: str = "parsed", alpha: float = 0.05
) -> StepTable:
    """Return the table of several runs.

    Args:
        paths: Run folders, in the order of the rows; runs with the same name are one row.
        names: Name of each run's row; by default its model, eyes and tiles, and its prompt if runs differ only there.
        column: Column of the scores.
        alpha: Level of the tests.

    Raises:
        InvalidInputError: If the number of names differs from the number of runs.
        RecordError: If a run is not finished or was changed.
        RunConflictError: If a row has two runs of one benchmark, or two runs of a benchmark used different data.
    """
    if names and len(names) != len(paths):
        problem = f"{len(names)} names for {len(paths)} runs"
        raise InvalidInputError("--name", problem, "Give one name per run, or none")
    rows: dict[str, dict[str, StoredRun]] = {}
    runs = [read_static_run(path) for path in paths]
    for path, run, name in zip(paths, runs, names or _names(runs), strict=True):
        row = rows.setdefault(name, {})
        known = row.setdefault(run.benchmark.name, run)
        if known is not run:
            problem = f"{known.path} and {path} are both {name!r} on {run.benchmark.name}"
            raise RunConflictError(f"{problem}. Give each run a name with --name.")
    benchmarks = tuple(dict.fromkeys(b for row in rows.values() for b in row))
    for benchmark in benchmarks:
        _require_same_data([row[benchmark] for row in rows.values() if benchmark in row])
    shown = tuple(Row(name, {b: _cell(run, column) for b, run in row.items()}) for name, row in rows.items())
    steps = _steps(rows, benchmarks, column, alpha)
    return StepTable(column, alpha, benchmarks, shown, steps, _warnings(rows, column))


def _names(runs: Sequence[StoredRun]) -> list[str]:
    """Return the name of each run's row: model, eyes, tiles, and the prompt where it alone tells runs apart."""
    plain = [(_name(run), run.benchmark.name) for run in runs]
    prompts = defaultdict[tuple[str, str], set[str]](set)
    for key, run in zip(plain, runs, strict=True):
        prompts[key].add(str(run.head["prompt"]))
    return [
        key[0] if len(prompts[key]) == 1 else f"{key[0]}, {run.head['prompt']}"
        for key, run in zip(plain, runs, strict=True)
    ]


def _name(run: StoredRun) -> str:
    eyes, tiles = run.head.get("eyes", "native"), run.head.get("max_tiles")
    name = str(run.head["model"])
    name += "" if eyes == "native" else f", {eyes}"
    return name if tiles is None else f"{name}, {tiles} tiles"


def _cell(run: StoredRun, column: str) -> Cell:
    return Cell(run.headline[column], len(run.counted()), str(run.path))


def _require_same_data(runs: Sequence[StoredRun]) -> None:
    first, *others = runs
    for other in others:
        if other.head["data"] != first.head["data"]:
            problem = f"{first.path} and {other.path} asked different data of {first.benchmark.name}"
            raise RunConflictError(f"{problem}. Run one of them again with the other's --data.")


def _steps(
    rows: dict[str, dict[str, StoredRun]], benchmarks: Sequence[str], column: str, alpha: float
) -> tuple[Step, ...]:
    found: list[Step] = []
    for (upper, above), (lower, below) in pairwise(rows.items()):
        for benchmark in benchmarks:
            if benchmark in above and benchmark in below:
                found.append(_step(upper, lower, above[benchmark], below[benchmark], column))
    adjusted = holm([step.p for step in found])
    return tuple(
        Step(
            s.upper, s.lower, s.benchmark, s.difference, s.p, a, s.test, s.changed, is_supported=a < alpha
        )
        for s, a in zip(found, adjusted, strict=True)
    )  # fmt: skip


def _step(upper: str, lower: str, above: StoredRun, below: StoredRun, column: str) -> Step:
    first, second = above.counted(), {item.id: item for item in below.counted()}
    pairs = [(item.score_in(column), second[item.id].score_in(column)) for item in first]
    clusters = [item.cluster for item in first]
    name = above.benchmark.name
    purpose = f"{name}:{upper}:{lower}"
    difference = paired_difference(pairs, clusters, purpose)
    p, test = paired_p(pairs, clusters, purpose)
    changed = tuple(word for key, word in FACTORS.items() if above.head.get(key) != below.head.get(key))
    return Step(upper, lower, above.benchmark.title, difference, p, p, test, changed, is_supported=False)


def _warnings(rows: dict[str, dict[str, StoredRun]], column: str) -> tuple[str, ...]:
    runs = [run for row in rows.values() for run in row.values()]
    found = []
    with_extractor = [run for run in runs if run.head.get("extractor") is not None]
    if column == "extracted" and 0 < len(with_extractor) < len(runs):
        found.append(
            f"{len(with_extractor)} of {len(runs)} runs used an extractor; the others have only what the parser read."
        )
    return tuple(found)
