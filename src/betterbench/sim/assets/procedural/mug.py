"""Generator of mugs with a handle that a gripper can pinch from above."""

import numpy as np

from betterbench.sim.assets.authoring import Draft, Turned, disc, generator, glazed, grip, part, zone
from betterbench.sim.assets.authoring.ceramics import DECORATIONS, FORMS
from betterbench.sim.assets.authoring.mesh import chamfered, sweep
from betterbench.sim.assets.authoring.paint import PALETTE, jittered, mixed, shaded, uniforms
from betterbench.sim.assets.authoring.solids import foot_square, solid_box, upright_cylinder

_WALL, _FLOOR, _TOP = 0.0035, 0.006, 0.0745  # thickness of wall and floor, height of the handle's top [m]


@generator("mug", colors=("red", "blue", "white", "green", "yellow", "black", "gray"), family="mugs")
def mug(rng: np.random.Generator, color: str) -> Draft:
    """Make a ceramic mug with a filled collision shape. Its handle points along +x.

    A stoneware mug of 0.3 l is 70 to 75 mm wide and 80 to 90 mm high, and weighs 0.25 to 0.35 kg. These mugs are light,
    because a light mug tilts less when it is held by its handle. The flat handle leaves room for a finger of 20 mm. A
    gripper whose hand is 45 mm above its pads does not touch the rim.
    """
    radius, height, bar = uniforms(rng, (0.0338, 0.0372), (0.080, 0.090), (0.0540, 0.0575))  # bar: x coordinate
    thick, depth, low = uniforms(rng, (0.0105, 0.0130), (0.0080, 0.0095), (0.010, 0.022))
    form, decoration = str(rng.choice(list(FORMS))), str(rng.choice(DECORATIONS))
    shade, half, end = jittered(PALETTE[color], rng, amount=0.14), thick / 2, bar + depth / 2
    axis, out, sides = -0.5 * (bar + 0.5 * depth - radius), 0.5 * (end - radius), int(rng.choice([24, 24, 24, 10]))
    base, b, c = (share * radius for share in FORMS[form])
    radii = (0.0, base - 0.004, base, b, c, radius, radius - 0.0012, radius - _WALL, b - _WALL, base - _WALL, 0.0)
    rising = (0.0, 0.0, 0.004, 0.30 * height, 0.65 * height, height - 0.0025, height)
    shell = Turned(radii, (*rising, height - 0.0012, 0.3 * height, _FLOOR + 0.004, _FLOOR), sides, crease_degrees=30.0)
    lining = mixed(shade, PALETTE["cream"], 0.85) if rng.random() < 0.5 else None
    picture = glazed(rng, shell, shade, decoration, rows=(1, 2, 5, 7, 9), lining=lining)
    # The arms are narrower than the bar. A finger then touches only the bar, which halves the number of contacts.
    arm = half - 0.0005
    a, z, near, far = _TOP - depth / 2, low + depth / 2, axis + radius - 0.004, axis + bar - depth / 2
    handle_x = (radius - 0.003, bar - 0.011, bar - 0.0033, bar, bar, bar - 0.00385, bar - 0.0132, base - 0.003)
    handle_z = (a, a, a - 0.0033, a - 0.011, z + 0.0132, z + 0.0044, z, z)
    loop = sweep(handle_x, handle_z, chamfered(half, -depth / 2, depth / 2, 0.0018), crease_degrees=50.0)
    body = grip("body", 0.056, 2.0 * radius, x=axis, clearance=0.003, preference=1)
    return Draft(
        shape="cylinder",
        description=f"A {color} ceramic coffee mug with a C-shaped handle.",
        tags=("mug", "cup", "coffee", "drinkware"),
        traits=("coffee",),
        mass_kg=round(0.25 * radius / 0.0355 * height / 0.085, 4),
        material="ceramic",
        densities=(1.0, 0.45, 1.0, 1.0, 1.0),
        parts=(
            part("shell", shell.mesh().moved(x=axis), picture, specular=0.5, shininess=0.6),
            part("handle", loop.moved(x=axis), shaded(shade, 0.97), specular=0.5, shininess=0.6),
            foot_square(0.70 * (base - 0.003), height=_FLOOR, x=axis),
            upright_cylinder(radius - 0.0005, 0.001, height, x=axis),
            solid_box((far, -half, low + 0.002), (axis + bar + depth / 2, half, _TOP - 0.001)),
            *(solid_box((near, -arm, p), (far, arm, q)) for p, q in ((_TOP - depth, _TOP), (low, low + depth))),
        ),
        grasps=(grip("handle", 0.061, thick, x=axis + bar), body),
        regions=(
            zone("handle", out, half, 0.5 * (_TOP + low), x=axis + 0.5 * (radius + end), half_z=0.5 * (_TOP - low)),
            disc("opening", radius - _WALL, height, x=axis),
            disc("base", radius, x=axis),
        ),
        parameters={"radius_m": radius, "height_m": height, "form": form, "decoration": decoration, "bar_m": bar},
    )
