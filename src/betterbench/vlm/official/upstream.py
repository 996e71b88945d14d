"""Interface of upstream scorers, and comparison of their scores with those of betterbench."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from betterbench.vlm.items import Item, ItemSet
from betterbench.vlm.scoring import StaticScore


class DroppedError(Exception):
    """Raised if the upstream program omits an item from its denominator."""


class StoppedError(Exception):
    """Raised if the upstream program stops with an error at an item."""


@dataclass(frozen=True, slots=True)
class UpstreamScorer:
    """Scorer that reproduces an upstream program.

    Attributes:
        name: Short name of the program.
        source: Repository, commit and file of the program.
        score: Function that returns the score of a reply. It raises DroppedError or StoppedError.
        group: Kind of group. The program's score is the mean over the mean scores of these groups. If None, it is the
            mean over all counted items.
        among: Names of the groups that are included in the mean. Empty if all groups are included.
        conventions: Coordinate conventions that the program can read. Empty if it can read all conventions.
    """

    name: str
    source: str
    score: Callable[[ItemSet, Item, str, str], Fraction]
    group: str | None = None
    among: tuple[str, ...] = ()
    conventions: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class UpstreamScore:
    """Result of an upstream scorer.

    Attributes:
        value: Score that the program gives, or None if it stops with an error or scores no item.
        scored: Number of items in the program's denominator.
        total: Number of items in the benchmark.
        differs: Number of items whose score differs from betterbench's score in the column "parsed".
        stopped_at: Identifier of the item at which the program stops with an error, or None.
        moved: Score that the program gives, minus betterbench's score in the column "parsed".
        note: Reason why there is no score. Empty if there is a score.
    """

    name: str
    source: str
    value: Fraction | None
    scored: int
    total: int
    differs: int
    stopped_at: str | None
    moved: Fraction | None
    note: str = ""

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict. Rates in it are fractions."""
        return {
            "name": self.name,
            "source": self.source,
            "value": None if self.value is None else float(self.value),
            "scored": self.scored,
            "total": self.total,
            "differs": self.differs,
            "stopped_at": self.stopped_at,
            "moved": None if self.moved is None else float(self.moved),
            "note": self.note,
        }


def upstream_scores(
    scorers: tuple[UpstreamScorer, ...],
    items: ItemSet,
    texts: Mapping[str, str],
    ours: StaticScore,
    coordinates: str,
) -> list[UpstreamScore]:
    """Score the same replies with several upstream programs. A missing reply is scored like an empty reply."""
    return [_scored(scorer, items, texts, ours, coordinates) for scorer in scorers]


def _scored(
    scorer: UpstreamScorer, items: ItemSet, texts: Mapping[str, str], ours: StaticScore, coordinates: str
) -> UpstreamScore:
    total = len(items.items)
    if scorer.conventions and coordinates not in scorer.conventions:
        note = f"reads {' or '.join(scorer.conventions)} only"
        return UpstreamScore(scorer.name, scorer.source, None, 0, total, 0, None, None, note)
    by_group: dict[str, list[Fraction]] = {}
    differs, scored, stopped = 0, 0, None
    for item, own in zip(items.items, ours.items, strict=True):
        try:
            score = scorer.score(items, item, texts.get(item.id, ""), coordinates)
        except DroppedError:
            differs += 1
            continue
        except StoppedError:
            stopped = item.id
            break
        scored += 1
        differs += score != own.score_in("parsed")
        by_group.setdefault(item.groups.get(scorer.group, "") if scorer.group else "", []).append(score)
    means = [
        sum(of, Fraction(0)) / len(of) for name, of in by_group.items() if not scorer.among or name in scorer.among
    ]
    value = sum(means, Fraction(0)) / len(means) if means and stopped is None else None
    moved = None if value is None else value - ours.headline["parsed"]
    note = "" if stopped is None else "ends with an error"
    return UpstreamScore(scorer.name, scorer.source, value, scored, total, differs, stopped, moved, note)
