"""Generators of spice jars, of plain jars that differ only in their label, and of a pill bottle of the same size."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from betterbench.sim.assets.asset import VisualPart
from betterbench.sim.assets.authoring import Draft, Turned, disc, generator, grip_across, part, standing
from betterbench.sim.assets.authoring.lettering import write_word
from betterbench.sim.assets.authoring.mesh import Mesh, creased, loft
from betterbench.sim.assets.authoring.paint import PALETTE, STEEL, Canvas, Rgb, jittered, mixed, shaded, uniforms

JAR_RADIUS_M = 0.0215
"""Mean radius of the jars [m], for which the holes of the rack are made. The radius of a single jar differs from it by
at most 0.3 mm. A 100 ml spice jar has a diameter of 42 to 44 mm."""

JAR_HEIGHT_M = 0.085
"""Mean height of the jars with their caps [m]. The variants differ from it by up to 4 mm. Real jars of this kind are 80
to 95 mm high."""

_SIDES = 24
_NAMES = {"white": "salt", "black": "pepper", "red": "paprika"}
_CONTENT: dict[str, Rgb] = {"white": (0.95, 0.95, 0.94), "black": (0.085, 0.075, 0.07), "red": (0.78, 0.07, 0.04)}

_PAPER: Rgb = (0.93, 0.92, 0.88)
_INK: Rgb = (0.07, 0.08, 0.10)
"""Label of every plain jar."""


_TRAITS = ("glass", "medicine", "pharmacy", "plain", "steel")
"""Tags of the jars and of the bottle that name a material, a use or an appearance."""


@generator("spice_jar", colors=("white", "black", "red"), family="spice jar")
def spice_jar(rng: np.random.Generator, color: str) -> Draft:
    """Make a glass spice jar that is filled to its shoulder with white salt (S), black pepper (P) or red paprika.

    The whole jar has the color of the spice. The cap has the same color or is made of steel, so that a cap never has
    the color of a different spice. The glass is painted instead of transparent, because a single transparent part
    doubles the rendering time of depth images.
    """
    shape, steel = _Shape(rng), bool(rng.random() < 0.45)
    content, name = jittered(_CONTENT[color], rng, amount=0.04), _NAMES[color]
    cap = jittered(shaded(STEEL, 0.80), rng) if steel else jittered(mixed(content, (0.5, 0.5, 0.5), 0.06), rng)
    canvas = shape.wrap(content)
    canvas.grain(rng, cells=(50, 64), amount=0.30 if color == "black" else 0.03)
    up = canvas.height_on_wall
    # Paint the thick glass base, the empty neck, and the highlights on the round sides.
    glass = mixed((0.66, 0.73, 0.73), content, 0.45)
    canvas.paint((up < 0.003) | (up > shape.body - 0.0015), glass)
    for share, thick, strength in ((0.10, 0.0012, 0.40), (0.88, 0.0008, 0.30)):
        canvas.paint(np.abs(canvas.x - share * canvas.width) < thick, (1.0, 1.0, 1.0), strength=strength)
    ink: Rgb = (0.13, 0.15, 0.22) if color == "white" else (0.97, 0.96, 0.93)
    red_pod = _Print(ink=ink, pod=shaded(content, 0.95), disc=ink, stalk=(0.10, 0.42, 0.14))
    _label(canvas, rng, name, red_pod, height=shape.body)
    description = f"A small glass spice jar of {color} {name} with a screw cap."
    return _jar(shape, canvas, cap, description, ("spice jar", "jar", "spice", name, "glass"), specular=0.7)


def _plain_jar(rng: np.random.Generator, name: str) -> Draft:
    """Make a steel spice jar with a pale label. The colors of body, cap and label are the same for every spice."""
    shape, steel = _Shape(rng), shaded((0.44, 0.45, 0.47), rng.uniform(0.86, 1.06))
    canvas = shape.wrap(steel)
    canvas.shade(1.0 + 0.10 * np.cos(4.0 * math.pi * canvas.x / canvas.width + rng.uniform(0.0, 6.0)))
    canvas.grain(rng, cells=(3, 90), amount=0.025)
    low, high = 0.0070, shape.body - 0.0060
    up = canvas.height_on_wall
    reach = np.abs(canvas.x - 0.5 * canvas.width)
    canvas.paint((reach < 0.46 * canvas.width) & (up > low) & (up < high), _PAPER)
    _label(canvas, rng, name, _Print(ink=_INK, pod=_INK, disc=_PAPER, stalk=_INK), height=shape.body)
    description = f"A plain steel spice jar with a gray cap and a pale label for {name}."
    tags = ("spice jar", "jar", "spice", "plain", name, "steel")
    return _jar(shape, canvas, (0.33, 0.34, 0.36), description, tags, specular=0.6)


@generator("plain_salt_jar", colors=("gray",), family="spice jar")
def plain_salt_jar(rng: np.random.Generator, _color: str) -> Draft:
    """Make a plain steel spice jar for salt. It differs from the other plain jars only in the S on its label."""
    return _plain_jar(rng, "salt")


@generator("plain_pepper_jar", colors=("gray",), family="spice jar")
def plain_pepper_jar(rng: np.random.Generator, _color: str) -> Draft:
    """Make a plain steel spice jar for pepper. It differs from the other plain jars only in the P on its label."""
    return _plain_jar(rng, "pepper")


@generator("plain_paprika_jar", colors=("gray",), family="spice jar")
def plain_paprika_jar(rng: np.random.Generator, _color: str) -> Draft:
    """Make a plain steel spice jar for paprika.

    It differs from the other plain jars only in the dark pod on its label.
    """
    return _plain_jar(rng, "paprika")


@generator("pill_bottle", colors=("white",), family="spice jar")
def pill_bottle(rng: np.random.Generator, color: str) -> Draft:
    """Make a pharmacy bottle as large as a spice jar, with a big cross and a tall, ribbed, child-proof cap.

    Pharmacy vials of 8 to 13 drams have diameters of 38 to 44 mm and weigh 60 to 120 g when filled. The mass here is at
    the upper end, so that it is similar to that of a spice jar.
    """
    shape = _Shape(rng)
    white, amber, r = PALETTE[color], bool(rng.random() < 0.5), shape.radius
    body = jittered((0.88, 0.42, 0.06) if amber else shaded(white, 1.1), rng, amount=0.05)
    ink = ((0.03, 0.50, 0.26), (0.04, 0.30, 0.66), (0.02, 0.46, 0.55))[int(rng.integers(3))]
    cap_height, ribs = rng.uniform(0.0215, 0.0260), int(rng.integers(12, 20))
    shoulder = shape.height - cap_height
    radii = (0.0, r - 0.0015, r - 0.0004, r - 0.0004, r - 0.0025)
    canvas = _Wrap(radii, (0.0, 0.0, 0.002, shoulder - 0.004, shoulder), body)
    _pharmacy_label(canvas, rng, ink, shoulder)
    low, top = shoulder - 0.0005, shape.height
    cap = _Wrap((r - 0.005, r, r, r - 0.0018, 0.0), (low, low, top - 0.002, top, top), shaded(white, 1.15))
    _, low_row, high_row, edge, _ = cap.solid.rows
    ribbed = 0.84 + 0.16 * np.sign(np.sin(2.0 * math.pi * ribs * cap.x / cap.width))
    cap.shade(np.where(cap.between(low_row + 0.002, high_row - 0.001), ribbed, 1.0))
    cap.shade(np.where(cap.y < low_row + 0.002, 0.88, 1.0))
    # The lid of a push-and-turn cap is set into its rim. It has no marks, because marks would look like the holes of a
    # shaker.
    cap.shade(np.where(cap.y > edge + 0.004, 0.93, 1.0))
    return _bottle(
        shape,
        f"A pharmacy pill bottle with a {color} ribbed child-proof cap and a cross on its label.",
        ("pill bottle", "pills", "medicine", "pharmacy", "bottle"),
        "plastic",
        part("body", canvas.mesh(), canvas, specular=0.4, shininess=0.5),
        part("cap", cap.mesh(), cap),
        amber=str(amber),
        ribs=float(ribs),
    )


class _Wrap(Canvas):
    """Texture that is wrapped around each half of a turned body, so that the print appears on both halves.

    Attributes:
        solid: The turned body.
        height_on_wall: (height, 1) height above the foot of each row of texture samples [m]. It is only valid for rows
            on the upright wall.
    """

    def __init__(self, radii: Sequence[float], heights: Sequence[float], color: Rgb, *, sides: int = _SIDES) -> None:
        """Create the texture of a body, given the radii and heights of its profile [m].

        If ``sides`` is small, the sides of the body look flat.
        """
        self.solid, self._sides = Turned(radii, heights), sides
        super().__init__(math.pi * max(radii), self.solid.rows[-1], (160, 192), color)
        self.height_on_wall = np.interp(self.y, self.solid.rows, heights)

    def mesh(self) -> Mesh:
        """Return the creased mesh.

        The texture covers each half of the mesh. The first half begins at -y, so the middle of the texture faces +x.
        """
        half = self._sides // 2
        turn = np.concatenate([np.arange(half + 1), half + np.arange(half + 1)]) * (math.pi / half) - 0.5 * math.pi
        c, s, n = np.cos(turn), np.sin(turn), len(turn)
        rings = [np.column_stack([r * c, r * s, np.full(n, z)]) for r, z in self.solid.profile]
        u, v = np.tile(np.arange(half + 1) / half, 2), np.array(self.solid.rows) / self.solid.rows[-1]
        return creased(loft(rings, u=u, v=v.tolist(), caps=(False, False)), 40.0 if self._sides > 16 else 20.0)


class _Shape:
    """Shape of one variant.

    The base is the same for all variants, so that every jar fits the holes of the spice rack. The shapes differ above
    the base.
    """

    def __init__(self, rng: np.random.Generator) -> None:
        r, self.height, cap, waist = uniforms(rng, (0.0212, 0.0218), (0.081, 0.089), (0.0165, 0.0245), (0.86, 0.97))
        self.radius, self.sides = r, int(rng.choice([_SIDES, _SIDES, 10, 12]))
        form, dome = (
            str(rng.choice(["straight", "shoulder", "cone", "barrel"])),
            float(rng.choice([0.001, 0.004, 0.008])),
        )
        low, neck = self.height - cap, max(waist * r, 0.0172)
        self.form, self.cap_height, self.body = form, cap, low - 0.004
        belly = {"straight": r, "shoulder": r, "cone": 0.5 * (r + neck), "barrel": r}[form]
        upper = {"straight": r, "shoulder": neck, "cone": neck, "barrel": 0.93 * r}[form]
        knee = {"straight": 0.94, "shoulder": 0.66, "cone": 0.66, "barrel": 0.80}[form] * low
        self._radii = (0.0, r - 0.0018, r, r, belly, upper, min(upper, 0.0185))
        self._heights = (0.0, 0.0, 0.0025, 0.55 * low, knee, low - 0.0015, low + 0.0005)
        wide = min(r, max(neck + 0.0015, 0.0190)) if form in ("shoulder", "cone") else r - 0.0010
        # Radius and upper end of each cylinder of the collision shape. Two cylinders meet at the knee.
        self.touched = (
            ((r, knee), (max(wide, neck), self.height)) if form in ("shoulder", "cone") else ((r, self.height),)
        )
        slope, top = float(rng.choice([0.0, 0.0, 0.0022])), self.height - dome
        self.cap_radius = wide
        profile = ((0.0160, low), (wide, low), (wide - slope, top - 0.0012), (0.82 * wide - slope, top))
        radii, heights = zip(*profile, (0.0, self.height), strict=True)
        self.cap = Turned(radii, heights)

    def wrap(self, color: Rgb) -> _Wrap:
        """Create the texture of the jar's body."""
        return _Wrap(self._radii, self._heights, color, sides=self.sides)


def _jar(shape: _Shape, canvas: _Wrap, cap: Rgb, description: str, tags: tuple[str, ...], *, specular: float) -> Draft:
    """Put a jar together from its body and its cap. The edge of the cap is knurled."""
    r, start = shape.cap_radius, shape.cap_radius - 0.0160
    knurled = shape.cap.canvas(cap, (128, 128))
    skirt = knurled.between(start + 0.002, start + shape.cap_height - 0.003)
    knurled.shade(np.where(skirt, 0.90 + 0.10 * np.cos(2.0 * math.pi * 16.0 * knurled.x / knurled.width), 1.0))
    knurled.shade(np.where(knurled.y > knurled.height - 0.62 * r, 0.93, 1.0))
    body = part("body", canvas.mesh(), canvas, specular=specular, shininess=0.7)
    top = part("cap", shape.cap.mesh(), knurled, specular=0.35, shininess=0.5)
    material = "steel" if "steel" in tags else "glass"
    return _bottle(shape, description, tags, material, body, top, form=shape.form, sides=float(shape.sides))


def _bottle(
    shape: _Shape,
    description: str,
    tags: tuple[str, ...],
    material: str,
    *visual: VisualPart,
    **parameters: float | str,
) -> Draft:
    """Return a jar or the pill bottle, given its visual parts.

    In a jar of average size, the glass and the cap weigh 70 g and the content weighs 50 g. For other sizes, the mass is
    proportional to the volume. The collision shape is a cylinder on a square foot. The finger pads reach 12 mm below
    the grasp, and therefore stay above the rack while the jar stands in a hole that is 35 mm deep.
    """
    r, height, touched = shape.radius, shape.height, shape.touched
    if material == "plastic":
        touched = ((r, height),)  # all variants of the pill bottle are straight
    mass = 0.12 * (r / JAR_RADIUS_M) ** 2 * height / JAR_HEIGHT_M
    return Draft(
        shape="cylinder",
        description=description,
        tags=tags,
        traits=tuple(tag for tag in tags if tag in _TRAITS),
        mass_kg=round(mass, 4),
        material=material,
        parts=(*visual, *standing(0.0140, *touched)),
        grasps=(grip_across(0.062, touched[-1][0]),),
        regions=(disc("base", r), disc("top", 0.0170, height)),
        parameters={"radius_m": r, "height_m": height, **parameters},
    )


@dataclass(frozen=True, slots=True)
class _Print:
    """Colors of a printed label: the color of letters and lines, and the colors of the pepper pod."""

    ink: Rgb
    pod: Rgb
    disc: Rgb
    stalk: Rgb


def _label(canvas: _Wrap, rng: np.random.Generator, name: str, colors: _Print, *, height: float) -> None:
    """Print the contents of the jar on its label: S for salt, P for pepper, or a pepper pod for paprika."""
    design, up, ink = str(rng.choice(["plain", "bands", "round", "frame"])), canvas.height_on_wall, colors.ink
    middle, across = 0.50 * height, 0.5 * canvas.width
    base = float(np.interp(middle, up[::-1, 0], canvas.y[::-1, 0]))
    reach = np.abs(canvas.x - across)
    if design == "bands":
        canvas.paint((np.abs(up - 0.15 * height) < 0.0016) | (np.abs(up - 0.86 * height) < 0.0016), ink)
    elif design == "frame":
        inside = (reach < 0.36 * canvas.width) & (up > 0.12 * height) & (up < 0.88 * height)
        core = (reach < 0.36 * canvas.width - 0.0016) & (up > 0.12 * height + 0.0016) & (up < 0.88 * height - 0.0016)
        canvas.paint(inside & ~core, ink)
    elif design == "round" and name != "paprika":
        away = np.hypot(canvas.x - across, canvas.y - base)
        canvas.paint((away < 0.0200) & (away > 0.0178), ink)
    if name == "paprika":
        _chili(canvas, (across, base), colors)
    else:
        letter = 0.0215 if design == "round" else 0.0270
        write_word(canvas, name[0].upper(), (across, base), height=letter, ink=ink, weight=0.20)


def _chili(canvas: _Wrap, center: tuple[float, float], colors: _Print) -> None:
    """Draw a pepper pod with its stalk on a round background."""
    x, y = center
    canvas.ellipse(center, (0.0165, 0.0185), colors.disc)
    canvas.ellipse((x - 0.0015, y - 0.0005), (0.0068, 0.0130), colors.pod, 0.35)
    canvas.ellipse((x + 0.0048, y - 0.0040), (0.0042, 0.0105), colors.disc, 0.45)
    canvas.line([(x - 0.0055, y + 0.0105), (x - 0.0020, y + 0.0165)], 0.0034, colors.stalk)


def _pharmacy_label(canvas: _Wrap, rng: np.random.Generator, ink: Rgb, height: float) -> None:
    """Draw a pharmacy label with a big cross, a colored edge, and a capsule in two colors below the cross."""
    up, left = canvas.height_on_wall, canvas.x - 0.5 * canvas.width
    wide, reach, low, high = 0.47 * canvas.width, np.abs(left), 0.0060, height - 0.0070
    canvas.paint((reach < wide) & (up > low) & (up < high), (0.98, 0.98, 0.97))
    canvas.paint((reach < wide) & (up > high - 0.0050) & (up < high), ink)
    center = 0.58 * height - 0.001
    dz = np.abs(up - center)
    canvas.paint((np.maximum(reach, dz) < 0.0125) & (np.minimum(reach, dz) < 0.0044), ink)
    half, thick = rng.uniform(0.0095, 0.0115), 0.0042
    away = np.hypot(np.maximum(reach - (half - thick), 0.0), up - 0.0125)
    canvas.paint(away < thick, (0.96, 0.76, 0.20))
    canvas.paint((away < thick) & (left < 0.0), ink)
