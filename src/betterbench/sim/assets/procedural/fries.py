"""Generator of boxes of French fries."""

import itertools
import math

import numpy as np

from betterbench.sim.assets.authoring import Draft, generator, grip, merge, part, solid_span, zone
from betterbench.sim.assets.authoring.mesh import Mesh, creased, loft, prism
from betterbench.sim.assets.authoring.paint import PALETTE, Canvas, Rgb, jittered, mixed, shaded, uniforms

# Fraction of the texture's height that shows the outside of the carton; the rest is its inside and the filling.
_OUTSIDE = 0.8


@generator("fries_box", colors=("red", "yellow", "blue", "green"))
def fries_box(rng: np.random.Generator, color: str) -> Draft:
    """Make a striped carton of French fries. Its wide side faces +x, and the gripper closes along x.

    A portion of fries weighs 0.10 to 0.12 kg. The carton is 38 to 42 mm thick where the finger pads close. The fries
    end below the underside of the Franka gripper's hand, which is 45 mm above the tool center point.
    """
    thick, width, height = uniforms(rng, (0.0370, 0.0415), (0.0550, 0.0660), (0.0740, 0.0860))
    dip, half_x, half_y = rng.uniform(0.006, 0.022), thick / 2, width / 2
    shade, design = (
        jittered(PALETTE[color], rng),
        str(rng.choice(["stripes", "disc", "smile", "broad stripes", "band"])),
    )
    picture = _print(rng, shade, design=design)
    sticks, dark = _sticks(rng, thick, width, height)
    golden = jittered(mixed((0.93, 0.68, 0.20), (0.90, 0.58, 0.13), rng.random()), rng, amount=0.08)
    return Draft(
        shape="box",
        description=f"A {color} and white striped carton of French fries.",
        tags=("fries", "french fries", "chips", "food", "carton"),
        traits=(
            "chips",
            "food",
        ),
        mass_kg=round(0.115 * thick * width / (0.040 * 0.062), 4),
        material="cardboard",
        parts=(
            part("carton", _carton(thick, width, height, dip=dip), picture, specular=0.15),
            part("fries", sticks, golden, specular=0.12),
            part("dark_fries", dark, shaded(golden, 0.86), specular=0.12),
            solid_span((-half_x, half_x), half_y, (0.0, height - 0.002)),
            solid_span((-0.36 * thick, 0.36 * thick), 0.38 * width, (height - 0.002, 0.100)),
        ),
        grasps=(grip("body", 0.068, thick, across="x"),),
        regions=(zone("base", half_x, half_y),),
        parameters={"thickness_m": thick, "width_m": width, "carton_height_m": height, "design": design},
    )


def _carton(thick: float, width: float, height: float, *, dip: float) -> Mesh:
    """Return the mesh of the filled carton, which is narrower at the bottom.

    The upper edge is scooped at the front and straight at the back.
    """
    n = 9  # points along each wide face
    y = np.linspace(-1.0, 1.0, n)
    half_x, half_y = thick / 2, width / 2
    bulge = 1.0 - 0.30 * y**2  # the wide faces bow outward
    front = np.stack([half_x * bulge, half_y * y], axis=1)
    outline = np.concatenate([front, -front])
    scoop = height - dip * (1.0 - y**2) ** 0.8
    back = height - 0.15 * dip * (1.0 - y**2)
    rim = np.concatenate([scoop, back[::-1]])
    low = outline * np.array([0.80, 0.84])

    def ring(plan: np.ndarray, z: np.ndarray | float) -> np.ndarray:
        return np.column_stack([plan, np.broadcast_to(z, len(plan))])

    inner = outline * np.array([0.93, 0.97])
    filling = np.minimum(rim - 0.004, height - 0.014)
    rings = [ring(low, 0.0), ring(outline, rim), ring(inner, rim - 0.0002), ring(inner * 0.97, filling)]
    # The texture runs from the center of the front (0) over the narrow side to the center of the back (1).
    u = np.concatenate([0.42 * np.abs(y), 1.0 - 0.42 * np.abs(y)])
    return creased(loft(rings, u=u, v=(0.0, _OUTSIDE, _OUTSIDE + 0.04, 1.0)), 42.0)


def _print(rng: np.random.Generator, shade: Rgb, *, design: str) -> Canvas:
    """Draw the carton, with its stripes and the sign on its front."""
    canvas = Canvas(1.0, 1.0, (128, 128), (0.93, 0.92, 0.89))
    x, y = canvas.x, canvas.y
    pitch = 0.28 if design == "broad stripes" else 0.14
    stripes = np.abs((x / pitch + 0.5) % 1.0 - 0.5) < 0.25
    outside, level = y < _OUTSIDE, 0.45
    canvas.paint(outside if design in ("smile", "band") else outside & stripes, shade)
    if design == "disc":
        for u in (0.0, 1.0):
            canvas.ellipse((u, level), (0.23, 0.185), (0.93, 0.92, 0.89))
            canvas.ellipse((u, level), (0.195, 0.155), shade)
            canvas.ellipse((u, level), (0.10, 0.08), PALETTE["yellow"])
    elif design == "band":
        canvas.paint(outside & (y > 0.30) & (y < 0.52), (0.93, 0.92, 0.89))
        canvas.paint(outside & (y > 0.36) & (y < 0.46), PALETTE["yellow"])
    elif design == "smile":
        for u in (0.0, 1.0):
            above = canvas.inside_ellipse((u, level + 0.10), (0.24, 0.19))
            canvas.paint(canvas.inside_ellipse((u, level + 0.06), (0.24, 0.20)) & ~above, PALETTE["yellow"])
        canvas.paint(outside & (y > 0.08) & (y < 0.14), (0.93, 0.92, 0.89))
    canvas.shade(np.where(outside, 0.86 + 0.14 * np.clip(y / (0.5 * _OUTSIDE), 0.0, 1.0), 1.0))
    canvas.paint(y > _OUTSIDE + 0.02, mixed((0.93, 0.92, 0.89), (0.55, 0.35, 0.10), 0.35))
    canvas.paint(y > _OUTSIDE + 0.12, (0.62, 0.40, 0.10))
    canvas.grain(rng, cells=(10, 10), amount=0.015)
    return canvas


def _sticks(rng: np.random.Generator, thick: float, width: float, height: float) -> tuple[Mesh, Mesh]:
    """Return the fries in two shades. They are square sticks at random angles that end 92 to 111 mm above the table."""
    meshes: tuple[list[Mesh], list[Mesh]] = ([], [])
    columns = np.linspace(-0.40, 0.40, 7).tolist()
    for index, (row, column) in enumerate(itertools.product((-0.26, 0.0, 0.26), columns)):
        if index % 10 != 9:
            foot = np.array([row * thick, column * width * 0.88, height - 0.030])
            tall = 0.108 - 0.012 * abs(column) / 0.4 - rng.uniform(0.0, 0.016) - (0.006 if row > 0.1 else 0.0)
            lean_x, lean_y, half, turn = uniforms(rng, (-0.10, 0.10), (-0.10, 0.10), (0.0029, 0.0036), (-0.5, 0.5))
            tip = np.array([(row + lean_x) * thick, (column + lean_y) * width, tall])
            corners = turn + math.pi / 4 + np.arange(4) * math.pi / 2
            square = np.stack([np.cos(corners), np.sin(corners), np.zeros(4)], axis=1) * half * math.sqrt(2.0)
            slant = np.array([[0.0, 0.0, 0.0015], [0, 0, -0.0005], [0, 0, -0.0015], [0, 0, 0.0005]])
            meshes[index % 2].append(prism([foot + square, tip + square + slant]))
    return merge(meshes[0]), merge(meshes[1])
