"""Dinner plates of three sizes that stack on their feet, and a shallow bowl of a plate's size."""

import math

import numpy as np

from betterbench.assets.asset import CollisionPart, Grasp
from betterbench.assets.authoring import Draft, Turned, disc, generator, part, round_wall, upright_cylinder
from betterbench.assets.authoring.draft import JAW_OPENS_ALONG_X
from betterbench.assets.authoring.paint import PALETTE, Canvas, Rgb, jittered, mixed, shaded
from betterbench.geometry import Pose, from_yaw, multiply

FOOT_HEIGHT_M = 0.012
"""Height of a plate's foot [m]: holds the rim of the inner plate above that of the outer one."""

FLOOR_M = 0.016
"""Height of the floor on which the next plate stands [m]."""

RIM_M = 0.036
"""Height of the rim [m]: 20 mm of upright lip were measured to be held without slipping, 15 mm were not."""

_LIP = 0.004
_GRIP_BELOW_RIM = 0.006  # the pads then reach 18 mm down the lip and end 2 mm above the floor
_COLORS = ("white", "red", "blue", "green", "yellow")
_MEDIUM_RADIUS = 0.074


@generator("plate_large", colors=_COLORS, family="plate")
def plate_large(rng: np.random.Generator, color: str) -> Draft:
    """Make the plate at the bottom of a stack: 176 mm across, 0.30 kg.

    Dessert plates of stoneware have diameters of 170 to 210 mm and weigh 0.3 to 0.4 kg. This one is only stood on.
    """
    return _plate(rng, color, "large", radius=0.088, mass_kg=0.30)


@generator("plate_medium", colors=("red", "white", "blue", "green", "yellow"), family="plate")
def plate_medium(rng: np.random.Generator, color: str) -> Draft:
    """Make the plate in the middle of a stack: 148 mm across, 0.15 kg.

    Melamine side plates (1.5 g/cm^3, 3 to 4 mm thick) of 150 mm weigh 0.10 to 0.16 kg. Held at its rim, a plate of
    this size tilts by 3 degrees with 0.15 kg and by more than 20 with 0.25 kg.
    """
    return _plate(rng, color, "medium", radius=_MEDIUM_RADIUS, mass_kg=0.15)


@generator("plate_small", colors=("blue", "white", "red", "green", "yellow"), family="plate")
def plate_small(rng: np.random.Generator, color: str) -> Draft:
    """Make the plate on top of a stack: 120 mm across, 0.12 kg, a melamine saucer with a lip."""
    return _plate(rng, color, "small", radius=0.060, mass_kg=0.12)


def _plate(rng: np.random.Generator, color: str, size: str, *, radius: float, mass_kg: float) -> Draft:
    """Make a plate: a foot, a flat floor, an upright lip."""
    glaze, r, foot = _Glaze(rng, color), radius, 0.55 * radius
    edge, low = RIM_M - 0.0012, FOOT_HEIGHT_M
    outside = (0.0, foot, foot + 0.0015, r - 0.0030, r, r, r - 0.5 * _LIP)
    z = (0.0, 0.0, low, low + 0.0008, low + 0.0045, edge, RIM_M, edge, FLOOR_M + 0.0004, FLOOR_M)
    plate = Turned((*outside, r - _LIP, r - _LIP - 0.0022, 0.0), z, sides=28)
    picture = glaze.draw(plate, wall=4, rim=5, inner=7, floor=8)
    return Draft(
        shape="round",
        description=f"A {size} round {color} plate with an upright lip.",
        tags=("plate", f"{size} plate", "dinner plate", "tableware", "crockery"),
        mass_kg=mass_kg,
        # The foot is a ring and the floor thin: the foot weighs a third of the solid that stands for it.
        densities=(0.33, *(1.0,) * 9),
        parts=(
            part("plate", plate.mesh(), picture, specular=0.5, shininess=0.6),
            upright_cylinder(foot, 0.0, low),
            upright_cylinder(r - 0.001, low, FLOOR_M),
            *_lip(r, low + 0.002, RIM_M),
        ),
        grasps=_rim_grasps(r, RIM_M),
        regions=(disc("base", foot), disc("floor", r - _LIP, FLOOR_M), disc("rim", r, RIM_M)),
        parameters={"radius_m": r, "foot_radius_m": foot, "design": glaze.design},
    )


@generator("shallow_bowl", colors=("red", "white", "blue"), family="plate")
def shallow_bowl(rng: np.random.Generator, color: str) -> Draft:
    """Make a shallow bowl of the medium plate's diameter: from above a plate, from the side clearly none.

    A melamine bowl of 150 mm weighs 0.12 to 0.2 kg. The collision shape is the upright upper wall, a disc under the
    hollow and the foot, so that a plate that is wrongly stood in the bowl rests on its floor.
    """
    glaze = _Glaze(rng, color)
    r, rim, floor, foot = _MEDIUM_RADIUS, 0.045, 0.0125, 0.034
    outside = (0.0, foot, foot + 0.001, 0.052, 0.0665, 0.0728, r, r - 0.5 * _LIP)
    rising, falling = (0.0, 0.0, 0.0045, 0.0090, 0.0185, 0.0300, rim - 0.0012), (0.0300, 0.0185, floor + 0.0006, floor)
    radii = (*outside, r - _LIP, 0.0680, 0.0600, 0.0430, 0.0)
    bowl = Turned(radii, (*rising, rim, rim - 0.0012, *falling), crease_degrees=44.0)
    return Draft(
        shape="round",
        description=f"A shallow {color} bowl with a curved wall.",
        tags=("bowl", "shallow bowl", "soup bowl", "tableware", "crockery"),
        mass_kg=0.17,
        densities=(0.33, *(1.0,) * 9),
        parts=(
            part("bowl", bowl.mesh(), glaze.draw(bowl, wall=3, rim=6, inner=8, floor=11), specular=0.5, shininess=0.6),
            upright_cylinder(foot, 0.0, 0.0075),
            upright_cylinder(0.060, 0.0075, floor),
            *_lip(r, 0.0140, rim),
        ),
        grasps=_rim_grasps(r, rim),
        regions=(disc("base", foot), disc("floor", 0.045, floor), disc("rim", r, rim)),
        parameters={"radius_m": r, "foot_radius_m": foot, "height_m": rim, "design": glaze.design},
    )


def _lip(radius: float, low: float, high: float) -> list[CollisionPart]:
    """Return eight upright boxes tangential to the rim, where the grasps take it; they stand out by 1.5 mm at most."""
    return round_wall(radius, _LIP, low, high, half_length=math.sqrt((radius + 0.0015) ** 2 - radius**2))


def _rim_grasps(radius: float, rim: float) -> tuple[Grasp, ...]:
    """Return the ways to pinch the lip from above, every 45 degrees, the fingers opening along the radius.

    They share the name "rim", so that a search by name gives the one at +x and a planner can choose among all.
    """
    away, height = radius - 0.5 * _LIP, rim - _GRIP_BELOW_RIM
    angles = [k * math.pi / 4.0 for k in range(8)]
    places = [(away * math.cos(a), away * math.sin(a), height) for a in angles]
    turns = [multiply(from_yaw(a), JAW_OPENS_ALONG_X) for a in angles]
    return tuple(Grasp("rim", Pose(place, turn), _LIP) for place, turn in zip(places, turns, strict=True))


class _Glaze:
    """The glaze of a set of tableware: one look gives one design to every piece of it."""

    def __init__(self, rng: np.random.Generator, color: str) -> None:
        self.color: Rgb = jittered(PALETTE[color], rng, amount=0.07)
        self.design = str(rng.choice(["plain", "line", "ring", "two lines", "speckled"]))
        # The line on white ware is gray, sand or a pale blue.
        tints = ((0.62, 0.63, 0.65), (0.74, 0.66, 0.52), (0.58, 0.66, 0.76))
        white = color == "white"
        self._light = tints[int(rng.integers(3))] if white else shaded(self.color, rng.uniform(1.5, 1.9))
        self._rng = rng

    def draw(self, piece: Turned, *, wall: int, rim: int, inner: int, floor: int) -> Canvas:
        """Draw a piece from the foot over the rim to the middle of the floor.

        Given are the numbers of the points of its profile where the wall, the rim, the inside of the lip and the floor
        begin.
        """
        foot, crest, lip, well = (piece.rows[k] for k in (wall, rim, inner, floor))
        canvas = piece.canvas(self.color, (64, 256), width=1.0)
        y, end = canvas.y, canvas.height
        if self.design == "speckled":
            ink = mixed(self.color, self._light, 0.75)
            canvas.spots(self._rng, 90, ink, radius=(0.0006, 0.0013), rows=(0.0, end), stretch=6.0)
        # The floor catches more light in its middle; a turned ring shows where the foot is.
        away = (end - y) / (end - well)
        canvas.paint(y > well, shaded(self.color, 1.14), strength=0.8)
        canvas.shade(np.where(y > well, 1.0 - 0.10 * np.clip(away - 0.55, 0.0, 1.0) / 0.45, 1.0))
        canvas.shade(np.where(np.abs(away - 0.62) < 0.012, 0.86, 1.0))
        rings = {"ring": ((0.78, 0.035),), "two lines": ((0.84, 0.016), (0.92, 0.016))}
        for place, width in rings.get(self.design, ()):
            canvas.paint(np.abs(away - place) < width, self._light)
        # The inside of the lip lies in its own shadow, deepest where it meets the floor.
        down = np.clip((y - lip) / (well - lip), 0.0, 1.0)
        canvas.shade(np.where((y > lip) & (y <= well), 0.92 - 0.20 * down, 1.0))
        # Glaze runs thin over the rim, and there is none under the foot.
        canvas.paint(canvas.between(crest - 0.0004, lip + 0.0006), self._light)
        if self.design == "line":
            canvas.paint(canvas.between(crest - 0.0045, crest), self._light)
        canvas.shade(np.where(y < foot, 0.78, 1.0))
        return canvas
