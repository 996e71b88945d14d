"""Generator of crushed beverage cans, which are trash and look different from full cans."""

import math
from dataclasses import dataclass

import numpy as np

from betterbench.geometry import Pose, from_yaw, multiply
from betterbench.sim.assets.asset import CollisionPart, Grasp
from betterbench.sim.assets.authoring import Draft, centered, disc, generator, part
from betterbench.sim.assets.authoring.draft import JAW_OPENS_ALONG_Y
from betterbench.sim.assets.authoring.mesh import Mesh, creased, loft
from betterbench.sim.assets.authoring.paint import PALETTE, Canvas, jittered, uniforms
from betterbench.sim.assets.procedural.can import DESIGNS, can_shell, draw_label

_SIDES = 18
_RADIUS = 0.0300
_CAN = can_shell(_RADIUS, 0.115, 0.0115)  # shape of the can before it was crushed


@dataclass(frozen=True, slots=True)
class _Crush:
    """Shape of a can that was squeezed while its axis was along x. Lengths are in meters and angles in radians.

    Attributes:
        length, height: Length and height of the crushed can.
        waist: Half the width of the can where it was pressed together.
        at: Position of the waist along x.
        bend: Angle between the two ends, about the vertical axis.
        lift: Height of the ends above the table.
    """

    length: float
    height: float
    waist: float
    at: float
    bend: float
    lift: float


@generator("crushed_can", colors=("red", "silver", "blue", "green"))
def crushed_can(rng: np.random.Generator, color: str) -> Draft:
    """Make an empty can that lies on its side, squeezed in the middle and bent.

    An empty can has 13 to 14 g of aluminum. With some of the drink left in it, it weighs 18 to 22 g. The gripper grasps
    it at its waist.
    """
    length, height, waist, at = uniforms(rng, (0.082, 0.098), (0.044, 0.052), (0.0165, 0.0215), (-0.006, 0.006))
    bend, lift, heading = uniforms(rng, (0.14, 0.46), (0.0, 0.010), (1.15, 1.55))
    bend, heading = bend * float(rng.choice([-1.0, 1.0])), heading * float(rng.choice([-1.0, 1.0]))
    if rng.random() < 0.5:
        heading += math.pi  # turns the other end to the front
    design, shade = str(rng.choice(DESIGNS)), jittered(PALETTE[color], rng, amount=0.06)
    crush = _Crush(length, height, waist, at, bend, lift)
    mesh = _squeezed(rng, crush).rotated("z", heading)
    canvas = draw_label(rng, _CAN, shade, design=design)
    _wear(rng, canvas, at=0.5 + at / length)
    x, y, z = centered(mesh)
    mesh = mesh.moved(x, y, z)
    middle = (x + at * math.cos(heading), y + at * math.sin(heading), 0.024)
    grasp = Pose(middle, multiply(from_yaw(heading), JAW_OPENS_ALONG_Y))
    return Draft(
        shape="irregular",
        description=f"A crushed, empty {color} soda can.",
        tags=("crushed can", "can", "empty can", "metal", "trash"),
        traits=(
            "metal",
            "trash",
        ),
        mass_kg=round(0.22 * length, 4),
        material="aluminum",
        parts=(part("shell", mesh, canvas, specular=0.6, shininess=0.5), *_solids(crush, heading, (x, y))),
        grasps=(Grasp("body", grasp, 2.0 * waist, 0.012),),
        regions=(disc("base", 0.5 * length),),
        parameters={"length_m": length, "height_m": height, "waist_m": 2.0 * waist, "design": design},
    )


def _bent(crush: _Crush, along: float) -> tuple[float, float, float]:
    """Return x, y and the direction [rad] of the can's axis, at a given distance along the axis from the waist."""
    turn = 0.5 * crush.bend * math.copysign(1.0, along)
    return crush.at + along * math.cos(turn), along * math.sin(turn), turn


def _solids(crush: _Crush, heading: float, shift: tuple[float, float]) -> tuple[CollisionPart, ...]:
    """Return collision boxes for the waist and the two ends of the can.

    Between the boxes, there is room for the finger pads.
    """
    turn, wide = 0.5 * abs(crush.bend), 0.86 * _RADIUS
    # The inner corner of an end, turned toward the waist, stays clear of a finger 22 mm wide.
    free = (0.0165 + wide * math.sin(turn)) / math.cos(turn)
    low, high = -0.5 * crush.length - crush.at, 0.5 * crush.length - crush.at
    boxes = [(0.0, (free + 0.003, crush.waist, 0.42 * crush.height), 0.42 * crush.height + 0.001)]
    for start, end in ((low, -free), (free, high)):
        half = (0.5 * (end - start) - 0.001, wide, 0.46 * crush.height)
        boxes.append((0.5 * (start + end), half, half[2]))
    solids = []
    for along, half, z in boxes:
        x, y, turn = _bent(crush, along) if along else (crush.at, 0.0, 0.0)
        c, s = math.cos(heading), math.sin(heading)
        position = (shift[0] + c * x - s * y, shift[1] + s * x + c * y, z)
        solids.append(CollisionPart("box", half, position, from_yaw(heading + turn)))
    return tuple(solids)


def _squeezed(rng: np.random.Generator, crush: _Crush) -> Mesh:
    """Return the mesh of the crushed can, which lies along x with its lid at +x.

    It uses the same texture rows as the full can.
    """
    rows = [row / _CAN.rows[-1] for row in _CAN.rows]
    body = [(_RADIUS, t, rows[2] + t * (rows[3] - rows[2])) for t in (0.0, 0.17, 0.34, 0.5, 0.66, 0.83, 1.0)]
    # Each station has a radius [m], a fraction of the length, and a texture row. The stations run from the bottom to
    # the lid, which is pushed in.
    stations = [(0.0, 0.03, 0.0), (0.75 * _RADIUS, 0.0, rows[1])]
    stations += [(r, 0.07 + 0.80 * t, row) for r, t, row in body]
    stations += [(0.83 * _RADIUS, 0.985, rows[4]), (0.79 * _RADIUS, 1.0, rows[6]), (0.73 * _RADIUS, 0.955, rows[7])]
    stations += [(0.0, 0.93, 1.0)]
    angle = 2.0 * math.pi * np.arange(_SIDES) / _SIDES
    phase = rng.uniform(0.0, 2.0 * math.pi)
    rings = []
    for index, (radius, share, _) in enumerate(stations):
        along = (share - 0.5) * crush.length - crush.at
        pinch = math.exp(-((along / 0.021) ** 2))
        rough = 0.0 if radius == 0.0 else (0.06 + 0.10 * pinch) * min(1.0, 4.0 * share, 4.0 * (1.0 - share) + 0.2)
        wave = np.cos(3.0 * angle + phase + math.pi * (index % 2)) + 0.7 * rng.uniform(-1.0, 1.0, _SIDES)
        reach = radius * (1.0 + rough * wave)
        across = reach * np.cos(angle) * (1.0 - pinch * (1.0 - crush.waist / _RADIUS))
        across = np.clip(across, -_RADIUS, _RADIUS)
        up = 0.5 * crush.height * reach / _RADIUS * np.sin(angle) * (1.0 - 0.12 * pinch)
        # The lid and the bottom are tilted to different sides; the sharp edge of each fold protrudes.
        tilt = 0.22 * (share - 0.5) * across + 0.0026 * (-1.0) ** index * (np.abs(np.sin(angle)) - 0.5) * (radius > 0.0)
        x0, y0, turn = _bent(crush, along)
        x = x0 + tilt * math.cos(turn) - across * math.sin(turn)
        y = y0 + tilt * math.sin(turn) + across * math.cos(turn)
        z = (
            0.5 * crush.height
            + up
            + crush.lift * (abs(along) / (0.5 * crush.length)) ** 2 * np.clip(up / (0.5 * crush.height) + 0.4, 0.0, 1.0)
        )
        rings.append(np.stack([x, y, np.maximum(z, 0.0)], axis=1))
    u = 1.0 - np.abs(np.arange(_SIDES) / (_SIDES / 2) - 1.0)
    return creased(loft(rings, u=u, v=[row for *_, row in stations], caps=(False, False)), 24.0)


def _wear(rng: np.random.Generator, canvas: Canvas, *, at: float) -> None:
    """Darken the dents in the can, show bare metal along the folds, and draw the opened lid."""
    low, high, lid, end = _CAN.rows[2], _CAN.rows[3], _CAN.rows[7], _CAN.rows[8]
    middle = low + (at - 0.07) / 0.80 * (high - low)
    slant = 0.010 * np.sin(80.0 * canvas.x + rng.uniform(0.0, 6.0))
    canvas.shade(1.0 - 0.45 * np.exp(-(((canvas.y + slant - middle) / 0.006) ** 2)))
    for _ in range(7):
        x, y = rng.uniform(0.0, canvas.width), middle + rng.uniform(-0.030, 0.030)
        points = [(x, y), (x + rng.uniform(-0.02, 0.02), y + rng.uniform(-0.018, 0.018))]
        canvas.line(points, 0.0022, (0.90, 0.91, 0.92), strength=0.85)
        canvas.line([(a + 0.0022, b + 0.0015) for a, b in points], 0.0020, (0.15, 0.04, 0.04), strength=0.45)
    # Draw the drinking hole on one side of the lid.
    hole = canvas.between(lid + 0.15 * (end - lid), lid + 0.72 * (end - lid)) & (canvas.x > 0.72 * canvas.width)
    canvas.paint(hole, (0.10, 0.10, 0.11))
