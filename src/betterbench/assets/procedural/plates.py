"""Dinner plates of three sizes that stack on their feet, and a shallow bowl of a plate's size."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from betterbench.assets.asset import CollisionPart, Grasp
from betterbench.assets.authoring.draft import JAW_OPENS_ALONG_X, Draft, disc, part
from betterbench.assets.authoring.mesh import lathe, profile_length
from betterbench.assets.authoring.paint import PALETTE, Canvas, Colour, jittered, mixed, shaded
from betterbench.assets.authoring.registry import generator
from betterbench.assets.authoring.solids import upright_cylinder
from betterbench.geometry import Pose, from_yaw, multiply

FOOT_HEIGHT_M = 0.012
"""Height of a plate's foot [m]: holds the rim of the inner plate above that of the outer one."""

FLOOR_M = 0.016
"""Height of the floor on which the next plate stands [m]."""

RIM_M = 0.036
"""Height of the rim [m]: 20 mm of upright lip were measured to be held without slipping, 15 mm were not."""

_LIP = 0.004
_SIDES = 28
_GRIP_BELOW_RIM = 0.006  # the pads then reach 18 mm down the lip and end 2 mm above the floor
_COLOURS = ("white", "red", "blue", "green", "yellow")


@dataclass(frozen=True, slots=True)
class _Size:
    """Radius of the rim [m] and mass [kg]."""

    radius: float
    mass: float

    @property
    def foot(self) -> float:
        """Radius of the foot [m]."""
        return 0.55 * self.radius


_LARGE, _MEDIUM, _SMALL = _Size(0.088, 0.30), _Size(0.074, 0.15), _Size(0.060, 0.12)


@generator("plate_large", colours=_COLOURS, family="plate")
def plate_large(rng: np.random.Generator, colour: str) -> Draft:
    """Make the plate at the bottom of a stack: 176 mm across, 0.30 kg.

    Dessert plates of stoneware have diameters of 170 to 210 mm and weigh 0.3 to 0.4 kg. This one is only stood on.
    """
    return _plate(rng, colour, _LARGE, size_word="large")


@generator("plate_medium", colours=("red", "white", "blue", "green", "yellow"), family="plate")
def plate_medium(rng: np.random.Generator, colour: str) -> Draft:
    """Make the plate in the middle of a stack: 148 mm across, 0.15 kg.

    Melamine side plates (1.5 g/cm^3, 3 to 4 mm thick) of 150 mm weigh 0.10 to 0.16 kg. Held at its rim, a plate of
    this size tilts by 3 degrees with 0.15 kg and by more than 20 with 0.25 kg.
    """
    return _plate(rng, colour, _MEDIUM, size_word="medium")


@generator("plate_small", colours=("blue", "white", "red", "green", "yellow"), family="plate")
def plate_small(rng: np.random.Generator, colour: str) -> Draft:
    """Make the plate on top of a stack: 120 mm across, 0.12 kg, a melamine saucer with a lip."""
    return _plate(rng, colour, _SMALL, size_word="small")


def _plate(rng: np.random.Generator, colour: str, size: _Size, *, size_word: str) -> Draft:
    """Make a plate: a foot, a flat floor, an upright lip."""
    glaze = _Glaze(rng, colour)
    r = size.radius
    profile = [
        (0.0, 0.0),
        (size.foot, 0.0),
        (size.foot + 0.0015, FOOT_HEIGHT_M),
        (r - 0.0030, FOOT_HEIGHT_M + 0.0008),
        (r, FOOT_HEIGHT_M + 0.0045),
        (r, RIM_M - 0.0012),
        (r - 0.5 * _LIP, RIM_M),
        (r - _LIP, RIM_M - 0.0012),
        (r - _LIP - 0.0022, FLOOR_M + 0.0004),
        (0.0, FLOOR_M),
    ]
    collision = (
        upright_cylinder(size.foot, 0.0, FOOT_HEIGHT_M),
        upright_cylinder(r - 0.001, FOOT_HEIGHT_M, FLOOR_M),
        *_lip(r, FOOT_HEIGHT_M + 0.002, RIM_M),
    )
    return Draft(
        shape="round",
        description=f"A {size_word} round {colour} plate with an upright lip.",
        tags=("plate", f"{size_word} plate", "dinner plate", "tableware", "crockery"),
        mass_kg=size.mass,
        densities=(0.33, *(1.0,) * 9),
        parts=(
            part("plate", lathe(profile, _SIDES, wrap=True), glaze.plate(profile), specular=0.5, shininess=0.6),
            *collision,
        ),
        grasps=_rim_grasps(r, RIM_M),
        regions=(
            disc("base", size.foot),
            disc("floor", r - _LIP, FLOOR_M),
            disc("rim", r, RIM_M),
        ),
        parameters={"radius_m": r, "foot_radius_m": size.foot, "design": glaze.design},
    )


@generator("shallow_bowl", colours=("red", "white", "blue"), family="plate")
def shallow_bowl(rng: np.random.Generator, colour: str) -> Draft:
    """Make a shallow bowl of the medium plate's diameter: from above a plate, from the side clearly none.

    A melamine bowl of 150 mm weighs 0.12 to 0.2 kg. The collision shape is the upright upper wall, a disc under the
    hollow and the foot, so that a plate that is wrongly stood in the bowl rests on its floor.
    """
    glaze = _Glaze(rng, colour)
    r, rim, floor, foot = _MEDIUM.radius, 0.045, 0.0125, 0.034
    profile = [
        (0.0, 0.0),
        (foot, 0.0),
        (foot + 0.001, 0.0045),
        (0.052, 0.0090),
        (0.0665, 0.0185),
        (0.0728, 0.0300),
        (r, rim - 0.0012),
        (r - 0.5 * _LIP, rim),
        (r - _LIP, rim - 0.0012),
        (0.0680, 0.0300),
        (0.0600, 0.0185),
        (0.0430, floor + 0.0006),
        (0.0, floor),
    ]
    collision = (
        upright_cylinder(foot, 0.0, 0.0075),
        upright_cylinder(0.060, 0.0075, floor),
        *_lip(r, 0.0140, rim),
    )
    return Draft(
        shape="round",
        description=f"A shallow {colour} bowl with a curved wall.",
        tags=("bowl", "shallow bowl", "soup bowl", "tableware", "crockery"),
        mass_kg=0.17,
        densities=(0.33, *(1.0,) * 9),
        parts=(
            part(
                "bowl",
                lathe(profile, 24, wrap=True, crease_degrees=44.0),
                glaze.bowl(profile),
                specular=0.5,
                shininess=0.6,
            ),
            *collision,
        ),
        grasps=_rim_grasps(r, rim),
        regions=(
            disc("base", foot),
            disc("floor", 0.045, floor),
            disc("rim", r, rim),
        ),
        parameters={"radius_m": r, "foot_radius_m": foot, "height_m": rim, "design": glaze.design},
    )


def _lip(radius: float, low: float, high: float) -> list[CollisionPart]:
    """Return eight upright boxes tangential to the rim, where the grasps take it; they stand out by 1.5 mm at most."""
    half_length = math.sqrt((radius + 0.0015) ** 2 - radius**2)
    away, half_height = radius - 0.5 * _LIP, 0.5 * (high - low)
    return [
        CollisionPart(
            "box",
            (0.5 * _LIP, half_length, half_height),
            (away * math.cos(angle), away * math.sin(angle), low + half_height),
            from_yaw(angle),
        )
        for angle in (k * math.pi / 4.0 for k in range(8))
    ]


def _rim_grasps(radius: float, rim: float) -> tuple[Grasp, ...]:
    """Return the ways to pinch the lip from above, every 45 degrees, the fingers opening along the radius.

    They share the name "rim", so that a search by name gives the one at +x and a planner can choose among all.
    """
    away, height = radius - 0.5 * _LIP, rim - _GRIP_BELOW_RIM
    return tuple(
        Grasp(
            "rim",
            Pose(
                (away * math.cos(angle), away * math.sin(angle), height), multiply(from_yaw(angle), JAW_OPENS_ALONG_X)
            ),
            _LIP,
        )
        for angle in (k * math.pi / 4.0 for k in range(8))
    )


class _Glaze:
    """The glaze of a set of tableware: one look gives one design to every piece of it."""

    def __init__(self, rng: np.random.Generator, colour: str) -> None:
        self.colour: Colour = jittered(PALETTE[colour], rng, amount=0.07)
        self.design = str(rng.choice(["plain", "line", "ring", "two lines", "speckled"]))
        self._light = shaded(self.colour, rng.uniform(1.5, 1.9)) if colour != "white" else self._tint(rng)
        self._rng = rng

    @staticmethod
    def _tint(rng: np.random.Generator) -> Colour:
        """Return the line on white ware: grey, sand or a pale blue."""
        return ((0.62, 0.63, 0.65), (0.74, 0.66, 0.52), (0.58, 0.66, 0.76))[int(rng.integers(3))]

    def plate(self, profile: list[tuple[float, float]]) -> Canvas:
        """Draw a plate from the foot over the rim to the middle of the floor."""
        return self._draw(profile, wall=4, rim=5, inner=7, floor=8)

    def bowl(self, profile: list[tuple[float, float]]) -> Canvas:
        """Draw a bowl from the foot over the rim to the middle of the floor."""
        return self._draw(profile, wall=3, rim=6, inner=8, floor=11)

    def _draw(self, profile: list[tuple[float, float]], *, wall: int, rim: int, inner: int, floor: int) -> Canvas:
        length = profile_length(profile)
        canvas = Canvas(1.0, float(length[-1]), (64, 256), self.colour)
        y = canvas.y
        end = float(length[-1])
        lip, well, bottom = float(length[inner]), float(length[floor]), end - float(length[floor])
        if self.design == "speckled":
            for u, v, size in self._rng.uniform(0.0, 1.0, (90, 3)).tolist():
                radius = 0.0006 + 0.0007 * size
                canvas.ellipse((u, v * end), (radius * 6.0, radius), mixed(self.colour, self._light, 0.75))
        # The floor catches more light in its middle; a turned ring shows where the foot is.
        away = (end - y) / bottom
        on_floor = y > well
        canvas.paint(on_floor, shaded(self.colour, 1.14), strength=0.8)
        canvas.shade(np.where(on_floor, 1.0 - 0.10 * np.clip(away - 0.55, 0.0, 1.0) / 0.45, 1.0))
        canvas.shade(np.where(np.abs(away - 0.62) < 0.012, 0.86, 1.0))
        if self.design == "ring":
            canvas.paint(np.abs(away - 0.78) < 0.035, self._light)
        if self.design == "two lines":
            for place in (0.84, 0.92):
                canvas.paint(np.abs(away - place) < 0.016, self._light)
        # The inside of the lip lies in its own shadow, deepest where it meets the floor.
        down = np.clip((y - lip) / (well - lip), 0.0, 1.0)
        canvas.shade(np.where((y > lip) & (y <= well), 0.92 - 0.20 * down, 1.0))
        # Glaze runs thin over the rim, and there is none under the foot.
        canvas.paint((y > float(length[rim]) - 0.0004) & (y < lip + 0.0006), self._light)
        if self.design == "line":
            canvas.paint((y > float(length[rim]) - 0.0045) & (y < float(length[rim])), self._light)
        canvas.shade(np.where(y < float(length[wall]), 0.78, 1.0))
        return canvas
