"""Generator of open waste bins for a desk."""

import math
from collections.abc import Sequence

import numpy as np

from betterbench.geometry import from_axis_angle, from_yaw, multiply
from betterbench.sim.assets.asset import CollisionPart, VisualPart
from betterbench.sim.assets.authoring import Draft, Turned, disc, flared_walls, generator, part, solid_box, zone
from betterbench.sim.assets.authoring.materials import material
from betterbench.sim.assets.authoring.mesh import Mesh, creased
from betterbench.sim.assets.authoring.paint import PALETTE, Canvas, Rgb, jittered, mixed, shaded, uniforms

_WALL, _FLOOR = 0.004, 0.006
_SIDES = 32
_FINISHES = ("mesh", "plain", "slots", "ribs", "plain")


@generator("waste_bin", colors=("black", "gray", "blue"))
def waste_bin(rng: np.random.Generator, color: str) -> Draft:
    """Make an open waste bin that widens toward its rim. It is round or square and made of wire mesh or plastic.

    Most bins have a bag that is folded over the rim. Plastic bins have the three recycling arrows on their front. Bins
    of 3 to 5 l for tables and desks are 18 to 22 cm wide and 12 to 25 cm high, and weigh 0.3 to 0.7 kg. This bin is
    low, so that an object that is released above its rim falls only 10 cm. It weighs 0.55 to 0.65 kg, most of it in the
    floor, as stable bins do.
    """
    rim, foot, height = uniforms(rng, (0.0990, 0.1050), (0.0890, 0.0940), (0.118, 0.134))
    square, finish = rng.random() < 0.4, str(rng.choice(_FINISHES))
    bag, metal_rim = rng.random() < 0.6, rng.random() < 0.5
    hem, folds = rng.uniform(0.022, 0.036), rng.uniform(-1.0, 1.0, (3, _SIDES))
    bag_color = ((0.94, 0.94, 0.95), (0.80, 0.87, 0.93), (0.84, 0.90, 0.86))[int(rng.integers(3))]
    shade = jittered(shaded(PALETTE[color], 1.12) if color == "black" else PALETTE[color], rng)
    if square:
        rim, foot = 0.94 * rim, 0.94 * foot
    corner = _corners() if square else np.ones(_SIDES)
    radii = (0.0, foot - 0.003, foot, rim - 0.003, rim, rim, rim - 0.003, foot - _WALL, 0.0)
    heights = (0.0, 0.0, 0.004, height - 0.008, height - 0.006, height - 0.001, height, _FLOOR, _FLOOR)
    shell = Turned(radii, heights, sides=_SIDES, crease_degrees=50.0)
    picture = _pattern(rng, shell, shade, finish=finish, metal_rim=metal_rim, symbol=_symbol_height(finish, bag=bag))
    seen: list[VisualPart] = []
    if bag:
        # The bag hides the inside of the bin.
        outside = Turned(radii[:5], heights[:5], sides=_SIDES, crease_degrees=50.0)
        share = outside.rows[-1] / shell.rows[-1]
        mesh = outside.mesh()
        mesh = Mesh(mesh.vertices, mesh.faces, mesh.uv * np.array([1.0, share]))
        seen += [part("bin", _squared(mesh, corner), picture, specular=0.25)]
        seen += [_bag(rng, (foot, rim, height), corner, bag_color, hem=hem, folds=folds)]
    else:
        seen += [part("bin", _squared(shell.mesh(), corner), picture, specular=0.25)]
    inner_low = foot - _WALL
    # The inside is the widest upright box from floor to rim that fits between the walls at the floor.
    inside, half = 0.5 * (height - _FLOOR), (0.92 if square else 0.78) * inner_low
    shape = "square" if square else "round"
    top = rim - 0.003
    walls = _square_walls(foot, top, height) if square else flared_walls(foot, top, height, wall=_WALL, floor=_FLOOR)
    return Draft(
        shape="box" if square else "cylinder",
        description=f"A {shape} open {color} waste bin{' with a bag' if bag else ''}.",
        tags=("bin", "waste bin", "trash can", "wastebasket", "container"),
        mass_kg=round(48.0 * rim * height, 3),
        densities=(3.0,) if square else (3.0, 3.0, *(0.25,) * 8),
        material="steel" if finish == "mesh" else "plastic",
        parts=(*seen, *walls),
        regions=(
            zone("inside", half, half, _FLOOR + inside, half_z=inside),
            disc("opening", rim - 0.003 - _WALL, height),
            disc("base", foot),
        ),
        parameters={"rim_radius_m": rim, "foot_radius_m": foot, "height_m": height, "pattern": finish, "shape": shape},
    )


def _corners() -> np.ndarray:
    """Return one factor per side by which the radius of a round body is multiplied to make it a rounded square."""
    angle = 2.0 * math.pi * np.arange(_SIDES) / _SIDES
    share: np.ndarray = (np.abs(np.cos(angle)) ** 6 + np.abs(np.sin(angle)) ** 6) ** (-1.0 / 6.0)
    return share


def _squared(mesh: Mesh, corner: np.ndarray) -> Mesh:
    """Return a mesh of revolution with the radius of each side multiplied by its factor in ``corner``."""
    angle = np.arctan2(mesh.vertices[:, 1], mesh.vertices[:, 0])
    return mesh.scaled_across(corner[np.round(angle * _SIDES / (2.0 * math.pi)).astype(int) % _SIDES])


def _square_walls(foot: float, top: float, height: float) -> Sequence[CollisionPart]:
    """Return the collision shape of a square bin: a floor and four leaning boards."""
    flare, half_z = math.atan2(top - foot, height), 0.5 * (height - 0.001)
    away, board = 0.5 * (foot + top) - 0.5 * _WALL, (0.5 * _WALL, top - 0.004, half_z / math.cos(flare) - 0.0005)
    low, walls = foot - 0.002, []
    for angle in (k * math.pi / 2.0 for k in range(4)):
        turn = multiply(from_yaw(angle), from_axis_angle((0.0, flare, 0.0)))
        at = (away * math.cos(angle), away * math.sin(angle), 0.001 + half_z)
        walls.append(CollisionPart("box", board, at, turn, friction=material("plastic").friction))
    return (solid_box((-low, -low, 0.0), (low, low, _FLOOR)), *walls)


def _bag(
    rng: np.random.Generator,
    size: tuple[float, float, float],
    corner: np.ndarray,
    color: Rgb,
    *,
    hem: float,
    folds: np.ndarray,
) -> VisualPart:
    """Return a bag that lines the bin and is folded outward over its rim. It ends in a ragged hem."""
    foot, rim, height = size

    def wall(z: float) -> float:
        return foot + (rim - 0.003 - foot) * z / height

    low, middle = height - hem, 0.45 * height
    radii = (wall(low) + 0.0080, rim + 0.0030, rim + 0.0020, rim - 0.0050, wall(middle) - 0.011, foot - 0.010, 0.0)
    levels = (low, height - 0.006, height + 0.0012, height + 0.0006, middle, _FLOOR + 0.001, _FLOOR + 0.001)
    turned = Turned(radii, levels, sides=_SIDES, crease_degrees=60.0)
    mesh = _squared(turned.mesh(), corner)
    points, angle = mesh.vertices.copy(), np.arctan2(mesh.vertices[:, 1], mesh.vertices[:, 0])
    side = np.round(angle * _SIDES / (2.0 * math.pi)).astype(int) % _SIDES
    ragged, level = np.abs(points[:, 2] - low) < 1e-6, np.abs(points[:, 2] - middle) < 1e-6
    reach = np.hypot(points[:, 0], points[:, 1])
    # The bag moves at most 2 mm outward, because it is only visual and has no contacts.
    shift = np.where(ragged, 0.003 * folds[1][side] + 0.002, 0.0) + np.where(level, 0.006 * folds[2][side], 0.0)
    points[:, :2] *= (1.0 + shift / np.maximum(reach, 1e-9))[:, None]
    points[:, 2] += np.where(ragged, 0.007 * folds[0][side], 0.0)
    canvas = turned.canvas(color, (128, 128))
    canvas.grain(rng, cells=(26, 3), amount=0.07)
    _, outside, _, inside, _, floor, _ = turned.rows
    canvas.shade(np.where(canvas.y < outside, 0.80 + 0.20 * np.clip(canvas.y / outside, 0.0, 1.0), 1.0))
    canvas.shadow(inside, floor, 0.92, 0.38)
    return part("bag", creased(Mesh(points, mesh.faces, mesh.uv), 35.0), canvas, specular=0.3, shininess=0.3)


def _pattern(
    rng: np.random.Generator, shell: Turned, shade: Rgb, *, finish: str, metal_rim: bool, symbol: float
) -> Canvas:
    """Draw the texture of the bin, from the bottom over the wall and the rim to the floor inside."""
    foot, top, lip, floor = (shell.rows[k] for k in (2, 3, 6, 7))
    half = math.pi * 0.5 * (shell.radii[2] + shell.radii[3])
    canvas = shell.canvas(shade, (256, 256), width=half)
    x, y = canvas.x, canvas.y
    inside = y > lip
    # At each height, both sides of the wall show the same row of the pattern, so the pattern seems to continue through
    # the wall.
    share = np.where(inside, 1.0 - (y - lip) / (floor - lip), (y - foot) / (top - foot))
    up = share * (top - foot)
    wall, field = (share > 0.0) & (share < 1.0), (share > 0.08) & (share < 0.94)
    down = np.clip((y - lip) / (floor - lip), 0.0, 1.0)
    open_, edge = shaded(shade, 0.22), mixed(shade, (1.0, 1.0, 1.0), 0.30)
    if finish == "mesh":
        pitch = half / 18
        a, b = (x + up) % pitch, (x - up) % pitch
        wire = (np.abs(a - 0.5 * pitch) < 0.15 * pitch) | (np.abs(b - 0.5 * pitch) < 0.15 * pitch)
        canvas.paint(field & ~wire, shaded(shade, 0.30))
        canvas.paint(field & wire, mixed(shade, (1.0, 1.0, 1.0), 0.42))
    elif finish == "slots":
        pitch = half / 22
        canvas.paint(field & (np.abs(x % pitch - 0.5 * pitch) < 0.24 * pitch) & (np.abs(share - 0.5) > 0.03), open_)
    elif finish == "ribs":
        for level in (0.15, 0.30, 0.45, 0.60, 0.75):
            canvas.paint(wall & (np.abs(share - level) < 0.030), shaded(shade, 0.60))
            canvas.paint(wall & (np.abs(share - level - 0.045) < 0.015), edge)
    else:
        canvas.grain(rng, cells=(20, 20), amount=0.015)
    if symbol > 0.0:
        for middle in (0.0, half):
            _arrows(canvas, (middle, foot + symbol * (top - foot)), 0.072 * symbol, (0.93, 0.95, 0.93), canvas.y < top)
    canvas.shade(np.where(inside, 0.82 - 0.42 * down, 0.84 + 0.16 * np.clip(share, 0.0, 1.0)))
    metal = (0.74, 0.75, 0.77) if metal_rim else mixed(shade, (1.0, 1.0, 1.0), 0.22)
    canvas.paint(canvas.between(top, lip), metal)
    return canvas


def _symbol_height(finish: str, *, bag: bool) -> float:
    """Return the height of the recycling sign's center, as a fraction of the wall's height. 0 if there is no sign.

    If the bin has a bag, the sign is below the hem of the bag.
    """
    if finish == "mesh" or (bag and finish == "slots"):
        return 0.0
    return 0.38 if bag else 0.48


def _arrows(canvas: Canvas, center: tuple[float, float], radius: float, ink: Rgb, where: np.ndarray) -> None:
    """Draw the recycling sign: three arrows that follow each other around a triangle."""
    dx, dy = canvas.x - center[0], canvas.y - center[1]
    for k in range(3):
        turn = 2.0 * math.pi * k / 3.0
        u, v = math.cos(turn) * dx + math.sin(turn) * dy, -math.sin(turn) * dx + math.cos(turn) * dy
        # This is one side of the triangle: a level arrow below the middle that points to the right.
        shaft = (np.abs(v + 0.55 * radius) < 0.17 * radius) & (u > -0.62 * radius) & (u < 0.22 * radius)
        head = (u > 0.20 * radius) & (np.abs(v + 0.55 * radius) < 0.40 * (0.86 * radius - u) / 0.66)
        canvas.paint((shaft | head) & where, ink)
