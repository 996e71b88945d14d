"""CALVIN scene state for the success rules, with poses and contacts of the blocks, doors, lights and robot."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from betterbench.errors import InvalidInputError
from betterbench.geometry import Quaternion, Vector

TouchedLink = tuple[int, int]
"""Body and link indices for one side of a contact."""


@dataclass(frozen=True, slots=True)
class BlockInfo:
    """State of a movable block.

    Attributes:
        body: Its body's index.
        position: Position in the world [m].
        rotation: Unit quaternion (w, x, y, z) of R_world_block.
        velocity: Linear [m/s] and angular velocity [rad/s], six numbers.
        contacts: Links in contact with it.
    """

    body: int
    position: Vector
    rotation: Quaternion
    velocity: tuple[float, ...]
    contacts: frozenset[TouchedLink]

    @property
    def bodies(self) -> frozenset[int]:
        """Indices of the bodies in contact with it."""
        return frozenset(body for body, _ in self.contacts)


@dataclass(frozen=True, slots=True)
class PlayTable:
    """Scene state at one control step.

    Attributes:
        robot: Index of the robot's body.
        touched: Indices of the bodies that the robot touches.
        blocks: The blocks by CALVIN's names ("block_red").
        table: Table links by name, each as a contact.
        doors: Joint positions [m] by name ("base__drawer").
        lights: 0 or 1 by name ("led").
    """

    robot: int
    touched: frozenset[int]
    blocks: Mapping[str, BlockInfo]
    table: Mapping[str, TouchedLink]
    doors: Mapping[str, float]
    lights: Mapping[str, int]


def read_play_table(info: Mapping[str, Any]) -> PlayTable:
    """Read the result of calvin_env's ``env.get_info()``.

    Contacts are tuples of PyBullet's ``getContactPoints``, in which the third number is the other body and the fifth
    its link. Quaternions of PyBullet are (x, y, z, w).

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
            "Use that version, with use_scene_info=True",
        ) from problem


def _block(found: Mapping[str, Any]) -> BlockInfo:
    x, y, z, w = map(finite_number, found["current_orn"])
    px, py, pz = map(finite_number, found["current_pos"])
    vx, vy, vz = map(finite_number, found["current_lin_vel"])
    wx, wy, wz = map(finite_number, found["current_ang_vel"])
    contacts = frozenset((int(c[2]), int(c[4])) for c in found["contacts"])
    return BlockInfo(int(found["uid"]), (px, py, pz), (w, x, y, z), (vx, vy, vz, wx, wy, wz), contacts)


def _number(value: float | Sequence[float]) -> float:
    """Return a joint position given as a number or as the first element of a sequence."""
    return finite_number(value[0] if isinstance(value, Sequence) else value)


def finite_number(value: Any) -> float:  # noqa: ANN401 - of a stranger
    """Return a Python or NumPy number as a float. Raises ValueError for a text, a boolean or a non-finite number."""
    number = float("nan") if isinstance(value, bool | str | bytes) else float(value)
    if not math.isfinite(number):
        raise ValueError(f"{str(value)[:40]!r} is not a finite number")
    return number
