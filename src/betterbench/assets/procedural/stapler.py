"""Staplers."""

import math

import numpy as np

from betterbench.assets.authoring import Draft, generator, grip, part, zone
from betterbench.assets.authoring.mesh import box, slab
from betterbench.assets.authoring.paint import PALETTE, STEEL, jittered, mixed, shaded
from betterbench.assets.authoring.solids import hinged_box, solid_box


@generator("stapler", colors=("black", "red", "blue"))
def stapler(rng: np.random.Generator, color: str) -> Draft:
    """Make a half-strip desk stapler of 125 x 36 x 55 mm and 0.2 to 0.25 kg; its mouth is at +x."""
    length, width, height = rng.uniform(0.121, 0.128), rng.uniform(0.0345, 0.0365), rng.uniform(0.053, 0.057)
    slope, nose = math.radians(rng.uniform(6.0, 8.5)), str(rng.choice(["round", "square"]))
    badge, two_tone = rng.random() < 0.6, rng.random() < 0.5
    shade = jittered(shaded(PALETTE[color], 1.08) if color == "black" else PALETTE[color], rng)
    dark = (0.13, 0.13, 0.14) if color != "black" else (0.20, 0.20, 0.21)
    half, side, grasped = 0.5 * length, 0.5 * width, 0.92 * width
    base_x = (-half, half - 0.002, half, half - 0.004, -half + 0.004, -half)
    base = slab(base_x, (0.0, 0.0, 0.003, 0.0085, 0.0105, 0.008), side, bevel=0.0020)
    cheek_x = [x - half for x in (0.001, 0.030, 0.024, 0.014, 0.003)]
    cheeks = slab(cheek_x, (0.007, 0.007, 0.026, 0.030, 0.024), side, bevel=0.0014)
    arm, hinge, drop = length - 0.014, (slope, -half + 0.013, 0.0165), 0.55 if nose == "round" else 0.25
    t = height - 0.013 - 0.0085 - arm * math.sin(slope)
    x = (-0.010, arm, arm + 0.001, arm - 0.35 * drop * 0.05, arm - 0.026, 0.030, 0.002, -0.010)
    z = (0.003, 0.003, 0.003 + (1 - drop) * t, 0.003 + 0.92 * t, 0.0035 + t, 0.0025 + 0.92 * t, 0.003 + 0.62 * t, 0.012)
    cover = slab(x, z, 0.46 * width, bevel=0.0034)  # drawn level about the hinge, as all of the arm
    magazine = box((arm - 0.004, 0.62 * width, 0.0095), (0.5 * arm, 0.0, 0.0), bevel=0.0008)
    head = box((0.0035, 0.66 * width, 0.0120), (arm - 0.0030, 0.0, 0.0005), bevel=0.0008)
    anvil = box((0.018, 0.50 * width, 0.0022), (half - 0.017, 0.0, 0.0098), bevel=0.0005)
    plate = box((0.026, 0.42 * width, 0.0016), (0.62 * arm, 0.0, 0.0030 + 0.965 * t), bevel=0.0004)
    visual = [
        part("base", base, dark if two_tone else shaded(shade, 0.85), specular=0.3),
        part("cheeks", cheeks, dark if two_tone else shaded(shade, 0.75), specular=0.3),
        part("cover", cover.hinged(*hinge), shade, specular=0.45, shininess=0.5),
        part("magazine", magazine.hinged(*hinge), STEEL, specular=0.8, shininess=0.7),
        part("head", head.hinged(*hinge), shaded(STEEL, 0.85), specular=0.8, shininess=0.7),
        part("anvil", anvil, STEEL, specular=0.8, shininess=0.7),
        part("badge", plate.hinged(*hinge), mixed(STEEL, shade, 0.15), specular=0.6),
    ][: 7 if badge else 6]
    top = max(float(p.vertices[:, 2].max()) for p in visual)
    arm_half = (0.5 * (arm + 0.010), 0.5 * grasped, 0.5 * (0.97 * t + 0.0075))
    return Draft(
        shape="irregular",
        description=f"A {color} desk stapler with a steel magazine.",
        tags=("stapler", "office", "desk", "stationery"),
        mass_kg=0.22,
        parts=(
            *visual,
            solid_box((-half, -side, 0.0), (half, side, 0.0095)),
            solid_box((-half + 0.002, -0.5 * grasped, 0.0095), (-half + 0.024, 0.5 * grasped, 0.025)),
            hinged_box(arm_half, (0.5 * (arm - 0.010), 0.5 * (0.97 * t - 0.0015)), *hinge),
        ),
        grasps=(grip("body", 0.032, grasped),),
        regions=(zone("base", half, side),),
        parameters={"length_m": length, "width_m": width, "height_m": top, "nose": nose},
    )
