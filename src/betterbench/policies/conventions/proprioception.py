"""Proprioceptive inputs of a policy: vectors composed of parts of the robot state, such as joint positions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from betterbench.errors import InvalidInputError, PolicyError
from betterbench.geometry import TOOL_DOWN, normalize, rotate, to_axis_angle_near, turn_between
from betterbench.interface import Observation
from betterbench.interface.actions import JOINT_POSITION, ROBOT_ACTION_SPACES
from betterbench.json_form import strict_form
from betterbench.policies.conventions.rotation import ROTATION_SIZES, RotationFormat, to_format

StatePart = Literal[
    "ee_position",
    "ee_quaternion_wxyz",
    "ee_quaternion_xyzw",
    "ee_axis_angle",
    "ee_rpy",
    "ee_rotation_6d",
    "ee_rotation_6d_rows",
    "ee_rotation_6d_interleaved",
    "ee_matrix",
    "ee_rpy_from_down",
    "ee_x",
    "ee_y",
    "ee_z",
    "ee_axis_angle_x",
    "ee_axis_angle_y",
    "ee_axis_angle_z",
    "ee_roll",
    "ee_pitch",
    "ee_yaw",
    "ee_roll_from_down",
    "ee_pitch_from_down",
    "ee_yaw_from_down",
    "ee_quaternion_w",
    "ee_quaternion_x",
    "ee_quaternion_y",
    "ee_quaternion_z",
    "gripper_width",
    "gripper_fingers",
    "gripper_open_fraction",
    "gripper_closed_fraction",
    "gripper_command",
    "gripper_command_closed",
    "ee_axis_angle_short",
    "controller_position",
    "controller_axis_angle",
    "controller_rotation_6d",
    "joint_positions",
    "joint_velocities",
    "step",
    "zero",
    "so101_degrees",
    "so101_normalized",
]
"""Name of a part of the robot state.

``ee_rpy_from_down`` is the rotation of the tool relative to a tool that points straight down, as angles [rad] about the
fixed axes of the base (as in BridgeData V2 and SimplerEnv's WidowX). ``ee_axis_angle_short`` is a rotation vector [rad]
of length at most pi, which may therefore jump between two steps. ``gripper_fingers`` are the positions [m] of two
finger joints, the second negated, as in robosuite and LIBERO. ``gripper_open_fraction`` and ``gripper_closed_fraction``
are fractions of the full opening width. ``so101_degrees`` and ``so101_normalized`` are the measured motor positions in
the units of the action space of the same name. ``zero`` is a placeholder for a value that the policy does not use.

Some parts come from other simulators. In LIBERO, ``controller_position`` and the corresponding rotations are the
end-effector pose that robosuite's controller measured one physics step earlier. Elsewhere, they are the current pose.
``gripper_command`` is the last gripper command in CALVIN: 1 to open, -1 to close. ``gripper_command_closed`` is 1 if
the last command closed the gripper, and otherwise 0.
"""

_AXES: dict[str, tuple[StatePart, int]] = {
    **{f"ee_{axis}": ("ee_position", i) for i, axis in enumerate("xyz")},
    **{f"ee_axis_angle_{axis}": ("ee_axis_angle", i) for i, axis in enumerate("xyz")},
    **{f"ee_quaternion_{axis}": ("ee_quaternion_wxyz", i) for i, axis in enumerate("wxyz")},
    **{f"ee_{angle}": ("ee_rpy", i) for i, angle in enumerate(("roll", "pitch", "yaw"))},
    **{f"ee_{angle}_from_down": ("ee_rpy_from_down", i) for i, angle in enumerate(("roll", "pitch", "yaw"))},
}
"""Vector and index of each part that is a single component of a vector."""

_SIZES: dict[str, int] = {
    "ee_position": 3,
    "ee_rpy_from_down": 3,
    "gripper_fingers": 2,
    "ee_axis_angle_short": 3,
    "controller_position": 3,
    "controller_axis_angle": 3,
    "controller_rotation_6d": 6,
    "joint_positions": JOINT_POSITION.dim - 1,
    "joint_velocities": JOINT_POSITION.dim - 1,
    **{name: space.dim for name, space in ROBOT_ACTION_SPACES.items()},
    **{f"ee_{form}": size for form, size in ROTATION_SIZES.items()},
}
"""Number of values in each part with several values. If it depends on the robot, the number is that of the Panda."""

_PER_JOINT = ("joint_positions", "joint_velocities")
"""Parts with one value per arm joint."""

MotorPart = Literal["so101_degrees", "so101_normalized"]
"""Parts in the motor units of a particular robot."""


@strict_form
@dataclass(frozen=True, slots=True)
class StateRule:
    """State input of a policy: a vector of concatenated parts of the robot state.

    Attributes:
        key: Path of the vector in the request.
        parts: Parts of the vector, in order.
        dtype: Number type of the vector.
        scalar: Whether a number is sent instead of an array. This requires a vector of length 1.
    """

    key: tuple[str, ...]
    parts: tuple[StatePart, ...]
    dtype: Literal["float32", "float64", "int64"] = "float32"
    scalar: bool = False

    def __post_init__(self) -> None:
        """Check that the state has at least one part, and that a scalar has only one value."""
        where = f"state {'/'.join(self.key)}"
        if not self.parts:
            raise InvalidInputError(where, "the state has no parts", "List at least one part, such as ee_position")
        if self.scalar and self.size != 1:
            raise InvalidInputError(
                where, f"a scalar has one value, but the parts have {self.size} values", "Omit scalar"
            )

    @property
    def size(self) -> int:
        """Number of values in the vector."""
        return sum(_SIZES.get(part, 1) for part in self.parts)

    @property
    def holds_position(self) -> bool:
        """Whether the vector contains the end-effector position or one of its coordinates."""
        return any(_AXES.get(part, (part, 0))[0] in ("ee_position", "controller_position") for part in self.parts)

    def columns(self, joints: int | None = None) -> list[tuple[StatePart, slice]]:
        """Return the parts of the vector, each with the slice of the vector that contains its values.

        ``joints`` is the number of arm joints. By default, it is 7, as for the Panda.
        """
        found, begin = [], 0
        for part in self.parts:
            end = begin + (joints if joints and part in _PER_JOINT else _SIZES.get(part, 1))
            found.append((part, slice(begin, end)))
            begin = end
        return found

    def read(
        self,
        observation: Observation,
        *,
        ee_offset_m: Sequence[float],
        gripper_opening_m: float,
        tool_offset_m: Sequence[float] = (0.0, 0.0, 0.0),
    ) -> np.ndarray | float | int:
        """Compute the state input from an observation.

        Args:
            observation: Observation of betterbench.
            ee_offset_m: Offset that is added to the end-effector position [m], for policies whose positions have a
                different origin.
            gripper_opening_m: Width at which the gripper is considered fully open [m].
            tool_offset_m: Position of the policy's tool point in betterbench's tool frame [m].

        Returns:
            Array (size,) of type ``dtype``, or a number if ``scalar`` is set.
        """
        values: list[float] = []
        for part in self.parts:
            vector, place = _AXES.get(part, (part, None))
            if vector in observation.native:
                numbers = observation.native[vector].tolist()
            elif vector in ("ee_position", "controller_position"):
                numbers = tool_position(observation, ee_offset_m, tool_offset_m)
            else:
                numbers = _read_part(vector, observation, gripper_opening_m)
            values += numbers if place is None else numbers[place : place + 1]
        if self.scalar:
            return int(values[0]) if self.dtype == "int64" else float(values[0])
        return np.array(values, dtype=self.dtype)


def tool_position(
    observation: Observation, ee_offset_m: Sequence[float], tool_offset_m: Sequence[float]
) -> list[float]:
    """Return the position [x, y, z] of a policy's tool point in the policy's coordinates [m].

    ``ee_offset_m`` is the offset between the origins of the policy and of betterbench. ``tool_offset_m`` is the
    position of the tool point in betterbench's tool frame.
    """
    position = [float(p) + o for p, o in zip(observation.ee_position, ee_offset_m, strict=True)]
    if not any(tool_offset_m):
        return position
    w, x, y, z = observation.ee_quaternion.tolist()
    ox, oy, oz = tool_offset_m
    return [p + d for p, d in zip(position, rotate(normalize((w, x, y, z)), (ox, oy, oz)), strict=True)]


def _read_part(part: StatePart, observation: Observation, gripper_opening_m: float) -> list[float]:
    """Return the values of a state part, except for positions of the end effector."""
    if part == "joint_positions":
        return list(observation.joint_positions.tolist())
    if part == "joint_velocities":
        return list(observation.joint_velocities.tolist())
    if part in ROBOT_ACTION_SPACES:
        from betterbench.sim.robots import motor_positions  # noqa: PLC0415 - imports MuJoCo, which is needed only here

        return motor_positions(ROBOT_ACTION_SPACES[part], observation)
    if part == "step":
        return [observation.step]
    if part == "zero":
        return [0.0]
    if part in ("gripper_command", "gripper_command_closed"):
        raise PolicyError(
            f"{part} is available only in CALVIN. Use gripper_width or gripper_closed_fraction in the adapter."
        )
    if part.startswith("gripper_"):
        return _gripper(part, observation.gripper_width, gripper_opening_m)
    w, x, y, z = observation.ee_quaternion.tolist()
    if part in ("ee_axis_angle_short", "controller_axis_angle"):
        return to_format((w, x, y, z), "axis_angle")
    if part == "controller_rotation_6d":
        return to_format((w, x, y, z), "rotation_6d")
    if part == "ee_axis_angle":
        return list(to_axis_angle_near((w, x, y, z), TOOL_DOWN))
    if part == "ee_rpy_from_down":
        return to_format(turn_between(TOOL_DOWN, (w, x, y, z)), "rpy")
    return _rotation((w, x, y, z), part.removeprefix("ee_"))  # type: ignore[arg-type]


def _rotation(q: Sequence[float], form: RotationFormat) -> list[float]:
    """Convert the rotation of a tool so that its values are continuous when the tool points straight down.

    A tool that points down is rotated by 180 degrees about x, so the scalar part w of its quaternion is close to 0. The
    usual rule w >= 0 would change the signs of all components when w crosses 0, and the roll angle would jump by 2 pi.
    Here, quaternions have x >= 0, and roll angles are in [0, 2 pi).
    """
    values = to_format(q, form)
    if form in ("quaternion_wxyz", "quaternion_xyzw"):
        x = values[1] if form == "quaternion_wxyz" else values[0]
        return [-v for v in values] if x < 0.0 else values
    if form == "rpy" and values[0] < 0.0:
        values[0] += 2.0 * math.pi
    return values


def _gripper(part: str, width_m: float, opening_m: float) -> list[float]:
    if part == "gripper_width":
        return [width_m]
    if part == "gripper_fingers":
        return [0.5 * width_m, -0.5 * width_m]
    opened = min(max(width_m / opening_m, 0.0), 1.0)
    return [opened if part == "gripper_open_fraction" else 1.0 - opened]
