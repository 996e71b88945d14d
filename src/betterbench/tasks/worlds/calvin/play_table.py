"""State of a CALVIN scene for the success rules: the blocks and their contacts, the doors, the lights and the robot."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from betterbench.errors import InvalidInputError
from betterbench.geometry import Quaternion, Vector

TouchedLink = tuple[int, int]
"""One side of a contact, given by the indices of a body and of one of its links."""


@dataclass(frozen=True, slots=True)
class BlockInfo:
    """State of a movable block.

    Attributes:
        body: Index of the block's body.
        position: Position in the world [m].
        rotation: Rotation from the block's frame to the world frame, as a unit quaternion (w, x, y, z).
        velocity: Linear velocity [m/s] and angular velocity [rad/s], six numbers.
        contacts: Links that are in contact with the block.
    """

    body: int
    position: Vector
    rotation: Quaternion
    velocity: tuple[float, ...]
    contacts: frozenset[TouchedLink]

    @property
    def bodies(self) -> frozenset[int]:
        """Indices of the bodies that are in contact with the block."""
        return frozenset(body for body, _ in self.contacts)


@dataclass(frozen=True, slots=True)
class PlayTable:
    """State of the scene at one control step.

    Attributes:
        robot: Index of the robot's body.
        touched: Indices of the bodies that the robot touches.
        blocks: The blocks, by CALVIN's names ("block_red").
        table: Links of the table by name, in the same form as in the contacts.
        doors: Joint positions [m] by name ("base__drawer").
        lights: State of each light (0 or 1) by name ("led").
    """

    robot: int
    touched: frozenset[int]
    blocks: Mapping[str, BlockInfo]
    table: Mapping[str, TouchedLink]
    doors: Mapping[str, float]
    lights: Mapping[str, int]


def read_play_table(info: Mapping[str, Any]) -> PlayTable:
    """Convert the result of calvin_env's ``env.get_info()``.

    Contacts are tuples as returned by PyBullet's ``getContactPoints``. Their third number is the other body, and their
    fifth number is the touched link of that body. PyBullet's quaternions are (x, y, z, w).

    Raises:
        InvalidInputError: If a part is missing or malformed.
    """
    try:
        robot, scene = info["robot_info"], info["scene_info"]
        table = scene["fixed_objects"]["table"]
        return PlayTable(
            robot=int(robot["uid"]),
            touched=frozenset(int(c[2]) for c in robot["contacts"]),
            blocks={name: _block(found) for name, found in scene["movable_objects"].items()},
            table={name: (int(table["uid"]), int(link)) for name, link in table["links"].items()},
            doors={name: _number(found["current_state"]) for name, found in scene["doors"].items()},
            lights={name: int(found["logical_state"]) for name, found in scene["lights"].items()},
        )
    except (ArithmeticError, AttributeError, KeyError, TypeError, ValueError, IndexError) as problem:
        raise InvalidInputError(
            "get_info() of CALVIN",
            f"does not have the form of calvin_env@797142c: {type(problem).__name__}: {problem}",
            "Use that version of calvin_env with use_scene_info=True",
        ) from problem


def _block(found: Mapping[str, Any]) -> BlockInfo:
    x, y, z, w = map(finite_number, found["current_orn"])
    px, py, pz = map(finite_number, found["current_pos"])
    vx, vy, vz = map(finite_number, found["current_lin_vel"])
    wx, wy, wz = map(finite_number, found["current_ang_vel"])
    contacts = frozenset((int(c[2]), int(c[4])) for c in found["contacts"])
    return BlockInfo(int(found["uid"]), (px, py, pz), (w, x, y, z), (vx, vy, vz, wx, wy, wz), contacts)


def _number(value: float | Sequence[float]) -> float:
    """Convert a joint position to a float. It is given as a number or as the first element of a sequence."""
    return finite_number(value[0] if isinstance(value, Sequence) else value)


def finite_number(value: Any) -> float:  # noqa: ANN401 - of a stranger
    """Return a Python or NumPy number as a float.

    Raises:
        ValueError: If the value is a string, a boolean or not finite.
    """
    number = float("nan") if isinstance(value, bool | str | bytes) else float(value)
    if not math.isfinite(number):
        raise ValueError(f"{str(value)[:40]!r} is not a finite number")
    return number
