"""Generator of a wooden rack with three numbered holes for jars."""

import math

import numpy as np

from betterbench.geometry import from_yaw
from betterbench.sim.assets.asset import CollisionPart
from betterbench.sim.assets.authoring import Draft, generator, part, solid_box, solid_span, zone
from betterbench.sim.assets.authoring.lettering import write_word
from betterbench.sim.assets.authoring.mesh import (
    ABOVE,
    FRONT,
    Mesh,
    box,
    creased,
    loft,
    mapped,
    merge,
    prism,
    rectangle,
)
from betterbench.sim.assets.authoring.paint import Canvas, Rgb, jittered, mixed, shaded, uniforms
from betterbench.sim.assets.procedural.spice_jars import JAR_RADIUS_M

CLEARANCE_M = 0.0027
"""Clearance on each side between a jar of mean radius and its hole [m]. The task requires at most 3 mm per side. All
variants of the jars have 2.4 to 3.0 mm.
"""

PITCH_M = 0.085
"""Distance between the centers of the holes [m]. It leaves room for an open gripper (80 mm plus the fingers) around one
jar next to another jar."""

_FLOOR = 0.006
_DEPTH = 0.035
_HEIGHT = _FLOOR + _DEPTH
_APOTHEM = JAR_RADIUS_M + CLEARANCE_M
_RIM = 0.0012  # chamfer of the holes, visual only
_WOOD: dict[str, Rgb] = {"brown": (0.60, 0.38, 0.19), "gray": (0.52, 0.51, 0.49)}


@generator("spice_rack", colors=("brown", "gray"))
def spice_rack(rng: np.random.Generator, color: str) -> Draft:
    """Make a solid wooden rack with octagonal holes 1, 2 and 3 along y. Hole 1 is at -y.

    A block of hardwood (650 kg/m^3) of 0.073 x 0.27 x 0.041 m minus the three holes weighs 0.38 kg. The rack is meant
    to be fixed in place. All variants have the same holes, because these determine the tolerance of the task. The
    variants differ in width, length, edges, wood, grain, finish and marks.
    """
    half_x, half_y = uniforms(rng, (0.0345, 0.0400), (0.1290, 0.1370))
    edge = rng.uniform(0.0012, 0.0045)  # chamfer of the outer edges, visual only
    plan = (half_x, half_y, edge)
    wood = jittered(shaded(_WOOD[color], rng.uniform(0.62, 1.35)), rng, amount=0.08)
    style, stripe = str(rng.choice(["plate", "burnt", "painted"])), rng.random() < 0.5
    burnt = mixed(wood, (0.95, 0.86, 0.70), 0.45)
    plate = {"plate": (0.93, 0.91, 0.85), "burnt": burnt, "painted": (0.10, 0.11, 0.13)}[style]
    ink: Rgb = (0.96, 0.95, 0.92) if style == "painted" else (0.09, 0.06, 0.04)
    a, p = _APOTHEM, PITCH_M
    gaps = ((-half_y, -p - a), (-p + a, -a), (a, p - a), (p + a, half_y))
    walls = (
        solid_span((-half_x, half_x), half_y, (0.0, _FLOOR)),
        solid_span((_APOTHEM, half_x), half_y, (_FLOOR, _HEIGHT)),
        solid_span((-half_x, -_APOTHEM), half_y, (_FLOOR, _HEIGHT)),
        *(solid_box((-_APOTHEM, low, _FLOOR), (_APOTHEM, high, _HEIGHT)) for low, high in gaps),
    )
    return Draft(
        shape="box",
        description=f"A {color} wooden spice rack with three numbered holes in a row.",
        tags=("spice rack", "rack", "jar holder", "wood", "holes"),
        traits=("wood",),
        mass_kg=0.38,
        material="wood",
        densities=(1.0,) * len(walls),
        parts=(
            part("block", _outside(plan), _grain(rng, wood, half_y, stripe=stripe), specular=0.15),
            part(
                "top",
                merge([_cell(index, plan) for index in range(3)]),
                _top(rng, wood, plan),
                view=ABOVE,
                specular=0.15,
            ),
            part("marks", _marks(plan), _digits(plate, ink)),
            *walls,
            *(_corner(hole * PITCH_M, (k + 0.5) * math.pi / 2.0) for hole in (-1, 0, 1) for k in range(4)),
        ),
        regions=tuple(zone(f"hole_{n}", 0.004, 0.004, _FLOOR, y=(n - 2) * p, half_z=_DEPTH) for n in (1, 2, 3)),
        parameters={"clearance_m": CLEARANCE_M, "pitch_m": p, "depth_m": _DEPTH, "apothem_m": a, "marks": style},
    )


def _corner(center: float, angle: float) -> CollisionPart:
    """Return the box that bevels one corner of a square hole, so that the hole becomes octagonal.

    The hole is centered at y = ``center``, and the corner is in the direction ``angle`` [rad].
    """
    depth = 0.0049  # half the depth of the box, which reaches into the corner of the square
    away, half = _APOTHEM + depth, (depth, _APOTHEM * math.tan(math.pi / 8.0), 0.5 * _DEPTH)
    middle = (away * math.cos(angle), center + away * math.sin(angle), _FLOOR + 0.5 * _DEPTH)
    return CollisionPart("box", half, middle, from_yaw(angle))


def _outside(plan: tuple[float, float, float]) -> Mesh:
    """Return the sides and the bottom of the block up to its chamfer. Each long side shows the whole texture."""
    half_x, half_y, edge = plan
    insets = ((0.0, 0.0), (0.0, _HEIGHT - edge), (edge, _HEIGHT))
    rings = [rectangle(half_x - e, half_y - e, z) for e, z in insets]
    u = np.array([0.0, 0.8, 1.0, 0.2])
    sides = loft(rings, u=u, v=(0.0, 0.93, 1.0), caps=(False, False))
    bottom = prism([rectangle(half_x - 0.001, half_y - 0.001, z) for z in (0.0, 0.001)])
    return merge([creased(sides, 30.0), bottom])


def _cell(index: int, plan: tuple[float, float, float]) -> Mesh:
    """Return one third of the rack's top face, with one of its holes."""
    center = (index - 1) * PITCH_M
    half_x, half_y = plan[0] - plan[2], plan[1] - plan[2]
    low = -0.5 * PITCH_M if index > 0 else -(half_y - PITCH_M)
    high = 0.5 * PITCH_M if index < 2 else half_y - PITCH_M

    def octagon(apothem: float, z: float) -> np.ndarray:
        points = []
        for k in range(16):
            angle = k * math.pi / 8.0
            radius = apothem / math.cos(math.pi / 8.0) if k % 2 else apothem
            points.append((radius * math.cos(angle), center + radius * math.sin(angle), z))
        return np.array(points)

    side = _APOTHEM * math.tan(math.pi / 8.0)
    outer = [
        (half_x, 0.0), (half_x, side), (half_x, high), (side, high),
        (0.0, high), (-side, high), (-half_x, high), (-half_x, side),
        (-half_x, 0.0), (-half_x, -side), (-half_x, low), (-side, low),
        (0.0, low), (side, low), (half_x, low), (half_x, -side),
    ]  # fmt: skip
    border = np.array([(x, center + y, _HEIGHT) for x, y in outer])
    rings = [border, octagon(_APOTHEM + _RIM, _HEIGHT), octagon(_APOTHEM, _HEIGHT - _RIM), octagon(_APOTHEM, _FLOOR)]
    return creased(loft(rings, caps=(False, True)), 30.0)


def _marks(plan: tuple[float, float, float]) -> Mesh:
    """Return the six number plates, two for each hole. Each plate shows one third of the texture, i.e. one digit."""
    half_x, _, edge = plan
    plates = []
    for index in range(3):
        y = (index - 1) * PITCH_M
        front = mapped(box((0.0008, 0.030, 0.028), (half_x, y, 0.0200)), *FRONT)
        middle = 0.5 * (_APOTHEM + _RIM + half_x - edge)
        above = mapped(box((0.0084, 0.0150, 0.0008), (middle, y, _HEIGHT)), *ABOVE)
        for plate in (front, above):
            uv = np.stack([(index + plate.uv[:, 0]) / 3.0, plate.uv[:, 1]], axis=1)
            plates.append(Mesh(plate.vertices, plate.faces, uv))
    return merge(plates)


def _digits(plate: Rgb, ink: Rgb) -> Canvas:
    """Draw the three digits side by side."""
    canvas = Canvas(3.0, 1.0, (192, 64), plate)
    for index in range(3):
        # The plates on the front and on the top show the same texture, and the digit has the same width on both.
        write_word(canvas, str(index + 1), (index + 0.5, 0.5), height=0.74, ink=ink, weight=0.19)
    return canvas


def _grain(rng: np.random.Generator, wood: Rgb, length: float, *, stripe: bool) -> Canvas:
    """Draw the wood of a long side of the block."""
    canvas = Canvas(2 * length, _HEIGHT, (256, 48), wood)
    canvas.grain(rng, cells=(5, 22), amount=0.07)
    canvas.grain(rng, cells=(40, 40), amount=0.02)
    if stripe:
        canvas.band(0.0028, 0.0048, shaded(wood, 0.62))
    canvas.shade(0.86 + 0.14 * np.clip(canvas.y / (0.7 * _HEIGHT), 0.0, 1.0))
    return canvas


def _top(rng: np.random.Generator, wood: Rgb, plan: tuple[float, float, float]) -> Canvas:
    """Draw the top face. The holes are shaded."""
    lit = shaded(wood, 1.10)
    width, depth = 2.0 * (plan[1] - plan[2]), 2.0 * (plan[0] - plan[2])
    canvas = Canvas(width, depth, (256, 80), lit)
    canvas.grain(rng, cells=(5, 30), amount=0.07)
    canvas.grain(rng, cells=(40, 40), amount=0.02)
    for hole in (-1, 0, 1):
        x, y = np.abs(canvas.x - 0.5 * width - hole * PITCH_M), np.abs(canvas.y - 0.5 * depth)
        away = np.maximum(np.maximum(x, y), math.sqrt(0.5) * (x + y))
        canvas.shade(np.where(away < _APOTHEM + 0.0008, 0.52, 1.0))
        canvas.shade(np.where(away < _APOTHEM - 0.0040, 0.82, 1.0))
    return canvas
