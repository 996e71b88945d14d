"""Static illusion gap: accuracy of a model on training scenes minus its accuracy on variations of these scenes.

It corresponds to the illusion gap of a policy in simulation, i.e. to the drop in its success rate when the scene
changes. The static gap is measured with questions instead of actions, on the same scenes and seeds. Each question about
a variation is paired with its twin, the same question about the training scene
(:func:`~betterbench.vqa.twins.static_twins`). Pairs about the same training scene are not independent, so the
statistics treat them as a cluster.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from fractions import Fraction
from typing import Any, Literal

from betterbench.statistics import Difference, holm
from betterbench.vlm.items import AXIS, TRAINING, Item, ItemSet
from betterbench.vlm.pairs import paired_difference, paired_p

Kind = Literal["all", "axis", "type", "axis and type"]


@dataclass(frozen=True, slots=True)
class StaticGap:
    """Static illusion gap in one part of a benchmark.

    Attributes:
        kind: Kind of part, such as an axis of variation or a question type.
        name: "all", the name of an axis, the name of a question type, or "AXIS: TYPE".
        pairs: Number of questions that have a twin, i.e. the same question about the training scene.
        scenes: Number of training scenes.
        training: Mean score of the twins, as a fraction.
        variation: Mean score of the questions about variations, as a fraction.
        difference: Paired difference, training minus variation.
        p: p-value of the paired test. None for a combination of an axis and a question type, which is not tested
            because its pairs are already tested in two other parts.
        test: Name of the test. Empty if there is no test.
        adjusted: ``p`` after Holm's correction over all parts with a test.
        is_supported: Whether ``adjusted`` is below the significance level.
    """

    kind: Kind
    name: str
    pairs: int
    scenes: int
    training: float
    variation: float
    difference: Difference
    p: float | None
    test: str
    adjusted: float | None = None
    is_supported: bool = False

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict."""
        return {**asdict(self), "difference": self.difference.to_json()}


@dataclass(frozen=True, slots=True)
class StaticGaps:
    """Static illusion gaps of a run.

    Attributes:
        questions: Number of questions about variations.
        paired: Number of these questions that have a twin, i.e. the same question about the training scene.
        by_column: Gaps in each column of the scores. The first gap is over all pairs.
    """

    questions: int
    paired: int
    by_column: Mapping[str, tuple[StaticGap, ...]]

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict."""
        gaps = {column: [gap.to_json() for gap in found] for column, found in self.by_column.items()}
        return {"questions": self.questions, "paired": self.paired, "by_column": gaps}


def static_gaps(
    items: ItemSet, scores: Mapping[str, Mapping[str, Fraction]], *, alpha: float = 0.05
) -> StaticGaps | None:
    """Return the static illusion gaps of a run.

    Returns None if no item has a twin, i.e. the same question about the training scene.

    Args:
        items: Items and their twins.
        scores: Score of each item, in each column.
        alpha: Significance level of the tests, for all tested parts together.
    """
    by_id = {item.id: item for item in items.items}
    pairs = [(by_id[twin], by_id[name]) for name, twin in items.twins.items()]
    if not pairs:
        return None
    varied = sum(item.groups.get(AXIS, TRAINING) != TRAINING for item in items.items)
    found = {column: tuple(_gaps(pairs, of, alpha)) for column, of in scores.items()}
    return StaticGaps(varied, len(pairs), found)


def _gaps(pairs: Sequence[tuple[Item, Item]], scores: Mapping[str, Fraction], alpha: float) -> Iterator[StaticGap]:
    found = [_gap(kind, name, members, scores) for kind, name, members in _parts(pairs)]
    tested = [gap for gap in found if gap.p is not None]
    adjusted = dict(zip(map(id, tested), holm([gap.p or 0.0 for gap in tested]), strict=True))
    for gap in found:
        value = adjusted.get(id(gap))
        yield replace(gap, adjusted=value, is_supported=value is not None and value < alpha)


def _parts(pairs: Sequence[tuple[Item, Item]]) -> Iterator[tuple[Kind, str, list[tuple[Item, Item]]]]:
    yield "all", "all", list(pairs)
    axes, types = ({item.groups.get(kind, ""): None for _, item in pairs} for kind in (AXIS, "type"))
    for axis in sorted(axes):
        yield "axis", axis, [pair for pair in pairs if pair[1].groups.get(AXIS, "") == axis]
    for name in sorted(types):
        yield "type", name, [pair for pair in pairs if pair[1].groups.get("type", "") == name]
    for axis in sorted(axes):
        for name in sorted(types):
            both = [p for p in pairs if (p[1].groups.get(AXIS, ""), p[1].groups.get("type", "")) == (axis, name)]
            if both:
                yield "axis and type", f"{axis}: {name}", both


def _gap(kind: Kind, name: str, members: Sequence[tuple[Item, Item]], scores: Mapping[str, Fraction]) -> StaticGap:
    told = [(scores[twin.id], scores[item.id]) for twin, item in members]
    scenes = [twin.cluster for twin, _ in members]
    purpose = f"static gap:{kind}:{name}"
    p, test = (None, "") if kind == "axis and type" else paired_p(told, scenes, purpose)
    training, variation = (float(sum((pair[side] for pair in told), Fraction(0)) / len(told)) for side in (0, 1))
    difference = paired_difference(told, scenes, purpose)
    return StaticGap(kind, name, len(told), len(set(scenes)), training, variation, difference, p, test)
