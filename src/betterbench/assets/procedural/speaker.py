"""Small desktop loudspeakers."""

import math

import numpy as np

from betterbench.assets.authoring.draft import Draft, grip, part, zone
from betterbench.assets.authoring.mesh import Mesh, box, lathe, mapped, profile_length
from betterbench.assets.authoring.paint import PALETTE, Canvas, Colour, jittered, mixed, shaded
from betterbench.assets.authoring.registry import generator
from betterbench.assets.authoring.solids import solid_box

_PROUD = 0.0036  # how far a driver stands out of the front


@generator("speaker", colours=("black", "grey", "white", "blue"))
def speaker(rng: np.random.Generator, colour: str) -> Draft:
    """Make a small desktop loudspeaker; its round drivers look along +x.

    Small powered USB loudspeakers are 65 to 70 mm wide and deep, about 100 mm high, and weigh 0.3 to 0.4 kg each.
    """
    width = rng.uniform(0.0645, 0.0675)
    depth = rng.uniform(0.0660, 0.0690)  # with the drivers
    height, corner, two_way = rng.uniform(0.097, 0.103), rng.uniform(0.006, 0.012), rng.random() < 0.65
    cone = ((0.16, 0.16, 0.17), (0.72, 0.60, 0.34), (0.62, 0.63, 0.65), (0.70, 0.40, 0.18))[int(rng.integers(4))]
    led = ((0.25, 0.95, 0.35), (0.25, 0.60, 1.0), (1.0, 0.62, 0.15))[int(rng.integers(3))]
    shade = jittered(shaded(PALETTE[colour], 1.08) if colour == "black" else PALETTE[colour], rng)
    rim = shaded(shade, 0.45) if sum(shade) > 0.9 else mixed(shade, (0.66, 0.67, 0.70), 0.55)

    body_depth = depth - _PROUD
    front = 0.5 * depth - _PROUD
    middle = -0.5 * _PROUD
    cabinet = box((body_depth, width, height), (middle, 0.0, 0.5 * height), bevel=0.0035, corner=corner, steps=3)
    grain = Canvas(1.0, 1.0, (64, 64), shade)
    grain.grain(rng, cells=(32, 32), amount=0.02)
    grain.shade(np.where(grain.y < 0.06, 0.75, 1.0))
    large = rng.uniform(0.0235, 0.0250) if two_way else rng.uniform(0.0265, 0.0280)
    large_z = (0.335 if two_way else 0.46) * height
    visual = [
        part("cabinet", mapped(cabinet, (0.6, 0.8, 0.0), (0.0, 0.0, 1.0)), grain, specular=0.35, shininess=0.4),
        part("woofer", _driver(large, 20).moved(front, 0.0, large_z), _cone(rim, cone), specular=0.3),
    ]
    led_z = (0.60 if two_way else 0.86) * height
    if two_way:
        small = rng.uniform(0.0105, 0.0130)
        tweeter = _driver(small, 14).moved(front, 0.0, 0.80 * height)
        visual.append(part("tweeter", tweeter, _cone(rim, mixed(cone, (0.2, 0.2, 0.2), 0.4)), specular=0.4))
    lamp = box((0.0022, 0.0042, 0.0042), (front, 0.30 * width, led_z), bevel=0.0006)
    visual.append(part("lamp", lamp, led, specular=0.6))
    collision = (solid_box((-0.5 * depth, -0.5 * width, 0.0), (0.5 * depth, 0.5 * width, height)),)
    grip_z = 0.065
    return Draft(
        shape="box",
        description=f"A small {colour} desktop loudspeaker with {'two drivers' if two_way else 'one driver'}.",
        tags=("speaker", "loudspeaker", "desktop speaker", "audio"),
        mass_kg=0.35,
        parts=(*visual, *collision),
        grasps=(
            grip("body", grip_z, width, clearance=0.005),
            grip("depth", grip_z, depth, across="x", clearance=0.005, preference=1),
        ),
        regions=(zone("base", 0.5 * depth, 0.5 * width),),
        parameters={"width_m": width, "depth_m": depth, "height_m": height, "drivers": 2.0 if two_way else 1.0},
    )


def _driver_profile(radius: float) -> list[tuple[float, float]]:
    """Return the profile of a driver: rim, rubber surround, cone that falls back, dust cap."""
    return [
        (radius, -0.0006),
        (radius, 0.75 * _PROUD),
        (0.93 * radius, _PROUD),
        (0.84 * radius, 0.62 * _PROUD),
        (0.34 * radius, 0.0004),
        (0.24 * radius, 0.40 * _PROUD),
        (0.0, 0.62 * _PROUD),
    ]


def _driver(radius: float, segments: int) -> Mesh:
    """Return a driver that looks along +x, its back at x = 0."""
    profile = [(0.0, -0.0006), *_driver_profile(radius)]
    mesh = lathe(profile, segments, crease_degrees=30.0)
    return mesh.rotated("y", math.pi / 2.0)


def _cone(rim: Colour, cone: Colour) -> Canvas:
    """Draw a driver along its profile, from the back over the rim to the dust cap."""
    profile = [(0.0, -0.0006), *_driver_profile(0.025)]
    length = profile_length(profile) / profile_length(profile)[-1]
    canvas = Canvas(1.0, 1.0, (8, 128), rim)
    y = canvas.y
    canvas.paint(y > length[3], (0.05, 0.05, 0.055))
    canvas.paint(y > length[4], cone)
    depth = np.clip((y - length[4]) / (length[5] - length[4]), 0.0, 1.0)
    canvas.shade(np.where(y > length[4], 1.0 - 0.55 * depth, 1.0))
    canvas.paint(y > length[5], shaded(cone, 0.35))
    canvas.paint(y > length[6], mixed(cone, (0.1, 0.1, 0.1), 0.25))
    return canvas
