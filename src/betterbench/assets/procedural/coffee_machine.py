"""Coffee machines with a marked ring on the drip tray."""

from __future__ import annotations

import math

import numpy as np

from betterbench.assets.authoring.draft import Draft, disc, part
from betterbench.assets.authoring.mesh import Mesh, box, lathe, mapped, merge, prism, sweep, tube_section
from betterbench.assets.authoring.paint import PALETTE, Canvas, Colour, jittered, mixed, shaded
from betterbench.assets.authoring.registry import generator
from betterbench.assets.authoring.solids import solid_box
from betterbench.state import Region

_TRAY = 0.0115  # height of the tray's surface
_CHROME: Colour = (0.80, 0.81, 0.83)
_RING_RADIUS = 0.0425
_RIGHT, _UP = (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)  # what a viewer in front of the machine sees


@generator("coffee_machine", colours=("black", "silver", "cream", "red", "blue"))
def coffee_machine(rng: np.random.Generator, colour: str) -> Draft:
    """Make a C-shaped coffee machine; its front looks along +x. It is a fixture and cannot be grasped.

    A mug comes down with its handle towards +x. So the ring's centre is 78 to 82 mm in front of the wall, the head
    above it is narrow and ends 9 to 11 mm behind the ring's centre, and the nozzle stands 19 mm behind it, over the
    back part of the mug's opening; its tip is 126 mm above the tray, so that a mug of 88 mm slides under it with 38
    mm to spare. A small filter machine weighs about 3.5 kg.
    """
    width = rng.uniform(0.186, 0.204)
    wall_depth = rng.uniform(0.088, 0.096)
    tank_depth = 0.030
    reach = rng.uniform(0.078, 0.082)  # from the wall to the ring's centre
    height = rng.uniform(0.266, 0.284)
    tank_height = height + rng.uniform(0.010, 0.022)
    tray_depth = reach + 0.0490
    tray_width = rng.uniform(0.120, 0.150)
    front = 0.5 * (wall_depth + tray_depth)
    wall = front - tray_depth
    back = -front
    ring_x = wall + reach
    head_end = ring_x - rng.uniform(0.009, 0.011)
    head_half = rng.uniform(0.025, 0.0295)
    underside = _TRAY + 0.138
    head_top = underside + rng.uniform(0.046, 0.058)
    nozzle_x, nozzle_tip = ring_x - 0.019, _TRAY + 0.126
    face = str(rng.choice(["gauge", "display"]))
    corner = float(rng.choice([0.010, 0.022]))
    ring_colour = PALETTE["yellow"] if rng.random() < 0.5 else (0.35, 0.88, 0.22)
    shade = jittered(PALETTE[colour], rng)
    dark = (0.13, 0.13, 0.14) if sum(shade) > 0.6 else (0.20, 0.20, 0.22)

    housing_low = back + tank_depth
    housing = box(
        (wall - housing_low, width, height - 0.006),
        (0.5 * (wall + housing_low), 0.0, 0.5 * (height + 0.006)),
        bevel=0.006,
        corner=corner,
    )
    head = _head(wall - 0.004, head_end, head_half, underside, head_top)
    foot = box((wall - back, width - 0.004, 0.008), (0.5 * (wall + back), 0.0, 0.004))
    tray = box(
        (tray_depth + 0.010, tray_width, _TRAY),
        (front - 0.5 * (tray_depth + 0.010), 0.0, 0.5 * _TRAY),
        bevel=0.0018,
        corner=0.022,
        steps=2,
    )
    tank = box(
        (tank_depth - 0.001, 0.88 * width, tank_height - 0.012),
        (back + 0.5 * tank_depth, 0.0, 0.012 + 0.5 * (tank_height - 0.012)),
        corner=0.008,
    )
    panel = box((0.003, 0.80 * width, height - 0.050), (wall, 0.0, 0.5 * (height + 0.012)))
    grille = box((tray_depth - 0.016, tray_width - 0.018, 0.0008), (wall + 0.5 * tray_depth, 0.0, _TRAY))

    visual = [
        part("housing", merge([housing, head]), shade, specular=0.45, shininess=0.5),
        part("tray", merge([tray, foot]), dark, specular=0.2),
        part("tank", mapped(tank, _RIGHT, _UP), _tank_picture(), specular=0.6, shininess=0.7),
        part(
            "panel",
            mapped(panel, _RIGHT, _UP),
            _panel_picture(rng, shade, dark, face=face, split=head_top / height),
            specular=0.4,
        ),
        part("grille", mapped(grille, _RIGHT, (-1.0, 0.0, 0.0)), _grille_picture(), specular=0.4),
        part("ring", _flat_ring(_RING_RADIUS - 0.0065, _RING_RADIUS, _TRAY + 0.0014).moved(x=ring_x), ring_colour),
        part("nozzle", _nozzle(nozzle_x, nozzle_tip, underside), _CHROME, specular=0.9, shininess=0.8),
    ]
    knob_z = 0.5 * (head_top + height) + 0.004
    if face == "gauge":
        dial = _dial(0.0205).moved(wall + 0.001, 0.0, knob_z)
        visual.append(part("dial", mapped(dial, _RIGHT, _UP), _dial_picture(rng), specular=0.5))
    else:
        wand_y = 0.36 * width
        wand = sweep(
            [
                (wall - 0.004, wand_y, underside + 0.012),
                (wall + 0.022, wand_y, underside + 0.010),
                (wall + 0.030, wand_y, underside - 0.004),
                (wall + 0.038, wand_y, _TRAY + 0.060),
            ],
            tube_section(0.0042, 6),
            crease_degrees=70.0,
        )
        visual.append(part("wand", wand, _CHROME, specular=0.9, shininess=0.8))

    collision = (
        solid_box((back, -width / 2, 0.0), (wall, width / 2, height)),
        solid_box((back, -0.44 * width, height), (back + tank_depth, 0.44 * width, tank_height)),
        solid_box((wall, -tray_width / 2, 0.0), (front, tray_width / 2, _TRAY)),
        solid_box((wall, -head_half, underside), (head_end, head_half, head_top)),
        solid_box((nozzle_x - 0.009, -0.014, nozzle_tip), (nozzle_x + 0.009, 0.014, underside)),
    )
    return Draft(
        shape="irregular",
        description=f"A {colour} coffee machine with a {face}, a water tank and a marked ring on its drip tray.",
        tags=("coffee machine", "espresso machine", "coffee maker", "appliance", "fixture"),
        mass_kg=3.5,
        parts=(*visual, *collision),
        regions=(
            disc("ring", _RING_RADIUS, _TRAY, x=ring_x),
            Region(
                "spout",
                (0.5 * (wall + head_end), 0.0, 0.5 * (nozzle_tip + head_top)),
                (0.5 * (head_end - wall), head_half, 0.5 * (head_top - nozzle_tip)),
            ),
        ),
        parameters={
            "width_m": width,
            "depth_m": 2 * front,
            "height_m": height,
            "ring_reach_m": reach,
            "nozzle_behind_ring_m": 0.019,
            "face": face,
        },
    )


def _head(low_x: float, high_x: float, half: float, low: float, high: float) -> Mesh:
    """Return the overhanging head: a beak with a bevelled section that gets lower towards its end."""

    def section(x: float, half_y: float, z0: float, z1: float) -> np.ndarray:
        b = 0.006
        pairs = [
            (half_y, z0 + b),
            (half_y, z1 - b),
            (half_y - b, z1),
            (b - half_y, z1),
            (-half_y, z1 - b),
            (-half_y, z0 + b),
            (b - half_y, z0),
            (half_y - b, z0),
        ]
        return np.array([(x, y, z) for y, z in pairs])

    middle = low_x + 0.72 * (high_x - low_x)
    rings = [
        section(low_x, half, low, high),
        section(middle, half, low, high - 0.002),
        section(high_x - 0.004, half - 0.001, low, high - 0.010),
        section(high_x, half - 0.005, low + 0.004, high - 0.014),
    ]
    return prism(rings, crease_degrees=38.0)


def _flat_ring(inner: float, outer: float, top: float) -> Mesh:
    """Return a flat ring that rises from the tray to ``top`` [m]."""
    low = _TRAY - 0.0004
    return lathe([(outer, low), (outer, top - 0.0003), (inner, top), (inner, low)], 24)


def _nozzle(x: float, tip: float, underside: float) -> Mesh:
    """Return the chrome outlet: a collar under the head and two short spouts."""
    collar = lathe(
        [(0.0, tip + 0.0055), (0.0125, tip + 0.0055), (0.0140, underside + 0.001), (0.0, underside + 0.001)], 12
    )
    spout = lathe([(0.0, tip), (0.0038, tip), (0.0045, tip + 0.006), (0.0, tip + 0.006)], 6)
    return merge([collar.moved(x), spout.moved(x, 0.0070), spout.moved(x, -0.0070)])


def _dial(radius: float) -> Mesh:
    """Return a round instrument that faces along +x."""
    mesh = lathe([(radius, 0.0), (radius, 0.0045), (0.88 * radius, 0.006), (0.0, 0.0050)], 14, crease_degrees=30.0)
    return mesh.rotated("y", math.pi / 2)


def _dial_picture(rng: np.random.Generator) -> Canvas:
    """Draw a pressure gauge."""
    canvas = Canvas(2.0, 2.0, (64, 64), _CHROME)
    x, y = canvas.x - 1.0, canvas.y - 1.0
    r, angle = np.hypot(x, y), np.arctan2(y, x)
    canvas.paint(r < 0.86, (0.96, 0.95, 0.92))
    ticks = (r > 0.62) & (r < 0.80) & (np.abs(((angle / (math.pi / 6)) + 0.5) % 1.0 - 0.5) < 0.10) & (y > -0.55)
    canvas.paint(ticks, (0.1, 0.1, 0.1))
    canvas.paint((r > 0.66) & (r < 0.80) & (angle > 0.0) & (angle < 0.9), (0.80, 0.12, 0.08))
    turn = rng.uniform(0.8, 2.4)
    canvas.line([(1.0, 1.0), (1.0 + 0.62 * math.cos(turn), 1.0 + 0.62 * math.sin(turn))], 0.12, (0.75, 0.08, 0.06))
    canvas.paint(r < 0.13, (0.1, 0.1, 0.1))
    return canvas


def _panel_picture(rng: np.random.Generator, shade: Colour, dark: Colour, *, face: str, split: float) -> Canvas:
    """Draw the front: controls above the head, a steel splash plate below it.

    Args:
        rng: Source of the brushed grain.
        shade: Colour of the housing.
        dark: Colour of the trim.
        face: "gauge" (the dial is a part of its own) or "display".
        split: Height of the head's top as a share of the machine's.
    """
    canvas = Canvas(1.6, 2.3, (128, 192), mixed(_CHROME, dark, 0.25))
    canvas.grain(rng, cells=(3, 90), amount=0.035)
    level = 2.3 * (split - 0.02)
    upper = canvas.y > level
    canvas.paint(upper, dark if sum(shade) > 0.6 else mixed(dark, _CHROME, 0.22))
    middle = level + 0.56 * (2.3 - level)
    if face == "display":
        canvas.paint(upper & (np.abs(canvas.x - 0.80) < 0.30) & (np.abs(canvas.y - middle) < 0.13), (0.05, 0.10, 0.12))
        canvas.paint((np.abs(canvas.x - 0.68) < 0.10) & (np.abs(canvas.y - middle) < 0.06), (0.35, 0.85, 0.95))
        canvas.paint((np.abs(canvas.x - 0.95) < 0.07) & (np.abs(canvas.y - middle) < 0.03), (0.35, 0.85, 0.95))
    lights: tuple[Colour, ...] = ((0.92, 0.92, 0.90), (0.95, 0.55, 0.10), (0.92, 0.92, 0.90), (0.25, 0.80, 0.35))
    for u, light in zip((0.22, 0.43, 1.17, 1.38), lights, strict=True):
        canvas.ellipse((u, middle), (0.088, 0.088), shaded(_CHROME, 0.55))
        canvas.ellipse((u, middle), (0.066, 0.066), light)
    edge = (canvas.x < 0.03) | (canvas.x > 1.57) | (canvas.y < 0.03) | (canvas.y > 2.27)
    canvas.paint(edge, shaded(dark, 0.7))
    return canvas


def _tank_picture() -> Canvas:
    """Draw a smoky tank with water in it."""
    canvas = Canvas(1.0, 1.0, (32, 64), (0.66, 0.75, 0.80))
    canvas.band(0.0, 0.80, (0.38, 0.58, 0.72))
    canvas.band(0.79, 0.81, (0.80, 0.90, 0.95))
    canvas.band(0.955, 1.0, (0.25, 0.27, 0.30))
    return canvas


def _grille_picture() -> Canvas:
    """Draw the slots of the drip tray."""
    canvas = Canvas(1.0, 1.0, (128, 128), (0.62, 0.63, 0.65))
    slot = (np.abs((canvas.x * 13.0) % 1.0 - 0.5) < 0.24) & (np.abs(canvas.y - 0.5) < 0.45)
    canvas.paint(slot, (0.14, 0.14, 0.15))
    canvas.paint(np.abs(canvas.y - 0.5) < 0.02, (0.62, 0.63, 0.65))
    return canvas
