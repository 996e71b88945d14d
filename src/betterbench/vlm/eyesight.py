"""Eyesight of a model: the smallest object size at which it answers questions correctly.

Eyesight is estimated from the answers of the model. Each item of a question set from ``better vqa`` contains the size
of its object in the image. A psychometric function is fitted to the scores of one run, and yields the object size at
which the model can answer half of the questions (:mod:`betterbench.statistics.threshold`). If the function is fitted to
several runs of the same model with different image resolutions ("eyes"), it shows whether a single size explains all
scores. If one size explains them, the only effect of a lower resolution is that small objects become unreadable. All
sizes are measured at the effective resolution of the shown images
(:func:`~betterbench.vlm.models.eyes.size_in_detail`). They are geometric means of width and height in pixels.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from betterbench.statistics import Reading, Threshold, fit_threshold
from betterbench.tasks.randomness import stream
from betterbench.vlm.items import ItemSet
from betterbench.vlm.models.eyes import Eyes
from betterbench.vlm.scoring import StaticScore

LEAST_OF_FAMILY = 20
"""Minimum number of questions for which a family gets its own knowledge parameter. Smaller families share the parameter
of their question type."""
LEAST_PX = 0.5
"""Minimum object size [pixel]. Smaller sizes are replaced by it, since fractions of a pixel cannot be recognized."""


def readings_of(items: ItemSet, score: StaticScore, eyes: Eyes, column: str) -> list[Reading]:
    """Return the scores of all items with a known object size, for fitting the eyesight threshold."""
    found = []
    for item, scored in zip(items.items, score.items, strict=True):
        size = item.size_px(eyes)
        if size is not None:
            found.append(reading(size, float(scored.score_in(column)), item, eyes))
    return with_common_kinds(found)


class Grouped(Protocol):
    """Item of a benchmark with its groups, read either from the data of the benchmark or from a stored run."""

    @property
    def groups(self) -> Mapping[str, str]:
        """Name of the item's group for each kind of group."""

    @property
    def cluster(self) -> str:
        """Name of the item's cluster. The scores of items in the same cluster are not independent."""

    @property
    def chance(self) -> float | None:
        """Probability of guessing the answer, or None if unknown."""


def reading(size: float, score: float, item: Grouped, eyes: str) -> Reading:
    """Return the score of an item and the size of its object [pixel], for fitting the eyesight threshold.

    The kind of the item is its question type together with its family.
    """
    kind = f"{item.groups.get('type', '')}\n{item.groups.get('family', '')}"
    return Reading(max(size, LEAST_PX), score, item.chance or 0.0, kind, item.cluster, str(eyes))


def with_common_kinds(readings: Sequence[Reading]) -> list[Reading]:
    """Assign all items of rare families to one kind per question type.

    The fit of the eyesight threshold estimates one parameter per kind, for which a rare family has too few items.
    """
    counts = Counter(r.kind for r in readings)
    kinds = {kind: kind.split("\n")[counts[kind] >= LEAST_OF_FAMILY] for kind in counts}
    return [replace(r, kind=kinds[r.kind]) for r in readings]


def eyesight(readings: Sequence[Reading], purpose: str) -> Threshold | None:
    """Estimate the smallest object size that a model can recognize. Returns None if there are no scored items.

    Args:
        readings: Scores of items and sizes of their objects, from one run or from several runs with different image
            resolutions ("eyes").
        purpose: Name of the estimate. The random seed of the bootstrap is derived from it.
    """
    if not readings:
        return None
    return fit_threshold(readings, generator=_draws(purpose))


def eyesight_sentence(found: Threshold) -> str:
    """Describe an estimated eyesight threshold in one sentence."""
    if found.value is None:
        return f"Eyesight: {found.n} questions do not show the smallest readable size, because {found.reason}."
    return (
        f"Eyesight: the model recognizes objects from {found.value:.1f} pixels (95 % interval {found.low:.1f} to "
        f"{found.high:.1f}; "
        f"{found.n} questions about objects of {found.smallest:.0f} to {found.largest:.0f} pixels)."
    )


@dataclass(frozen=True, slots=True)
class EyesightComparison:
    """Eyesight of one model on one benchmark, compared between runs with different image resolutions (``--eyes``).

    Attributes:
        name: Name of the model, with all settings that the runs have in common.
        benchmark: Title of the benchmark.
        scores: Mean score of the items with a known object size, for each image resolution.
        alone: Threshold fitted to each run alone, for each image resolution.
        one: Threshold fitted to all runs together. For each run except the first, it also contains the part of the loss
            (compared with the first run) that the object sizes do not explain.
    """

    name: str
    benchmark: str
    scores: dict[str, float]
    alone: dict[str, Threshold]
    one: Threshold

    @property
    def further(self) -> tuple[str, ...]:
        """Image resolutions whose scores differ significantly from the scores expected from the object sizes."""
        return tuple(eyes for eyes, loss in self.one.further.items() if loss.is_supported)

    @property
    def sentence(self) -> str:
        """Result of the comparison, described in words."""
        where = f"{self.name}, {self.benchmark}"
        if self.one.value is None:
            unknown = "it cannot be concluded whether one size explains the scores with all eyes"
            return f"{where}: {unknown}, because {self.one.reason}."
        size = f"{self.one.value:.1f} pixels ({self.one.low:.1f} to {self.one.high:.1f})"
        if not self.further:
            return f"{where}: one size, {size}, explains the differences between the eyes."
        losses = []
        for eyes in self.further:
            loss = self.one.further[eyes]
            word = "loses" if loss.value > 0 else "gains"
            losses.append(
                f"{eyes} {word} {abs(100 * loss.value):.1f} points more than the sizes explain "
                f"({100 * loss.low:+.1f} to {100 * loss.high:+.1f})"
            )
        return (
            f"{self.name}, {self.benchmark}: one size does not explain the scores with all eyes. {'; '.join(losses)}."
        )

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict. All rates in it are fractions."""
        return {
            "name": self.name,
            "benchmark": self.benchmark,
            "scores": self.scores,
            "alone": {eyes: found.to_json() for eyes, found in self.alone.items()},
            "one": self.one.to_json(),
            "sentence": self.sentence,
        }


def compare_eyes(name: str, benchmark: str, runs: Sequence[tuple[str, Sequence[Reading]]]) -> EyesightComparison | None:
    """Compare runs of one model with different image resolutions on the same items.

    Returns None if no item has a known object size.

    Args:
        name: Name of the model.
        benchmark: Title of the benchmark.
        runs: Eyes (image resolution) and scored items of each run. The other runs are compared with the first run.
    """
    everything = [r for _, readings in runs for r in readings]
    if not everything:
        return None
    purpose = f"{benchmark}:{name}"
    alone = {eyes: fit_threshold(of, generator=_draws(f"{purpose}:{eyes}")) for eyes, of in runs}
    return EyesightComparison(
        name,
        benchmark,
        {eyes: sum(r.score for r in of) / len(of) for eyes, of in runs},
        alone,
        fit_threshold(everything, generator=_draws(f"{purpose}:one")),
    )


def _draws(purpose: str) -> np.random.Generator:
    return stream("static eyesight", 0, purpose)
