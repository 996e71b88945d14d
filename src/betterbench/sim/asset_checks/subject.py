"""Asset that is being checked, with measurements that several checks share."""

from __future__ import annotations

import functools

import numpy as np

from betterbench.sim.asset_checks.limits import CLOSED_WORDS, INSIDE_MM, INSIDE_SHARE
from betterbench.sim.asset_checks.rest import Rest, settled
from betterbench.sim.assets import Asset
from betterbench.sim.assets.importing.cavity import Cavity, cavity_of
from betterbench.sim.assets.importing.kinds import Kind
from betterbench.sim.assets.importing.measures import (
    Distances,
    collision_distances,
    corners_of,
    surface_solid,
    visual_surface,
)
from betterbench.sim.assets.importing.solid import Solid, solid_of


class Subject:
    """Asset that is being checked, and its kind. Each measurement is computed the first time a check needs it."""

    def __init__(self, asset: Asset, kind: Kind | None) -> None:
        self.asset, self.kind = asset, kind

    @functools.cached_property
    def surface(self) -> tuple[np.ndarray, np.ndarray]:
        """Visible surface: (n, 3) vertices [m] and (m, 3) vertex indices."""
        return visual_surface(self.asset)

    @functools.cached_property
    def size_m(self) -> np.ndarray:
        """Extents of the visible surface, (3,) [m]."""
        vertices, faces = self.surface
        return np.asarray(np.ptp(vertices[np.unique(faces)], axis=0))

    @property
    def longest_m(self) -> float:
        """Longest side of the visible surface [m]."""
        return float(self.size_m.max())

    @property
    def middle_m(self) -> float:
        """Second-longest side of the visible surface [m]."""
        return float(np.sort(self.size_m)[1])

    @functools.cached_property
    def solid(self) -> Solid:
        """Grid cells inside the visible surface."""
        return solid_of(*self.surface)

    @functools.cached_property
    def cavity(self) -> Cavity | None:
        """Visible hollow that is open at the top, or None if there is none.

        If the object holds no water, the hollow is computed again with all gaps of up to two cells closed. A colander,
        for example, has small holes but still counts as hollow.
        """
        return cavity_of(self.solid) or cavity_of(self.solid, with_seams=True)

    @functools.cached_property
    def hulls(self) -> tuple[np.ndarray, ...]:
        """Corners (n, 3) of each collision part [m]."""
        return tuple(corners_of(part) for part in self.asset.collision)

    @functools.cached_property
    def touched_cavity(self) -> Cavity | None:
        """The hollow that the collision parts leave open, or None if they leave none open."""
        return cavity_of(surface_solid(self.hulls), with_seams=True)

    @functools.cached_property
    def distances(self) -> Distances:
        """Distances between the collision shape and the visual shape."""
        filled = None if self.holds else self.cavity
        return collision_distances(self.hulls, self.solid, near_m=self.inside_limit_m, filled=filled)

    @property
    def inside_limit_m(self) -> float:
        """Maximum allowed distance of the visible surface from the collision parts [m]."""
        return max(0.001 * INSIDE_MM, INSIDE_SHARE * self.middle_m)

    @functools.cached_property
    def rest(self) -> Rest:
        """Simulated pose of the asset at rest on a table, and how much the asset still moves."""
        return settled(self.asset)

    @property
    def region_names(self) -> frozenset[str]:
        """Names of all regions of the asset."""
        return frozenset(region.name for region in self.asset.regions)

    @property
    def holds(self) -> bool:
        """Whether tasks may put objects into the asset. They may if the asset declares an inside and an opening."""
        return {"inside", "opening"} <= self.region_names

    @property
    def is_open(self) -> bool:
        """Whether objects of the asset's kind are hollow and open at the top.

        The result is False if the description or a tag of the asset says that it is full or covered.
        """
        words = " ".join((self.asset.description, *self.asset.tags)).lower()
        return self.kind is not None and self.kind.is_open and not any(word in words for word in CLOSED_WORDS)
