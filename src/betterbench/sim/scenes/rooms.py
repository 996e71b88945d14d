"""Rooms: the table top, wall, floor and light of a scene. The seed of a trial determines its room.

No table top has a color that instructions use. Objects in red, blue, yellow, bright green, white, black or the browns
of food are therefore visible on all table tops. Ambient, key and fill light add up to at most 1 on any surface. No
color is therefore clipped, and white still differs from light gray.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from betterbench.errors import UnknownNameError
from betterbench.geometry import Vector


@dataclass(frozen=True, slots=True)
class Light:
    """Light of a room: two directional lights and a uniform ambient light.

    Attributes:
        key_direction: Direction of the key light, which casts the shadow. The vector does not have to be normalized.
        key: Color (r, g, b) of the key light, each component in [0, 1].
        ambient: Color of the uniform ambient light.
        fill: Brightness of the fill light, which comes from the other side and casts no shadow.
    """

    key_direction: Vector
    key: Vector
    ambient: Vector
    fill: float


@dataclass(frozen=True, slots=True)
class Room:
    """Appearance of a table top and its surroundings, including the light.

    Attributes:
        name: Name of the room.
        surface: Material of the table top, one of ``SURFACES``.
        table: Mean color (r, g, b) of the table top, each component in [0, 1].
        wall: Color of the wall behind the robot.
        floor: Color of the floor.
    """

    name: str
    surface: str
    table: Vector
    wall: Vector
    floor: Vector
    light: Light


_NEUTRAL = Light((-0.55, -0.35, -1.0), (0.40, 0.40, 0.39), (0.40, 0.40, 0.40), 0.22)
_WARM_LEFT = Light((-0.45, -0.70, -1.0), (0.42, 0.405, 0.375), (0.405, 0.40, 0.395), 0.20)
_COOL_RIGHT = Light((-0.50, 0.65, -1.0), (0.375, 0.385, 0.41), (0.39, 0.395, 0.405), 0.20)
_SOFT = Light((-0.40, -0.20, -1.0), (0.26, 0.26, 0.26), (0.48, 0.48, 0.48), 0.22)
_STRONG_RIGHT = Light((-0.65, 0.45, -1.0), (0.49, 0.48, 0.45), (0.35, 0.35, 0.36), 0.14)
_EVENING = Light((-0.35, -0.85, -1.0), (0.445, 0.425, 0.395), (0.39, 0.385, 0.38), 0.18)
_DAYLIGHT = Light((-0.75, -0.10, -1.0), (0.42, 0.43, 0.45), (0.38, 0.385, 0.40), 0.18)
_CEILING = Light((-0.35, 0.20, -1.0), (0.38, 0.385, 0.37), (0.42, 0.425, 0.42), 0.16)

ROOMS: tuple[Room, ...] = (
    Room("ash", "wood", (0.72, 0.63, 0.51), (0.74, 0.76, 0.77), (0.62, 0.63, 0.65), _NEUTRAL),
    Room("concrete", "stone", (0.60, 0.61, 0.60), (0.80, 0.75, 0.68), (0.47, 0.42, 0.36), _WARM_LEFT),
    Room("olive laminate", "laminate", (0.49, 0.48, 0.38), (0.66, 0.72, 0.70), (0.55, 0.53, 0.50), _COOL_RIGHT),
    Room("mauve cloth", "cloth", (0.60, 0.50, 0.58), (0.82, 0.82, 0.80), (0.50, 0.51, 0.54), _SOFT),
    Room("teal cloth", "checks", (0.33, 0.50, 0.50), (0.78, 0.72, 0.66), (0.40, 0.36, 0.33), _STRONG_RIGHT),
    Room("terrazzo", "terrazzo", (0.63, 0.64, 0.65), (0.55, 0.61, 0.66), (0.40, 0.43, 0.46), _EVENING),
    Room("weathered planks", "planks", (0.48, 0.46, 0.44), (0.70, 0.74, 0.66), (0.58, 0.56, 0.52), _DAYLIGHT),
    Room("striped sage", "stripes", (0.60, 0.65, 0.59), (0.75, 0.68, 0.70), (0.52, 0.46, 0.42), _CEILING),
)
"""Rooms that are used in training and evaluation."""

UNSEEN_ROOMS: tuple[Room, ...] = (
    Room("rose tiles", "tiles", (0.68, 0.56, 0.54), (0.64, 0.70, 0.76), (0.45, 0.47, 0.50), _STRONG_RIGHT),
    Room("pale blue stripes", "stripes", (0.58, 0.65, 0.71), (0.84, 0.78, 0.68), (0.55, 0.48, 0.40), _EVENING),
    Room("plum terrazzo", "terrazzo", (0.45, 0.38, 0.44), (0.70, 0.76, 0.72), (0.60, 0.60, 0.58), _DAYLIGHT),
)
"""Held-out rooms, which do not occur in demonstrations."""


CLOTHS: Mapping[str, Vector] = {"blue": (0.24, 0.36, 0.60), "green": (0.27, 0.48, 0.31)}
"""Mean colors (r, g, b) of the tablecloths that a condition may name."""


def with_cloth(room: Room, cloth: str | None) -> Room:
    """Return a room with a tablecloth of the given color. If the color is None, the table stays bare.

    Wall, floor and light do not change, so that conditions with the same seed differ only in the cloth.

    Raises:
        UnknownNameError: If there is no tablecloth of this color.
    """
    if cloth is None:
        return room
    if cloth not in CLOTHS:
        raise UnknownNameError("tablecloth", cloth, CLOTHS)
    return replace(room, name=f"{room.name}, {cloth} cloth", surface="cloth", table=CLOTHS[cloth])
