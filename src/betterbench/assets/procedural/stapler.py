"""Staplers."""

import math
from collections.abc import Sequence

import numpy as np

from betterbench.assets.authoring import Draft, generator, grip, part, zone
from betterbench.assets.authoring.mesh import box, slab
from betterbench.assets.authoring.paint import PALETTE, STEEL, jittered, mixed, shaded, uniforms
from betterbench.assets.authoring.solids import hinged_box, solid_box


def stapler_size(rng: np.random.Generator) -> tuple[float, float, float]:
    """Draw length, width and height [m] of a stapler and of what looks like it: the first numbers of its look.

    Desk staplers are 110 to 150 mm long, 30 to 40 mm wide and 50 to 65 mm high; these fit into a drawer.
    """
    length, width, height = uniforms(rng, (0.112, 0.132), (0.0330, 0.0380), (0.0500, 0.0575))
    return length, width, height


@generator("stapler", colors=("black", "red", "blue"))
def stapler(rng: np.random.Generator, color: str) -> Draft:
    """Make a half-strip desk stapler of 0.2 to 0.25 kg; its mouth, which stands open, is at +x."""
    length, width, height = stapler_size(rng)
    slope, style = math.radians(rng.uniform(7.0, 11.0)), str(rng.choice(["wedge", "arch", "bar"]))
    badge, base_kind = str(rng.choice(["plate", "pad", "stripe"])), int(rng.integers(3))
    shade = jittered(shaded(PALETTE[color], 1.08) if color == "black" else PALETTE[color], rng)
    dark = (0.10, 0.10, 0.11) if color != "black" else (0.24, 0.24, 0.25)
    base_paint = (shaded(shade, 0.80), dark, (0.66, 0.67, 0.70))[base_kind]
    half, side, grasped = 0.5 * length, 0.5 * width, 0.92 * width
    base_x = (-half, half - 0.002, half, half - 0.004, -half + 0.004, -half)
    base = slab(base_x, (0.0, 0.0, 0.003, 0.0085, 0.0105, 0.008), side, bevel=0.0020)
    cheek_x = [x - half for x in (0.001, 0.034, 0.026, 0.014, 0.003)]
    cheeks = slab(cheek_x, (0.007, 0.007, 0.026, 0.030, 0.024), side, bevel=0.0014)
    arm, hinge = length - 0.014, (slope, -half + 0.013, 0.0165)
    t = height - 0.013 - 0.0085 - arm * math.sin(slope)
    cover = slab(*_cover(style, arm, t), 0.46 * width, bevel=0.0034)  # drawn level about the hinge, as all of the arm
    magazine = box((arm - 0.002, 0.74 * width, 0.0105), (0.5 * arm, 0.0, -0.0008), bevel=0.0008)
    head = box((0.0050, 0.76 * width, 0.0150), (arm - 0.0020, 0.0, -0.0005), bevel=0.0008)
    anvil = box((0.022, 0.62 * width, 0.0024), (half - 0.016, 0.0, 0.0098), bevel=0.0005)
    visual = [
        part("base", base, base_paint, specular=0.3),
        part("cheeks", cheeks, dark if base_kind == 1 else shaded(shade, 0.75), specular=0.3),
        part("cover", cover.hinged(*hinge), shade, specular=0.45, shininess=0.5),
        part("magazine", magazine.hinged(*hinge), shaded(STEEL, 1.15), specular=0.8, shininess=0.7),
        part("head", head.hinged(*hinge), shaded(STEEL, 0.85), specular=0.8, shininess=0.7),
        part("anvil", anvil, shaded(STEEL, 1.15), specular=0.8, shininess=0.7),
    ]
    crown = 0.0030 + 0.975 * t
    sizes = {"plate": (0.026, 0.42, 0.56), "pad": (0.034, 0.80, 0.70), "stripe": (0.050, 0.16, 0.52)}
    long, share, at = sizes[badge]
    plate = box((long, share * width, 0.0018), (at * arm, 0.0, crown + 0.0002), bevel=0.0004).hinged(*hinge)
    visual.append(part("badge", plate, dark if badge == "pad" else mixed(STEEL, shade, 0.10), specular=0.5))
    top = max(float(p.vertices[:, 2].max()) for p in visual)
    arm_half = (0.5 * (arm + 0.010), 0.5 * grasped, 0.5 * (0.97 * t + 0.0075))
    return Draft(
        shape="irregular",
        description=f"A {color} desk stapler with a steel magazine and an open mouth.",
        tags=("stapler", "office", "desk", "stationery"),
        mass_kg=0.22,
        material="plastic",
        parts=(
            *visual,
            solid_box((-half, -side, 0.0), (half, side, 0.0095)),
            solid_box((-half + 0.002, -0.5 * grasped, 0.0095), (-half + 0.024, 0.5 * grasped, 0.025)),
            hinged_box(arm_half, (0.5 * (arm - 0.010), 0.5 * (0.97 * t - 0.0015)), *hinge),
        ),
        grasps=(grip("body", 0.032, grasped),),
        regions=(zone("base", half, side),),
        parameters={"length_m": length, "width_m": width, "height_m": top, "style": style},
    )


def _cover(style: str, arm: float, t: float) -> tuple[Sequence[float], Sequence[float]]:
    """Return x and z of the side view of the cover about its hinge, for an arm of a length and a thickness [m]."""
    if style == "bar":
        x = (-0.010, arm, arm + 0.002, arm - 0.001, 0.010, -0.006, -0.011)
        return x, (0.003, 0.003, 0.003 + 0.5 * t, 0.003 + t, 0.003 + t, 0.003 + 0.8 * t, 0.012)
    if style == "arch":
        x = (-0.010, arm - 0.004, arm + 0.002, arm - 0.010, 0.72 * arm, 0.36 * arm, 0.010, -0.010)
        share = (0.0, 0.0, 0.22, 0.62, 0.97, 1.0, 0.62, 0.35)
        return x, [0.003 + s * t for s in share]
    x = (-0.010, arm, arm + 0.001, arm - 0.008, arm - 0.030, 0.030, 0.002, -0.010)
    return x, (0.003, 0.003, 0.003 + 0.35 * t, 0.003 + 0.88 * t, 0.0035 + t, 0.0025 + 0.92 * t, 0.003 + 0.62 * t, 0.012)
