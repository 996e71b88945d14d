"""Crushed beverage cans: the trash that a full can must not be taken for."""

import math

import numpy as np

from betterbench.assets.authoring import Draft, centered, disc, generator, grip_across, part
from betterbench.assets.authoring.mesh import Mesh, creased, loft
from betterbench.assets.authoring.paint import PALETTE, Canvas, jittered, uniforms
from betterbench.assets.authoring.solids import foot_square, upright_cylinder
from betterbench.assets.procedural.can import CAN_RADIUS, DESIGNS, can_shell, draw_label

_SIDES = 18
_CAN = can_shell(0.115, 0.0115)  # before it was crushed


@generator("crushed_can", colors=("red", "silver", "blue", "green"))
def crushed_can(rng: np.random.Generator, color: str) -> Draft:
    """Make an empty can that was stamped down along its axis: folded, skewed, half as high, a little wider.

    The empty can is 13 to 14 g of aluminum. It is given 20 g, for a rest of drink in it.
    """
    height, folds, lobes = rng.uniform(0.050, 0.058), int(rng.choice([3, 3, 4])), int(rng.choice([4, 5]))
    skew, tilt = rng.uniform(0.0025, 0.0045), math.radians(rng.uniform(6.0, 13.0))  # of the top
    design, shade = str(rng.choice(DESIGNS)), jittered(PALETTE[color], rng, amount=0.06)
    mesh = _folded(rng, height, folds=folds, lobes=lobes, skew=skew, tilt=tilt)
    mesh = mesh.moved(*centered(mesh))
    canvas = draw_label(rng, _CAN, shade, design=design)
    _scratch(rng, canvas, folds=folds)
    across = float(min(np.ptp(mesh.vertices[:, 0]), np.ptp(mesh.vertices[:, 1])))
    radius, top = 0.5 * min(across, 0.070) - 0.0008, float(mesh.vertices[:, 2].max())
    return Draft(
        shape="irregular",
        description=f"A crushed, empty {color} soda can.",
        tags=("crushed can", "can", "empty can", "metal", "trash"),
        mass_kg=0.020,
        parts=(
            part("shell", mesh, canvas, specular=0.7, shininess=0.6),
            foot_square(0.0165),
            upright_cylinder(radius, 0.0060, 0.80 * top),
            upright_cylinder(0.024, 0.0005, top - 0.004),
        ),
        grasps=(grip_across(0.028, radius, clearance=0.004),),
        regions=(disc("base", radius),),
        parameters={"height_m": top, "folds": float(folds), "lobes": float(lobes), "design": design},
    )


def _folded(rng: np.random.Generator, height: float, *, folds: int, lobes: int, skew: float, tilt: float) -> Mesh:
    """Return the crushed shell; its texture rows are those of the full can, so that the print is folded with it."""
    rows = [row / _CAN.rows[-1] for row in _CAN.rows]
    # Ring by ring: radius [m], height as a share of the whole, how strongly it is wrinkled, texture row.
    rings = [(0.0245, 0.0, 0.0, rows[1]), (CAN_RADIUS - 0.001, 0.13, 0.35, rows[2])]
    for k in range(1, 2 * folds):
        r = CAN_RADIUS + (-0.0055 if k % 2 == 1 else 0.0012) + rng.uniform(-0.0006, 0.0006)
        share = k / (2 * folds)
        rings.append((r, 0.13 + 0.69 * share, 1.0, rows[2] + share * (rows[3] - rows[2])))
    rings += [(CAN_RADIUS - 0.001, 0.82, 0.45, rows[3]), (0.0272, 0.965, 0.15, rows[4])]
    rings += [(0.0270, 1.0, 0.10, rows[5]), (0.0256, 1.0, 0.10, rows[6]), (0.0250, 0.945, 0.08, rows[7])]
    angle = 2.0 * math.pi * np.arange(_SIDES) / _SIDES
    heading, phase = uniforms(rng, (0.0, 2.0 * math.pi), (0.0, 2.0 * math.pi))
    points = []
    for index, (r, share, wrinkle, _) in enumerate(rings):
        # Buckled cylinders fold into diamonds: each fold is turned by half a lobe against the one below.
        turn = phase + math.pi * (index // 2 % 2)
        wave = np.cos(lobes * angle + turn)
        rough = rng.uniform(-1.0, 1.0, _SIDES)
        reach = r * (1.0 + wrinkle * (0.035 * wave + 0.018 * rough)) if wrinkle > 0.0 else np.full(_SIDES, r)
        reach = np.minimum(reach, CAN_RADIUS + 0.0016)
        x, y = reach * np.cos(angle), reach * np.sin(angle)
        z = height * share + wrinkle * (0.0022 * np.cos(lobes * angle + turn + 1.2) + 0.0008 * rough)
        z = z + share * math.tan(tilt) * (x * math.cos(heading) + y * math.sin(heading)) * share
        z = np.maximum(z, 0.0) if share > 0.0 else np.zeros(_SIDES)
        dx, dy = skew * share * math.cos(heading + 0.7), skew * share * math.sin(heading + 0.7)
        points.append(np.stack([x + dx, y + dy, z], axis=1))
    u = 1.0 - np.abs(np.arange(_SIDES) / (_SIDES / 2) - 1.0)
    return creased(loft(points, u=u, v=[row for *_, row in rings]), 28.0)


def _scratch(rng: np.random.Generator, canvas: Canvas, *, folds: int) -> None:
    """Rub the print off along the folds, where bare metal shows, and darken the valleys between them."""
    low, high = _CAN.rows[2], _CAN.rows[3]
    wave = 0.0012 * np.sin(900.0 * canvas.x + rng.uniform(0.0, 6.0))
    for k in range(1, 2 * folds):
        away = np.abs(canvas.y + wave - low - (high - low) * k / (2 * folds))
        if k % 2 == 1:
            canvas.shade(1.0 - 0.40 * np.clip(1.0 - away / 0.006, 0.0, 1.0))
        else:
            start, stop = sorted(rng.uniform(0.0, float(canvas.x.max()), 2).tolist())
            worn = (away < 0.0009) & (canvas.x > start) & (canvas.x < stop)
            canvas.paint(worn, (0.86, 0.87, 0.88), strength=0.8)
