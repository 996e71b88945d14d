"""Asset under test, with measurements that several checks share."""

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
    """Asset under test and its kind. Each measurement is computed when a check first needs it."""

    def __init__(self, asset: Asset, kind: Kind | None) -> None:
        self.asset, self.kind = asset, kind

    @functools.cached_property
    def surface(self) -> tuple[np.ndarray, np.ndarray]:
        """The visible surface: (n, 3) vertices [m] and (m, 3) vertex indices."""
        return visual_surface(self.asset)

    @functools.cached_property
    def size_m(self) -> np.ndarray:
        """(3,) extents of the visible surface [m]."""
        vertices, faces = self.surface
        return np.asarray(np.ptp(vertices[np.unique(faces)], axis=0))

    @property
    def longest_m(self) -> float:
        """Longest side [m]."""
        return float(self.size_m.max())

    @property
    def middle_m(self) -> float:
        """Side of middle length [m]."""
        return float(np.sort(self.size_m)[1])

    @functools.cached_property
    def solid(self) -> Solid:
        """Voxels of the visible surface."""
        return solid_of(*self.surface)

    @functools.cached_property
    def cavity(self) -> Cavity | None:
        """Visible hollow that is open at the top, or None.

        Gaps that are as narrow as a seam are no leaks, such as the few holes that the reduced mesh of a colander keeps.
        """
        return cavity_of(self.solid) or cavity_of(self.solid, with_seams=True)

    @functools.cached_property
    def hulls(self) -> tuple[np.ndarray, ...]:
        """Corners (n, 3) of each collision part [m]."""
        return tuple(corners_of(part) for part in self.asset.collision)

    @functools.cached_property
    def touched_cavity(self) -> Cavity | None:
        """Hollow that the collision parts leave free, or None."""
        return cavity_of(surface_solid(self.hulls), with_seams=True)

    @functools.cached_property
    def distances(self) -> Distances:
        """Distances between the collision shape and the visual shape."""
        filled = None if self.holds else self.cavity
        return collision_distances(self.hulls, self.solid, near_m=self.inside_limit_m, filled=filled)

    @property
    def inside_limit_m(self) -> float:
        """Largest distance of the visible surface from the collision parts [m]."""
        return max(0.001 * INSIDE_MM, INSIDE_SHARE * self.middle_m)

    @functools.cached_property
    def rest(self) -> Rest:
        """Simulated rest pose of the asset on a table, with its residual movement."""
        return settled(self.asset)

    @property
    def region_names(self) -> frozenset[str]:
        """Names of the regions of the asset."""
        return frozenset(region.name for region in self.asset.regions)

    @property
    def holds(self) -> bool:
        """Whether tasks may put objects into the asset, because it declares an inside and an opening."""
        return {"inside", "opening"} <= self.region_names

    @property
    def is_open(self) -> bool:
        """Whether objects of this kind are hollow and open at the top.

        False if a tag or the name says that it is full or covered.
        """
        words = " ".join((self.asset.description, *self.asset.tags)).lower()
        return self.kind is not None and self.kind.is_open and not any(word in words for word in CLOSED_WORDS)
