"""Generator of small desktop loudspeakers."""

import numpy as np

from betterbench.sim.assets.asset import VisualPart
from betterbench.sim.assets.authoring import Draft, Turned, generator, grip, part, solid_span, span, zone
from betterbench.sim.assets.authoring.mesh import box
from betterbench.sim.assets.authoring.paint import PALETTE, Canvas, Rgb, jittered, mixed, shaded, uniforms

_PROUD = 0.0036  # distance by which a driver protrudes from the front [m]


@generator("speaker", colors=("black", "gray", "white", "blue"))
def speaker(rng: np.random.Generator, color: str) -> Draft:
    """Make a small desktop loudspeaker whose round drivers face +x.

    Small powered USB loudspeakers are 60 to 75 mm wide and deep and 90 to 120 mm high, and weigh 0.25 to 0.45 kg each.
    The mass here is 785 kg/m^3 times the volume of the bounding box.
    """
    width, depth, height = uniforms(rng, (0.0590, 0.0690), (0.0600, 0.0690), (0.088, 0.112))
    corner, two_way = rng.uniform(0.003, 0.016), rng.random() < 0.6
    cone = ((0.88, 0.88, 0.87), (0.88, 0.72, 0.24), (0.66, 0.67, 0.69), (0.80, 0.44, 0.16))[int(rng.integers(4))]
    baffle, feet = str(rng.choice(["same", "dark", "silver"])), rng.random() < 0.5
    led = ((0.25, 0.95, 0.35), (0.25, 0.60, 1.0), (1.0, 0.62, 0.15))[int(rng.integers(3))]
    shade = jittered(shaded(PALETTE[color], 1.08) if color == "black" else PALETTE[color], rng)
    rim = shaded(shade, 0.35) if sum(shade) > 0.9 else mixed(shade, (0.80, 0.81, 0.83), 0.80)
    half, front = 0.5 * depth, 0.5 * depth - _PROUD
    cabinet = span((-half, front), 0.5 * width, (0.0, height), bevel=0.0035, corner=corner, steps=3)
    grain = Canvas(1.0, 1.0, (64, 64), shade)
    grain.grain(rng, cells=(32, 32), amount=0.02)
    grain.shade(np.where(grain.y < (0.12 if feet else 0.05), 0.55, 1.0))
    large = width * (rng.uniform(0.37, 0.40) if two_way else rng.uniform(0.42, 0.44))
    middle = (0.06 * height + large) if two_way else 0.46 * height
    view = ((0.6, 0.8, 0.0), (0.0, 0.0, 1.0))
    visual = [
        part("cabinet", cabinet, grain, view=view, specular=0.35, shininess=0.4),
        _driver("woofer", large, front, middle, rim=rim, cone=cone, sides=20, specular=0.3),
    ]
    if two_way:
        dark = mixed(cone, (0.2, 0.2, 0.2), 0.4)
        small = width * rng.uniform(0.17, 0.21)
        visual.append(
            _driver(
                "tweeter",
                small,
                front,
                0.5 * (height - 0.004 + middle + large),
                rim=rim,
                cone=dark,
                sides=14,
                specular=0.4,
            )
        )
    if baffle != "same":
        plate = span((front - 0.0004, front + 0.0004), 0.5 * width - 0.006, (0.006, height - 0.006))
        silver = mixed(shade, (0.62, 0.63, 0.65), 0.30 if color == "black" else 1.0)  # a black speaker stays black
        visual.append(part("baffle", plate, shaded(shade, 0.40) if baffle == "dark" else silver))
    lamp = box((0.0022, 0.0042, 0.0042), (front, 0.36 * width, 0.94 * height), bevel=0.0006)
    return Draft(
        shape="box",
        description=f"A small {color} desktop loudspeaker with {'two drivers' if two_way else 'one driver'}.",
        tags=("speaker", "loudspeaker", "desktop speaker", "audio"),
        traits=("audio",),
        mass_kg=round(785.0 * width * depth * height, 3),
        material="plastic",
        parts=(*visual, part("lamp", lamp, led, specular=0.6), solid_span((-half, half), 0.5 * width, (0.0, height))),
        grasps=(
            grip("body", height - 0.040, width, clearance=0.005),
            grip("depth", height - 0.040, depth, across="x", clearance=0.005, preference=1),
        ),
        regions=(zone("base", half, 0.5 * width),),
        parameters={"width_m": width, "depth_m": depth, "height_m": height, "drivers": 2.0 if two_way else 1.0},
    )


def _driver(
    name: str, radius: float, x: float, z: float, *, rim: Rgb, cone: Rgb, sides: int, specular: float
) -> VisualPart:
    """Return a loudspeaker driver that faces +x, with a rim, a rubber surround, a recessed cone and a dust cap."""
    shares, levels = (0.0, 1.0, 1.0, 0.93, 0.84, 0.34, 0.24, 0.0), (0.75 * _PROUD, _PROUD, 0.62 * _PROUD, 0.0004)
    z_profile = (-0.0006, -0.0006, *levels, 0.40 * _PROUD, 0.62 * _PROUD)
    solid = Turned([share * radius for share in shares], z_profile, sides, 30.0, wrap=False)
    # The texture has the rows of a 25 mm driver.
    rows = Turned([share * 0.025 for share in shares], z_profile).rows
    _, _, _, surround, inner, cap, dust, _ = (row / rows[-1] for row in rows)
    canvas = Canvas(1.0, 1.0, (8, 128), rim)
    y = canvas.y
    canvas.paint(y > surround, (0.03, 0.03, 0.035))
    canvas.paint(y > inner, cone)
    canvas.shadow(inner, cap, 1.0, 0.40)
    canvas.paint(y > cap, shaded(cone, 0.35))
    canvas.paint(y > dust, mixed(cone, (0.1, 0.1, 0.1), 0.25))
    return part(name, solid.facing_front(x, z), canvas, specular=specular)
