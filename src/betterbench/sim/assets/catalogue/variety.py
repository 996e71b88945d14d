"""Select several assets with different shapes and colors for one description."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass

from betterbench.errors import InvalidInputError
from betterbench.sim.assets.catalogue.entry import CatalogueEntry
from betterbench.sim.assets.catalogue.expansion import COLORS, understood
from betterbench.sim.assets.catalogue.search import Catalogue, Filters, Hit
from betterbench.sim.assets.catalogue.terms import terms

MOST = 100
"""Maximum number of assets for one description."""
_SEARCHED = 60
_NEAR = 0.35
"""Minimum score of an asset with a different name than the best hit, as a fraction of the best score."""


@dataclass(frozen=True, slots=True)
class Chosen:
    """An asset that was chosen for a description.

    Attributes:
        id: Id of the asset. It includes the variant ("procedural/mug-red#3") if the row represents several variants.
        hit: Search result for the asset, with its catalogue row and its score.
    """

    id: str
    hit: Hit

    def to_json(self) -> dict[str, object]:
        """Return the asset as a JSON object."""
        return {**self.hit.to_json(), "id": self.id, "row": self.hit.entry.id}


def choose_different(
    catalogue: Catalogue, description: str, count: int, *, seed: int = 0, filters: Filters | None = None
) -> list[Chosen]:
    """Choose assets of the kind that fits a description best, so that they differ from each other as much as possible.

    The first asset is drawn from the best results. Each further asset is the one that differs most from the assets
    already chosen, in source, color, variant and proportions. If the description names a color, all assets have that
    color.

    Args:
        catalogue: Catalogue to search.
        description: Description of the object in plain words.
        count: Number of assets to choose.
        seed: Random seed. The same seed gives the same assets.
        filters: Filters of the search.

    Raises:
        InvalidInputError: If ``count`` is out of range, or too few assets in the catalogue fit the description.
    """
    if not 1 <= count <= MOST:
        raise InvalidInputError("num", f"{count} is out of range", f"Use a number from 1 to {MOST}")
    hits = _of_one_kind(catalogue.search(description, limit=_SEARCHED, filters=filters), description)
    left = [Chosen(one, hit) for hit in hits for one in _looks(hit.entry)]
    if not left:
        problem = f"no asset in the catalogue fits {description!r}"
        raise InvalidInputError(
            "query", problem, "Use other words, allow more licenses with --license any, or index more sources"
        )
    if len(left) < count:
        problem = f"only {len(left)} assets of the catalogue fit {description!r}, but {count} are requested"
        raise InvalidInputError(
            "num", problem, "Request fewer assets, allow more licenses with --license any, or index more sources"
        )
    # a hash of the seed breaks ties, so that different seeds give different choices
    draw = {one.id: hashlib.sha256(f"{seed} {one.id}".encode()).digest() for one in left}
    chosen: list[Chosen] = []
    while len(chosen) < count:
        best = max(left, key=lambda one: (*_distance(one, chosen), draw[one.id]))
        chosen.append(best)
        left.remove(best)
    return chosen


def _looks(entry: CatalogueEntry) -> list[str]:
    if entry.variants == 1:
        return [entry.id]
    return [f"{entry.id}#{look}" for look in range(entry.variants)]


def _of_one_kind(hits: Sequence[Hit], description: str) -> list[Hit]:
    """Return the search results of the same kind as the best one, in the color that the description names."""
    if not hits:
        return []
    asked = understood(description).colors
    colored = [hit for hit in hits if asked and _color(hit.entry) in asked]
    pool = colored or [hit for hit in hits if not asked or not _color(hit.entry)] or list(hits)
    first = pool[0]
    kind = _kind(first.entry)
    return [
        hit
        for hit in pool
        if _kind(hit.entry) == kind and (hit.entry.category == first.entry.category or hit.score >= _NEAR * first.score)
    ]


def _kind(entry: CatalogueEntry) -> str:
    """Return the last noun of an asset's category, or of its name if it has no category ("pie" for "apple pie")."""
    named = [word for word in terms(entry.category or entry.name) if word not in COLORS]
    return named[-1] if named else entry.name


def _color(entry: CatalogueEntry) -> str:
    """Return the color given by an asset's source, or else the first color word in its texts, or else ""."""
    said = terms(f"{entry.color} {entry.name} {entry.description}")
    return next((word for word in said if word in COLORS), "")


def _distance(one: Chosen, others: Sequence[Chosen]) -> tuple[float, float]:
    """Return the distance from an asset to the nearest other asset, and the sum of its distances to all others."""
    distances = [_between(one, other) for other in others]
    return min(distances, default=0.0), sum(distances)


def _between(one: Chosen, other: Chosen) -> float:
    first, second = one.hit.entry, other.hit.entry
    color = float(_color(first) != _color(second))
    look = float(one.id.partition("#")[2] != other.id.partition("#")[2])
    source = float(first.source != second.source)
    return source + color + look + min(_proportions(first, second), 1.0)


def _proportions(first: CatalogueEntry, second: CatalogueEntry) -> float:
    """Return a measure of how much the proportions of two boxes differ.

    Each side is divided by the longest side of its box. The measure is the largest difference between the logarithms of
    corresponding sides.
    """
    if first.size_m is None or second.size_m is None or min(*first.size_m, *second.size_m) <= 0.0:
        return 0.0
    pairs = zip(first.size_m, second.size_m, strict=True)
    shares = [math.log(a / max(first.size_m)) - math.log(b / max(second.size_m)) for a, b in pairs]
    return max(map(abs, shares))
