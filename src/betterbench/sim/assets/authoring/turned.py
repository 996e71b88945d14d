"""Solids of revolution: the mesh, the wrapped texture and the collision shapes are made from the same profile."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from betterbench.sim.assets.asset import CollisionPart
from betterbench.sim.assets.authoring.mesh import Mesh, lathe, profile_length
from betterbench.sim.assets.authoring.paint import Canvas, Rgb
from betterbench.sim.assets.authoring.solids import standing


@dataclass(frozen=True, slots=True)
class Turned:
    """Profile that is revolved about the vertical axis.

    Attributes:
        radii: Radius at each point of the profile [m]. The profile begins at the bottom and goes up on the outside. A
            radius of zero closes the surface.
        heights: Height of each point [m].
        crease_degrees: Angle above which an edge is drawn as a sharp edge.
        wrap: Whether to wrap the texture around each half of the circumference. If False, the texture has only one
            column.
        phase: Angle at which the first side begins [rad].
    """

    radii: Sequence[float]
    heights: Sequence[float]
    sides: int = 24
    crease_degrees: float = 40.0
    wrap: bool = True
    phase: float = 0.0

    @property
    def profile(self) -> list[tuple[float, float]]:
        """Points (radius, height) of the profile [m]."""
        return list(zip(self.radii, self.heights, strict=True))

    @property
    def rows(self) -> list[float]:
        """Distance along the profile from its first point to each of its points [m].

        It is also the texture row of the point.
        """
        return [float(e) for e in profile_length(self.profile)]

    def mesh(self) -> Mesh:
        """Return the creased mesh, with texture coordinates for a texture created by :meth:`canvas`."""
        return lathe(self.profile, self.sides, crease_degrees=self.crease_degrees, wrap=self.wrap, phase=self.phase)

    def facing_front(self, x: float, z: float) -> Mesh:
        """Return the mesh turned so that its axis points along +x.

        Its lower end is at ``x`` and its center at height ``z`` [m].
        """
        return self.mesh().rotated("y", math.pi / 2).moved(x, 0.0, z)

    def canvas(self, color: Rgb, pixels: tuple[int, int] = (128, 256), *, width: float | None = None) -> Canvas:
        """Create an empty texture for the surface. Its rows go up along the profile.

        If ``width`` is None, the texture is as wide as half of the largest circumference [m], or 1 if it has only one
        column.
        """
        if width is None:
            width = math.pi * max(self.radii) if self.wrap else 1.0
        return Canvas(width, self.rows[-1], pixels, color)

    def filled(self, foot_half: float, top: float | None = None) -> tuple[CollisionPart, ...]:
        """Return the bounding cylinder of the solid on a square foot.

        It ends at height ``top`` [m], or at the top of the solid.
        """
        return standing(foot_half, (max(self.radii), max(self.heights) if top is None else top))
