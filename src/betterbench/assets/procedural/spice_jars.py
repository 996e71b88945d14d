"""Spice jars, the same jars with nothing but a label to tell them apart, and a pill bottle of their size."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from betterbench.assets.asset import CollisionPart, Grasp, VisualPart
from betterbench.assets.authoring.draft import JAW_OPENS_ALONG_Y, Draft, disc, part
from betterbench.assets.authoring.lettering import write
from betterbench.assets.authoring.mesh import Mesh, creased, lathe, loft, profile_length
from betterbench.assets.authoring.paint import PALETTE, Canvas, Colour, jittered, mixed, shaded
from betterbench.assets.authoring.registry import generator
from betterbench.assets.authoring.solids import foot, upright_cylinder
from betterbench.geometry import Pose
from betterbench.state import Region

JAR_RADIUS_M = 0.0215
"""Radius of every jar [m]: a 100 ml spice jar has a diameter of 42 to 44 mm. The rack's holes are made for it."""

JAR_HEIGHT_M = 0.085
"""Height of every jar with its cap [m]: such jars are 80 to 95 mm high."""

_MASS_KG = 0.12  # 70 g of glass and cap and 50 g of what is inside
_GRIP_HEIGHT = 0.062  # the pads reach 12 mm below it, and so stay above a hole 35 mm deep
_SIDES = 24
_GLASS: Colour = (0.66, 0.73, 0.73)
_PAPER: Colour = (0.93, 0.91, 0.85)
_NAMES = {"white": "SALT", "black": "PEPPER", "red": "PAPRIKA"}
_CONTENT: dict[str, Colour] = {"white": (0.93, 0.93, 0.92), "black": (0.11, 0.095, 0.085), "red": (0.70, 0.10, 0.03)}
_PRINT: dict[str, Colour] = {"white": (0.97, 0.97, 0.96), "black": (0.06, 0.06, 0.07), "red": (0.80, 0.05, 0.05)}
# Caps in colours that no spice has, so that the word for what is inside never names a cap.
_CAPS: tuple[Colour, ...] = (
    PALETTE["green"],
    PALETTE["blue"],
    (0.58, 0.38, 0.20),
    PALETTE["silver"],
    PALETTE["yellow"],
    PALETTE["purple"],
)


@generator("spice_jar", colours=("white", "black", "red"), family="spice jar")
def spice_jar(rng: np.random.Generator, colour: str) -> Draft:
    """Make a glass spice jar; its colour is that of what is inside: white salt, black pepper, red paprika.

    The glass is drawn rather than transparent, because one transparent part doubles the cost of every picture of
    depth. Within a look the three spices have caps of three different colours.
    """
    shape = _Shape(rng)
    order = rng.permutation(len(_CAPS))
    cap = jittered(_CAPS[int(order[tuple(_NAMES).index(colour)])], rng, amount=0.06)
    fill = rng.uniform(0.050, 0.055)
    content = _CONTENT[colour]
    canvas = shape.canvas(_GLASS)
    up = canvas.height_on_wall
    canvas.paint((up > 0.003) & (up < fill), content)
    canvas.grain(rng, cells=(60, 80), amount=0.10 if colour == "black" else 0.03)
    # The thick foot of the glass, and the gleam of its round sides.
    canvas.paint(up < 0.003, mixed(_GLASS, content, 0.25))
    canvas.paint(np.abs(canvas.x - 0.2 * canvas.width) < 0.0011, (1.0, 1.0, 1.0), strength=0.35)
    canvas.paint(np.abs(canvas.x - 0.85 * canvas.width) < 0.0007, (1.0, 1.0, 1.0), strength=0.25)
    _label(canvas, rng, colour)
    return _jar(
        shape,
        canvas,
        cap,
        description=f"A small glass spice jar of {_NAMES[colour].lower()} with a {colour} label and a screw cap.",
        tags=("spice jar", "jar", "spice", _NAMES[colour].lower(), "glass"),
        specular=0.7,
    )


@generator("plain_jar", colours=("white", "black", "red"), family="spice jar")
def plain_jar(rng: np.random.Generator, colour: str) -> Draft:
    """Make a steel spice jar whose body and cap are the same for every spice: only the label tells them apart."""
    shape = _Shape(rng)
    steel = shaded((0.52, 0.53, 0.55), rng.uniform(0.86, 1.06))
    canvas = shape.canvas(steel)
    canvas.shade(1.0 + 0.10 * np.cos(4.0 * math.pi * canvas.x / canvas.width + rng.uniform(0.0, 6.0)))
    canvas.grain(rng, cells=(3, 90), amount=0.025)
    _label(canvas, rng, colour)
    return _jar(
        shape,
        canvas,
        (0.33, 0.34, 0.36),
        description=f"A plain steel spice jar with a grey cap and a {colour} label that says {_NAMES[colour].lower()}.",
        tags=("spice jar", "jar", "spice", "plain", _NAMES[colour].lower(), "steel"),
        specular=0.6,
    )


@generator("pill_bottle", colours=("white",))
def pill_bottle(rng: np.random.Generator, colour: str) -> Draft:
    """Make a pharmacy bottle with a ribbed child-proof cap, of a spice jar's size.

    Vials of 8 to 13 drams have diameters of 38 to 44 mm; filled they weigh 60 to 120 g. The heavy end is used, so that
    it feels like the jar it is taken for.
    """
    white = PALETTE[colour]
    amber = rng.random() < 0.5
    body = jittered((0.86, 0.42, 0.08) if amber else white, rng, amount=0.05)
    ink = ((0.05, 0.50, 0.24), (0.75, 0.08, 0.10), (0.06, 0.30, 0.62))[int(rng.integers(3))]
    cap_height = rng.uniform(0.0195, 0.0235)
    ribs = int(rng.integers(26, 36))
    shoulder = JAR_HEIGHT_M - cap_height
    profile = [
        (0.0, 0.0),
        (JAR_RADIUS_M - 0.0015, 0.0),
        (JAR_RADIUS_M - 0.0004, 0.002),
        (JAR_RADIUS_M - 0.0004, shoulder - 0.004),
        (0.0190, shoulder),
    ]
    canvas = _Wrap(profile, body)
    if amber:
        # Pills seen through the amber plastic.
        canvas.paint((canvas.height_on_wall > 0.003) & (canvas.height_on_wall < 0.046), shaded(body, 0.80))
        canvas.grain(rng, cells=(14, 24), amount=0.08)
    _pharmacy_label(canvas, rng, ink)
    cap_profile = [
        (0.0165, shoulder - 0.0005),
        (JAR_RADIUS_M, shoulder - 0.0005),
        (JAR_RADIUS_M, JAR_HEIGHT_M - 0.002),
        (JAR_RADIUS_M - 0.0018, JAR_HEIGHT_M),
        (0.0, JAR_HEIGHT_M),
    ]
    cap = _Wrap(cap_profile, shaded(white, 1.1))
    low, high, end = (float(profile_length(cap_profile)[k]) for k in (1, 2, 4))
    edge = (cap.length > low + 0.002) & (cap.length < high - 0.001)
    cap.shade(np.where(edge, 0.88 + 0.12 * np.sign(np.sin(2.0 * math.pi * ribs * cap.x / cap.width)), 1.0))
    cap.shade(np.where(cap.length < low + 0.002, 0.92, 1.0))
    # The arrows of a push-and-turn cap: a ring with gaps.
    arrows = (np.abs(end - cap.length - 0.0115) < 0.0012) & (np.cos(6.0 * math.pi * cap.x / cap.width) > -0.4)
    cap.paint(arrows, (0.55, 0.56, 0.58))
    collision = _solid()
    return Draft(
        shape="cylinder",
        description=f"A pharmacy pill bottle with a {colour} ribbed child-proof cap and a printed label.",
        tags=("pill bottle", "pills", "medicine", "pharmacy", "bottle"),
        mass_kg=_MASS_KG,
        parts=(
            part("body", canvas.mesh(), canvas, specular=0.4, shininess=0.5),
            part("cap", cap.mesh(), cap, specular=0.2),
            *collision,
        ),
        grasps=_grasps(),
        regions=_regions(),
        parameters={"radius_m": JAR_RADIUS_M, "height_m": JAR_HEIGHT_M, "amber": str(amber), "ribs": float(ribs)},
    )


class _Wrap(Canvas):
    """A picture that goes once around each half of a turned body, so that its print reads rightly on both.

    Attributes:
        width: Half the circumference [m].
        length: (height, width) distance along the profile of each sample [m].
        height_on_wall: (height, width) height of each sample above the foot [m], as far as the wall is upright.
    """

    def __init__(
        self, profile: Sequence[tuple[float, float]], colour: Colour, *, pixels: tuple[int, int] = (160, 192)
    ) -> None:
        """Start a picture for the body turned from ``profile`` (radius, z) [m]."""
        self._profile = tuple(profile)
        self.width = math.pi * max(r for r, _ in profile)
        along = profile_length(profile)
        super().__init__(self.width, float(along[-1]), pixels, colour)
        self.length = self.y
        self.height_on_wall = np.interp(self.y, along, [z for _, z in profile])

    def mesh(self) -> Mesh:
        """Return the creased mesh; each half begins with a seam, the first at -y: +x is in the middle of one."""
        half = _SIDES // 2
        turn = np.concatenate([np.arange(half + 1), half + np.arange(half + 1)]) * (math.pi / half) - 0.5 * math.pi
        u = np.tile(np.arange(half + 1) / half, 2)
        along = profile_length(self._profile)
        rings = [
            np.stack([r * np.cos(turn), r * np.sin(turn), np.full(len(turn), z)], axis=1) for r, z in self._profile
        ]
        return creased(loft(rings, u=u, v=along / along[-1], caps=(False, False)), 40.0)


class _Shape:
    """The profile that the looks of a jar share: one radius, one height, another neck and cap."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.cap_height = rng.uniform(0.0185, 0.0235)
        self.cap_radius = rng.uniform(0.0196, 0.0208)
        self.shoulder = rng.uniform(0.0030, 0.0055)
        self.dome = float(rng.choice([0.0010, 0.0010, 0.0030]))
        neck = JAR_HEIGHT_M - self.cap_height
        self.profile = (
            (0.0, 0.0),
            (JAR_RADIUS_M - 0.0018, 0.0),
            (JAR_RADIUS_M, 0.0025),
            (JAR_RADIUS_M, neck - self.shoulder),
            (0.0180, neck + 0.0005),
        )

    def canvas(self, colour: Colour) -> _Wrap:
        """Return the picture of the jar below its cap."""
        return _Wrap(self.profile, colour)

    def cap(self) -> Mesh:
        """Return the mesh of the cap."""
        low, r = JAR_HEIGHT_M - self.cap_height, self.cap_radius
        profile = [
            (0.0160, low),
            (r, low),
            (r, JAR_HEIGHT_M - 0.0014 - self.dome),
            (r - 0.0014, JAR_HEIGHT_M - self.dome),
            (0.0, JAR_HEIGHT_M),
        ]
        return lathe(profile, _SIDES, wrap=True)


def _jar(
    shape: _Shape, canvas: _Wrap, cap: Colour, *, description: str, tags: tuple[str, ...], specular: float
) -> Draft:
    """Put a jar together."""
    collision = _solid()
    return Draft(
        shape="cylinder",
        description=description,
        tags=tags,
        mass_kg=_MASS_KG,
        parts=(part("body", canvas.mesh(), canvas, specular=specular, shininess=0.7), _cap(shape, cap), *collision),
        grasps=_grasps(),
        regions=_regions(),
        parameters={"radius_m": JAR_RADIUS_M, "height_m": JAR_HEIGHT_M, "cap_height_m": shape.cap_height},
    )


def _cap(shape: _Shape, colour: Colour) -> VisualPart:
    """Return the cap with its knurled edge."""
    reach = shape.cap_radius - 0.0160 + shape.cap_height + shape.cap_radius
    canvas = Canvas(math.pi * shape.cap_radius, reach, (128, 128), colour)
    skirt = (canvas.y > shape.cap_radius - 0.0160 + 0.002) & (
        canvas.y < shape.cap_radius - 0.0160 + shape.cap_height - 0.003
    )
    canvas.shade(np.where(skirt, 0.90 + 0.10 * np.cos(2.0 * math.pi * 22.0 * canvas.x / (math.pi * 0.02)), 1.0))
    canvas.shade(np.where(canvas.y > reach - 0.62 * shape.cap_radius, 0.93, 1.0))
    return part("cap", shape.cap(), canvas, specular=0.35, shininess=0.5)


def _label(canvas: _Wrap, rng: np.random.Generator, colour: str) -> None:
    """Glue the label on: paper, a big band in the spice's colour, its name on the band."""
    up, x, width = canvas.height_on_wall, canvas.x, canvas.width
    design = str(rng.choice(["band", "frame", "round", "full"]))
    low, high = 0.0095, 0.0500
    reach = np.abs(x - 0.5 * width)
    print_colour = _PRINT[colour]
    ink: Colour = (0.10, 0.11, 0.13) if colour == "white" else (0.96, 0.95, 0.92)
    # White print needs a darker paper around it, the others a light one.
    paper = (0.62, 0.53, 0.38) if colour == "white" else _PAPER
    wide = 0.45 * width
    on_label = (reach < wide) & (up > low) & (up < high)
    canvas.paint(on_label, paper)
    middle = 0.0320
    if design == "band":
        field = on_label & (np.abs(up - middle) < 0.0125)
    elif design == "frame":
        field = on_label & (reach < wide - 0.0022) & (up > low + 0.0022) & (up < high - 0.0022)
    elif design == "round":
        field = on_label & ((reach / (wide - 0.001)) ** 4 + ((up - middle) / 0.0150) ** 4 < 1.0)
    else:
        field = on_label & (up > low + 0.0075)
    canvas.paint(field, print_colour)
    name = _NAMES[colour]
    size = min(0.0098, 0.80 * wide / (0.45 * len(name)))
    base = float(np.interp(middle, canvas.height_on_wall[::-1, 0], canvas.length[::-1, 0]))
    write(canvas, name, (0.5 * width, base), height=size, ink=ink, weight=0.20)
    for offset in (0.0080, -0.0080):
        canvas.paint(field & (np.abs(up - middle - offset) < 0.0006) & (reach < 0.6 * wide), ink)


def _pharmacy_label(canvas: _Wrap, rng: np.random.Generator, ink: Colour) -> None:
    """Glue on the label of a pharmacy: a cross in a coloured head and lines of small print."""
    up, x, width = canvas.height_on_wall, canvas.x, canvas.width
    reach = np.abs(x - 0.5 * width)
    wide = 0.43 * width
    low, high = 0.0080, 0.0520
    canvas.paint((reach < wide) & (up > low) & (up < high), (0.97, 0.97, 0.96))
    head = 0.0350
    left = x - 0.5 * width
    canvas.paint((reach < wide) & (up > head + 0.0135) & (up < high), ink)
    centre = head + 0.0025
    cross = (np.maximum(np.abs(left + 0.0125), np.abs(up - centre)) < 0.0078) & (
        np.minimum(np.abs(left + 0.0125), np.abs(up - centre)) < 0.0027
    )
    canvas.paint(cross, ink)
    grey = (0.25, 0.26, 0.30)
    for row in range(3):
        end = rng.uniform(0.55, 0.9) * wide
        canvas.paint((left > -0.0015) & (left < end) & (np.abs(up - centre - 0.005 + 0.005 * row) < 0.0010), grey)
    for row in range(4):
        end = rng.uniform(0.5, 0.92) * wide
        start = -0.88 * wide
        canvas.paint((left > start) & (left < end) & (np.abs(up - 0.0255 + 0.0045 * row) < 0.0008), grey)


def _solid() -> tuple[CollisionPart, ...]:
    """Return the collision shapes of every jar: one cylinder on a square foot."""
    return (foot(0.0140), upright_cylinder(JAR_RADIUS_M, 0.0005, JAR_HEIGHT_M))


def _grasps() -> tuple[Grasp, ...]:
    """Return the one way to take a jar."""
    pose = Pose((0.0, 0.0, _GRIP_HEIGHT), JAW_OPENS_ALONG_Y)
    return (Grasp("body", pose, 2.0 * JAR_RADIUS_M, symmetric_yaw=True),)


def _regions() -> tuple[Region, ...]:
    """Return the named places of every jar."""
    return (
        disc("base", JAR_RADIUS_M),
        disc("top", 0.0195, JAR_HEIGHT_M),
    )
