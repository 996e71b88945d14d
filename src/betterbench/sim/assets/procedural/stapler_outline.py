"""Size of staplers and of the block that looks like a stapler, and outlines of the stapler's cover and badge."""

from collections.abc import Sequence

import numpy as np

from betterbench.sim.assets.authoring import Mesh, uniforms
from betterbench.sim.assets.authoring.mesh import box


def stapler_size(rng: np.random.Generator) -> tuple[float, float, float]:
    """Draw the length, width and height [m] of a stapler or of the block that looks like it.

    A generator must call this function before it draws any other random number, so that a stapler and its block get
    equal sizes. Desk staplers are 110 to 150 mm long, 30 to 40 mm wide and 50 to 65 mm high. The sizes here fit into a
    drawer.
    """
    length, width, height = uniforms(rng, (0.112, 0.132), (0.0330, 0.0380), (0.0500, 0.0575))
    return length, width, height


def cover_outline(style: str, arm: float, t: float) -> tuple[Sequence[float], Sequence[float]]:
    """Return the x and z coordinates of the cover's side view, relative to its hinge [m].

    The arm has the given length and thickness [m].
    """
    x: Sequence[float]
    if style == "bar":
        x = (-0.010, arm, arm + 0.002, arm - 0.001, 0.010, -0.006, -0.011)
        return x, (0.003, 0.003, 0.003 + 0.5 * t, 0.003 + t, 0.003 + t, 0.003 + 0.8 * t, 0.012)
    if style == "arch":
        x = (-0.010, arm - 0.004, arm + 0.002, arm - 0.010, 0.72 * arm, 0.36 * arm, 0.010, -0.010)
        share = (0.0, 0.0, 0.22, 0.62, 0.97, 1.0, 0.62, 0.35)
        return x, [0.003 + s * t for s in share]
    x = (-0.010, arm, arm + 0.001, arm - 0.008, arm - 0.030, 0.030, 0.002, -0.010)
    return x, (0.003, 0.003, 0.003 + 0.35 * t, 0.003 + 0.88 * t, 0.0035 + t, 0.0025 + 0.92 * t, 0.003 + 0.62 * t, 0.012)


def on_top(badge: str, arm: float, width: float, t: float) -> Mesh:
    """Return the mesh of the badge (plate, pad or stripe) on top of the cover when the cover is level.

    Coordinates are in meters, relative to the hinge.
    """
    sizes = {"plate": (0.026, 0.42, 0.56), "pad": (0.034, 0.80, 0.70), "stripe": (0.050, 0.16, 0.52)}
    long, share, at = sizes[badge]
    return box((long, share * width, 0.0018), (at * arm, 0.0, 0.0032 + 0.975 * t), bevel=0.0004)
