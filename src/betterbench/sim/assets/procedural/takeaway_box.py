"""Generator of open takeaway boxes made of kraft board."""

import numpy as np

from betterbench.sim.assets.authoring import Draft, generator, open_box, part, zone
from betterbench.sim.assets.authoring.mesh import Mesh, creased, loft
from betterbench.sim.assets.authoring.paint import Canvas, Rgb, jittered, mixed, shaded

_WALL = 0.005
_FLOOR = 0.005
# Fraction of the texture's height that shows the outside; the rest is the inside and the floor.
_OUTSIDE = 0.58


@generator("takeaway_box", colors=("brown", "white"))
def takeaway_box(rng: np.random.Generator, color: str) -> Draft:
    """Make a low, wide, open kraft box with a printed sign on its long side, which faces +x.

    The inside is about 0.20 m (x) by 0.27 m (y). The box weighs 0.45 kg, most of it in the floor, like a box with a
    stiff insert and some content. An empty box of 40 g would slide when it is touched.
    """
    half_x, half_y = 0.100 + rng.uniform(-0.002, 0.002), 0.135 + rng.uniform(-0.002, 0.002)
    height, tooth = rng.uniform(0.100, 0.108), rng.uniform(0.0032, 0.0045)
    tone, band = (
        mixed((0.84, 0.66, 0.44), (0.66, 0.46, 0.27), rng.random()),
        str(rng.choice(["line", "band", "stripes"])),
    )
    kraft = jittered(tone if color == "brown" else (0.90, 0.88, 0.83), rng, amount=0.06)
    sign = str(rng.choice(["burger", "sun", "leaf"]))
    ink = ((0.62, 0.12, 0.10), (0.12, 0.30, 0.16), (0.20, 0.14, 0.10))[int(rng.integers(3))]
    mesh, front = _box(rng, half_x + _WALL, half_y + _WALL, height, tooth=tooth)
    around = 2.0 * (half_x + half_y + 2 * _WALL)
    picture = _print(rng, kraft, ink, sign=sign, band=band, height=height, half_perimeter=around, front=front)
    inside = 0.5 * (height - _FLOOR)
    return Draft(
        shape="box",
        description=f"An open {color} takeaway box of kraft board with a printed {sign}.",
        tags=("box", "takeaway box", "food tray", "container"),
        mass_kg=0.45,
        material="cardboard",
        densities=(3.0, 0.25, 0.25, 0.25, 0.25),
        parts=(part("box", mesh, picture, specular=0.05), *open_box((half_x, half_y), _WALL, _FLOOR, height)),
        regions=(
            zone("inside", half_x, half_y, _FLOOR + inside, half_z=inside),
            zone("opening", half_x, half_y, height),
        ),
        parameters={"inner_x_m": 2 * half_x, "inner_y_m": 2 * half_y, "height_m": height, "sign": sign, "print": band},
    )


def _box(rng: np.random.Generator, half_x: float, half_y: float, height: float, *, tooth: float) -> tuple[Mesh, float]:
    """Return the mesh of the box, and the fraction of the texture's width at which the front ends."""
    long, short = 16, 10  # even numbers of segments along y and along x, so that each side has a midpoint
    corners = [(half_x, -half_y), (half_x, half_y), (-half_x, half_y), (-half_x, -half_y)]
    plan = []
    for (ax, ay), (bx, by), count in zip(corners, [*corners[1:], corners[0]], (long, short) * 2, strict=True):
        plan += [(ax + (bx - ax) * k / count, ay + (by - ay) * k / count) for k in range(count)]
    outline = np.array(plan)
    n = len(outline)
    teeth = np.where(np.arange(n) % 2 == 0, 0.0, -tooth)
    on_short = np.abs(np.abs(outline[:, 1]) - half_y) < 1e-9
    # The middle of the narrow sides is folded in, most at the rim and not at all at the floor.
    fold = np.where(on_short, np.clip(1.0 - np.abs(outline[:, 0]) / half_x, 0.0, 1.0), 0.0) * 0.0040
    # Long sides are slightly uneven, as in folded paper.
    on_long = np.abs(np.abs(outline[:, 0]) - half_x) < 1e-9
    bulge = np.where(on_long, np.clip(1.0 - np.abs(outline[:, 1]) / half_y, 0.0, 1.0), 0.0)
    wave = bulge * rng.uniform(0.2, 1.0, n) * 0.0022

    def ring(inset: float, push: np.ndarray, z: np.ndarray | float) -> np.ndarray:
        points = np.zeros((n, 3))
        points[:, 0] = outline[:, 0] - np.sign(outline[:, 0]) * np.where(on_long, inset + push, 0.0)
        points[:, 1] = outline[:, 1] - np.sign(outline[:, 1]) * np.where(on_short, inset + push, 0.0)
        corner = on_long & on_short
        points[corner, 0] = np.sign(outline[corner, 0]) * (half_x - inset)
        points[corner, 1] = np.sign(outline[corner, 1]) * (half_y - inset)
        points[:, 2] = z
        return points

    none, bent, paper = np.zeros(n), fold + wave, 0.0012
    outer = [ring(0.0, none, 0.0), ring(0.0, 0.5 * bent, 0.52 * height), ring(0.0, bent, height + teeth)]
    rings = [*outer, ring(paper, bent, height + teeth), ring(paper, none, _FLOOR)]
    # The texture coordinate is the distance along the edge from the center of the front. Therefore the only seams are
    # at the centers of the front and the back.
    x, y = outline[:, 0], np.abs(outline[:, 1])
    back = np.where(np.abs(x + half_x) < 1e-9, 2 * half_y + 2 * half_x - y, half_y + half_x - x)
    along = np.where(np.abs(x - half_x) < 1e-9, y, back)
    half_perimeter = 2.0 * (half_x + half_y)
    v = (0.0, 0.52 * _OUTSIDE, _OUTSIDE, _OUTSIDE + 0.01, 0.97)
    return creased(loft(rings, u=along / half_perimeter, v=v), 35.0), half_y / half_perimeter


def _print(
    rng: np.random.Generator,
    kraft: Rgb,
    ink: Rgb,
    *,
    sign: str,
    band: str,
    height: float,
    half_perimeter: float,
    front: float,
) -> Canvas:
    """Draw the texture for one half of the box, from the center of its front to the center of its back."""
    scale = height / _OUTSIDE  # meters per full height of the texture
    canvas = Canvas(half_perimeter, scale, (256, 128), kraft)
    x, y = canvas.x, canvas.y
    outside = y < height
    canvas.grain(rng, cells=(60, 10), amount=0.022)
    canvas.grain(rng, cells=(9, 5), amount=0.025)
    middle = 0.50 * height
    if band == "band":
        canvas.paint(outside & (y < 0.20 * height), ink)
    elif band == "stripes":
        canvas.paint(
            outside & (y > 0.10 * height) & (y < 0.90 * height) & ((x / half_perimeter * 40.0) % 1.0 < 0.35),
            mixed(kraft, ink, 0.5),
        )
    for u in (0.0, half_perimeter):
        if band == "stripes":
            canvas.ellipse((u, middle), (0.050, 0.042), kraft)
        _sign(canvas, sign, (u, middle), ink, kraft)
    canvas.paint(outside & (np.abs(y - 0.09 * height) < 0.0022), ink, strength=0.8)
    edge = front * half_perimeter
    # Draw folds at the corners, in the middle of the narrow side, and across the board where it was folded flat.
    for at in (edge, half_perimeter - edge):
        canvas.paint(outside & (np.abs(x - at) < 0.0022), shaded(kraft, 0.80), strength=0.7)
    canvas.paint(outside & (np.abs(x - 0.5 * half_perimeter) < 0.0020), shaded(kraft, 0.72), strength=0.8)
    canvas.paint(outside & (np.abs(y - 0.80 * height) < 0.0012), shaded(kraft, 0.84), strength=0.6)
    canvas.shade(np.where(outside, 0.88 + 0.12 * np.clip(y / (0.5 * height), 0.0, 1.0), 1.0))
    down = np.clip((y - height) / (scale - height), 0.0, 1.0)
    canvas.shade(np.where(outside, 1.0, 0.86 - 0.30 * down))
    return canvas


def _sign(canvas: Canvas, sign: str, center: tuple[float, float], ink: Rgb, kraft: Rgb) -> None:
    """Draw the printed sign (a burger, a sun or a leaf), which is seven tenths as high as the board."""
    dx, dy = (canvas.x - center[0]) / 1.15, (canvas.y - center[1]) / 1.15
    if sign == "burger":
        canvas.paint(((dx / 0.034) ** 2 + ((dy - 0.003) / 0.027) ** 2 < 1.0) & (dy > 0.006), ink)
        canvas.paint((np.abs(dx) < 0.037) & (np.abs(dy + 0.001) < 0.0040), ink)
        canvas.paint((np.abs(dx) < 0.033) & (dy < -0.009) & (dy > -0.021), ink)
    elif sign == "sun":
        r, angle = np.hypot(dx, dy), np.arctan2(dy, np.abs(dx) + 1e-12)
        canvas.paint((r > 0.020) & (r < 0.031) & (np.cos(10.0 * angle) > 0.1), ink)
        canvas.paint(r < 0.016, ink)
        canvas.paint(r < 0.009, mixed(kraft, ink, 0.1))
    else:
        leaf = (dx / 0.018) ** 2 + (dy / 0.030) ** 2 < 1.0
        canvas.paint(leaf, ink)
        canvas.paint(np.abs(dx) < 0.0014, kraft)
        for level in (-0.012, 0.0, 0.012):
            canvas.paint(leaf & (np.abs(dy - level - 0.6 * np.abs(dx)) < 0.0014), kraft)
