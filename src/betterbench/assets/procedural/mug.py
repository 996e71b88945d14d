"""Mugs with a handle that a parallel jaw can pinch from above."""

import numpy as np

from betterbench.assets.authoring import Draft, Turned, disc, generator, glazed, grip, part, zone
from betterbench.assets.authoring.mesh import chamfered, sweep
from betterbench.assets.authoring.paint import PALETTE, jittered, mixed, shaded
from betterbench.assets.authoring.solids import foot_square, round_wall, solid_box

_WALL, _FLOOR, _TOP = 0.0035, 0.006, 0.0745  # thickness of wall and floor, height of the handle's top [m]


@generator("mug", colors=("red", "blue", "white", "green", "yellow", "black", "gray"))
def mug(rng: np.random.Generator, color: str) -> Draft:
    """Make a ceramic mug; its handle points along +x.

    A stoneware mug of 0.3 l is 70 to 75 mm wide and 80 to 90 mm high and weighs 0.25 to 0.35 kg; the light end is used,
    because the whole weight hangs on one side of the jaw. The handle has flat sides and room for a finger of 20 mm; its
    grasp is high enough for a Franka hand, 45 mm above it, to clear the rim.
    """
    radius, height = rng.uniform(0.0345, 0.0368), rng.uniform(0.0815, 0.0875)
    taper, bar = float(rng.choice([1.0, 1.0, 0.95, 0.91])), rng.uniform(0.0545, 0.0570)  # bar: its x from the axis
    thick, depth, low = rng.uniform(0.0110, 0.0125), rng.uniform(0.0080, 0.0092), rng.uniform(0.010, 0.018)
    decoration, pale = str(rng.choice(["plain", "band", "rim", "stripes", "speckled"])), rng.random() < 0.4
    shade, base, half, end = jittered(PALETTE[color], rng), radius * taper, thick / 2, bar + depth / 2
    axis, out = -0.5 * (bar + 0.5 * depth - radius), 0.5 * (end - radius)
    radii = (0.0, base - 0.004, base, radius, radius - 0.0012, radius - _WALL, base - _WALL, 0.0)
    shell = Turned(radii, (0.0, 0.0, 0.004, height - 0.0025, height, height - 0.0012, _FLOOR + 0.004, _FLOOR))
    lining = mixed(shade, PALETTE["cream"], 0.85) if pale else None
    picture = glazed(rng, shell, shade, decoration, rows=(1, 2, 3, 5, 6), lining=lining)
    a, b, near, far = _TOP - depth / 2, low + depth / 2, axis + radius - 0.004, axis + bar - depth / 2
    handle_x = (radius - 0.003, bar - 0.011, bar - 0.0033, bar, bar, bar - 0.00385, bar - 0.0132, radius - 0.003)
    handle_z = (a, a, a - 0.0033, a - 0.011, b + 0.0132, b + 0.0044, b, b)
    loop = sweep(handle_x, handle_z, chamfered(half, -depth / 2, depth / 2, 0.0018), crease_degrees=50.0)
    sizes: dict[str, float | str] = {"radius_m": radius, "height_m": height, "taper": taper, "bar_distance_m": bar}
    return Draft(
        shape="cylinder",
        description=f"A {color} ceramic coffee mug with a C-shaped handle.",
        tags=("mug", "cup", "coffee", "drinkware"),
        mass_kg=0.25,
        parts=(
            part("shell", shell.mesh().moved(x=axis), picture, specular=0.5, shininess=0.6),
            part("handle", loop.moved(x=axis), shaded(shade, 0.97), specular=0.5, shininess=0.6),
            foot_square(0.70 * (base - 0.003), height=_FLOOR, x=axis),
            *round_wall(radius - 0.0005, _WALL, 0.001, height, x=axis),
            solid_box((far, -half, low + 0.002), (axis + bar + depth / 2, half, _TOP - 0.001)),
            solid_box((near, -half, _TOP - depth), (far, half, _TOP - 0.0005)),
            solid_box((near, -half, low), (far, half, low + depth)),
        ),
        grasps=(
            grip("handle", 0.061, thick, x=axis + bar),
            grip("body", 0.056, 2.0 * radius, x=axis, clearance=0.003, preference=1),
        ),
        regions=(
            zone("handle", out, half, 0.5 * (_TOP + low), x=axis + 0.5 * (radius + end), half_z=0.5 * (_TOP - low)),
            disc("opening", radius - _WALL, height, x=axis),
            disc("base", radius, x=axis),
        ),
        parameters={**sizes, "handle_thickness_m": thick, "decoration": decoration},
    )
