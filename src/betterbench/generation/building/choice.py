"""Choices of assets for descriptions."""

from __future__ import annotations

from dataclasses import dataclass

from betterbench.generation.scenario import DescribedObject
from betterbench.sim.assets import Asset, build_unpainted
from betterbench.sim.assets.catalogue.entry import CatalogueEntry


@dataclass(frozen=True, slots=True)
class Choice:
    """Asset chosen for a description.

    Attributes:
        group: Group of the description.
        described: The description.
        entry: Row of the catalogue.
        score: Score of the search in (0, 1].
        passed_over: Better search results that are not suitable for the group, with the reason.
    """

    group: str
    described: DescribedObject
    entry: CatalogueEntry
    score: float
    passed_over: tuple[str, ...] = ()


def asset_of(entry: CatalogueEntry) -> Asset:
    """Return the asset of a catalogue row."""
    return build_unpainted(entry.category, color=entry.color or None)
