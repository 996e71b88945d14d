"""Staplers and the wooden block that has the outline of one."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from betterbench.assets.asset import CollisionPart
from betterbench.assets.authoring.draft import Draft, grip, part, zone
from betterbench.assets.authoring.mesh import Mesh, box, mapped, prism
from betterbench.assets.authoring.paint import PALETTE, Canvas, jittered, mixed, shaded
from betterbench.assets.authoring.registry import generator
from betterbench.assets.authoring.solids import solid_box
from betterbench.geometry import from_axis_angle

_STEEL = (0.74, 0.75, 0.77)


@generator("stapler", colours=("black", "red", "blue"))
def stapler(rng: np.random.Generator, colour: str) -> Draft:
    """Make a desk stapler; its mouth is at +x.

    A half-strip desk stapler is 125 x 36 x 55 mm and weighs 0.2 to 0.25 kg.
    """
    length = rng.uniform(0.121, 0.128)
    width = rng.uniform(0.0345, 0.0365)
    height = rng.uniform(0.053, 0.057)
    slope = math.radians(rng.uniform(6.0, 8.5))
    nose = str(rng.choice(["round", "square"]))
    badge = rng.random() < 0.6
    two_tone = rng.random() < 0.5
    shade = jittered(shaded(PALETTE[colour], 1.08) if colour == "black" else PALETTE[colour], rng)
    dark = (0.13, 0.13, 0.14) if colour != "black" else (0.20, 0.20, 0.21)
    half = 0.5 * length

    base = _slab(
        [
            (-half, 0.0),
            (half - 0.002, 0.0),
            (half, 0.003),
            (half - 0.004, 0.0085),
            (-half + 0.004, 0.0105),
            (-half, 0.008),
        ],
        0.5 * width,
        bevel=0.0020,
    )
    # The arm is drawn level, with its hinge at the origin, and then turned up.
    arm_length = length - 0.014
    thick = height - 0.013 - 0.0085 - arm_length * math.sin(slope)
    drop = 0.55 if nose == "round" else 0.25
    cover = _slab(
        [
            (-0.010, 0.0030),
            (arm_length, 0.0030),
            (arm_length + 0.001, 0.0030 + (1.0 - drop) * thick),
            (arm_length - 0.35 * drop * 0.05, 0.0030 + 0.92 * thick),
            (arm_length - 0.026, 0.0035 + thick),
            (0.030, 0.0025 + 0.92 * thick),
            (0.002, 0.0030 + 0.62 * thick),
            (-0.010, 0.0120),
        ],
        0.46 * width,
        bevel=0.0034,
    )
    magazine = box((arm_length - 0.004, 0.62 * width, 0.0095), (0.5 * arm_length, 0.0, 0.0), bevel=0.0008)
    head = box((0.0035, 0.66 * width, 0.0120), (arm_length - 0.0030, 0.0, 0.0005), bevel=0.0008)
    anvil = box((0.018, 0.50 * width, 0.0022), (half - 0.017, 0.0, 0.0098), bevel=0.0005)
    hinge_x, hinge_z = -half + 0.013, 0.0165
    cheeks = _slab(
        [
            (-half + 0.001, 0.007),
            (-half + 0.030, 0.007),
            (-half + 0.024, 0.026),
            (-half + 0.014, 0.030),
            (-half + 0.003, 0.024),
        ],
        0.5 * width,
        bevel=0.0014,
    )

    def arm(mesh: Mesh) -> Mesh:
        return mesh.rotated("y", -slope).moved(hinge_x, 0.0, hinge_z)

    visual = [
        part("base", base, dark if two_tone else shaded(shade, 0.85), specular=0.3),
        part("cheeks", cheeks, dark if two_tone else shaded(shade, 0.75), specular=0.3),
        part("cover", arm(cover), shade, specular=0.45, shininess=0.5),
        part("magazine", arm(magazine), _STEEL, specular=0.8, shininess=0.7),
        part("head", arm(head), shaded(_STEEL, 0.85), specular=0.8, shininess=0.7),
        part("anvil", anvil, _STEEL, specular=0.8, shininess=0.7),
    ]
    if badge:
        plate = box((0.026, 0.42 * width, 0.0016), (0.62 * arm_length, 0.0, 0.0030 + 0.965 * thick), bevel=0.0004)
        visual.append(part("badge", arm(plate), mixed(_STEEL, shade, 0.15), specular=0.6))
    top = max(float(np.max(p.vertices[:, 2])) for p in visual)
    tilt = from_axis_angle((0.0, -slope, 0.0))
    half_arm = 0.5 * (arm_length + 0.010)
    local_x, local_z = 0.5 * (arm_length - 0.010), 0.5 * (0.97 * thick - 0.0015)
    arm_centre = (
        hinge_x + math.cos(slope) * local_x - math.sin(slope) * local_z,
        0.0,
        hinge_z + math.sin(slope) * local_x + math.cos(slope) * local_z,
    )
    grip_width = 0.92 * width
    collision = (
        solid_box((-half, -0.5 * width, 0.0), (half, 0.5 * width, 0.0095)),
        solid_box((-half + 0.002, -0.5 * grip_width, 0.0095), (-half + 0.024, 0.5 * grip_width, 0.025)),
        CollisionPart("box", (half_arm, 0.5 * grip_width, 0.5 * (0.97 * thick + 0.0075)), arm_centre, tilt),
    )
    return Draft(
        shape="irregular",
        description=f"A {colour} desk stapler with a steel magazine.",
        tags=("stapler", "office", "desk", "stationery"),
        mass_kg=0.22,
        parts=(*visual, *collision),
        grasps=(grip("body", 0.032, grip_width),),
        regions=(zone("base", half, 0.5 * width),),
        parameters={"length_m": length, "width_m": width, "height_m": top, "nose": nose},
    )


def _slab(outline: Sequence[tuple[float, float]], half_y: float, *, bevel: float) -> Mesh:
    """Return a convex side view (x, z), counter-clockwise with x to the right, made ``2 half_y`` wide along y [m]."""
    points = np.asarray(outline, dtype=float)
    centre = points.mean(axis=0)
    away = points - centre
    reach = np.linalg.norm(away, axis=1, keepdims=True)
    inner = centre + away * np.maximum(1.0 - 1.2 * bevel / reach, 0.5)
    rings = []
    for y, flat in ((half_y, inner), (half_y - bevel, points), (-half_y + bevel, points), (-half_y, inner)):
        rings.append(np.column_stack([flat[:, 0], np.full(len(flat), y), flat[:, 1]]))
    return prism(rings, crease_degrees=35.0)


@generator("stapler_block", colours=("black", "red", "blue"))
def stapler_block(rng: np.random.Generator, colour: str) -> Draft:
    """Make a painted wooden wedge with the size and outline of a stapler: no gap, no metal, bevelled edges.

    Beech of 700 kg/m^3 would weigh 0.15 kg at this size; the block has a stapler's 0.22 kg, as a denser wood has, so
    that it differs from a stapler for the eye alone.
    """
    length = rng.uniform(0.121, 0.128)
    width = rng.uniform(0.0345, 0.0365)
    height = rng.uniform(0.053, 0.057)
    rear = height * rng.uniform(0.48, 0.60)
    front = height * rng.uniform(0.86, 1.0)
    bevel = rng.uniform(0.0020, 0.0032)
    shade = jittered(shaded(PALETTE[colour], 1.25) if colour == "black" else PALETTE[colour], rng)
    half = 0.5 * length
    ridge = half - 0.030
    outline = [(-half, 0.0), (half, 0.0), (half, front), (ridge, height), (-half, rear)]
    canvas = Canvas(1.0, 1.0, (64, 64), shade)
    canvas.shade(1.0 + 0.05 * np.sin(2.0 * math.pi * (11.0 * canvas.y + 0.4 * np.sin(4.0 * canvas.x))))
    canvas.grain(rng, cells=(3, 26), amount=0.07)
    mesh = mapped(_slab(outline, 0.5 * width, bevel=bevel), (1.0, 0.5, 0.0), (0.0, 0.6, 1.0))
    slope = math.atan2(height - rear, ridge + half)
    # The wedge: a box to the height of the rear, and one that lies under the slope.
    plate = 0.5 * (height - rear) * math.cos(slope)
    middle = (0.5 * (ridge - half), 0.5 * (height + rear))
    collision = (
        solid_box((-half, -0.5 * width, 0.0), (half, 0.5 * width, rear)),
        solid_box((0.0, -0.5 * width, rear), (half - 0.001, 0.5 * width, 0.5 * (rear + height))),
        CollisionPart(
            "box",
            (0.5 * (ridge + half) / math.cos(slope) - 0.5 * math.tan(slope) * plate, 0.5 * width, 0.5 * plate),
            (middle[0] + 0.5 * plate * math.sin(slope), 0.0, middle[1] - 0.5 * plate * math.cos(slope)),
            from_axis_angle((0.0, -slope, 0.0)),
        ),
        solid_box((ridge - 0.012, -0.5 * width, rear), (half - 0.006, 0.5 * width, 0.5 * (front + height) - 0.001)),
    )
    return Draft(
        shape="irregular",
        description=f"A {colour} wooden block with the outline of a stapler.",
        tags=("block", "wedge", "wooden block", "toy"),
        mass_kg=0.22,
        parts=(part("block", mesh, canvas, specular=0.2), *collision),
        grasps=(grip("body", 0.032, width),),
        regions=(zone("base", half, 0.5 * width),),
        parameters={"length_m": length, "width_m": width, "height_m": height, "bevel_m": bevel},
    )
