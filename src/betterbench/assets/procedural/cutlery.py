"""Table cutlery with chunky handles that a parallel jaw can take from the table."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from betterbench.assets.asset import CollisionPart, VisualPart
from betterbench.assets.authoring.draft import Draft, grip, part, zone
from betterbench.assets.authoring.mesh import Mesh, creased, loft, merge, prism
from betterbench.assets.authoring.paint import Canvas, Colour, jittered, shaded
from betterbench.assets.authoring.registry import generator
from betterbench.assets.authoring.solids import solid_box
from betterbench.state import Region

_HALF = 0.080  # half the length of a piece [m]
_HANDLE = 0.085  # length of the handle [m]; it ends at +x
_WIDTH = 0.014
_THICKNESS = 0.013
_GRIP_HEIGHT = 0.0105
_MASS_KG = 0.05

_METAL: dict[str, Colour] = {"silver": (0.72, 0.73, 0.76), "yellow": (0.83, 0.62, 0.22)}
_HANDLES: tuple[Colour, ...] = ((0.10, 0.10, 0.11), (0.40, 0.21, 0.09), (0.58, 0.36, 0.17), (0.20, 0.12, 0.09))

# One station of a rod: x, half width, bottom, top [m].
_Station = tuple[float, float, float, float]


@generator("fork", colours=("silver", "yellow"))
def fork(rng: np.random.Generator, colour: str) -> Draft:
    """Make a table fork that lies along x, its four tines at -x.

    A dessert fork is 0.16 m long and weighs 40 to 60 g with a moulded handle. The handle is thicker than that of plain
    steel cutlery: a jaw reaches 12 mm below its centre, so it cannot take anything lower than 10 mm from a table.
    """
    half_width = rng.uniform(0.0150, 0.0170)
    tines = rng.uniform(0.034, 0.040)
    root = -_HALF + tines
    tine = rng.uniform(0.0019, 0.0022)  # half the width of a tine
    metal = jittered(_METAL[colour], rng, amount=0.04)

    pitch = 2.0 * (half_width - tine) / 3.0
    shoulder = min(root + 0.014, -0.030)
    palm = _rod(
        [
            (root - 0.002, half_width, 0.0004, 0.0042),
            (root + 0.004, half_width, 0.0, 0.0042),
            (shoulder, 0.42 * half_width, 0.0003, 0.0046),
            (shoulder + 0.008, 0.0036, 0.0020, 0.0064),
            (-0.002, 0.0034, 0.0042, 0.0088),
        ],
        chamfer=0.0012,
    )
    prongs = [
        prism(
            [
                _section(x, tine * narrow, low, high, y=y)
                for x, narrow, low, high in (
                    (-_HALF, 0.45, 0.0030, 0.0046),
                    (-_HALF + 0.40 * tines, 0.95, 0.0006, 0.0036),
                    (root, 1.0, 0.0004, 0.0040),
                )
            ],
            crease_degrees=40.0,
        )
        for y in (-1.5 * pitch, -0.5 * pitch, 0.5 * pitch, 1.5 * pitch)
    ]
    head = part("head", merge([palm, *prongs]), metal, specular=0.9, shininess=0.8)
    return _draft(
        rng,
        "fork",
        colour,
        metal,
        head,
        reach=half_width,
        head_end=shoulder,
        parameters={"head_width_m": 2 * half_width, "tine_length_m": tines},
    )


@generator("spoon", colours=("silver", "yellow"))
def spoon(rng: np.random.Generator, colour: str) -> Draft:
    """Make a table spoon that lies along x, its bowl at -x.

    A dessert spoon is 0.16 m long and weighs 40 to 60 g with a moulded handle; its handle is that of the fork.
    """
    half_width = rng.uniform(0.0160, 0.0175)
    half_length = rng.uniform(0.0250, 0.0280)
    depth = rng.uniform(0.0085, 0.0105)
    metal = jittered(_METAL[colour], rng, amount=0.04)
    centre = -_HALF + half_length
    angle = 2.0 * math.pi * np.arange(18) / 18
    # Egg-shaped: blunt towards the tip, pointed towards the neck.
    x = np.cos(angle)
    y = np.sin(angle) * (1.0 - 0.16 * x)

    def ring(share: float, z: float, inset: float = 0.0) -> np.ndarray:
        scale_x, scale_y = share * half_length - inset, share * half_width - inset
        return np.stack([centre + scale_x * x, scale_y * y, np.full(18, z)], axis=1)

    rings = [
        ring(0.45, 0.0),
        ring(0.76, 0.18 * depth),
        ring(0.95, 0.62 * depth),
        ring(1.0, depth),
        ring(1.0, depth + 0.0004, 0.0012),
        ring(0.93, 0.66 * depth + 0.0010, 0.0012),
        ring(0.72, 0.24 * depth + 0.0012, 0.0010),
        ring(0.38, 0.0018),
    ]
    rows = (0.0, 0.15, 0.32, 0.48, 0.54, 0.66, 0.82, 0.95)
    bowl = creased(loft(rings, v=rows), 60.0)
    canvas = Canvas(1.0, 1.0, (8, 64), metal)
    canvas.shade(np.where(canvas.y > 0.56, 0.62 + 0.30 * np.clip((canvas.y - 0.56) / 0.40, 0.0, 1.0), 1.0))
    canvas.paint((canvas.y > 0.46) & (canvas.y < 0.56), shaded(metal, 1.4))
    end = centre + half_length
    neck = _rod(
        [
            (end - 0.004, 0.0046, depth - 0.0036, depth - 0.0002),
            (end + 0.006, 0.0036, 0.0046, 0.0090),
            (-0.002, 0.0034, 0.0042, 0.0088),
        ],
        chamfer=0.0012,
    )
    head = part("bowl", bowl, canvas, specular=0.8, shininess=0.8)
    return _draft(
        rng,
        "spoon",
        colour,
        metal,
        head,
        part("neck", neck, metal, specular=0.9, shininess=0.8),
        reach=0.55 * half_width,
        head_end=centre + 0.45 * half_length,
        parameters={"bowl_width_m": 2 * half_width, "bowl_length_m": 2 * half_length},
        rim=CollisionPart(
            "ellipsoid", (half_length, half_width, 0.45 * depth), (centre, 0.0, 0.56 * depth), (1.0, 0.0, 0.0, 0.0)
        ),
    )


def _draft(
    rng: np.random.Generator,
    name: str,
    colour: str,
    metal: Colour,
    *head: VisualPart,
    reach: float,
    head_end: float,
    parameters: dict[str, float | str],
    rim: CollisionPart | None = None,
) -> Draft:
    """Put a head on a handle.

    Args:
        rng: Source of the handle.
        name: Category.
        colour: Colour word.
        metal: Colour of the metal.
        *head: Visual parts of head and neck.
        reach: Half the width on which the head stands [m].
        head_end: The x at which the head leaves the table [m].
        parameters: The numbers of the head.
        rim: What the head has above its standing surface, if that is wider.

    Returns:
        The draft.
    """
    plastic = jittered(_HANDLES[int(rng.integers(len(_HANDLES)))], rng, amount=0.12)
    rivets = rng.random() < 0.6
    swell = rng.uniform(0.0, 0.0012)  # how much the handle narrows towards the head
    start = _HALF - _HANDLE
    w, t = 0.5 * _WIDTH, _THICKNESS
    handle = _rod(
        [
            (start, w - swell - 0.0015, 0.0016, t - 0.0022),
            (start + 0.003, w - swell, 0.0, t - 0.0006),
            (start + 0.022, w, 0.0, t),
            (_HALF - 0.006, w, 0.0, t),
            (_HALF - 0.0015, w - 0.0016, 0.0, t - 0.0018),
            (_HALF, w - 0.0040, 0.0022, t - 0.0045),
        ],
        chamfer=0.0032,
    )
    collar = _rod(
        [
            (start - 0.005, 0.0042, 0.0030, 0.0096),
            (start - 0.003, 0.0056, 0.0018, 0.0108),
            (start + 0.002, 0.0056, 0.0018, 0.0108),
        ],
        chamfer=0.0020,
    )
    parts = [
        *head,
        part("handle", handle, plastic, specular=0.35, shininess=0.4),
        part("collar", collar, shaded(metal, 0.92), specular=0.9, shininess=0.8),
    ]
    if rivets:
        angle = 2.0 * math.pi * np.arange(8) / 8
        dots = []
        for x in (start + 0.026, _HALF - 0.022):
            outline = np.stack([x + 0.0024 * np.cos(angle), 0.0024 * np.sin(angle), np.full(8, t - 0.001)], axis=1)
            dots.append(prism([outline, outline + np.array([0.0, 0.0, 0.0013])]))
        parts.append(part("rivets", merge(dots), metal, specular=0.9, shininess=0.8))
    grasped = solid_box((start, -w, 0.0), (_HALF, w, t))
    collision = [
        grasped,
        solid_box((head_end, -0.0035, 0.002), (start, 0.0035, 0.0085)),
        solid_box((-_HALF + (0.004 if rim is None else 0.014), -reach, 0.0), (head_end, reach, 0.0042)),
    ]
    if rim is not None:
        collision.append(rim)
    return Draft(
        shape="irregular",
        description=f"A {colour} {name} with a moulded handle.",
        tags=(name, "cutlery", "flatware", "tableware"),
        mass_kg=_MASS_KG,
        densities=(1.0, 3.0, 2.5),
        parts=(*parts, *collision),
        grasps=(grip("handle", _GRIP_HEIGHT, _WIDTH, x=_HALF - 0.5 * _HANDLE),),
        regions=(
            zone("base", _HALF, reach),
            Region("handle", (_HALF - 0.5 * _HANDLE, 0.0, 0.5 * t), (0.5 * _HANDLE, w, 0.5 * t)),
        ),
        parameters={**parameters, "rivets": str(rivets)},
    )


def _section(
    x: float, half_width: float, low: float, high: float, *, y: float = 0.0, chamfer: float = 0.0
) -> np.ndarray:
    """Return the points of an upright rectangle across x, counter-clockwise seen from +x, its corners cut."""
    c = min(chamfer, 0.6 * half_width, 0.35 * (high - low))
    if c <= 0.0:
        corners = [(half_width, low), (half_width, high), (-half_width, high), (-half_width, low)]
    else:
        w = half_width
        corners = [
            (w, low + c),
            (w, high - c),
            (w - c, high),
            (-w + c, high),
            (-w, high - c),
            (-w, low + c),
            (-w + c, low),
            (w - c, low),
        ]
    return np.array([(x, y + a, b) for a, b in corners])


def _rod(stations: Sequence[_Station], *, chamfer: float) -> Mesh:
    """Return the closed loft of sections along x."""
    return prism([_section(*station, chamfer=chamfer) for station in stations], crease_degrees=32.0)
