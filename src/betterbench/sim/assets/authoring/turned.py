"""Solids of revolution. Mesh, wrapped texture and collision shapes of a solid are made from the same profile."""

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
        crease_degrees: Angle between two faces above which the edge between them is drawn as a sharp edge.
        wrap: Whether to wrap the texture around each half of the circumference. If False, the texture has only one
            column.
        phase: Angle about the vertical axis at which the first side of the surface begins [rad].
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
        """Distances along the profile from its first point to each of its points [m].

        These are also the texture rows of the points.
        """
        return [float(e) for e in profile_length(self.profile)]

    def mesh(self) -> Mesh:
        """Return the creased mesh, with texture coordinates for a texture created by :meth:`canvas`."""
        return lathe(self.profile, self.sides, crease_degrees=self.crease_degrees, wrap=self.wrap, phase=self.phase)

    def facing_front(self, x: float, z: float) -> Mesh:
        """Return the mesh turned so that its axis points along +x.

        The lower end of the solid is at ``x`` and its axis at height ``z`` [m].
        """
        return self.mesh().rotated("y", math.pi / 2).moved(x, 0.0, z)

    def canvas(self, color: Rgb, pixels: tuple[int, int] = (128, 256), *, width: float | None = None) -> Canvas:
        """Create an empty texture for the surface. Its rows follow the profile upward.

        If ``width`` is None, the width of the texture is half of the largest circumference [m]. If the texture is not
        wrapped, it has only one column, and its width is 1.
        """
        if width is None:
            width = math.pi * max(self.radii) if self.wrap else 1.0
        return Canvas(width, self.rows[-1], pixels, color)

    def filled(self, foot_half: float, top: float | None = None) -> tuple[CollisionPart, ...]:
        """Return the collision shape of the filled solid: its bounding cylinder, which stands on a square foot.

        The cylinder ends at height ``top`` [m]. If ``top`` is None, it ends at the top of the solid.
        """
        return standing(foot_half, (max(self.radii), max(self.heights) if top is None else top))
