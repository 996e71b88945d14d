"""Scores of answers. All items of a benchmark are in the denominator, with or without an answer.

An item scores 0 if it has no answer, if its request was rejected, or if its answer cannot be read. Each score has three
columns. The first column only counts values that the strict parser has read. The second column also counts values that
the tolerant parser has read. The third column also counts values that an extractor has copied from the remaining
answers.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from fractions import Fraction
from math import floor
from typing import Any

from betterbench.statistics import ClusteredMean, clustered_mean
from betterbench.vlm.benchmarks.benchmark import Benchmark
from betterbench.vlm.items import Item, ItemSet
from betterbench.vlm.static_gap import StaticGaps, static_gaps
from betterbench.vqa.coordinates import Convention
from betterbench.vqa.parsing import Read, Stage, read_text
from betterbench.vqa.parsing.extractor import read_extraction
from betterbench.vqa.parsing.points import exact_groups
from betterbench.vqa.question import Form
from betterbench.vqa.scoring import is_in_place

COLUMNS = ("strict", "parsed", "extracted")
"""Columns of a score: values from the strict parser, from both parsers, and from both parsers and the extractor."""

_LEVELS = {"easy": 1, "medium": 2, "hard": 3}


def score_in_column(score: Fraction, stage: Stage, column: str) -> Fraction:
    """Return the score of an item in a column of :data:`COLUMNS`.

    The score is 0 if the column does not count values that were read in the given parsing stage.
    """
    counted = {"strict": ("strict",), "parsed": ("strict", "tolerant")}.get(column)
    return score if counted is None or stage in counted else Fraction(0)


@dataclass(frozen=True, slots=True)
class ItemScore:
    """Score of one item.

    Attributes:
        value: Value that was read from the answer, or None (see :class:`~betterbench.vqa.parsing.Read`).
        stage: Stage of parsing in which the value was read.
        score: Score of the value, between 0 and 1.
        is_answered: Whether the model gave a reply.
        is_outside: Whether a point or box is partly outside the image. This suggests a different coordinate convention.
    """

    id: str
    value: str | None
    stage: Stage
    score: Fraction
    is_answered: bool
    is_outside: bool = False

    def score_in(self, column: str) -> Fraction:
        """Return the score of the item in a column of :data:`COLUMNS`."""
        return score_in_column(self.score, self.stage, column)


@dataclass(frozen=True, slots=True)
class Part:
    """Score of a part of a benchmark.

    Attributes:
        kind: Kind of group, or "all".
        name: Name of the group, or "all".
        n: Number of items.
        answered: Number of items that the model answered.
        read: Number of items whose answer could be read.
        means: Mean score in each column.
        if_dropped: Mean score over the answered items only, for comparison with programs that drop failed items. None
            if no item was answered.
        reference: Reference rates in percent, such as the success rate of guessing.
    """

    kind: str
    name: str
    n: int
    answered: int
    read: int
    means: Mapping[str, ClusteredMean]
    if_dropped: Fraction | None
    reference: Mapping[str, float] = field(default_factory=dict)

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict. All rates in it are fractions."""
        means = {column: mean.to_json() for column, mean in self.means.items()}
        dropped = None if self.if_dropped is None else float(self.if_dropped)
        return {**asdict(self), "means": means, "if_dropped": dropped, "reference": dict(self.reference)}


@dataclass(frozen=True, slots=True)
class StaticScore:
    """Scores of a model on a benchmark.

    Attributes:
        parts: Scores of the whole benchmark and of each group. The first is that of the whole benchmark ("all").
        macro: Unweighted mean over the groups of each kind, in each column.
        headline: Headline number of the benchmark in each column.
        rule: Description of how the headline number is computed.
        changed: Number of items whose score the extractor changed.
        outside: Number of items for which the answer has a point or box that is partly outside the image.
        items: Scores of the items, in order.
        gaps: Static illusion gaps. None if no question has a twin, i.e. the same question about the training scene.
    """

    benchmark: str
    parts: tuple[Part, ...]
    macro: Mapping[str, Mapping[str, Fraction]]
    headline: Mapping[str, Fraction]
    rule: str
    changed: int
    outside: int
    items: tuple[ItemScore, ...]
    gaps: StaticGaps | None = None

    @property
    def all(self) -> Part:
        """Score of the whole benchmark: the micro mean of the scores of all items."""
        return self.parts[0]

    def part(self, kind: str, name: str) -> Part:
        """Return the score of a group. Raises KeyError if there is no such group."""
        return next((p for p in self.parts if (p.kind, p.name) == (kind, name)), None) or _no_part(kind, name)

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict without the items. All rates in it are fractions."""
        return {
            "benchmark": self.benchmark,
            "rule": self.rule,
            "headline": {column: float(v) for column, v in self.headline.items()},
            "macro": {kind: {c: float(v) for c, v in means.items()} for kind, means in self.macro.items()},
            "changed_by_extractor": self.changed,
            "outside_the_picture": self.outside,
            "parts": [part.to_json() for part in self.parts],
            "static_gap": None if self.gaps is None else self.gaps.to_json(),
        }


def _no_part(kind: str, name: str) -> Part:
    raise KeyError((kind, name))


def score_answers(
    benchmark: Benchmark,
    items: ItemSet,
    texts: Mapping[str, str],
    convention: Convention,
    *,
    extractions: Mapping[str, str] | None = None,
) -> StaticScore:
    """Score the replies of a model.

    Args:
        benchmark: The benchmark.
        items: Items of the benchmark.
        texts: Reply of the model to each item, keyed by the item's id. Items without a reply score 0.
        convention: Declared coordinate convention.
        extractions: Replies of an extractor, keyed by the item's id, or None.
    """
    told = extractions or {}
    scores = tuple(_score(items, item, texts.get(item.id), convention, told.get(item.id)) for item in items.items)
    parts = tuple(_parts(benchmark, items, scores))
    macro = {
        kind: {column: _mean([_of(p, column) for p in parts if p.kind == kind]) for column in COLUMNS}
        for kind in benchmark.groups
    }
    head = benchmark.headline
    counted = [p for p in parts if p.kind == head.over and (not head.among or p.name in head.among)]
    used = parts[:1] if head.rule == "micro" else counted
    return StaticScore(
        benchmark=benchmark.name,
        parts=parts,
        macro=macro,
        headline={column: _mean([_of(p, column) for p in used]) for column in COLUMNS},
        rule=head.words,
        changed=sum(s.stage == "extractor" and s.score > 0 for s in scores),
        outside=sum(s.is_outside for s in scores),
        items=scores,
        gaps=static_gaps(items, {column: {s.id: s.score_in(column) for s in scores} for column in COLUMNS}),
    )


def _of(part: Part, column: str) -> Fraction:
    return part.means[column].mean or Fraction(0)


def _mean(values: Sequence[Fraction]) -> Fraction:
    return sum(values, Fraction(0)) / len(values) if values else Fraction(0)


def _score(items: ItemSet, item: Item, text: str | None, convention: Convention, extraction: str | None) -> ItemScore:
    spec = item.spec(convention)
    read = Read(None, "none") if not text else read_text(spec, text)
    if read.answer is None and text and extraction is not None:
        read = read_extraction(spec, text, extraction)
    score, outside = score_of(items, item, read.answer)
    return ItemScore(item.id, read.answer, read.stage, score, bool(text), outside)


def score_of(items: ItemSet, item: Item, value: str | None) -> tuple[Fraction, bool]:
    """Return the score of an answer, between 0 and 1, and whether the answer has positions outside the image."""
    if value is None:
        return Fraction(0), False
    if item.form in (Form.BOX, Form.POINT, Form.POINTS):
        groups = exact_groups(value)
        outside = any(not 0 <= v <= (item.width, item.height)[i % 2] for group in groups for i, v in enumerate(group))
        if item.form is Form.POINTS:
            return _share_in_mask(items, item, groups), outside
        places = [[float(v) for v in group] for group in groups]
        return Fraction(is_in_place(places, box=item.gold.box, runs=item.gold.runs, width=item.width)), outside
    return Fraction(value == item.gold.text), False


def _share_in_mask(items: ItemSet, item: Item, groups: list[list[Fraction]]) -> Fraction:
    """Return the fraction of points that are in the target region.

    A point counts as the pixel that contains it. A point on the right or lower edge of the image counts as the last
    pixel. Four numbers are a box, which counts as all pixels inside it, as in RoboRefer's evaluation. Points outside
    the image score 0.
    """
    if item.gold.mask is None:
        return Fraction(0)
    mask = items.mask(item.gold.mask)
    rows, columns = mask.shape
    # The scale is 1 unless the mask has a different size than the image.
    scale = Fraction(columns, item.width), Fraction(rows, item.height)
    right, count = 0, 0
    for numbers in groups:
        group = [v * scale[i % 2] for i, v in enumerate(numbers)]
        if len(group) == 2:
            x, y = (_pixel(group[0], columns), _pixel(group[1], rows))
            count += 1
            right += 0 <= x < columns and 0 <= y < rows and bool(mask[y, x])
        elif len(group) == 4:
            left, top, end, bottom = map(floor, group)
            count += max(0, end - left) * max(0, bottom - top)
            right += int(mask[max(0, top) : max(0, bottom), max(0, left) : max(0, end)].sum())
    return Fraction(right, count) if count else Fraction(0)


def _pixel(value: Fraction, side: int) -> int:
    return side - 1 if value == side else floor(value)


def _parts(benchmark: Benchmark, items: ItemSet, scores: Sequence[ItemScore]) -> Iterator[Part]:
    """Yield the score of the whole benchmark, and then the score of each group."""
    pairs = list(zip(items.items, scores, strict=True))
    yield _part("all", "all", pairs, items)
    for kind in benchmark.groups:
        groups: dict[str, list[tuple[Item, ItemScore]]] = {}
        for item, score in pairs:
            if kind in item.groups:
                groups.setdefault(item.groups[kind], []).append((item, score))
        for name in sorted(groups, key=lambda name: (_LEVELS.get(name, 0), name)):
            yield _part(kind, name, groups[name], items)


def _part(kind: str, name: str, pairs: Sequence[tuple[Item, ItemScore]], items: ItemSet) -> Part:
    clusters = [item.cluster for item, _ in pairs]
    answered = [s for _, s in pairs if s.is_answered]
    return Part(
        kind=kind,
        name=name,
        n=len(pairs),
        answered=len(answered),
        read=sum(s.value is not None for _, s in pairs),
        means={c: clustered_mean([s.score_in(c) for _, s in pairs], clusters) for c in COLUMNS},
        if_dropped=_mean([s.score for s in answered]) if answered else None,
        reference=items.reference.get(name, {}),
    )
