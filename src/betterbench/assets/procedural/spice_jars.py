"""Spice jars, the same jars with nothing but a label to tell them apart, and a pill bottle of their size."""

import math
from collections.abc import Sequence

import numpy as np

from betterbench.assets.asset import VisualPart
from betterbench.assets.authoring import Draft, Turned, disc, generator, grip_across, part, standing
from betterbench.assets.authoring.lettering import write_word
from betterbench.assets.authoring.mesh import Mesh, creased, loft
from betterbench.assets.authoring.paint import PALETTE, Canvas, Rgb, jittered, mixed, shaded, uniforms

JAR_RADIUS_M = 0.0215
"""Radius of every jar [m]: a 100 ml spice jar has a diameter of 42 to 44 mm. The rack's holes are made for it."""

JAR_HEIGHT_M = 0.085
"""Height of every jar with its cap [m]: such jars are 80 to 95 mm high."""

_SIDES = 24
_GLASS: Rgb = (0.66, 0.73, 0.73)
_NAMES = {"white": "SALT", "black": "PEPPER", "red": "PAPRIKA"}
_CONTENT: dict[str, Rgb] = {"white": (0.93, 0.93, 0.92), "black": (0.11, 0.095, 0.085), "red": (0.70, 0.10, 0.03)}
_PRINT: dict[str, Rgb] = {"white": (0.97, 0.97, 0.96), "black": (0.06, 0.06, 0.07), "red": (0.80, 0.05, 0.05)}
# Caps in colors that no spice has, so that the word for what is inside never names a cap.
_CAPS = [PALETTE.get(c, (0.58, 0.38, 0.20)) for c in ("green", "blue", "wood", "silver", "yellow", "purple")]


@generator("spice_jar", colors=("white", "black", "red"), family="spice jar")
def spice_jar(rng: np.random.Generator, color: str) -> Draft:
    """Make a glass spice jar; its color is that of what is inside: white salt, black pepper, red paprika.

    The glass is drawn rather than transparent, because one transparent part doubles the cost of every picture of
    depth. Within a look the three spices have caps of three different colors.
    """
    shape = _Shape(rng)
    order = rng.permutation(len(_CAPS))
    cap = jittered(_CAPS[int(order[tuple(_NAMES).index(color)])], rng, amount=0.06)
    fill, content, name = rng.uniform(0.050, 0.055), _CONTENT[color], _NAMES[color].lower()
    canvas = _Wrap(*shape.profile, _GLASS)
    up = canvas.height_on_wall
    canvas.paint((up > 0.003) & (up < fill), content)
    canvas.grain(rng, cells=(60, 80), amount=0.10 if color == "black" else 0.03)
    # The thick foot of the glass, and the gleam of its round sides.
    canvas.paint(up < 0.003, mixed(_GLASS, content, 0.25))
    for share, thick, strength in ((0.2, 0.0011, 0.35), (0.85, 0.0007, 0.25)):
        canvas.paint(np.abs(canvas.x - share * canvas.width) < thick, (1.0, 1.0, 1.0), strength=strength)
    _label(canvas, rng, color)
    description = f"A small glass spice jar of {name} with a {color} label and a screw cap."
    return _jar(shape, canvas, cap, description, ("spice jar", "jar", "spice", name, "glass"), specular=0.7)


@generator("plain_jar", colors=("white", "black", "red"), family="spice jar")
def plain_jar(rng: np.random.Generator, color: str) -> Draft:
    """Make a steel spice jar whose body and cap are the same for every spice: only the label tells them apart."""
    shape, name = _Shape(rng), _NAMES[color].lower()
    canvas = _Wrap(*shape.profile, shaded((0.52, 0.53, 0.55), rng.uniform(0.86, 1.06)))
    canvas.shade(1.0 + 0.10 * np.cos(4.0 * math.pi * canvas.x / canvas.width + rng.uniform(0.0, 6.0)))
    canvas.grain(rng, cells=(3, 90), amount=0.025)
    _label(canvas, rng, color)
    description = f"A plain steel spice jar with a gray cap and a {color} label that says {name}."
    tags = ("spice jar", "jar", "spice", "plain", name, "steel")
    return _jar(shape, canvas, (0.33, 0.34, 0.36), description, tags, specular=0.6)


@generator("pill_bottle", colors=("white",))
def pill_bottle(rng: np.random.Generator, color: str) -> Draft:
    """Make a pharmacy bottle with a ribbed child-proof cap, of a spice jar's size.

    Vials of 8 to 13 drams have diameters of 38 to 44 mm; filled they weigh 60 to 120 g. The heavy end is used, so that
    it feels like the jar it is taken for.
    """
    white, amber = PALETTE[color], rng.random() < 0.5
    body = jittered((0.86, 0.42, 0.08) if amber else white, rng, amount=0.05)
    ink = ((0.05, 0.50, 0.24), (0.75, 0.08, 0.10), (0.06, 0.30, 0.62))[int(rng.integers(3))]
    cap_height, ribs = rng.uniform(0.0195, 0.0235), int(rng.integers(26, 36))
    shoulder, r = JAR_HEIGHT_M - cap_height, JAR_RADIUS_M
    radii = (0.0, r - 0.0015, r - 0.0004, r - 0.0004, 0.0190)
    canvas = _Wrap(radii, (0.0, 0.0, 0.002, shoulder - 0.004, shoulder), body)
    if amber:
        # Pills seen through the amber plastic.
        canvas.paint((canvas.height_on_wall > 0.003) & (canvas.height_on_wall < 0.046), shaded(body, 0.80))
        canvas.grain(rng, cells=(14, 24), amount=0.08)
    _pharmacy_label(canvas, rng, ink)
    low = shoulder - 0.0005
    z = (low, low, JAR_HEIGHT_M - 0.002, JAR_HEIGHT_M, JAR_HEIGHT_M)
    cap = _Wrap((0.0165, r, r, r - 0.0018, 0.0), z, shaded(white, 1.1))
    _, low_row, high_row, _, end = cap.solid.rows
    ribbed = 0.88 + 0.12 * np.sign(np.sin(2.0 * math.pi * ribs * cap.x / cap.width))
    cap.shade(np.where(cap.between(low_row + 0.002, high_row - 0.001), ribbed, 1.0))
    cap.shade(np.where(cap.y < low_row + 0.002, 0.92, 1.0))
    # The arrows of a push-and-turn cap: a ring with gaps.
    arrows = (np.abs(end - cap.y - 0.0115) < 0.0012) & (np.cos(6.0 * math.pi * cap.x / cap.width) > -0.4)
    cap.paint(arrows, (0.55, 0.56, 0.58))
    return _bottle(
        f"A pharmacy pill bottle with a {color} ribbed child-proof cap and a printed label.",
        ("pill bottle", "pills", "medicine", "pharmacy", "bottle"),
        part("body", canvas.mesh(), canvas, specular=0.4, shininess=0.5),
        part("cap", cap.mesh(), cap),
        amber=str(amber),
        ribs=float(ribs),
    )


class _Wrap(Canvas):
    """A picture that goes once around each half of a turned body, so that its print reads rightly on both.

    Attributes:
        solid: The body.
        height_on_wall: (height, width) height of each sample above the foot [m], as far as the wall is upright.
    """

    def __init__(self, radii: Sequence[float], heights: Sequence[float], color: Rgb) -> None:
        """Start a picture for the body turned from a profile [m]."""
        self.solid = Turned(radii, heights)
        super().__init__(math.pi * max(radii), self.solid.rows[-1], (160, 192), color)
        self.height_on_wall = np.interp(self.y, self.solid.rows, heights)

    def mesh(self) -> Mesh:
        """Return the creased mesh; each half begins with a seam, the first at -y: +x is in the middle of one."""
        half = _SIDES // 2
        turn = np.concatenate([np.arange(half + 1), half + np.arange(half + 1)]) * (math.pi / half) - 0.5 * math.pi
        c, s, n = np.cos(turn), np.sin(turn), len(turn)
        rings = [np.column_stack([r * c, r * s, np.full(n, z)]) for r, z in self.solid.profile]
        u, v = np.tile(np.arange(half + 1) / half, 2), np.array(self.solid.rows) / self.solid.rows[-1]
        return creased(loft(rings, u=u, v=v.tolist(), caps=(False, False)), 40.0)


class _Shape:
    """The profile that the looks of a jar share: one radius, one height, another neck and cap."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.cap_height, r, shoulder = uniforms(rng, (0.0185, 0.0235), (0.0196, 0.0208), (0.0030, 0.0055))
        dome = float(rng.choice([0.0010, 0.0010, 0.0030]))
        low, top = JAR_HEIGHT_M - self.cap_height, JAR_HEIGHT_M - dome
        radii = (0.0, JAR_RADIUS_M - 0.0018, JAR_RADIUS_M, JAR_RADIUS_M, 0.0180)
        self.profile = radii, (0.0, 0.0, 0.0025, low - shoulder, low + 0.0005)
        self.cap_radius = r
        self.cap = Turned((0.0160, r, r, r - 0.0014, 0.0), (low, low, JAR_HEIGHT_M - 0.0014 - dome, top, JAR_HEIGHT_M))


def _jar(shape: _Shape, canvas: _Wrap, cap: Rgb, description: str, tags: tuple[str, ...], *, specular: float) -> Draft:
    """Put a jar together; the edge of its cap is knurled."""
    r, start = shape.cap_radius, shape.cap_radius - 0.0160
    knurled = Canvas(math.pi * r, start + shape.cap_height + r, (128, 128), cap)
    skirt = knurled.between(start + 0.002, start + shape.cap_height - 0.003)
    knurled.shade(np.where(skirt, 0.90 + 0.10 * np.cos(2.0 * math.pi * 22.0 * knurled.x / (math.pi * 0.02)), 1.0))
    knurled.shade(np.where(knurled.y > knurled.height - 0.62 * r, 0.93, 1.0))
    body = part("body", canvas.mesh(), canvas, specular=specular, shininess=0.7)
    top = part("cap", shape.cap.mesh(), knurled, specular=0.35, shininess=0.5)
    return _bottle(description, tags, body, top, cap_height_m=shape.cap_height)


def _bottle(description: str, tags: tuple[str, ...], *visual: VisualPart, **parameters: float | str) -> Draft:
    """Return what every jar and the pill bottle have in common, around what is seen of one.

    70 g of glass and cap and 50 g of what is inside; one cylinder on a square foot; pads that reach 12 mm below the
    grasp, and so stay above a hole 35 mm deep.
    """
    return Draft(
        shape="cylinder",
        description=description,
        tags=tags,
        mass_kg=0.12,
        parts=(*visual, *standing(0.0140, (JAR_RADIUS_M, JAR_HEIGHT_M))),
        grasps=(grip_across(0.062, JAR_RADIUS_M),),
        regions=(disc("base", JAR_RADIUS_M), disc("top", 0.0195, JAR_HEIGHT_M)),
        parameters={"radius_m": JAR_RADIUS_M, "height_m": JAR_HEIGHT_M, **parameters},
    )


def _label(canvas: _Wrap, rng: np.random.Generator, color: str) -> None:
    """Glue the label on: paper, a big band in the spice's color, its name on the band."""
    up, width, wide = canvas.height_on_wall, canvas.width, 0.45 * canvas.width
    design = str(rng.choice(["band", "frame", "round", "full"]))
    low, high, middle = 0.0095, 0.0500, 0.0320
    reach = np.abs(canvas.x - 0.5 * width)
    ink: Rgb = (0.10, 0.11, 0.13) if color == "white" else (0.96, 0.95, 0.92)
    # White print needs a darker paper around it, the others a light one.
    label = (reach < wide) & (up > low) & (up < high)
    canvas.paint(label, (0.62, 0.53, 0.38) if color == "white" else (0.93, 0.91, 0.85))
    if design == "band":
        field = np.abs(up - middle) < 0.0125
    elif design == "frame":
        field = (reach < wide - 0.0022) & (up > low + 0.0022) & (up < high - 0.0022)
    elif design == "round":
        field = (reach / (wide - 0.001)) ** 4 + ((up - middle) / 0.0150) ** 4 < 1.0
    else:
        field = up > low + 0.0075
    canvas.paint(label & field, _PRINT[color])
    name = _NAMES[color]
    size = min(0.0098, 0.80 * wide / (0.45 * len(name)))
    base = float(np.interp(middle, up[::-1, 0], canvas.y[::-1, 0]))
    write_word(canvas, name, (0.5 * width, base), height=size, ink=ink, weight=0.20)
    for offset in (0.0080, -0.0080):
        canvas.paint(label & field & (np.abs(up - middle - offset) < 0.0006) & (reach < 0.6 * wide), ink)


def _pharmacy_label(canvas: _Wrap, rng: np.random.Generator, ink: Rgb) -> None:
    """Glue on the label of a pharmacy: a cross in a colored head and lines of small print."""
    up, left, wide = canvas.height_on_wall, canvas.x - 0.5 * canvas.width, 0.43 * canvas.width
    reach, high, head = np.abs(left), 0.0520, 0.0350
    canvas.paint((reach < wide) & (up > 0.0080) & (up < high), (0.97, 0.97, 0.96))
    canvas.paint((reach < wide) & (up > head + 0.0135) & (up < high), ink)
    center = head + 0.0025
    dx, dz = np.abs(left + 0.0125), np.abs(up - center)
    canvas.paint((np.maximum(dx, dz) < 0.0078) & (np.minimum(dx, dz) < 0.0027), ink)
    # Small print: rows, their share of the width, where they begin, the uppermost, their distance and half height.
    blocks = (
        (3, (0.55, 0.9), -0.0015, center + 0.005, 0.005, 0.0010),
        (4, (0.5, 0.92), -0.88 * wide, 0.0255, 0.0045, 0.0008),
    )
    for rows, shares, start, top, pitch, half in blocks:
        for row in range(rows):
            end = rng.uniform(*shares) * wide
            canvas.paint((left > start) & (left < end) & (np.abs(up - top + pitch * row) < half), (0.25, 0.26, 0.30))
