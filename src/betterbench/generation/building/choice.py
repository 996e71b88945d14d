"""Asset chosen for the description of an object."""

from __future__ import annotations

from dataclasses import dataclass

from betterbench.generation.scenario import DescribedObject
from betterbench.sim.assets import Asset, build_unpainted
from betterbench.sim.assets.catalogue.entry import CatalogueEntry


@dataclass(frozen=True, slots=True)
class Choice:
    """Asset chosen for the description of an object in a scenario.

    Attributes:
        group: Object group of the description.
        described: Description of the object.
        entry: Catalogue row of the chosen asset.
        score: Search score in (0, 1].
        passed_over: Better search results that are not suitable for the group, with the reason.
    """

    group: str
    described: DescribedObject
    entry: CatalogueEntry
    score: float
    passed_over: tuple[str, ...] = ()


def asset_of(entry: CatalogueEntry) -> Asset:
    """Build the asset that a catalogue row describes."""
    return build_unpainted(entry.category, color=entry.color or None)
