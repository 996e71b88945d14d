"""Look-alikes of the items in a cast (a scenario with chosen assets).

A look-alike is an object of another category with the same color or shape.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from betterbench.generation.building.choice import asset_of
from betterbench.generation.building.names import answers_to, names_of, noun_of
from betterbench.generation.cast import Cast
from betterbench.generation.measures import WIDEST_GRASP_M
from betterbench.sim.assets import build_unpainted, colors
from betterbench.sim.assets.catalogue.entry import CatalogueEntry
from betterbench.sim.assets.catalogue.expansion import COLORS
from betterbench.sim.assets.catalogue.search import Catalogue
from betterbench.sim.assets.catalogue.sources.procedural import NAME
from betterbench.tasks.condition import ObjectSpec

_LOOK_ALIKES = 4
_ALIKE_SIZE = 0.5
"""Minimum ratio between the extents of an object and its look-alike."""


def look_alikes_in(
    cast: Cast, rows: Mapping[str, CatalogueEntry], catalogue: Catalogue
) -> Iterator[tuple[str, tuple[ObjectSpec, ...]]]:
    """Yield the name of each item with a list of distractors that have the item's color or shape.

    The distractors are objects of other kinds. The most similar distractor comes first.
    """
    present = [spec for specs in cast.groups.values() for spec in specs]
    candidates = _graspable(catalogue, {spec.category for spec in present})
    called = {word for spec in present for word in names_of(spec.kind, rows.get(spec.name))}
    kinds = {" ".join(word for word in spec.kind.split() if word not in COLORS) or spec.kind for spec in present}
    others = [
        entries
        for entries in candidates.values()
        if called.isdisjoint(names_of(noun_of(entries[0]), entries[0]))
        and not any(answers_to(kind, entries[0]) for kind in kinds)
    ]
    for item in (spec for spec in present if spec.role == "item"):
        ranked = sorted(
            (-likeness, entry.id, entry)
            for entries in others
            for likeness, entry in [_most_alike(item, entries)]
            if likeness > 0.0
        )
        yield item.name, tuple(_distractor(entry) for _, _, entry in ranked[:_LOOK_ALIKES])


def _distractor(entry: CatalogueEntry) -> ObjectSpec:
    color = entry.color if len(colors(entry.category)) > 1 else None
    return ObjectSpec(f"{entry.category}_like", noun_of(entry), entry.category, color, role="distractor")


def _graspable(catalogue: Catalogue, present: set[str]) -> Mapping[str, list[CatalogueEntry]]:
    """Return the catalogue rows of assets that fit into the gripper, by category.

    Categories that are already present in the scenario are left out.
    """
    found: dict[str, list[CatalogueEntry]] = {}
    for entry in catalogue.entries(NAME):
        if entry.category not in present:
            asset = asset_of(entry)
            if asset.grasps and min(g.width_m for g in asset.grasps) <= WIDEST_GRASP_M:
                found.setdefault(entry.category, []).append(entry)
    return found


def _most_alike(item: ObjectSpec, entries: Sequence[CatalogueEntry]) -> tuple[float, CatalogueEntry]:
    """Find the catalogue row that is most similar to an item. Return the similarity (0 to 3) and the row.

    The similarity is 0 if neither the color nor the shape is the same.
    """
    own = build_unpainted(item.category, color=item.color)
    best = (0.0, entries[0])
    for entry in entries:
        other = asset_of(entry)
        color, shape = float(other.color == own.color), float(other.shape == own.shape)
        ratio = max(other.size_m) / max(own.size_m)
        size = min(ratio, 1.0 / ratio)
        if (color or shape) and size >= _ALIKE_SIZE and color + shape + size > best[0]:
            best = (color + shape + size, entry)
    return best
