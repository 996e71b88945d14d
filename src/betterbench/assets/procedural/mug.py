"""Mugs with a handle that a parallel jaw can pinch from above."""

import numpy as np

from betterbench.assets.authoring import Draft, Turned, disc, generator, glazed, grip, part, zone
from betterbench.assets.authoring.mesh import chamfered, sweep
from betterbench.assets.authoring.paint import PALETTE, jittered, mixed, shaded
from betterbench.assets.authoring.solids import foot_square, solid_box, upright_cylinder

_WALL, _FLOOR, _TOP = 0.0035, 0.006, 0.0745  # thickness of wall and floor, height of the handle's top [m]
_FORMS = {
    # Shares of the radius at the foot, at a third and at two thirds of the height; the rim has the whole.
    "straight": (1.0, 1.0, 1.0),
    "tapered": (0.88, 0.92, 0.96),
    "waisted": (0.97, 0.93, 0.94),
    "round foot": (0.80, 0.98, 1.0),
    "step": (0.93, 0.93, 1.0),
}
_DECORATIONS = ("plain", "band", "rim", "stripes", "two-tone", "dots")
_BANDS = {"band": ((0.40, 0.62),), "rim": ((0.84, 2.0),), "stripes": ((0.20, 0.29), (0.42, 0.51), (0.64, 0.73))}


def _crease(sides: int) -> float:
    """Return the angle above which an edge is sharp: between the faces of a mug with few sides [degrees]."""
    return 40.0 if sides > 12 else 25.0


@generator("mug", colors=("red", "blue", "white", "green", "yellow", "black", "gray"))
def mug(rng: np.random.Generator, color: str) -> Draft:
    """Make a ceramic mug; its handle points along +x.

    A stoneware mug of 0.3 l is 70 to 75 mm wide and 80 to 90 mm high and weighs 0.25 to 0.35 kg; the light end is used,
    because the whole weight hangs on one side of the jaw. Its collision shape is filled: nothing is put into a mug. The
    handle has flat sides and room for a finger of 20 mm; its grasp is high enough for a Franka hand, 45 mm above it, to
    clear the rim.
    """
    radius, height = rng.uniform(0.0338, 0.0372), rng.uniform(0.0800, 0.0900)
    form, bar = str(rng.choice(list(_FORMS))), rng.uniform(0.0540, 0.0575)  # bar: its x from the axis
    thick, depth, low = rng.uniform(0.0105, 0.0130), rng.uniform(0.0080, 0.0095), rng.uniform(0.010, 0.022)
    decoration, pale = str(rng.choice(_DECORATIONS)), rng.random() < 0.5
    shade, half, end = jittered(PALETTE[color], rng, amount=0.14), thick / 2, bar + depth / 2
    axis, out, sides = -0.5 * (bar + 0.5 * depth - radius), 0.5 * (end - radius), int(rng.choice([24, 24, 24, 10]))
    a, b, c = (share * radius for share in _FORMS[form])
    base, inner = a, min(b, c, radius) - _WALL
    radii = (0.0, a - 0.004, a, b, c, radius, radius - 0.0012, radius - _WALL, inner, a - _WALL, 0.0)
    rising = (0.0, 0.0, 0.004, 0.30 * height, 0.65 * height, height - 0.0025, height)
    shell = Turned(radii, (*rising, height - 0.0012, 0.5 * height, _FLOOR + 0.004, _FLOOR), sides, _crease(sides))
    # Gray on pale glazes: blue is what another mug is called by.
    ink = PALETTE["cream"] if sum(shade) < 1.9 else (0.30, 0.30, 0.32)
    lining = mixed(shade, PALETTE["cream"], 0.85) if pale else None
    picture = glazed(rng, shell, shade, decoration, rows=(1, 2, 5, 7, 9), lining=lining, ink=ink, bands=_BANDS)
    if decoration == "two-tone":
        glazing = picture.y < shell.rows[2] + 0.36 * (shell.rows[5] - shell.rows[2])
        picture.paint(glazing & (picture.y > shell.rows[1]), ink)
    upper, lower, near, far = _TOP - depth / 2, low + depth / 2, axis + radius - 0.004, axis + bar - depth / 2
    start = min(a, b) - 0.003
    handle_x = (radius - 0.003, bar - 0.011, bar - 0.0033, bar, bar, bar - 0.00385, bar - 0.0132, start)
    handle_z = (upper, upper, upper - 0.0033, upper - 0.011, lower + 0.0132, lower + 0.0044, lower, lower)
    loop = sweep(handle_x, handle_z, chamfered(half, -depth / 2, depth / 2, 0.0018), crease_degrees=50.0)
    sizes: dict[str, float | str] = {"radius_m": radius, "height_m": height, "form": form, "bar_distance_m": bar}
    return Draft(
        shape="cylinder",
        description=f"A {color} ceramic coffee mug with a C-shaped handle.",
        tags=("mug", "cup", "coffee", "drinkware"),
        mass_kg=round(0.25 * radius / 0.0355 * height / 0.085, 4),
        material="ceramic",
        densities=(1.0, 0.45, 1.0, 1.0, 1.0),
        parts=(
            part("shell", shell.mesh().moved(x=axis), picture, specular=0.5, shininess=0.6),
            part("handle", loop.moved(x=axis), shaded(shade, 0.97), specular=0.5, shininess=0.6),
            foot_square(0.70 * (base - 0.003), height=_FLOOR, x=axis),
            upright_cylinder(radius - 0.0005, 0.001, height, x=axis),
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
