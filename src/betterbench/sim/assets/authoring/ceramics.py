"""Glaze textures for hollow tableware such as mugs and cups."""

from collections.abc import Mapping, Sequence

import numpy as np

from betterbench.sim.assets.authoring.paint import PALETTE, Canvas, Rgb, mixed, shaded
from betterbench.sim.assets.authoring.turned import Turned

FORMS: Mapping[str, tuple[float, float, float]] = {
    "straight": (1.0, 1.0, 1.0),
    "tapered": (0.88, 0.92, 0.96),
    "waisted": (0.97, 0.93, 0.94),
    "round foot": (0.80, 0.98, 1.0),
    "step": (0.93, 0.93, 1.0),
}
"""Shapes of mugs. The three numbers are the radii at the foot, at one third and at two thirds of the height, relative
to the radius at the rim."""

DECORATIONS = ("plain", "band", "rim", "stripes", "two-tone", "dots")
"""Names of mug decorations."""

BANDS: Mapping[str, Sequence[tuple[float, float]]] = {
    "band": ((0.40, 0.62),),
    "rim": ((0.84, 2.0),),
    "stripes": ((0.20, 0.29), (0.42, 0.51), (0.64, 0.73)),
    "two-tone": ((-0.05, 0.36),),
}
"""Painted bands of each decoration. A band is given by its lower and upper edge, as fractions of the wall height.
Values above 1 are on the rim."""


def glazed(
    rng: np.random.Generator,
    vessel: Turned,
    shade: Rgb,
    decoration: str,
    *,
    rows: tuple[int, int, int, int, int],
    lining: Rgb | None,
    ink: Rgb | None = None,
    bands: Mapping[str, Sequence[tuple[float, float]]] = BANDS,
    shadow: tuple[float, float] = (0.80, 0.38),
    unglazed: float = 0.75,
) -> Canvas:
    """Paint the texture of a glazed vessel, from the foot over the rim to the shaded floor inside.

    On the rim, the glaze is thinner and therefore brighter.

    Args:
        rng: Random generator for the speckles.
        vessel: Profile of the vessel.
        shade: Color of the outside.
        decoration: Either a key of ``bands``, or "speckled", or "dots". For any other value, there is no decoration.
        rows: Indices of five profile points: the end of the unglazed foot, and the beginnings of the wall, the rim, the
            inside and the inner floor.
        lining: Color of the inside. If None, the inside has the same color as the outside.
        ink: Color of the decoration. If None, it is cream on dark glazes and dark gray on light glazes.
        bands: Painted bands of each decoration.
        shadow: Brightness of the inside just below the rim, and its decrease from there down to the floor.
        unglazed: Brightness of the foot.
    """
    foot, wall, rim, inner, floor = (vessel.rows[k] for k in rows)
    span = rim - wall
    canvas = vessel.canvas(shade)
    if ink is None:
        ink = PALETTE["cream"] if sum(shade) < 2.2 else (0.30, 0.30, 0.32)
    for low, high in bands.get(decoration, ()):
        canvas.band(wall + low * span, min(wall + high * span, inner), ink)
    if decoration == "speckled":
        canvas.spots(rng, 70, mixed(shade, ink, 0.7), radius=(0.0006, 0.0012), rows=(wall, rim))
    elif decoration == "dots":
        for k in range(9):
            for row in range(2):
                center = ((k + 0.5 * row) * canvas.width / 8.0, wall + (0.42 + 0.30 * row) * span)
                canvas.ellipse(center, (0.0030, 0.0030), ink)
    if lining is not None:
        canvas.paint(canvas.y > inner, lining)
    canvas.shadow(inner, floor, *shadow)
    canvas.shade(np.where(canvas.y < foot, unglazed, 1.0))
    canvas.paint(canvas.between(rim, inner), shaded(shade, 1.25), strength=0.6)
    return canvas
