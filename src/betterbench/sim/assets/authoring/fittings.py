"""Fittings of appliances, each with its texture: gauges, control panels, grilles, outlets, tubes and markings."""

import math

import numpy as np

from betterbench.sim.assets.asset import CollisionPart, VisualPart
from betterbench.sim.assets.authoring.draft import part
from betterbench.sim.assets.authoring.mesh import ABOVE, FRONT, merge, span, sweep, tube_section
from betterbench.sim.assets.authoring.paint import CHROME, Canvas, Rgb, mixed, shaded
from betterbench.sim.assets.authoring.solids import solid_span
from betterbench.sim.assets.authoring.turned import Turned


def water_tank(x: tuple[float, float], half_y: float, z: tuple[float, float]) -> VisualPart:
    """Return a tinted water tank with a dark lid, four fifths full.

    The tank extends between the two given positions in x and between the two given heights in z [m].
    """
    canvas = Canvas(1.0, 1.0, (32, 64), (0.66, 0.75, 0.80))
    canvas.band(0.0, 0.80, (0.38, 0.58, 0.72))
    canvas.band(0.79, 0.81, (0.80, 0.90, 0.95))
    canvas.band(0.955, 1.0, (0.25, 0.27, 0.30))
    return part("tank", span(x, half_y, z, corner=0.008), canvas, view=FRONT, specular=0.6, shininess=0.7)


def grille(x: tuple[float, float], half_y: float, z: float, *, slots: float) -> VisualPart:
    """Return a steel grille that lies on a surface at height ``z`` and extends between two positions in x [m]."""
    metal: Rgb = (0.62, 0.63, 0.65)
    canvas = Canvas(1.0, 1.0, (128, 128), metal)
    canvas.paint((np.abs((canvas.x * slots) % 1.0 - 0.5) < 0.24) & (np.abs(canvas.y - 0.5) < 0.45), (0.14, 0.14, 0.15))
    canvas.paint(np.abs(canvas.y - 0.5) < 0.02, metal)
    return part("grille", span(x, half_y, (z - 0.0004, z + 0.0004)), canvas, view=ABOVE, specular=0.4)


def ring_mark(radius: float, width: float, x: float, z: float, paint: Rgb) -> VisualPart:
    """Return a flat ring with the given outer radius and width, on a surface at height ``z``, centered at ``x`` [m]."""
    radii, low = (radius, radius, radius - width, radius - width), z - 0.0004
    return part("ring", Turned(radii, (low, z + 0.0011, z + 0.0014, low), wrap=False).mesh().moved(x), paint)


def outlet(x: float, tip: float, top: float) -> tuple[VisualPart, CollisionPart]:
    """Return a chrome coffee outlet at ``x`` [m].

    A collar is attached to the underside of a surface at height ``top``. Two spouts reach from the collar down to
    height ``tip`` [m].
    """
    solid = solid_span((x - 0.009, x + 0.009), 0.014, (tip, top))
    collar = Turned((0.0, 0.0125, 0.0140, 0.0), (tip + 0.0055, tip + 0.0055, top + 0.001, top + 0.001), 12, wrap=False)
    spout = Turned((0.0, 0.0038, 0.0045, 0.0), (tip, tip, tip + 0.006, tip + 0.006), 6, wrap=False).mesh()
    mesh = merge([collar.mesh().moved(x), spout.moved(x, 0.0070), spout.moved(x, -0.0070)])
    return part("nozzle", mesh, CHROME, specular=0.9, shininess=0.8), solid


def steam_wand(x: float, y: float, z: float) -> VisualPart:
    """Return a bent chrome tube that sticks out of the front of an appliance.

    The tube begins at (x, y), slightly above height ``z``, and its tip points down and ends below ``z`` [m].
    """
    along, up = (x - 0.004, x + 0.022, x + 0.030, x + 0.038), (z + 0.012, z + 0.010, z - 0.004, z - 0.078)
    mesh = sweep(along, up, tube_section(0.0042, 6), crease_degrees=70.0).moved(y=y)
    return part("wand", mesh, CHROME, specular=0.9, shininess=0.8)


def gauge(rng: np.random.Generator, radius: float, x: float, z: float) -> VisualPart:
    """Return a round gauge that faces +x, with a red range on its scale and a needle at a random angle.

    The back of the gauge is at ``x`` and its center at height ``z`` [m].
    """
    canvas = Canvas(2.0, 2.0, (64, 64), CHROME)
    r, up = canvas.radius, canvas.y - 1.0
    angle = np.arctan2(up, canvas.x - 1.0)
    canvas.paint(r < 0.86, (0.96, 0.95, 0.92))
    ticks = (r > 0.62) & (r < 0.80) & (np.abs(((angle / (math.pi / 6)) + 0.5) % 1.0 - 0.5) < 0.10) & (up > -0.55)
    canvas.paint(ticks, (0.1, 0.1, 0.1))
    canvas.paint((r > 0.66) & (r < 0.80) & (angle > 0.0) & (angle < 0.9), (0.80, 0.12, 0.08))
    turn = rng.uniform(0.8, 2.4)
    canvas.line([(1.0, 1.0), (1.0 + 0.62 * math.cos(turn), 1.0 + 0.62 * math.sin(turn))], 0.12, (0.75, 0.08, 0.06))
    canvas.paint(r < 0.13, (0.1, 0.1, 0.1))
    dial = Turned((radius, radius, 0.88 * radius, 0.0), (0.0, 0.0045, 0.006, 0.005), 14, 30.0, wrap=False)
    return part("dial", dial.facing_front(x, z), canvas, view=FRONT, specular=0.5)


def panel(
    rng: np.random.Generator,
    x: float,
    half_y: float,
    z: tuple[float, float],
    housing: Rgb,
    *,
    trim: Rgb,
    split: float,
    display: bool,
) -> VisualPart:
    """Return the front panel of an appliance: a plate of brushed steel with a field of lamps above it.

    The panel is at ``x``, between the two heights in ``z`` [m]. ``split`` is the height at which the field with the
    lamps begins, as a fraction of the panel's height. ``trim`` is the color of the panel's edges. On a bright housing,
    it is also the color of the field. If ``display`` is True, there is a display in the center of the field.
    """
    canvas = Canvas(1.6, 2.3, (128, 192), mixed(CHROME, trim, 0.25))
    canvas.grain(rng, cells=(3, 90), amount=0.035)
    level = 2.3 * split
    upper = canvas.y > level
    canvas.paint(upper, trim if sum(housing) > 0.6 else mixed(trim, CHROME, 0.22))
    middle = level + 0.56 * (2.3 - level)
    if display:
        canvas.paint(upper & canvas.near(0.80, middle, 0.30, 0.13), (0.05, 0.10, 0.12))
        canvas.paint(canvas.near(0.68, middle, 0.10, 0.06) | canvas.near(0.95, middle, 0.07, 0.03), (0.35, 0.85, 0.95))
    white = (0.92, 0.92, 0.90)
    for across, light in ((0.22, white), (0.43, (0.95, 0.55, 0.10)), (1.17, white), (1.38, (0.25, 0.80, 0.35))):
        canvas.ellipse((across, middle), (0.088, 0.088), shaded(CHROME, 0.55))
        canvas.ellipse((across, middle), (0.066, 0.066), light)
    canvas.paint((canvas.x < 0.03) | (canvas.x > 1.57) | (canvas.y < 0.03) | (canvas.y > 2.27), shaded(trim, 0.7))
    return part("panel", span((x - 0.0015, x + 0.0015), half_y, z), canvas, view=FRONT, specular=0.4)
