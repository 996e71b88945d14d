"""Generator of staplers."""

import math

import numpy as np

from betterbench.sim.assets.authoring import Draft, generator, grip, part, zone
from betterbench.sim.assets.authoring.mesh import box, slab
from betterbench.sim.assets.authoring.paint import PALETTE, STEEL, jittered, shaded
from betterbench.sim.assets.authoring.solids import hinged_box, solid_box
from betterbench.sim.assets.procedural.stapler_outline import cover_outline, on_top, stapler_size


@generator("stapler", colors=("black", "red", "blue"))
def stapler(rng: np.random.Generator, color: str) -> Draft:
    """Make a half-strip desk stapler with its mouth at +x.

    It weighs 0.2 to 0.25 kg, i.e. 945 kg/m^3 times the volume of its bounding box.
    """
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
    t = height - 0.0215 - arm * math.sin(slope)
    # Build the complete arm in its level pose about the hinge.
    cover = slab(*cover_outline(style, arm, t), 0.46 * width, bevel=0.0034)
    magazine = box((arm - 0.002, 0.74 * width, 0.0105), (0.5 * arm, 0.0, -0.0008), bevel=0.0008)
    head = box((0.0050, 0.76 * width, 0.0150), (arm - 0.0020, 0.0, -0.0005), bevel=0.0008)
    anvil = box((0.022, 0.62 * width, 0.0024), (half - 0.016, 0.0, 0.0098), bevel=0.0005)
    visual = [
        part("base", base, base_paint, specular=0.3),
        part("cheeks", cheeks, dark if base_kind == 1 else shaded(shade, 0.75), specular=0.3),
        part("cover", cover.hinged(*hinge), shade, specular=0.45, shininess=0.5),
        part("magazine", magazine.hinged(*hinge), shaded(STEEL, 1.15), specular=0.8, shininess=0.7),
        part("head", head.hinged(*hinge), shaded(STEEL, 0.85), specular=0.8, shininess=0.7),
        part("badge", on_top(badge, arm, width, t).hinged(*hinge), dark if badge == "pad" else STEEL, specular=0.5),
        part("anvil", anvil, shaded(STEEL, 1.15), specular=0.8, shininess=0.7),
    ]
    arm_half = (0.5 * (arm + 0.010), 0.5 * grasped, 0.5 * (0.97 * t + 0.0075))
    return Draft(
        shape="irregular",
        description=f"A {color} desk stapler with a steel magazine and an open mouth.",
        tags=("stapler", "office", "desk", "stationery"),
        traits=(
            "desk",
            "stationery",
            "office",
        ),
        mass_kg=round(945.0 * length * width * height, 4),
        material="plastic",
        parts=(
            *visual,
            solid_box((-half, -side, 0.0), (half, side, 0.0095)),
            solid_box((-half + 0.002, -0.5 * grasped, 0.0095), (-half + 0.024, 0.5 * grasped, 0.025)),
            hinged_box(arm_half, (0.5 * (arm - 0.010), 0.5 * (0.97 * t - 0.0015)), *hinge),
        ),
        grasps=(grip("body", 0.032, grasped),),
        regions=(zone("base", half, side),),
        parameters={"length_m": length, "width_m": width, "height_m": height, "style": style},
    )
