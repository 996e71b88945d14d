"""Finished runs of ``better vlm``, read from their folders."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from betterbench.errors import InvalidInputError, RecordError
from betterbench.json_form import open_form, open_seal, open_sealed_lines, read_bounded, read_form
from betterbench.vlm.benchmarks import Benchmark, find_benchmark
from betterbench.vlm.running import ITEMS_NAME, KIND, RESULT_NAME, RUN_NAME
from betterbench.vlm.scoring import COLUMNS, score_in_column
from betterbench.vqa.parsing import Stage

_MAX_BYTES = 1 << 28
_CURE = "Run `better vlm` again with the same --out. Items that already have an answer are not repeated"


@open_form
@dataclass(frozen=True, slots=True)
class StoredItem:
    """Score of an item, as stored in the folder of a run.

    Attributes:
        score: Exact score of the value, such as "0", "1" or "2/3".
        stage: Stage of parsing in which the value was read.
        groups: Name of the item's group for each kind of group.
        cluster: Name of the scene, image or video that the item is about. Scores of items in the same cluster are not
            independent.
        size_px: Size of the smallest object that the question is about, at the resolution of the run [pixel]. None if
            unknown.
        chance: Probability of guessing the answer, or None if unknown.
        value: Value that was read from the answer, or None if the answer could not be read.
        prompt: The prompt. None in runs that were written by earlier versions.
        target: The correct answer. None in runs that were written by earlier versions.
    """

    id: str
    score: str
    stage: Stage
    groups: dict[str, str]
    cluster: str
    size_px: float | None = None
    chance: float | None = None
    value: str | None = None
    prompt: str | None = None
    target: str | None = None

    def score_in(self, column: str) -> Fraction:
        """Return the score of the item in a column of :data:`~betterbench.vlm.scoring.COLUMNS`."""
        return score_in_column(Fraction(self.score), self.stage, column)


@dataclass(frozen=True, slots=True)
class StoredRun:
    """A finished run of ``better vlm``, read from its folder.

    Attributes:
        path: Folder of the run.
        head: Settings and overall results of the run.
        items: Score of each item, in the order of the data.
        headline: Headline number of the benchmark in each column, as a fraction.
    """

    path: Path
    head: Mapping[str, Any]
    items: Mapping[str, StoredItem]
    headline: Mapping[str, float]

    @property
    def benchmark(self) -> Benchmark:
        """Benchmark on which the model was evaluated."""
        return find_benchmark(str(self.head["benchmark"]))

    def static_gap(self, column: str) -> float | None:
        """Return the static illusion gap over all pairs, in one column of the scores, as a fraction.

        Returns None if the run has no static illusion gap.
        """
        told = self.head.get("static_gap")
        if not isinstance(told, Mapping):
            return None
        try:
            return float(told["by_column"][column][0]["difference"]["value"])
        except (KeyError, IndexError, TypeError, ValueError) as error:
            raise RecordError(f"{self.path / RESULT_NAME}: its static gap has no entry {error}. {_CURE}.") from error

    def counted(self) -> tuple[StoredItem, ...]:
        """Return the items that are included in the headline number of the benchmark."""
        rule = self.benchmark.headline
        if rule.rule == "micro":
            return tuple(self.items.values())
        return tuple(i for i in self.items.values() if not rule.among or i.groups.get(rule.over) in rule.among)


_ITEM = TypeAdapter(StoredItem)


def is_static_run(path: Path) -> bool:
    """Return whether a folder contains a run of ``better vlm``."""
    file = path / RUN_NAME
    if not file.is_file():
        return False
    try:
        head = open_seal(read_bounded(file, max_bytes=_MAX_BYTES, cure=_CURE), where=str(file), cure=_CURE)
    except InvalidInputError:
        return False
    return head.get("kind") == KIND


def read_static_run(path: Path) -> StoredRun:
    """Read a finished run of ``better vlm``.

    Raises:
        RecordError: If the run is not finished, or a file was changed or cannot be read.
    """
    file = path / RESULT_NAME
    if not file.is_file():
        raise RecordError(f"{path}: this run is not finished. {_CURE}.")
    result = open_seal(_bytes(file), where=str(file), cure=_CURE, raises=RecordError)
    where = path / ITEMS_NAME
    items: dict[str, StoredItem] = {}
    lines = open_sealed_lines(_bytes(where), where=str(where), cure=_CURE, raises=RecordError)
    for number, line in enumerate(lines, start=1):
        item = read_form(_ITEM, line, where=f"{where}, line {number}", cure=_CURE, raises=RecordError)
        items[item.id] = item
    try:
        headline = {column: float(result["headline"][column]) for column in COLUMNS}
        head = {name: result[name] for name in ("benchmark", "data", "model", "prompt", "coordinates")}
    except (KeyError, TypeError, ValueError) as error:
        raise RecordError(f"{file} has no entry {error}. {_CURE}.") from error
    return StoredRun(path, {**result, **head}, items, headline)


def _bytes(file: Path) -> bytes:
    return read_bounded(file, max_bytes=_MAX_BYTES, cure=_CURE, raises=RecordError)
