"""Conversion of a policy's answer to actions, according to its columns, units, frame and gripper convention."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from betterbench.errors import InvalidInputError, PolicyError, one_line
from betterbench.geometry import conjugate, from_axis_angle, multiply, rotate, to_axis_angle
from betterbench.interface import Observation
from betterbench.interface.actions import (
    JOINT_SPACES,
    ROBOT_ACTION_SPACES,
    ROTATION_PER_UNIT_RAD,
    TRANSLATION_PER_UNIT_M,
    WORLD_ACTION_SPACES,
    action_space,
)
from betterbench.json_form import strict_form
from betterbench.policies.conventions.rotation import ROTATION_SIZES, RotationFormat, from_format, to_format

AnswerKind = Literal[
    "action",
    "translation",
    "translation_x",
    "translation_y",
    "translation_z",
    "rotation",
    "rotation_x",
    "rotation_y",
    "rotation_z",
    "joints",
    "gripper",
    "unused",
]
"""Meaning of a group of columns in an answer: a complete action in betterbench's format, or a part of an action.

For absolute poses, the translation is the position. A translation, or a rotation with three values, may be split into
its axes: ``rotation_x`` is the first value of the rotation format, i.e. the x component of a rotation vector or the
roll angle.
"""

Polarity = Literal[
    "close_positive",
    "open_positive",
    "closed_fraction",
    "closed_at_least",
    "open_fraction",
    "open_sign",
    "closed_linear",
    "open_linear",
]
"""Convention of the gripper value in an answer.

``close_positive`` and ``open_positive`` use the sign of the value. In the other conventions, the value g is a fraction
from 0 to 1, and 1 means closed (``closed_...``) or open (``open_...``). ``closed_fraction`` closes the gripper above
the threshold and opens it otherwise. ``closed_at_least`` also closes it at the threshold. ``open_fraction`` opens it
above the threshold and closes it otherwise. ``open_sign`` uses the sign of 1 - 2 g, so the gripper does not move at
0.5. ``closed_linear`` and ``open_linear`` convert g to the gripper commands 2 g - 1 and 1 - 2 g.
"""

_DELTAS = ("ee_delta", "ee_delta_measured")

_OPENS_POSITIVE = frozenset(name for name in WORLD_ACTION_SPACES if name.startswith("calvin_"))
"""Action spaces in which a positive gripper value opens the gripper."""

_ADDS_ANGLES = ("calvin_relative", "calvin_delta")
"""Action spaces in which the rotation is a vector of angles that are added to the angles of the last pose."""

_OWN_ROTATION: dict[str, RotationFormat] = {
    "calvin_relative": "rpy",
    "calvin_delta": "rpy",
    "calvin_absolute": "rpy",
    "calvin_absolute_quaternion": "quaternion_xyzw",
    "libero_absolute": "axis_angle",
}
"""Rotation formats of the action spaces of LIBERO and CALVIN."""

_OF_THE_SPACE: Any = None
"""Default value of the fields that are set to the convention of the action space."""

_BY_AXIS: dict[str, tuple[AnswerKind, AnswerKind, AnswerKind]] = {
    "translation": ("translation_x", "translation_y", "translation_z"),
    "rotation": ("rotation_x", "rotation_y", "rotation_z"),
}
"""Parts of an answer that may be split into axes, with the names of the parts for the three axes."""


@strict_form
@dataclass(frozen=True, slots=True)
class AnswerPart:
    """Consecutive columns of a policy's answer that contain one quantity, such as a rotation.

    Attributes:
        key: Path of the array in the reply. Parts with the same key are consecutive columns of one array.
        kind: Meaning of the columns.
        size: Number of columns. None means the standard number for this kind.
    """

    key: tuple[str, ...]
    kind: AnswerKind
    size: int | None = None


@strict_form
@dataclass(frozen=True, slots=True)
class AnswerRule:
    """Rule that converts a policy's answer to actions, according to its columns, frame, units and gripper convention.

    By default, the rotation format, the units and the gripper convention are taken from the action space. For example,
    an answer in the action space ``calvin_relative`` is then executed unchanged.

    Attributes:
        space: Name of the action space.
        parts: Columns of the answer, in order.
        rotation: Format of rotations.
        frame: Frame in which deltas are given: the robot's base frame, or the frame of the tool at each step.
        translation_unit_m: Translation per action unit [m]: 0.05 with LIBERO's scaling, and 1 if deltas are given in
            meters.
        rotation_unit_rad: Rotation per action unit in a rotation vector or angle [rad].
        joint_unit_rad: Joint rotation per action unit [rad].
        step_rate_hz: Control rate of the training data [Hz]. If it is set, deltas are treated as velocities and
            rescaled to the control rate of the run. With None, deltas are not rescaled.
        gripper: Convention of the gripper value.
        gripper_threshold: Threshold of the conventions ``closed_fraction``, ``closed_at_least`` and ``open_fraction``.
        precision: Number type to which actions are rounded before execution, as in the policy's own client.
    """

    space: str = "ee_delta"
    parts: tuple[AnswerPart, ...] = (AnswerPart(("actions",), "action"),)
    rotation: RotationFormat = _OF_THE_SPACE
    frame: Literal["base", "tool"] = "base"
    translation_unit_m: float = _OF_THE_SPACE
    rotation_unit_rad: float = _OF_THE_SPACE
    joint_unit_rad: float = 1.0
    step_rate_hz: float | None = None
    gripper: Polarity = _OF_THE_SPACE
    gripper_threshold: float = 0.5
    precision: Literal["float64", "float32"] = "float64"

    def __post_init__(self) -> None:
        """Set the default conventions of the action space, and check that the parts form an action in this space."""
        for name, own in own_conventions(self.space).items():
            if getattr(self, name) is None:
                object.__setattr__(self, name, own)
        self._check_numbers()
        self._check_kinds()
        self._check_conventions()

    def _check_numbers(self) -> None:
        if not self.parts:
            raise InvalidInputError(
                "answer", "the answer has no parts", "List its parts, for example translation, rotation and gripper"
            )
        for name in ("translation_unit_m", "rotation_unit_rad", "joint_unit_rad", "step_rate_hz"):
            value = getattr(self, name)
            if value is not None and not 0.0 < value < float("inf"):
                raise InvalidInputError(f"answer: {name}", f"{value:g} is out of range", "Use a number greater than 0")
        if not 0.0 <= self.gripper_threshold < 1.0:
            raise InvalidInputError(
                "answer: gripper_threshold",
                f"{self.gripper_threshold:g} is out of range",
                "Use a number that is at least 0 and less than 1",
            )
        for part in self.parts:
            if part.size is not None and not 1 <= part.size <= 10_000:
                raise InvalidInputError(
                    f"answer: {part.kind}",
                    f"the number of columns, {part.size}, is out of range",
                    "Use at least one column",
                )
            if part.kind == "unused" and part.size is None:
                raise InvalidInputError(
                    "answer: unused",
                    "the number of columns is missing",
                    "Set size to the number of columns, such as 1",
                )
            if part.kind != "unused" and part.size not in (None, self._natural(part.kind)):
                raise InvalidInputError(
                    f"answer: {part.kind}",
                    f"expected {self._natural(part.kind)} columns, got {part.size}",
                    "Omit the size",
                )

    def _check_kinds(self) -> None:
        needed = {"joints", "gripper"} if self.space in JOINT_SPACES else {"translation", "rotation", "gripper"}
        needed = {"action"} if self.space in ROBOT_ACTION_SPACES else needed
        given: list[str] = [p.kind for p in self.parts if p.kind != "unused"]
        kinds = given
        for whole, axes in _BY_AXIS.items():
            if sorted(k for k in given if k in axes) == sorted(axes):
                kinds = [*(k for k in kinds if k not in axes), whole]
        if given != ["action"] and sorted(kinds) != sorted(needed):
            raise InvalidInputError(
                "answer",
                f"the answer has {', '.join(given) or 'nothing'}",
                f"{self.space} needs each of {', '.join(sorted(needed))} once. A translation or rotation may "
                "also be given as three axes (translation_x, translation_y, translation_z)",
            )
        if "rotation_x" in given and ROTATION_SIZES[self.rotation] != len(_BY_AXIS["rotation"]):
            raise InvalidInputError(
                "answer: rotation",
                f"{self.rotation} has {ROTATION_SIZES[self.rotation]} numbers, not three axes",
                "Use axis_angle or rpy, or a single part for the rotation",
            )

    def _check_conventions(self) -> None:
        if self.as_is and not self._means_ours:
            raise InvalidInputError(
                "answer",
                "the columns contain complete actions, whose rotation format, units, frame and gripper "
                "convention are fixed",
                "Omit rotation, units, frame and gripper, or list the parts (translation, rotation, gripper)",
            )
        if self.frame == "tool" and self.space not in _DELTAS:
            raise InvalidInputError("answer: frame", f"{self.space} has no tool frame", "Use the frame base")
        if self.space in _ADDS_ANGLES and self.rotation != "rpy":
            raise InvalidInputError(
                "answer: rotation",
                f"{self.space} adds angles to the last pose, but {self.rotation} does not consist of angles",
                "Use the rotation format rpy",
            )
        if self.step_rate_hz is not None and self.space in WORLD_ACTION_SPACES:
            raise InvalidInputError(
                "answer: step_rate_hz",
                f"{self.space} always runs at the control rate of its benchmark",
                "Omit step_rate_hz",
            )

    @property
    def as_is(self) -> bool:
        """Whether the answer consists of complete actions in betterbench's format."""
        return any(part.kind == "action" for part in self.parts)

    def in_space(self, space: str) -> AnswerRule:
        """Return a copy of the rule for another action space.

        For an action space of LIBERO or CALVIN, the copy uses the rotation format, units and gripper convention of the
        space. Raises UnknownNameError if the action space does not exist, and InvalidInputError if the columns do not
        form an action in that space.
        """
        if space == self.space or space not in WORLD_ACTION_SPACES:
            return replace(self, space=space)
        return replace(self, space=space, frame="base", step_rate_hz=None, **own_conventions(space))

    def _natural(self, kind: AnswerKind) -> int | None:
        sizes = {
            "translation": 3,
            "rotation": ROTATION_SIZES[self.rotation],
            "joints": action_space(self.space).dim - 1,
            "gripper": 1,
        }
        sizes |= {axis: 1 for axes in _BY_AXIS.values() for axis in axes}
        return action_space(self.space).dim if kind == "action" else sizes.get(kind)

    def _size(self, part: AnswerPart) -> int:
        return part.size or self._natural(part.kind) or 0

    @property
    def columns(self) -> dict[tuple[str, ...], int]:
        """Number of columns of each array in the answer, by path."""
        found: dict[tuple[str, ...], int] = {}
        for part in self.parts:
            found[part.key] = found.get(part.key, 0) + self._size(part)
        return found

    def read(
        self,
        reply: Mapping[Any, Any],
        observation: Observation,
        *,
        ee_offset_m: tuple[float, ...],
        control_rate_hz: float,
        tool_offset_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> np.ndarray:
        """Convert a reply to actions, (horizon, dim) float64 in the rule's action space.

        Actions with non-finite values remain non-finite, so that they can be detected later.

        Args:
            reply: Decoded reply of the policy.
            observation: Observation to which the policy replied. Its tool rotation defines the tool frame.
            ee_offset_m: Offset that was added to the end-effector position in the observation [m]. It is subtracted
                from absolute positions.
            control_rate_hz: Control rate of the run [Hz].
            tool_offset_m: Position of the policy's tool point in betterbench's tool frame [m]. Absolute poses are
                converted to betterbench's tool point.

        Raises:
            PolicyError: If the reply lacks an array that the rule reads, or contains an invalid rotation.
        """
        arrays = {key: _rows(reply, key, width) for key, width in self.columns.items()}
        lengths = {len(a) for a in arrays.values()}
        if len(lengths) > 1:
            told = ", ".join(f"{'/'.join(k)}: {len(a)}" for k, a in arrays.items())
            raise PolicyError(f"the reply's arrays have different lengths ({told}). All must have the same length.")
        taken: dict[str, np.ndarray] = {}
        at = dict.fromkeys(arrays, 0)
        for part in self.parts:
            begin = at[part.key]
            at[part.key] = begin + self._size(part)
            taken[part.kind] = arrays[part.key][:, begin : at[part.key]]
        if self.as_is:
            return taken["action"]
        for whole, axes in _BY_AXIS.items():
            if axes[0] in taken:
                taken[whole] = np.concatenate([taken.pop(axis) for axis in axes], axis=1)
        used = np.concatenate([v for k, v in taken.items() if k != "unused"], axis=1)
        bad = ~np.isfinite(used).all(axis=1)
        if self._is_plain:
            pieces = [taken["translation"], taken["rotation"]] if "translation" in taken else [taken["joints"]]
            return np.concatenate([*pieces, taken["gripper"]], axis=1)
        clean = {k: self._rounded(np.where(bad[:, None], 0.0, v)) for k, v in taken.items()}
        try:
            offsets = (ee_offset_m, tool_offset_m)
            actions = self._convert(clean, bad, observation, offsets, self._pace(control_rate_hz))
        except ValueError as error:
            raise PolicyError(f"the reply contains an invalid rotation ({error}). Send {self.rotation}.") from error
        actions = self._rounded(actions)
        actions[bad] = np.nan
        return actions

    def _rounded(self, numbers: np.ndarray) -> np.ndarray:
        """Round numbers to the type ``precision``, and return them as float64."""
        if self.precision == "float64":
            return numbers
        with np.errstate(over="ignore"):
            return numbers.astype(np.float32).astype(np.float64)

    @property
    def _means_ours(self) -> bool:
        """Whether the answer uses exactly the conventions of the action space."""
        plain = self.frame == "base" and self.step_rate_hz is None and self.precision == "float64"
        return plain and all(getattr(self, name) == own for name, own in own_conventions(self.space).items())

    @property
    def _is_plain(self) -> bool:
        """Whether the columns of the answer only need to be reordered, without converting any numbers."""
        if self.space in _DELTAS or self.space in WORLD_ACTION_SPACES:
            return self._means_ours
        plain = self.gripper == "close_positive" and self.step_rate_hz is None
        return plain and self.space == "joint_position"

    def _pace(self, control_rate_hz: float) -> float:
        """Return the duration of a control step of the run, divided by the step duration of the training data."""
        return 1.0 if self.step_rate_hz is None else self.step_rate_hz / control_rate_hz

    def _convert(
        self,
        taken: Mapping[str, np.ndarray],
        bad: np.ndarray,
        observation: Observation,
        offsets: tuple[tuple[float, ...], tuple[float, float, float]],
        pace: float,
    ) -> np.ndarray:
        scale = np.array(action_space(self.space).scale[:-1])
        gripper = self._close(taken["gripper"])
        if self.space in JOINT_SPACES:
            factor = self.joint_unit_rad * pace if self.space == "joint_delta" else 1.0
            return np.concatenate([taken["joints"] * (factor / scale), gripper], axis=1)
        rows = [row.tolist() for row in taken["rotation"]]
        if self.space in _OWN_ROTATION:
            gripper = -gripper if self.space in _OPENS_POSITIVE else gripper
            return np.concatenate([self._in_world(taken["translation"], rows, bad), gripper], axis=1)
        if self.space == "ee_pose":
            zero = from_format((0.0,) * 3, "axis_angle")
            turns = [zero if b else from_format(row, self.rotation) for row, b in zip(rows, bad, strict=True)]
            own = np.array([rotate(turn, offsets[1]) for turn in turns]) + np.array(offsets[0])
            return np.concatenate([taken["translation"] - own, turns, gripper], axis=1)
        if self.frame == "base" and self.rotation == "axis_angle":
            # Multiply by a single factor, which is exactly 1 if the answer uses the units of the action space.
            units = np.array([self.translation_unit_m] * 3 + [self.rotation_unit_rad] * 3)
            twist = np.concatenate([taken["translation"], taken["rotation"]], axis=1)
            return np.concatenate([twist * (units * pace / scale), gripper], axis=1)
        translation = taken["translation"] * (self.translation_unit_m * pace)
        rotation = np.zeros((len(rows), 3))
        for i, row in enumerate(rows):
            if bad[i]:
                continue
            if self.rotation == "axis_angle":  # only in the tool frame; the base frame is handled above
                rotation[i] = np.multiply(row, self.rotation_unit_rad)
            elif self.rotation == "rpy":
                rotation[i] = to_axis_angle(from_format([v * self.rotation_unit_rad for v in row], "rpy"))
            else:
                rotation[i] = to_axis_angle(from_format(row, self.rotation))
        rotation *= pace
        if self.frame == "tool":
            self._to_base(translation, rotation, observation)
        return np.concatenate([np.concatenate([translation, rotation], axis=1) / scale, gripper], axis=1)

    def _in_world(self, translation: np.ndarray, rows: list[list[float]], bad: np.ndarray) -> np.ndarray:
        """Return the translations and rotations in the format of a LIBERO or CALVIN action, as (horizon, 6 or 7)."""
        if self.space in _ADDS_ANGLES:
            scale = action_space(self.space).scale
            moves = translation * (self.translation_unit_m / scale[0])
            return np.concatenate([moves, np.array(rows) * (self.rotation_unit_rad / scale[3])], axis=1)
        own = _OWN_ROTATION[self.space]
        if self.rotation == own:
            return np.concatenate([translation, np.array(rows)], axis=1)
        blank = [0.0] * ROTATION_SIZES[own]
        turns = [
            blank if b else to_format(from_format(row, self.rotation), own) for row, b in zip(rows, bad, strict=True)
        ]
        return np.concatenate([translation, np.array(turns)], axis=1)

    def _to_base(self, translation: np.ndarray, rotation: np.ndarray, observation: Observation) -> None:
        """Rotate deltas (horizon, 3) from the tool frame to the base frame, in place.

        Each delta is given in the tool frame after all previous deltas have been executed.
        """
        tool = from_format(observation.ee_quaternion.tolist(), "quaternion_wxyz")
        for i in range(len(translation)):
            turn = from_axis_angle(rotation[i].tolist())
            translation[i] = rotate(tool, translation[i].tolist())
            rotation[i] = rotate(tool, rotation[i].tolist())
            tool = multiply(tool, turn)

    def _close(self, gripper: np.ndarray) -> np.ndarray:
        """Convert the gripper column so that positive values close the gripper."""
        if self.gripper == "close_positive":
            return gripper
        if self.gripper == "open_positive":
            return -gripper
        if self.gripper in ("closed_linear", "open_linear"):
            return 2.0 * gripper - 1.0 if self.gripper == "closed_linear" else 1.0 - 2.0 * gripper
        if self.gripper == "open_sign":
            signs: np.ndarray = np.sign(1.0 - 2.0 * gripper)
            return signs
        if self.gripper == "closed_at_least":
            return np.where(gripper >= self.gripper_threshold, 1.0, -1.0)
        above = np.where(gripper > self.gripper_threshold, 1.0, -1.0)
        return above if self.gripper == "closed_fraction" else -above

    def write(
        self,
        actions: np.ndarray,
        observation: Observation,
        *,
        ee_offset_m: tuple[float, ...],
        control_rate_hz: float,
        tool_offset_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> dict[tuple[str, ...], np.ndarray]:
        """Convert actions to the arrays of a reply, each (horizon, columns) float64, by path.

        This method is the inverse of :meth:`read`.
        """
        given = np.asarray(actions, dtype=np.float64)
        scale, pace = np.array(action_space(self.space).scale[:-1]), self._pace(control_rate_hz)
        body, gripper = given[:, :-1], given[:, -1:]
        closing = -gripper if self.space in _OPENS_POSITIVE else gripper
        kinds: dict[str, np.ndarray] = {"gripper": self._as_policy(closing)}
        if self.as_is:
            kinds["action"] = given
        elif self.space in _ADDS_ANGLES:
            kinds["translation"] = (body * scale)[:, :3] / self.translation_unit_m
            kinds["rotation"] = (body * scale)[:, 3:] / self.rotation_unit_rad
        elif self.space in _OWN_ROTATION:
            own = _OWN_ROTATION[self.space]
            kinds["translation"] = body[:, :3]
            kinds["rotation"] = np.array([to_format(from_format(q.tolist(), own), self.rotation) for q in body[:, 3:]])
        elif self.space in JOINT_SPACES:
            factor = self.joint_unit_rad * pace if self.space == "joint_delta" else 1.0
            kinds["joints"] = body * (scale / factor)
        elif self.space == "ee_pose":
            turns = [from_format(q.tolist(), "quaternion_wxyz") for q in body[:, 3:]]
            offset = np.array([rotate(turn, tool_offset_m) for turn in turns]) + np.array(ee_offset_m)
            kinds["translation"] = body[:, :3] + offset
            kinds["rotation"] = np.array([to_format(q.tolist(), self.rotation) for q in body[:, 3:]])
        else:
            moves, turns = (body * scale)[:, :3], (body * scale)[:, 3:]
            if self.frame == "tool":
                self._to_tool(moves, turns, observation)
            kinds["translation"] = moves / (self.translation_unit_m * pace)
            kinds["rotation"] = self._turns(turns / pace)
        for whole, axes in _BY_AXIS.items():
            if whole in kinds:
                kinds |= {axis: kinds[whole][:, i : i + 1] for i, axis in enumerate(axes)}
        columns: dict[tuple[str, ...], list[np.ndarray]] = {}
        for part in self.parts:
            blank = np.zeros((len(given), self._size(part)))
            columns.setdefault(part.key, []).append(kinds.get(part.kind, blank))
        return {key: np.concatenate(parts, axis=1) for key, parts in columns.items()}

    def _to_tool(self, translation: np.ndarray, rotation: np.ndarray, observation: Observation) -> None:
        """Rotate deltas (horizon, 3) from the base frame to the tool frame, in place."""
        tool = from_format(observation.ee_quaternion.tolist(), "quaternion_wxyz")
        for i in range(len(translation)):
            translation[i] = rotate(conjugate(tool), translation[i].tolist())
            rotation[i] = rotate(conjugate(tool), rotation[i].tolist())
            tool = multiply(tool, from_axis_angle(rotation[i].tolist()))

    def _turns(self, vectors: np.ndarray) -> np.ndarray:
        if self.rotation == "axis_angle":
            return vectors / self.rotation_unit_rad
        forms = np.array([to_format(from_axis_angle(v.tolist()), self.rotation) for v in vectors])
        return forms / self.rotation_unit_rad if self.rotation == "rpy" else forms

    def _as_policy(self, gripper: np.ndarray) -> np.ndarray:
        if self.gripper == "close_positive":
            return gripper
        if self.gripper == "open_positive":
            return -gripper
        if self.gripper in ("closed_linear", "open_linear", "open_sign"):
            share = 0.5 * (1.0 + gripper)
            return share if self.gripper == "closed_linear" else 1.0 - share
        beyond: np.ndarray = gripper > 0.0 if self.gripper in ("closed_fraction", "closed_at_least") else gripper <= 0.0
        return np.where(beyond, 1.0, 0.0 if self.gripper_threshold > 0.0 else -1.0)


def twist(*keys: str) -> tuple[AnswerPart, ...]:
    """Return the parts of an answer that consists of translation, rotation and gripper.

    Args:
        *keys: Name of the array that contains all parts, or the names of three arrays with one part each.
    """
    translation, rotation, gripper = keys * 3 if len(keys) == 1 else keys
    return (
        AnswerPart((translation,), "translation"),
        AnswerPart((rotation,), "rotation"),
        AnswerPart((gripper,), "gripper"),
    )


def own_conventions(space: str) -> dict[str, Any]:
    """Return the rotation format, units and gripper convention of an action space, by field of :class:`AnswerRule`.

    Raises UnknownNameError if the action space is unknown.
    """
    scale = action_space(space).scale
    added = space in _ADDS_ANGLES
    return {
        "rotation": _OWN_ROTATION.get(space, "axis_angle"),
        "translation_unit_m": scale[0] if added else TRANSLATION_PER_UNIT_M,
        "rotation_unit_rad": scale[3] if added else ROTATION_PER_UNIT_RAD,
        "gripper": "open_positive" if space in _OPENS_POSITIVE else "close_positive",
    }


def get_entry(reply: Mapping[Any, Any], key: tuple[str, ...]) -> object:
    """Return the value at a path in a reply. Raises PolicyError, which lists the existing keys, if it is missing."""
    found: object = reply
    for name in key:
        if not isinstance(found, Mapping) or name not in found:
            there = "no map"
            if isinstance(found, Mapping):
                there = ", ".join(sorted(one_line(k, most=40) for k in found)[:20])
            raise PolicyError(
                f"the reply has no {'/'.join(key)!r}. It has: {there or 'nothing'}. "
                "Choose another preset, or correct the adapter."
            )
        found = found[name]
    return found


def number_array(given: object) -> np.ndarray:
    """Convert a value in an answer to an array.

    Return an array of dtype object if the value contains booleans or lists of unequal length, so that callers reject
    it.
    """
    try:
        return np.asarray(None) if _holds_truths(given) else np.asarray(given)
    except ValueError:
        return np.asarray(None)


def _holds_truths(given: object) -> bool:
    """Return whether nested lists or an array contain booleans, which NumPy would convert to 0 and 1."""
    if isinstance(given, list | tuple):
        return any(isinstance(item, bool | np.bool_) or _holds_truths(item) for item in given)
    return isinstance(given, np.ndarray) and given.dtype.kind == "b"


def _rows(reply: Mapping[Any, Any], key: tuple[str, ...], width: int) -> np.ndarray:
    """Return the array at a path in a reply as (horizon, width) float64."""
    name, given = "/".join(key), get_entry(reply, key)
    array = number_array(given)
    if array.dtype.kind not in "fiu":
        kind = array.dtype if isinstance(given, np.ndarray) else type(given).__name__
        raise PolicyError(f"the reply's {name!r} is not an array of real numbers ({kind}). Send float32 or float64.")
    shape = array.shape
    while array.ndim > 2 and array.shape[0] == 1:
        array = array[0]
    if array.ndim == 1:
        array = array[:, None] if width == 1 else array[None]
    if array.ndim != 2 or array.shape[1] != width:
        raise PolicyError(
            f"the reply's {name!r} has shape {shape}, but the adapter reads ({width},) or (horizon, {width}). "
            "Choose another preset, or correct the adapter."
        )
    if len(array) == 0:
        raise PolicyError(f"the reply's {name!r} is an empty chunk of shape {shape}. Send at least one action.")
    with np.errstate(invalid="ignore"):  # suppress the warning for signaling NaNs; NaNs are handled later
        return array.astype(np.float64)
