"""Solids of revolution: mesh, wrapped texture and collision shapes from one profile."""

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
        radii: Radius at each profile point [m], from the bottom on the outside upward. A radius of zero closes the
            surface.
        heights: Height of each point [m].
        crease_degrees: Angle above which an edge is drawn sharp.
        wrap: Whether to wrap the texture around each half of the circumference. Otherwise, the texture has one column.
        phase: Angle of the first side [rad].
    """

    radii: Sequence[float]
    heights: Sequence[float]
    sides: int = 24
    crease_degrees: float = 40.0
    wrap: bool = True
    phase: float = 0.0

    @property
    def profile(self) -> list[tuple[float, float]]:
        """The points (radius, height) [m]."""
        return list(zip(self.radii, self.heights, strict=True))

    @property
    def rows(self) -> list[float]:
        """Distance [m] along the profile from its first point to each point. It is the texture row of the point."""
        return [float(e) for e in profile_length(self.profile)]

    def mesh(self) -> Mesh:
        """Return the creased mesh with the texture coordinates of :meth:`canvas`."""
        return lathe(self.profile, self.sides, crease_degrees=self.crease_degrees, wrap=self.wrap, phase=self.phase)

    def facing_front(self, x: float, z: float) -> Mesh:
        """Return the mesh with its axis along +x, its lower end at ``x`` and its center at height ``z`` [m]."""
        return self.mesh().rotated("y", math.pi / 2).moved(x, 0.0, z)

    def canvas(self, color: Rgb, pixels: tuple[int, int] = (128, 256), *, width: float | None = None) -> Canvas:
        """Create an empty texture for the surface, with rows upward along the profile.

        By default, its horizontal extent is half of the largest circumference [m], or 1 for a one-column texture.
        """
        if width is None:
            width = math.pi * max(self.radii) if self.wrap else 1.0
        return Canvas(width, self.rows[-1], pixels, color)

    def filled(self, foot_half: float, top: float | None = None) -> tuple[CollisionPart, ...]:
        """Return the bounding cylinder of the solid on a square foot, up to ``top`` or the top of the solid [m]."""
        return standing(foot_half, (max(self.radii), max(self.heights) if top is None else top))
