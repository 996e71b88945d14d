"""Generators of table cutlery, whose handles are thick enough for a gripper to grasp them on the table."""

import math
from collections.abc import Mapping

import numpy as np

from betterbench.sim.assets.asset import CollisionPart, VisualPart
from betterbench.sim.assets.authoring import Draft, generator, grip, part, rod, solid_span, zone
from betterbench.sim.assets.authoring.mesh import creased, loft, merge, prism
from betterbench.sim.assets.authoring.paint import Canvas, Rgb, jittered, shaded, uniforms

_HALF = 0.080  # half the length of a piece [m]
_HANDLE = 0.085  # length of the handle [m]; it ends at +x
_GRIP_HEIGHT = 0.0115

_METAL: dict[str, Rgb] = {"silver": (0.72, 0.73, 0.76), "yellow": (0.83, 0.62, 0.22)}
_HANDLES: Mapping[str, tuple[str, tuple[Rgb, ...]]] = {
    "dark": ("plastic", ((0.09, 0.09, 0.10), (0.17, 0.17, 0.19))),
    "wood": ("wood", ((0.36, 0.19, 0.09), (0.55, 0.24, 0.10))),
    "pale": ("plastic", ((0.90, 0.87, 0.78), (0.80, 0.81, 0.83))),
    "bright": ("plastic", ((0.72, 0.09, 0.08), (0.10, 0.42, 0.20), (0.80, 0.45, 0.06))),
    "steel": ("steel", ((0.60, 0.61, 0.64),)),
}
"""Material and colors of handles. No handle is blue, because the cup on the same table is blue."""


@generator("fork", colors=("silver", "yellow"))
def fork(rng: np.random.Generator, color: str) -> Draft:
    """Make a table fork that lies along x, with its three or four tines at -x. The color "yellow" gives brass.

    A dessert fork with a molded handle is 0.16 m long and weighs 40 to 60 g. The handle is thicker than that of plain
    steel cutlery. This is necessary because the gripper reaches 12 mm below the center of its pads and therefore cannot
    grasp objects lower than 10 mm from a table.
    """
    half_width, tines, tine = uniforms(rng, (0.0145, 0.0180), (0.030, 0.043), (0.0019, 0.0023))  # half a tine's width
    count = int(rng.choice([3, 4, 4]))
    metal = jittered(_METAL[color], rng, amount=0.04)
    root, pitch = -_HALF + tines, 2.0 * (half_width - tine) / (count - 1)
    shoulder = min(root + 0.014, -0.030)
    wide = [(root - 0.002, half_width, 0.0004, 0.0042), (root + 0.004, half_width, 0.0, 0.0042)]
    neck = [(shoulder + 0.008, 0.0036, 0.0020, 0.0064), (-0.002, 0.0034, 0.0042, 0.0088)]
    palm = rod([*wide, (shoulder, 0.42 * half_width, 0.0003, 0.0046), *neck], chamfer=0.0012)
    bent = (-_HALF + 0.40 * tines, 0.95 * tine, 0.0006, 0.0036)
    prong = [(-_HALF, 0.45 * tine, 0.0030, 0.0046), bent, (root, tine, 0.0004, 0.0040)]
    prongs = [rod(prong, y=k * pitch, crease_degrees=40.0) for k in (i - 0.5 * (count - 1) for i in range(count))]
    head = part("head", merge([palm, *prongs]), metal, specular=0.9, shininess=0.8)
    sizes = {"head_width_m": 2 * half_width, "tine_length_m": tines, "tines": float(count)}
    return _piece(rng, f"{color} fork", metal, [head], reach=half_width, head_end=shoulder, sizes=sizes)


@generator("spoon", colors=("silver", "yellow"))
def spoon(rng: np.random.Generator, color: str) -> Draft:
    """Make a table spoon that lies along x, with its bowl at -x. The color "yellow" gives brass.

    A dessert spoon with a molded handle is 0.16 m long and weighs 40 to 60 g. The handle is the same as that of the
    fork.
    """
    half_width, half_length, depth = uniforms(rng, (0.0160, 0.0195), (0.0225, 0.0290), (0.0080, 0.0110))
    metal, center = jittered(_METAL[color], rng, amount=0.04), -_HALF + half_length
    angle = 2.0 * math.pi * np.arange(18) / 18
    # The bowl is egg-shaped: blunt toward the tip, pointed toward the neck.
    x = np.cos(angle)
    y = np.sin(angle) * (1.0 - rng.uniform(0.0, 0.22) * x)
    under = ((0.45, 0.0, 0.0), (0.76, 0.18 * depth, 0.0), (0.95, 0.62 * depth, 0.0), (1.0, depth, 0.0))
    inside = ((0.93, 0.66 * depth + 0.0010, 0.0012), (0.72, 0.24 * depth + 0.0012, 0.0010), (0.38, 0.0018, 0.0))
    rings = []
    for s, z, e in (*under, (1.0, depth + 0.0004, 0.0012), *inside):
        rings.append(np.column_stack([center + (s * half_length - e) * x, (s * half_width - e) * y, np.full(18, z)]))
    bowl = creased(loft(rings, v=(0.0, 0.15, 0.32, 0.48, 0.54, 0.66, 0.82, 0.95)), 60.0)
    canvas = Canvas(1.0, 1.0, (8, 64), metal)
    canvas.shade(np.where(canvas.y > 0.56, 0.62 + 0.30 * np.clip((canvas.y - 0.56) / 0.40, 0.0, 1.0), 1.0))
    canvas.paint(canvas.between(0.46, 0.56), shaded(metal, 1.4))
    end, tail = center + half_length, (-0.002, 0.0034, 0.0042, 0.0088)
    start = (end - 0.004, 0.0046, depth - 0.0036, depth - 0.0002)
    neck = rod([start, (end + 0.006, 0.0036, 0.0046, 0.0090), tail], chamfer=0.0012)
    head = [
        part("bowl", bowl, canvas, specular=0.8, shininess=0.8),
        part("neck", neck, metal, specular=0.9, shininess=0.8),
    ]
    rim = CollisionPart("ellipsoid", (half_length, half_width, 0.45 * depth), (center, 0.0, 0.56 * depth))
    sizes = {"bowl_width_m": 2 * half_width, "bowl_length_m": 2 * half_length}
    middle = center + 0.45 * half_length
    return _piece(rng, f"{color} spoon", metal, head, reach=0.55 * half_width, head_end=middle, sizes=sizes, rim=rim)


def _piece(
    rng: np.random.Generator,
    name: str,
    metal: Rgb,
    head: list[VisualPart],
    *,
    reach: float,
    head_end: float,
    sizes: Mapping[str, float],
    rim: CollisionPart | None = None,
) -> Draft:
    """Return the draft of a piece of cutlery made of the given head and a handle.

    Args:
        rng: Random generator for the handle.
        name: Color and kind, such as "silver fork".
        metal: Color of the metal.
        head: Visual parts of the head.
        reach: Half the width of the part of the head that touches the table [m].
        head_end: Position along x at which the head stops touching the table [m].
        sizes: Parameters of the head, which are stored in the asset.
        rim: Collision shape of the raised part of the head. None if this part is not wider than the part that touches
            the table.
    """
    style = str(rng.choice(list(_HANDLES)))
    material, paints = _HANDLES[style]
    plastic = jittered(paints[int(rng.integers(len(paints)))], rng, amount=0.12)
    # The handle narrows by ``swell`` toward the head, and by ``taper`` toward its end [m].
    rivets, swell, taper = (
        style in ("dark", "wood") and rng.random() < 0.7,
        *uniforms(rng, (0.0, 0.0026), (0.0, 0.0022)),
    )
    width, t = uniforms(rng, (0.0130, 0.0168), (0.0122, 0.0140))
    start, w, striped = _HALF - _HANDLE, 0.5 * width, rng.random() < 0.4
    low = [(start, w - swell - 0.0015, 0.0016, t - 0.0022), (start + 0.003, w - swell, 0.0, t - 0.0006)]
    high = [(_HALF - 0.0015, w - taper - 0.0016, 0.0, t - 0.0018), (_HALF, w - taper - 0.0036, 0.0022, t - 0.0045)]
    handle = rod(
        [*low, (start + 0.022, w, 0.0, t), (start + 0.062, w, 0.0, t), (_HALF - 0.006, w - taper, 0.0, t), *high],
        chamfer=0.0032,
    )
    ring = (0.0056, 0.0018, 0.0108)
    stations = [(start - 0.005, 0.0042, 0.0030, 0.0096), (start - 0.003, *ring), (start + 0.002, *ring)]
    collar = rod(stations, chamfer=0.002)
    parts = [
        *head,
        part("handle", handle, plastic, specular=0.35, shininess=0.4),
        part("collar", collar, shaded(metal, 0.92), specular=0.9, shininess=0.8),
    ]
    if rivets:
        parts.append(_rivets(metal, t, start + 0.026, _HALF - 0.022))
    elif striped:
        parts.append(_bands(shaded(plastic, 0.55) if sum(plastic) > 1.2 else metal, w, t, start + 0.018, _HALF - 0.012))
    color, kind = name.split()
    tip, middle = -_HALF + (0.004 if rim is None else 0.014), _HALF - 0.5 * _HANDLE
    return Draft(
        shape="irregular",
        description=f"A {color} {kind} with a molded handle.",
        tags=(kind, "cutlery", "flatware", "tableware"),
        mass_kg=round({"plastic": 0.047, "wood": 0.043, "steel": 0.062}[material] * width / 0.0148, 4),
        material=material,
        # The head is steel. The handle is mostly plastic around a steel tang.
        densities=(1.0, 3.0, 2.5),
        parts=(
            *parts,
            solid_span((start, _HALF), w, (0.0, t)),
            solid_span((head_end, start), 0.0035, (0.002, 0.0085)),
            solid_span((tip, head_end), reach, (0.0, 0.0042)),
            *([] if rim is None else [rim]),
        ),
        grasps=(grip("handle", _GRIP_HEIGHT, width, x=middle),),
        regions=(zone("base", _HALF, reach), zone("handle", 0.5 * _HANDLE, w, 0.5 * t, x=middle, half_z=0.5 * t)),
        parameters={**sizes, "handle": style, "width_m": width, "rivets": str(rivets)},
    )


def _rivets(metal: Rgb, thickness: float, *x: float) -> VisualPart:
    """Return the heads of rivets on top of the handle, at the given positions along x [m]."""
    angle, z, dots = 2.0 * math.pi * np.arange(8) / 8, thickness - 0.001, []
    for at in x:
        outline = np.stack([at + 0.0024 * np.cos(angle), 0.0024 * np.sin(angle), np.full(8, z)], axis=1)
        dots.append(prism([outline, outline + np.array([0.0, 0.0, 0.0013])]))
    return part("rivets", merge(dots), metal, specular=0.9, shininess=0.8)


def _bands(paint: Rgb, half_width: float, thickness: float, *x: float) -> VisualPart:
    """Return bands around the handle, at the given positions along x [m]."""
    w, t = half_width + 0.0003, thickness + 0.0003
    rings = [rod([(at, w, 0.0003, t), (at + 0.005, w, 0.0003, t)], chamfer=0.0030) for at in x]
    return part("bands", merge(rings), paint, specular=0.5)
