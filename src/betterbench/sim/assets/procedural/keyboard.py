"""Generator of computer keyboards. The function that draws the keys is shared with the laptop generator."""

import math

import numpy as np

from betterbench.sim.assets.authoring import Draft, generator, leaning_box, merge, part, solid_span, zone
from betterbench.sim.assets.authoring.mesh import ABOVE, box, prism, rectangle
from betterbench.sim.assets.authoring.paint import PALETTE, Canvas, Rgb, jittered, mixed, shaded, uniforms

# Rows of keys from the nearest to the farthest: widths in units of one key, as on a compact keyboard.
ROWS: tuple[tuple[float, ...], ...] = (
    (1.25, 1.0, 1.25, 6.0, 1.25, 1.0, 1.0, 1.25),
    (2.25, *(1.0,) * 10, 1.75),
    (1.75, *(1.0,) * 11, 1.25),
    (1.5, *(1.0,) * 11, 1.5),
    (*(1.0,) * 13, 1.0),
    (*(0.93,) * 15,),
)
_KEYS: dict[str, dict[str, Rgb]] = {
    "black": {"same": (0.17, 0.17, 0.18), "two-tone": (0.36, 0.37, 0.39), "contrast": (0.26, 0.29, 0.35)},
    "white": {"same": (0.93, 0.93, 0.92), "two-tone": (0.94, 0.94, 0.93), "contrast": (0.80, 0.81, 0.83)},
    "gray": {"same": (0.55, 0.56, 0.58), "two-tone": (0.62, 0.63, 0.65), "contrast": (0.16, 0.16, 0.17)},
}


@generator("keyboard", colors=("black", "white", "gray"))
def keyboard(rng: np.random.Generator, color: str) -> Draft:
    """Make a compact computer keyboard whose user sits at +x. It is slightly higher at the far side.

    Compact keyboards with six rows of keys are 260 to 300 mm wide and 100 to 125 mm deep. They weigh 0.35 to 0.6 kg, or
    16 kg/m^2.
    """
    width, depth, near, far = uniforms(rng, (0.262, 0.292), (0.102, 0.120), (0.0085, 0.0135), (0.0155, 0.0215))
    corner, key_height, bezel = uniforms(rng, (0.002, 0.016), (0.0026, 0.0042), (0.004, 0.010))
    half_x, half_y = 0.5 * depth, 0.5 * width
    lip, style = float(rng.choice([0.0, 0.009, 0.014])), str(rng.choice(["same", "two-tone", "contrast"]))
    accent = (None, PALETTE["orange"], PALETTE["red"], PALETTE["green"])[int(rng.integers(4))]
    case = jittered(shaded(PALETTE[color], 1.05) if color == "black" else PALETTE[color], rng)
    keys, slope = _KEYS[color][style], math.atan2(far - near, 2.0 * half_x)

    def top(x: np.ndarray | float) -> np.ndarray:
        """Return the height of the top of the case at position x [m]."""
        return np.asarray(near + (far - near) * (half_x - np.asarray(x)) / (2.0 * half_x))

    rings = []
    for inset, level in ((0.0010, 0.0), (0.0, 0.10), (0.0, 0.90), (0.0012, 1.0)):
        ring = rectangle(half_x - inset, half_y - inset, 0.0, corner=corner, steps=2)
        ring[:, 2] = level * top(ring[:, 0])
        rings.append(ring)
    high_x, size = half_x - bezel, (2.0 * (half_y - bezel), half_x - bezel - (-half_x + bezel + lip))
    pitch, slabs = size[1] / len(ROWS), []
    for row in range(len(ROWS)):
        x = high_x - (row + 0.5) * pitch
        slab = box((0.90 * pitch, size[0], key_height + 0.002), (0.0, 0.0, 0.5 * key_height - 0.001), bevel=0.0008)
        slabs.append(slab.rotated("y", slope).moved(x, 0.0, float(top(x))))
    picture = Canvas(*size, (256, 128), shaded(case, 0.55) if color != "white" else (0.62, 0.62, 0.63))
    edges = shaded(keys, 0.80) if style == "two-tone" else None
    draw_keys(picture, (0.0, 0.0), size, keys, accent=accent, edges=edges)
    visual = [
        part("case", prism(rings), case, specular=0.25),
        part("keys", merge(slabs), picture, view=ABOVE, specular=0.15),
    ]
    if lip > 0.0:
        x, lamp = -half_x + 0.009, box((0.0022, 0.0030, 0.0014), (0.0, 0.0, 0.0003)).rotated("y", slope)
        dots = [lamp.moved(x, half_y - 0.030 - 0.008 * k, float(top(x))) for k in range(3)]
        visual.append(part("lamps", merge(dots), (0.30, 0.90, 0.40), specular=0.5))
    plate, middle = 0.004, 0.5 * (near + far) + key_height
    lid = (half_x / math.cos(slope) - 0.001, half_y, plate)
    return Draft(
        shape="box",
        description=f"A compact {color} computer keyboard with six rows of keys.",
        tags=("keyboard", "computer keyboard", "desk", "typing"),
        traits=(
            "desk",
            "typing",
        ),
        mass_kg=round(16.2 * width * depth, 3),
        material="rubber",  # material of the feet
        parts=(
            *visual,
            solid_span((-half_x, half_x), half_y, (0.0, near)),
            leaning_box(lid, (-plate * math.sin(slope), 0.0, middle - plate * math.cos(slope)), slope),
        ),
        regions=(zone("base", half_x, half_y),),
        parameters={"depth_m": 2.0 * half_x, "width_m": 2.0 * half_y, "keys": style},
    )


def draw_keys(
    canvas: Canvas,
    corner: tuple[float, float],
    size_m: tuple[float, float],
    keys: Rgb,
    *,
    accent: Rgb | None = None,
    edges: Rgb | None = None,
) -> None:
    """Draw six rows of keys into a field of a texture, as the user sees them. The space bar is in the lowest row.

    The field is given by its lower left corner, and its width and depth [m]. ``accent`` is the color of the escape and
    enter keys. ``edges`` is the color of the wide keys at the edges and of the keys in the farthest row. If it is None,
    they have the same color as the other keys.
    """
    pitch = size_m[1] / len(ROWS)
    gap, last = 0.075 * pitch, len(ROWS) - 1
    legend = (0.85, 0.86, 0.88) if sum(keys) < 1.3 else (0.22, 0.23, 0.25)
    for row, units in enumerate(ROWS):
        left, low = corner[0], corner[1] + row * pitch
        for index, unit in enumerate(units):
            share = size_m[0] * unit / sum(units)
            shade = keys
            if edges is not None and (index in (0, len(units) - 1) or row == last):
                shade = edges
            if accent is not None and (row, index) in ((last, 0), (2, len(units) - 1)):
                shade = accent
            x, y = canvas.x - left, canvas.y - low
            cap = ((x > gap) & (x < share - gap)) & ((y > gap) & (y < pitch - gap))
            canvas.paint(cap, shaded(shade, 0.80))
            inner = ((x > 2.0 * gap) & (x < share - 2.0 * gap)) & ((y > 2.6 * gap) & (y < pitch - 1.6 * gap))
            canvas.paint(inner, mixed(shade, (1.0, 1.0, 1.0), 0.06))
            if unit <= 1.3:
                center = (left + 0.42 * share, low + 0.60 * pitch)
                canvas.ellipse(center, (0.13 * pitch, 0.15 * pitch), mixed(shade, legend, 0.75))
            left += share
