"""Views of a scene, and the modalities to render for each view."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

from betterbench.errors import InvalidInputError
from betterbench.geometry import Vector, distance
from betterbench.json_form import strict_form

Modality = Literal["rgb", "depth", "instances", "semantics", "boxes", "flow"]

MODALITIES: tuple[Modality, ...] = ("rgb", "depth", "instances", "semantics", "boxes", "flow")
"""All modalities, in the order of their columns."""

MAX_SIDE_PX = 4096
"""Maximum width or height of a view [pixel]."""

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,59}")
_FORMS = "NAME, NAME:SIZE, NAME:WIDTHxHEIGHT or NAME=X,Y,Z/X,Y,Z/FOVY:WIDTHxHEIGHT (position, target, degrees)"

_Side = Annotated[int, Field(ge=1, le=MAX_SIDE_PX)]


@strict_form
@dataclass(frozen=True, slots=True)
class PlacedCamera:
    """Camera that a user has placed at a fixed position in the world.

    Attributes:
        position: Position in the world frame [m].
        target: Point in the world frame that the camera looks at [m]. The up direction in the image is world +z, or +x
            if the camera looks straight down.
        fovy_deg: Vertical field of view [degree].
    """

    position: Vector
    target: Vector
    fovy_deg: float

    def __post_init__(self) -> None:
        """Raise InvalidInputError if the camera has no viewing direction or its field of view is out of range."""
        if not all(map(math.isfinite, (*self.position, *self.target))) or distance(self.position, self.target) < 1e-6:
            raise InvalidInputError(
                "camera", "position and target are the same point", "Use a target that differs from the position"
            )
        if not 1.0 <= self.fovy_deg <= 170.0:
            raise InvalidInputError(
                "camera", f"has a field of view of {self.fovy_deg:g} degrees", "Use an angle from 1 to 170 degrees"
            )


@strict_form
@dataclass(frozen=True, slots=True)
class ViewSpec:
    """Camera and image size [pixels] of a view. The camera is part of the scene (given by name) or user-defined."""

    camera: str
    width: _Side = 256
    height: _Side = 256
    placed: PlacedCamera | None = None

    def __post_init__(self) -> None:
        """Raise InvalidInputError if the name cannot be a file name or the size is out of range."""
        if not _NAME.fullmatch(self.camera):
            raise InvalidInputError("camera", f"{self.camera!r} cannot be a file name", "Use letters and digits")
        if not (1 <= self.width <= MAX_SIDE_PX and 1 <= self.height <= MAX_SIDE_PX):
            problem = f"{self.width} x {self.height} pixels is out of range"
            raise InvalidInputError(f"camera {self.camera}", problem, f"Use 1 to {MAX_SIDE_PX} pixels per side")

    @property
    def name(self) -> str:
        """File name of the view, composed of camera and size ("front_256x256")."""
        return f"{self.camera}_{self.width}x{self.height}"

    @property
    def text(self) -> str:
        """View in the format of the command line (see :meth:`parse`)."""
        place = ""
        if self.placed is not None:
            at, to = (",".join(map(repr, point)) for point in (self.placed.position, self.placed.target))
            place = f"={at}/{to}/{self.placed.fovy_deg!r}"
        return f"{self.camera}{place}:{self.width}x{self.height}"

    @classmethod
    def parse(cls, text: str) -> ViewSpec:
        """Parse the text of a view from the command line.

        The text is the name of a camera with an optional size ("wrist", "front:448", "left_shoulder:320x180"), or a
        user-defined camera: name, position, target and vertical field of view in degrees
        ("top=0.45,0,1.4/0.45,0,0/45:256x256").

        Raises:
            InvalidInputError: If the text is malformed.
        """
        name, _, size = text.partition(":")
        name, _, place = name.partition("=")
        try:
            sides = [int(side) for side in (size or "256").split("x")]
            width, height = sides if len(sides) == 2 else (sides[0], *sides)
            placed = None
            if place:
                at, to, fovy = place.split("/")
                placed = PlacedCamera(_vector(at), _vector(to), float(fovy))
        except ValueError:
            raise InvalidInputError("--camera", f"{text!r} is not a view", f"Use {_FORMS}") from None
        return cls(name, width, height, placed)


def _vector(text: str) -> Vector:
    x, y, z = (float(number) for number in text.split(","))
    return x, y, z


def modalities_named(names: Sequence[str]) -> tuple[Modality, ...]:
    """Return the given modalities in the order of their columns, or all modalities if no names are given.

    Raises:
        InvalidInputError: If a name is unknown.
    """
    unknown = [name for name in names if name not in MODALITIES]
    if unknown:
        raise InvalidInputError(
            "--modality", f"{unknown[0]!r} is unknown", f"Use one or more of {', '.join(MODALITIES)}"
        )
    return tuple(name for name in MODALITIES if not names or name in names)


def require_views(views: Sequence[ViewSpec]) -> None:
    """Raise InvalidInputError if there are no views, or if two views have the same name."""
    names = [view.name for view in views]
    twice = sorted({name for name in names if names.count(name) > 1})
    if not views or twice:
        problem = f"{twice[0]!r} is given twice" if twice else "no view is given"
        raise InvalidInputError("--camera", problem, "List each view only once")
