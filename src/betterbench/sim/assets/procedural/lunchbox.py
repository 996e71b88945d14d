"""Generator of open plastic lunchboxes with a hinged lid."""

import math

import numpy as np

from betterbench.sim.assets.asset import CollisionPart
from betterbench.sim.assets.authoring import Draft, centered, generator, merge, open_box, part, zone
from betterbench.sim.assets.authoring.mesh import Mesh, box, creased, loft, mapped, prism, rectangle
from betterbench.sim.assets.authoring.paint import PALETTE, Canvas, Rgb, jittered, mixed, shaded, uniforms
from betterbench.sim.assets.authoring.solids import hinged_box

_WALL, _FLOOR, _LIP = 0.005, 0.006, 0.003


@generator("lunchbox", colors=("blue", "green", "red"))
def lunchbox(rng: np.random.Generator, color: str) -> Draft:
    """Make an open lunchbox. Its latch faces +x, and its lid leans back over the -x side.

    The inside is about 0.20 m (x) by 0.25 m (y). The lid is opened by about 120 degrees, so that a gripper can enter
    from straight above. A box of this size made of 2.5 mm polypropylene weighs 0.35 kg. Here the mass is 0.5 kg, most
    of it in the floor, as for a box with a cooling element.
    """
    dx, dy, dz, corner = uniforms(rng, (-0.002, 0.002), (-0.002, 0.002), (-0.002, 0.002), (0.012, 0.038))
    half_x, half_y, height = 0.100 + dx, 0.125 + dy, 0.065 + dz
    opened, depth = math.radians(rng.uniform(117.0, 124.0)), rng.uniform(0.014, 0.018)  # angle and depth of the lid
    latches, motif = int(rng.choice([1, 2])), str(rng.choice(["fruit", "stripes", "dots", "star", "plain"]))
    shade = jittered(mixed(PALETTE[color], (1.0, 1.0, 1.0), 0.06), rng)
    lining = mixed(shade, (0.93, 0.93, 0.91), float(rng.choice([0.25, 0.60, 0.90])))
    trim = ((0.93, 0.92, 0.88), (0.95, 0.70, 0.12), (0.20, 0.21, 0.24))[int(rng.integers(3))]
    ox, oy = half_x + _WALL, half_y + _WALL
    tray, hinge = _tray(ox, oy, height, corner=corner), (opened, -ox - 0.001, height)
    length, lid_half = 2.0 * ox + _LIP, oy + _LIP
    lid = _lid(length, lid_half, depth, corner=corner).hinged(*hinge)
    at = (0.0,) if latches == 1 else (-0.45 * oy, 0.45 * oy)
    clip, front = (0.008, 0.034, 0.030), ox + _LIP + 0.003
    clips = merge([box(clip, (front, y, height - 0.017), bevel=0.002, corner=0.002) for y in at])
    knuckles = merge([box((0.010, 0.040, 0.012), (-ox - 0.003, y, height - 0.002)) for y in (-0.5 * oy, 0.5 * oy)])
    x, inside = centered(tray, lid, clips, knuckles)[0], 0.5 * (height - _FLOOR)
    picture = _lining(rng, shade, lining, trim, motif=motif)
    leaf = hinged_box((0.5 * length, lid_half, 0.5 * depth), (0.5 * length, 0.5 * depth), *hinge)
    leaf_x, _, leaf_z = leaf.position
    sizes: dict[str, float | str] = {"inner_x_m": 2 * half_x, "inner_y_m": 2 * half_y, "height_m": height}
    lean = (math.cos(0.5 * opened), 0.0, -math.sin(0.5 * opened), 0.0)
    return Draft(
        shape="box",
        description=f"An open {color} plastic lunchbox with a hinged lid.",
        tags=("lunchbox", "lunch box", "box", "container", "plastic"),
        traits=("plastic",),
        mass_kg=0.5,
        material="plastic",
        densities=(4.0, 0.5, 0.5, 0.5, 0.5, 0.15),
        parts=(
            part("tray", tray.moved(x=x), _shell(shade, lining), specular=0.4, shininess=0.5),
            part("lid", lid.moved(x=x), picture, specular=0.35, shininess=0.5),
            part("latch", clips.moved(x=x), trim, specular=0.4),
            part("hinge", knuckles.moved(x=x), shaded(shade, 0.75), specular=0.3),
            *open_box((half_x, half_y), _WALL, _FLOOR, height, x=x),
            CollisionPart("box", leaf.size, (x + leaf_x, 0.0, leaf_z), lean),
        ),
        regions=(
            zone("inside", half_x, half_y, _FLOOR + inside, x=x, half_z=inside),
            zone("opening", half_x, half_y, height, x=x),
            zone("base", ox, oy, x=x),
        ),
        parameters={**sizes, "lid_degrees": math.degrees(opened), "motif": motif},
    )


def _shell_of(half_x: float, half_y: float, corner: float, steps: list[tuple[float, float]]) -> list[np.ndarray]:
    """Return rounded rectangles, given the height of each and its inset from the outline of the box [m]."""
    return [rectangle(half_x - e, half_y - e, z, corner=max(corner - e, 0.006), steps=3) for e, z in steps]


def _tray(half_x: float, half_y: float, height: float, *, corner: float) -> Mesh:
    """Return the mesh of the box, which has rounded corners, a lip and a hollow inside."""
    outside = [(0.008, 0.0), (0.002, 0.006), (0.0, height - 0.011)]
    lip = [(-_LIP, height - 0.009), (-_LIP, height - 0.001), (-_LIP + 0.001, height), (_WALL - 0.002, height)]
    inside = [(_WALL - 0.0015, _FLOOR + 0.006), (_WALL + 0.005, _FLOOR)]
    rings = _shell_of(half_x, half_y, corner, [*outside, *lip, *inside])
    # In the texture, rows below 0.45 are the outside, rows up to 0.55 the lip, and all others the inside.
    return creased(loft(rings, v=(0.02, 0.06, 0.42, 0.46, 0.50, 0.54, 0.60, 0.90, 0.97)), 40.0)


def _shell(shade: Rgb, lining: Rgb) -> Canvas:
    """Draw the texture of the box, from the underside over the lip to the shaded inside."""
    canvas = Canvas(1.0, 1.0, (8, 128), shade)
    y = canvas.y
    canvas.shade(np.where(y < 0.42, 0.86 + 0.14 * y / 0.42, 1.0))
    canvas.band(0.55, 1.1, lining)
    canvas.shadow(0.55, 0.90, 0.92, 0.22)
    canvas.paint(canvas.between(0.47, 0.55), shaded(shade, 1.12), strength=0.7)
    return canvas


def _lid(length: float, half_y: float, depth: float, *, corner: float) -> Mesh:
    """Return the closed lid, which extends from its hinge at the origin along +x. Its inner side has the texture."""
    steps = [(0.007, depth - 0.004), (0.006, 0.0), (0.0, 0.0), (0.0, depth - 0.004), (0.004, depth)]
    closed = prism(_shell_of(0.5 * length, half_y, corner, steps), crease_degrees=40.0).moved(x=0.5 * length)
    # The texture is projected from below, with the hinge at the bottom. When the lid is open, this side is in front.
    return mapped(closed, (0.0, 1.0, 0.0), (1.0, 0.0, 0.0))


def _lining(rng: np.random.Generator, shade: Rgb, lining: Rgb, trim: Rgb, *, motif: str) -> Canvas:
    """Draw the inner side of the lid, with a border, a molded panel and a printed motif."""
    width, height = 0.266, 0.213
    canvas = Canvas(width, height, (192, 160), shade)
    x, y = canvas.x - 0.5 * width, canvas.y - 0.5 * height
    edge = np.minimum(0.5 * width - np.abs(x), 0.5 * height - np.abs(y))
    canvas.paint(edge > 0.0075, lining)
    canvas.paint((edge > 0.022) & (edge < 0.0245), shaded(lining, 0.80))
    ink = trim if abs(sum(trim) - sum(lining)) > 0.6 else shade
    if motif == "stripes":
        for offset in (-0.036, 0.0, 0.036):
            canvas.paint((np.abs(y - offset) < 0.007) & (edge > 0.032), ink)
    elif motif == "dots":
        for u in np.linspace(-0.075, 0.075, 5).tolist():
            for v in (-0.045, 0.0, 0.045):
                canvas.ellipse((0.5 * width + u, 0.5 * height + v), (0.009, 0.009), ink)
    elif motif == "star":
        canvas.paint(np.hypot(x, y) < 0.030 * (1.0 + 0.42 * np.cos(5.0 * np.arctan2(x, y))), ink)
    elif motif == "fruit":
        canvas.paint(np.hypot(np.abs(x) - 0.013, y + 0.004) < 0.026, ink)
        canvas.paint((np.abs(x - 0.1 * y) < 0.0022) & (y > 0.015) & (y < 0.042), (0.34, 0.22, 0.10))
        canvas.ellipse((0.5 * width + 0.016, 0.5 * height + 0.034), (0.014, 0.006), (0.25, 0.50, 0.14), 0.45)
    canvas.grain(rng, cells=(6, 5), amount=0.012)
    return canvas
