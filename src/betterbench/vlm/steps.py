"""Stepwise comparison of ``better vlm`` runs, in the layout of Table 3 in arXiv:2604.18000 ("the paper").

A row is a model with its image resolution and prompt, and a column is a benchmark. Each row is compared with the row
above it on the same items. A step between two rows is only supported if its paired test is significant after Holm's
correction over all steps in the table. The paper itself draws conclusions about steps from single numbers, for example
from a drop on EgoPlan-Bench2 from 33.38 to 31.95 after co-training.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import Any

from betterbench.errors import InvalidInputError, RunConflictError
from betterbench.statistics import Difference, Reading, holm
from betterbench.vlm.eyesight import EyesightComparison, compare_eyes, reading, with_common_kinds
from betterbench.vlm.pairs import paired_difference, paired_p
from betterbench.vlm.stored import StoredItem, StoredRun, read_static_run

FACTORS = {
    "model": "model",
    "eyes": "eyes",
    "max_tiles": "tiles",
    "prompt": "prompt",
    "coordinates": "coordinates",
    "extractor": "extractor",
    "max_tokens": "longest answer",
}
"""Settings of a run that may explain a difference, each with the name that is shown for it."""
_ABOUT_THE_MODEL = ("model", "eyes", "tiles")


@dataclass(frozen=True, slots=True)
class Cell:
    """Cell of the table, with the headline number of one model on one benchmark.

    Attributes:
        value: Headline number of the benchmark, as a fraction.
        n: Number of items on which the headline number is based.
        run: Folder of the run.
        parts: Mean score of each group that is a column of the paper's table, keyed by the name of the group.
    """

    value: float
    n: int
    run: str
    parts: dict[str, float]


@dataclass(frozen=True, slots=True)
class Row:
    """Row of the table: one model with its image resolution and prompt, and its headline number for each benchmark."""

    name: str
    cells: dict[str, Cell]


@dataclass(frozen=True, slots=True)
class Step:
    """Difference between a row of the table and the row above it, on one benchmark.

    Attributes:
        upper: Name of the upper row.
        lower: Name of the lower row.
        benchmark: Name of the benchmark.
        difference: Paired difference of the mean scores (upper minus lower row), as a fraction. It is based on the
            items that are included in the headline number.
        p: p-value of the paired test.
        adjusted: p-value after Holm's correction over all steps in the table.
        test: Name of the test.
        changed: Settings that differ between the two runs.
        is_supported: Whether the adjusted p-value is below the significance level.
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
        """Description of the difference between the two rows in words."""
        points = 100 * (self.difference.value or 0.0)
        moved = "the same score as"
        if points != 0:
            moved = f"{abs(points):.1f} points {'less' if points > 0 else 'more'} than"
        low, high = sorted((-self.difference.low_pp, -self.difference.high_pp))
        verdict = "supported" if self.is_supported else "not supported"
        text = f"{self.benchmark}: {self.lower} has {moved} {self.upper} ({low:+.1f} to {high:+.1f}, {verdict})."
        if len(self.changed) > 1:
            text += f" {' and '.join(self.changed)} changed together, so it is unknown which one is the cause."
        elif not self.changed:
            text += " No setting changed, so the second run repeats the first."
        elif self.changed[0] not in _ABOUT_THE_MODEL:
            text += f" Only the {self.changed[0]} changed, so the step does not compare models."
        return text

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict."""
        return {**asdict(self), "sentence": self.sentence}


@dataclass(frozen=True, slots=True)
class GroupStep:
    """Difference between a row of the table and the row above it, on one group of questions, such as a relation.

    Attributes:
        upper: Name of the upper row.
        lower: Name of the lower row.
        benchmark: Title of the benchmark.
        kind: Kind of group, such as "relation".
        name: Name of the group, such as "left".
        n: Number of items in the group.
        difference: Paired difference of the mean scores (upper minus lower row), as a fraction.
        p: p-value of the paired test.
        adjusted: p-value after Holm's correction over all groups of this kind in the table.
        is_supported: Whether the adjusted p-value is below the significance level.
        explained_by: Smaller groups that explain the difference. Each of them has a supported difference. Without the
            items of these groups, the difference is not significant.
    """

    upper: str
    lower: str
    benchmark: str
    kind: str
    name: str
    n: int
    difference: Difference
    p: float
    adjusted: float
    is_supported: bool
    explained_by: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict."""
        return asdict(self)


@dataclass(frozen=True, slots=True)
class StepTable:
    """Table of runs, with the steps between neighboring rows.

    Attributes:
        column: Column of the scores: "strict", "parsed" or "extracted".
        alpha: Significance level of the tests.
        warnings: Differences between runs that limit the comparison.
        groups: Steps on each group of questions.
        eyesight: Comparisons between runs of one model that differ only in image resolution ("eyes"), for benchmarks
            with known object sizes.
    """

    column: str
    alpha: float
    benchmarks: tuple[str, ...]
    rows: tuple[Row, ...]
    steps: tuple[Step, ...]
    warnings: tuple[str, ...] = ()
    groups: tuple[GroupStep, ...] = ()
    eyesight: tuple[EyesightComparison, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict. All rates in it are fractions."""
        return {
            "column": self.column,
            "alpha": self.alpha,
            "benchmarks": self.benchmarks,
            "rows": [asdict(row) for row in self.rows],
            "steps": [step.to_json() for step in self.steps],
            "warnings": self.warnings,
            "groups": [group.to_json() for group in self.groups],
            "eyesight": [found.to_json() for found in self.eyesight],
        }


def step_table(
    paths: Sequence[Path], *, names: Sequence[str] = (), column: str = "parsed", alpha: float = 0.05
) -> StepTable:
    """Compare several runs in a table.

    Args:
        paths: Folders of the runs, in the order of the rows. Runs with the same name are in one row.
        names: Label of the table row for each run. If empty, the label consists of the model, its image resolution and
            number of tiles and, if runs differ only in the prompt, the prompt.
        column: Column of the scores: "strict", "parsed" or "extracted".
        alpha: Significance level of the tests.

    Raises:
        InvalidInputError: If the number of names differs from the number of runs.
        RecordError: If a run is not finished or was changed.
        RunConflictError: If a row has two runs on the same benchmark, or if two runs on a benchmark used different
            data.
    """
    if names and len(names) != len(paths):
        problem = f"{len(names)} names are given for {len(paths)} runs"
        raise InvalidInputError("--name", problem, "Use --name once for each run, or not at all")
    rows: dict[str, dict[str, StoredRun]] = {}
    runs = [read_static_run(path) for path in paths]
    for path, run, name in zip(paths, runs, names or _names(runs), strict=True):
        row = rows.setdefault(name, {})
        known = row.setdefault(run.benchmark.name, run)
        if known is not run:
            problem = f"{known.path} and {path} are both {name!r} on {run.benchmark.name}"
            raise RunConflictError(f"{problem}. Use --name to give each run a different name.")
    benchmarks = tuple(dict.fromkeys(b for row in rows.values() for b in row))
    for benchmark in benchmarks:
        _require_same_data([row[benchmark] for row in rows.values() if benchmark in row])
    shown = tuple(Row(name, {b: _cell(run, column) for b, run in row.items()}) for name, row in rows.items())
    steps = _steps(rows, benchmarks, column, alpha)
    groups = _group_steps(rows, benchmarks, column, alpha)
    seen = tuple(_eyesight(rows, benchmarks, column))
    return StepTable(column, alpha, benchmarks, shown, steps, _warnings(rows, column), groups, seen)


def _names(runs: Sequence[StoredRun]) -> list[str]:
    """Return the label of the table row for each run.

    The label consists of the model, the image resolution and the number of tiles. If runs differ only in the prompt,
    the label also contains the prompt.
    """
    plain = [(_name(run), run.benchmark.name) for run in runs]
    prompts = defaultdict[tuple[str, str], set[str]](set)
    for key, run in zip(plain, runs, strict=True):
        prompts[key].add(str(run.head["prompt"]))
    return [
        key[0] if len(prompts[key]) == 1 else f"{key[0]}, {run.head['prompt']}"
        for key, run in zip(plain, runs, strict=True)
    ]


def _name(run: StoredRun) -> str:
    eyes = _eyes(run)
    return str(run.head["model"]) + ("" if eyes == "native" else f", {eyes.removeprefix('native, ')}")


def _cell(run: StoredRun, column: str) -> Cell:
    kind = run.benchmark.columns
    scores: dict[str, list[Fraction]] = defaultdict(list)
    for item in run.items.values():
        if kind in item.groups:
            scores[item.groups[kind]].append(item.score_in(column))
    parts = {name: float(sum(of, Fraction(0)) / len(of)) for name, of in sorted(scores.items())}
    return Cell(run.headline[column], len(run.counted()), str(run.path), parts)


def _require_same_data(runs: Sequence[StoredRun]) -> None:
    first, *others = runs
    for other in others:
        if other.head["data"] != first.head["data"]:
            problem = f"{first.path} and {other.path} use different data of {first.benchmark.name}"
            raise RunConflictError(f"{problem}. Run one of the models again with the data of the other run (--data).")


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


def _group_steps(
    rows: dict[str, dict[str, StoredRun]], benchmarks: Sequence[str], column: str, alpha: float
) -> tuple[GroupStep, ...]:
    """Return the changes in score from each row of the table to the next, for all groups of questions.

    The p-values are corrected over all groups of the same kind.
    """
    found: dict[str, list[GroupStep]] = defaultdict(list)
    for (upper, above), (lower, below) in pairwise(rows.items()):
        for benchmark in benchmarks:
            if benchmark in above and benchmark in below:
                for step in _steps_of_groups(upper, lower, above[benchmark], below[benchmark], column):
                    found[step.kind].append(step)
    corrected = []
    for steps in found.values():
        for step, adjusted in zip(steps, holm([s.p for s in steps]), strict=True):
            corrected.append(replace(step, adjusted=adjusted, is_supported=adjusted < alpha))
    return tuple(_explained(step, corrected, rows, column, alpha) for step in corrected)


def _explained(
    step: GroupStep, steps: Sequence[GroupStep], rows: dict[str, dict[str, StoredRun]], column: str, alpha: float
) -> GroupStep:
    """Add to a step the smaller groups that explain it, such as the one relation for which the score drops."""
    same = (step.upper, step.lower, step.benchmark)
    smaller = [s for s in steps if s.is_supported and (s.upper, s.lower, s.benchmark) == same and s.n < step.n]
    if not step.is_supported or not smaller:
        return step
    run = next(run for run in rows[step.upper].values() if run.benchmark.title == step.benchmark)
    below = rows[step.lower][run.benchmark.name].items
    members = [item for item in run.items.values() if item.groups.get(step.kind) == step.name]
    sharing = [s for s in smaller if any(item.groups.get(s.kind) == s.name for item in members)]
    rest = [item for item in members if all(item.groups.get(s.kind) != s.name for s in sharing)]
    pairs = [(item.score_in(column), below[item.id].score_in(column)) for item in rest]
    purpose = f"{run.benchmark.name}:{step.upper}:{step.lower}:{step.kind}:{step.name}:rest"
    if not sharing or paired_p(pairs, [item.cluster for item in rest], purpose)[0] < alpha:
        return step
    return replace(step, explained_by=tuple(f"{s.kind}: {s.name}" for s in sharing))


def _steps_of_groups(upper: str, lower: str, above: StoredRun, below: StoredRun, column: str) -> Iterator[GroupStep]:
    """Yield the change in score between two runs for each group of questions, with an uncorrected p-value.

    Kinds of groups that have only one group are left out.
    """
    title, second = above.benchmark.title, below.items
    for kind in above.benchmark.groups:
        groups: dict[str, list[StoredItem]] = defaultdict(list)
        for item in above.items.values():
            if kind in item.groups:
                groups[item.groups[kind]].append(item)
        for name, items in groups.items() if len(groups) > 1 else ():
            pairs = [(item.score_in(column), second[item.id].score_in(column)) for item in items]
            clusters = [item.cluster for item in items]
            purpose = f"{above.benchmark.name}:{upper}:{lower}:{kind}:{name}"
            p, _ = paired_p(pairs, clusters, purpose)
            difference = paired_difference(pairs, clusters, purpose)
            yield GroupStep(upper, lower, title, kind, name, len(items), difference, p, p, is_supported=False)


def _eyesight(
    rows: dict[str, dict[str, StoredRun]], benchmarks: Sequence[str], column: str
) -> Iterator[EyesightComparison]:
    """Yield an eyesight comparison for each set of runs that differ only in image resolution and number of tiles."""
    same = [key for key in FACTORS if key not in ("eyes", "max_tiles")]
    for benchmark in benchmarks:
        models: dict[tuple[Any, ...], dict[str, StoredRun]] = defaultdict(dict)
        for row in rows.values():
            if benchmark in row:
                run = row[benchmark]
                models[tuple(run.head.get(key) for key in same)].setdefault(_eyes(run), run)
        for runs in models.values():
            if len(runs) > 1:
                first = next(iter(runs.values()))
                readings = [(eyes, _readings(run, eyes, column)) for eyes, run in runs.items()]
                found = compare_eyes(str(first.head["model"]), first.benchmark.title, readings)
                if found is not None:
                    yield found


def _eyes(run: StoredRun) -> str:
    """Return the image resolution of a run, followed by the maximum number of tiles if one was given."""
    tiles = run.head.get("max_tiles")
    return str(run.head.get("eyes", "native")) + ("" if tiles is None else f", {tiles} tiles")


def _readings(run: StoredRun, eyes: str, column: str) -> list[Reading]:
    """Return the scores of all items in a run that have a known object size, for fitting the eyesight threshold."""
    return with_common_kinds(
        [reading(i.size_px, float(i.score_in(column)), i, eyes) for i in run.items.values() if i.size_px is not None]
    )


def _warnings(rows: dict[str, dict[str, StoredRun]], column: str) -> tuple[str, ...]:
    runs = [run for row in rows.values() for run in row.values()]
    found = []
    with_extractor = [run for run in runs if run.head.get("extractor") is not None]
    if column == "extracted" and 0 < len(with_extractor) < len(runs):
        found.append(
            f"{len(with_extractor)} of {len(runs)} runs used an extractor; the others have only what the parser read."
        )
    for name, row in rows.items():
        for run in row.values():
            refused = run.head.get("refused")
            if isinstance(refused, int) and refused > 0:
                found.append(
                    f"{name}, {run.benchmark.title}: the server rejected {refused:,} of {len(run.items):,} requests, "
                    "which count as wrong."
                )
    return tuple(found)
