"""Proprioceptive inputs of a policy. They are parts of the robot's state in a given format and order."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from betterbench.errors import InvalidInputError, PolicyError
from betterbench.geometry import TOOL_DOWN, normalize, rotate, to_axis_angle_near, turn_between
from betterbench.interface import Observation
from betterbench.interface.actions import JOINT_POSITION, ROBOT_ACTION_SPACES, ActionSpace
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
"""Part of a robot state.

A part named after an action space in motor units is the measured position in these units. ``ee_rpy_from_down`` is the
rotation of the tool relative to a tool that points straight down, as angles about the fixed axes of the base (as in
BridgeData V2 and SimplerEnv's WidowX). ``gripper_fingers`` are the positions [m] of two finger joints, the second
negated, as in robosuite and LIBERO. ``gripper_open_fraction`` and ``gripper_closed_fraction`` are fractions of the full
opening width. ``zero`` fills an entry that the policy does not use. ``ee_axis_angle_short`` is a rotation vector of
length at most pi, so it may jump between two steps.

Some parts come from other simulators. ``controller_position`` and the corresponding rotations are the pose that
robosuite's controller measured in LIBERO one physics step earlier. Elsewhere, they are the pose of the tool.
``gripper_command`` is the last gripper command in CALVIN, 1 to open and -1 to close, and ``gripper_command_closed`` is
1 after a command to close.
"""

_AXES: dict[str, tuple[StatePart, int]] = {
    **{f"ee_{axis}": ("ee_position", i) for i, axis in enumerate("xyz")},
    **{f"ee_axis_angle_{axis}": ("ee_axis_angle", i) for i, axis in enumerate("xyz")},
    **{f"ee_quaternion_{axis}": ("ee_quaternion_wxyz", i) for i, axis in enumerate("wxyz")},
    **{f"ee_{angle}": ("ee_rpy", i) for i, angle in enumerate(("roll", "pitch", "yaw"))},
    **{f"ee_{angle}_from_down": ("ee_rpy_from_down", i) for i, angle in enumerate(("roll", "pitch", "yaw"))},
}
"""Parts that are a single component of a vector, each with the name of the vector and the index of the component."""

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
"""Number of values in each part. For a part whose length depends on the robot, this is the number for the Panda."""

_PER_JOINT = ("joint_positions", "joint_velocities")
"""Parts that have one value per arm joint."""

MotorPart = Literal["so101_degrees", "so101_normalized"]
"""Parts in the units of the motors of one particular robot."""


@strict_form
@dataclass(frozen=True, slots=True)
class StateRule:
    """State input of a policy: one vector that consists of parts of the robot's state.

    Attributes:
        key: Path of the vector in the request.
        parts: Parts of the vector, in order.
        dtype: Number type of the vector.
        scalar: Whether a plain number is sent instead of an array. This requires a vector of length 1.
    """

    key: tuple[str, ...]
    parts: tuple[StatePart, ...]
    dtype: Literal["float32", "float64", "int64"] = "float32"
    scalar: bool = False

    def __post_init__(self) -> None:
        """Check that the state has parts, and that a scalar has only one value."""
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
        """Return, for each part of the vector, the columns that belong to it.

        ``joints`` is the number of arm joints. By default, it is the number of the Panda's joints.
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
        """Return the state input for an observation, as an array (size,) of type ``dtype``.

        If the rule describes a scalar, return a number.

        ``ee_offset_m`` is added to the end-effector position, for policies whose positions have a different origin.
        ``tool_offset_m`` is the position of the policy's tool point in betterbench's tool frame. ``gripper_opening_m``
        is the width at which the gripper counts as fully open.
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
    """Return the position [x, y, z] of a policy's tool point [m].

    ``tool_offset_m`` is the tool point in betterbench's tool frame.
    """
    position = [float(p) + o for p, o in zip(observation.ee_position, ee_offset_m, strict=True)]
    if not any(tool_offset_m):
        return position
    w, x, y, z = observation.ee_quaternion.tolist()
    ox, oy, oz = tool_offset_m
    return [p + d for p, d in zip(position, rotate(normalize((w, x, y, z)), (ox, oy, oz)), strict=True)]


def _read_part(part: StatePart, observation: Observation, gripper_opening_m: float) -> list[float]:
    """Return the values of a state part that does not contain a position."""
    if part == "joint_positions":
        return list(observation.joint_positions.tolist())
    if part == "joint_velocities":
        return list(observation.joint_velocities.tolist())
    if part in ROBOT_ACTION_SPACES:
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


def motor_positions(space: ActionSpace, observation: Observation) -> list[float]:
    """Return the measured positions of a robot's motors, in the units of the robot's action space.

    Raises PolicyError if the observation comes from a different robot.
    """
    from betterbench.sim.robots import robot_of_space  # noqa: PLC0415 - MuJoCo, which only this part needs

    spec, joints = robot_of_space(space.name), observation.joint_positions.tolist()
    if len(joints) != space.dim - 1:
        raise PolicyError(
            f"{space.name} is a state format of the robot {spec.title}, but the observed robot has {len(joints)} "
            f"joints. Evaluate with --robot {spec.name}, or choose another preset."
        )
    return spec.positions_in(space, joints, observation.gripper_width)


def _rotation(q: Sequence[float], form: RotationFormat) -> list[float]:
    """Convert the rotation of a tool to a format whose values do not jump when the tool points straight down.

    Pointing down is a half turn about x, at which the scalar part w of the quaternion crosses zero. The usual rule w >=
    0 would flip all four signs there, so the roll angle would jump by a full turn between two images.
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
