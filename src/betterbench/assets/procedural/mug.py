"""Mugs with a handle that a parallel jaw can pinch from above."""

from __future__ import annotations

import math

import numpy as np

from betterbench.assets.asset import CollisionPart
from betterbench.assets.authoring.body import (
    solid_box,
)
from betterbench.assets.authoring.draft import Draft, disc, grip, part
from betterbench.assets.authoring.mesh import Mesh, lathe, profile_length, sweep
from betterbench.assets.authoring.paint import PALETTE, Canvas, Colour, jittered, mixed, shaded
from betterbench.assets.authoring.registry import generator
from betterbench.geometry import from_yaw
from betterbench.state import Region

_WALL = 0.0035
_FLOOR = 0.006


@generator("mug", colours=("red", "blue", "white", "green", "yellow", "black", "grey"))
def mug(rng: np.random.Generator, colour: str) -> Draft:
    """Make a ceramic mug; its handle points along +x.

    A stoneware mug of 0.3 l has an outer diameter of 70 to 75 mm and a height of 80 to 90 mm and weighs 0.25 to 0.35
    kg; the light end is used, because the whole weight hangs on one side of the jaw. The bar of the handle is 11 to
    12.5 mm thick across the fingers, with flat sides, and stands far enough from the wall for a 20 mm wide finger.
    The tool centre point of the handle grasp is high enough for a Franka hand (underside 45 mm above it) to clear the
    rim.
    """
    radius = rng.uniform(0.0345, 0.0368)
    height = rng.uniform(0.0815, 0.0875)
    taper = float(rng.choice([1.0, 1.0, 0.95, 0.91]))
    bar = rng.uniform(0.0545, 0.0570)  # distance of the handle's bar from the axis of the mug
    thickness = rng.uniform(0.0110, 0.0125)  # of the handle across the fingers
    depth = rng.uniform(0.0080, 0.0092)  # of the bar along x
    top, low = 0.0745, rng.uniform(0.010, 0.018)
    decoration = str(rng.choice(["plain", "band", "rim", "stripes", "speckled"]))
    pale_inside = rng.random() < 0.4
    axis = -0.5 * (bar + 0.5 * depth - radius)

    foot_radius = radius * taper
    profile = [
        (0.0, 0.0),
        (foot_radius - 0.004, 0.0),
        (foot_radius, 0.004),
        (radius, height - 0.0025),
        (radius - 0.0012, height),
        (radius - _WALL, height - 0.0012),
        (radius - _WALL - (radius - foot_radius), _FLOOR + 0.004),
        (0.0, _FLOOR),
    ]
    shade = jittered(PALETTE[colour], rng)
    shell = lathe(profile, 24, wrap=True, phase=0.0)
    picture = _glaze(rng, profile, shade, decoration=decoration, pale_inside=pale_inside)
    loop = _handle(radius, bar, thickness=thickness, depth=depth, top=top, low=low)
    handle_colour = shaded(shade, 0.97)

    walls = _walls(radius, axis, height)
    handle = (
        solid_box(
            (axis + bar - depth / 2, -thickness / 2, low + 0.002), (axis + bar + depth / 2, thickness / 2, top - 0.001)
        ),
        solid_box(
            (axis + radius - 0.004, -thickness / 2, top - depth), (axis + bar - depth / 2, thickness / 2, top - 0.0005)
        ),
        solid_box((axis + radius - 0.004, -thickness / 2, low), (axis + bar - depth / 2, thickness / 2, low + depth)),
    )
    half = 0.70 * (foot_radius - 0.003)
    floor = CollisionPart("box", (half, half, _FLOOR / 2), (axis, 0.0, _FLOOR / 2))
    collision = (floor, *walls, *handle)

    grip_height = 0.061
    return Draft(
        shape="cylinder",
        description=f"A {colour} ceramic coffee mug with a C-shaped handle.",
        tags=("mug", "cup", "coffee", "drinkware"),
        mass_kg=0.25,
        parts=(
            part("shell", shell.moved(x=axis), picture, specular=0.5, shininess=0.6),
            part("handle", loop.moved(x=axis), handle_colour, specular=0.5, shininess=0.6),
            *collision,
        ),
        grasps=(
            grip("handle", grip_height, thickness, x=axis + bar),
            grip("body", 0.056, 2.0 * radius, x=axis, clearance=0.003, preference=1),
        ),
        regions=(
            Region(
                "handle",
                (axis + 0.5 * (radius + bar + depth / 2), 0.0, 0.5 * (top + low)),
                (0.5 * (bar + depth / 2 - radius), thickness / 2, 0.5 * (top - low)),
            ),
            disc("opening", radius - _WALL, height, x=axis),
            disc("base", radius, x=axis),
        ),
        parameters={
            "radius_m": radius,
            "height_m": height,
            "taper": taper,
            "bar_distance_m": bar,
            "handle_thickness_m": thickness,
            "decoration": decoration,
        },
    )


def _handle(radius: float, bar: float, *, thickness: float, depth: float, top: float, low: float) -> Mesh:
    """Return the mesh of the C-shaped loop, with flat sides and bevelled edges."""
    upper, lower = top - depth / 2, low + depth / 2
    bend = 0.011
    path = [
        (radius - 0.003, 0.0, upper),
        (bar - bend, 0.0, upper),
        (bar - 0.3 * bend, 0.0, upper - 0.3 * bend),
        (bar, 0.0, upper - bend),
        (bar, 0.0, lower + 1.2 * bend),
        (bar - 0.35 * bend, 0.0, lower + 0.4 * bend),
        (bar - 1.2 * bend, 0.0, lower),
        (radius - 0.003, 0.0, lower),
    ]
    a, b, bevel = thickness / 2, depth / 2, 0.0018
    section = [
        (a, -b + bevel),
        (a, b - bevel),
        (a - bevel, b),
        (-a + bevel, b),
        (-a, b - bevel),
        (-a, -b + bevel),
        (-a + bevel, -b),
        (a - bevel, -b),
    ]
    return sweep(path, section, crease_degrees=50.0)


def _walls(radius: float, axis: float, height: float) -> list[CollisionPart]:
    """Return eight boxes around the hollow; they start 1 mm above the table, so that the floor alone stands on it."""
    apothem = radius - 0.0005
    half_length = apothem * math.tan(math.pi / 8)
    half_height = 0.5 * (height - 0.001)
    return [
        CollisionPart(
            "box",
            (_WALL / 2, half_length, half_height),
            (
                axis + (apothem - _WALL / 2) * math.cos(angle),
                (apothem - _WALL / 2) * math.sin(angle),
                0.001 + half_height,
            ),
            from_yaw(angle),
        )
        for angle in (k * math.pi / 4 for k in range(8))
    ]


def _glaze(
    rng: np.random.Generator,
    profile: list[tuple[float, float]],
    shade: Colour,
    *,
    decoration: str,
    pale_inside: bool,
) -> Canvas:
    """Draw the mug from the foot over the rim to the floor inside, with the inside in its own shadow."""
    length = profile_length(profile)
    foot, wall, rim, inner, floor = (float(length[k]) for k in (1, 2, 3, 5, 6))
    canvas = Canvas(math.pi * profile[3][0], float(length[-1]), (128, 256), shade)
    y = canvas.y
    accent = PALETTE["cream"] if sum(shade) < 2.2 else mixed(PALETTE["blue"], PALETTE["grey"], 0.3)
    span = rim - wall
    if decoration == "band":
        canvas.band(wall + 0.55 * span, wall + 0.72 * span, accent)
    elif decoration == "rim":
        canvas.band(wall + 0.94 * span, inner, accent)
    elif decoration == "stripes":
        for share in (0.22, 0.30, 0.38):
            canvas.band(wall + share * span, wall + (share + 0.035) * span, accent)
    elif decoration == "speckled":
        spots = rng.uniform(0.0, 1.0, (70, 3))
        for u, v, size in spots.tolist():
            centre = (u * math.pi * profile[3][0], wall + v * span)
            canvas.ellipse(centre, (0.0006 + 0.0006 * size, 0.0006 + 0.0006 * size), mixed(shade, accent, 0.7))
    if pale_inside:
        canvas.paint(y > inner, mixed(shade, PALETTE["cream"], 0.85))
    inside = y > inner
    down = np.clip((y - inner) / (floor - inner), 0.0, 1.0)
    canvas.shade(np.where(inside, 0.80 - 0.38 * down, 1.0))
    # The unglazed foot, and a faint lighter rim where glaze runs thin.
    canvas.shade(np.where(y < foot, 0.75, 1.0))
    canvas.paint((y > rim) & (y < inner), shaded(shade, 1.25), strength=0.6)
    return canvas
