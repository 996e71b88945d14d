"""Action spaces, which declare the meaning of each number in an action. Policy handshakes compare these declarations.

The last number of every action controls the gripper. In most action spaces, a positive number closes the gripper, a
negative number opens it, and zero keeps the last commanded width. Only the sign matters, and the fingers move at a
finite speed. LIBERO and robosuite policies expect the same convention (robosuite adds ``sign(action)`` times a speed to
the commanded width at every control step). CALVIN's own action spaces use the opposite sign (:data:`CALVIN_RELATIVE`)
and are available only in CALVIN. LeRobot's action spaces for the SO-101 set the opening width directly
(:data:`OPENING_SPACES`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NoReturn

import numpy as np

from betterbench.errors import InvalidActionError, InvalidInputError, UnknownNameError

TRANSLATION_PER_UNIT_M = 0.05
"""Translation per action unit [m]: the output scale of robosuite's OSC_POSE controller in LIBERO."""

ROTATION_PER_UNIT_RAD = 0.5
"""Rotation per action unit [rad]: the output scale of the same controller for rotation vectors."""

JOINT_STEP_PER_UNIT_RAD = 0.1
"""Joint step per action unit [rad].

At 20 Hz, this gives 2.0 rad/s, just below the velocity limit of the slowest Panda joint (2.175 rad/s).
"""

CONTROL_RATE_HZ = 20.0
"""Number of actions per second in betterbench's own scenes [Hz]. Other worlds have their own control rates."""

USUAL_ROBOT = "panda"
"""Robot that is used by scenes, plans and files that do not name a robot."""

PANDA_OPENING_M = 0.08
"""Largest opening width of the gripper of a Franka Panda [m]."""

GRIPPER_CONVENTION = (
    "gripper: negative opens, positive closes, zero keeps the last commanded width; only the sign counts"
)


@dataclass(frozen=True, slots=True)
class ActionSpace:
    """Declaration of the meaning of each number in an action.

    Attributes:
        name: Name of the action space ("ee_delta").
        components: Name of each number, in order. The last one is always "gripper".
        units: Unit of each number after multiplication by its scale ("m", "rad", "1").
        low: Smallest allowed value of each number. Smaller values are clipped, except in CALVIN (:attr:`clips`).
        high: Largest allowed value of each number. Larger values are clipped, except in CALVIN.
        scale: Factor that converts each number to its unit in ``units``.
        convention: Description of the frame, the reference and the polarity. Descriptions are compared at every
            handshake.
    """

    name: str
    components: tuple[str, ...]
    units: tuple[str, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    scale: tuple[float, ...]
    convention: str

    def __post_init__(self) -> None:
        """Raise InvalidInputError if a field does not have one entry per component, or if a bound is invalid."""
        where = f"action space {self.name!r}"
        for part in ("units", "low", "high", "scale"):
            if len(getattr(self, part)) != len(self.components):
                raise InvalidInputError(
                    where,
                    f"{part} has {len(getattr(self, part))} entries for {len(self.components)} components",
                    "Use one entry per component",
                )
        if not all(
            math.isfinite(lo) and math.isfinite(hi) and lo < hi for lo, hi in zip(self.low, self.high, strict=True)
        ):
            raise InvalidInputError(
                where, "a lower bound is not below its upper bound", "Use finite bounds with low < high"
            )

    @property
    def dim(self) -> int:
        """Number of components of an action."""
        return len(self.components)

    @property
    def neutral(self) -> np.ndarray | None:
        """Action (dim,) that keeps the robot still in every state, or None if there is no such action."""
        return np.zeros(self.dim) if self.is_delta and self.name not in WORLD_ACTION_SPACES else None

    @property
    def is_delta(self) -> bool:
        """Whether actions are relative (zero means no motion) rather than absolute targets."""
        return self.name in _DELTAS

    @property
    def clips(self) -> bool:
        """Whether out-of-bounds numbers are clipped. In CALVIN's action spaces, they are only counted."""
        return self.name not in WORLD_ACTION_SPACES

    def clip(self, action: object) -> np.ndarray:
        """Check an action, and return it as a new (dim,) float64 array.

        If the action space clips (:attr:`clips`), numbers out of bounds are moved to the nearest bound. Clipping is
        idempotent, so replaying a recorded action gives the same result.

        Raises:
            InvalidActionError: If the shape or type is wrong, or if a number is not finite.
        """
        given = action if isinstance(action, np.ndarray) else _as_array(action, self.name)
        if given.dtype.kind not in "fiu":
            raise InvalidActionError(
                f"{self.name} action: expected real numbers, got {given.dtype}. Send float32 or float64."
            )
        if given.shape != (len(self.components),):
            raise InvalidActionError(
                f"{self.name} action: expected shape ({self.dim},), got {given.shape}. "
                f"Send one action of {self.dim} numbers: {', '.join(self.components)}."
            )
        # A plain loop over floats takes 1 us. An array operation takes 3 us, because the CPU caches are cold between
        # two physics steps. A combination of `all` and `map` takes twice as long as the loop.
        values: list[float] = given.tolist()
        for value, low, high in zip(values, self.low, self.high, strict=True):
            if not low <= value <= high:
                break
        else:
            return given.astype(np.float64)
        for i, (value, low, high) in enumerate(zip(values, self.low, self.high, strict=True)):
            if not low <= value <= high:
                if not math.isfinite(value):
                    self._refuse(values)
                if self.clips:
                    values[i] = low if value < low else high
        return np.array(values, dtype=np.float64)

    def count_clipped(self, actions: np.ndarray) -> int:
        """Return the number of actions (n, dim) with at least one component out of bounds."""
        if not len(actions):
            return 0
        outside = (actions < np.array(self.low)) | (actions > np.array(self.high))
        return int(outside.any(axis=1).sum())

    def _refuse(self, values: list[float]) -> NoReturn:
        """Raise InvalidActionError with the names of the components that are not finite."""
        bad = ", ".join(f"{c} = {v}" for c, v in zip(self.components, values, strict=True) if not math.isfinite(v))
        raise InvalidActionError(f"{self.name} action: {bad}. Send only finite numbers.")

    def to_json(self) -> dict[str, Any]:
        """Return the action space in JSON form, which is also used in policy handshakes."""
        return {
            "name": self.name,
            "components": list(self.components),
            "units": list(self.units),
            "low": list(self.low),
            "high": list(self.high),
            "scale": list(self.scale),
            "convention": self.convention,
        }

    @classmethod
    def from_json(cls, form: Mapping[str, Any]) -> ActionSpace:
        """Read an action space from the JSON form that :meth:`to_json` returns.

        Raises InvalidInputError if a field is missing or has a wrong type.
        """
        try:
            texts = {name: tuple(str(v) for v in form[name]) for name in ("components", "units")}
            numbers = {name: tuple(float(v) for v in form[name]) for name in ("low", "high", "scale")}
            return cls(name=str(form["name"]), convention=str(form["convention"]), **texts, **numbers)  # type: ignore[arg-type]
        except (KeyError, TypeError, ValueError) as error:
            raise InvalidInputError(
                "action space", f"{error} is missing or malformed", "Pass the JSON that ActionSpace.to_json writes"
            ) from error


def _as_array(action: object, name: str) -> np.ndarray:
    """Convert a sequence to an array. Raises InvalidActionError if this is not possible."""
    try:
        return np.asarray(action)
    except (TypeError, ValueError) as error:
        raise InvalidActionError(
            f"{name} action: expected an array of numbers ({error}). Send a flat numpy array."
        ) from error


_TWIST = ("x", "y", "z", "rx", "ry", "rz", "gripper")
_JOINTS = (*(f"joint{i}" for i in range(1, 8)), "gripper")


def _twist(name: str, reference: str) -> ActionSpace:
    """Return an action space in which actions add a translation and a rotation vector to a reference pose."""
    return ActionSpace(
        name=name,
        components=_TWIST,
        units=("m", "m", "m", "rad", "rad", "rad", "1"),
        low=(-1.0,) * 7,
        high=(1.0,) * 7,
        scale=(TRANSLATION_PER_UNIT_M,) * 3 + (ROTATION_PER_UNIT_RAD,) * 3 + (1.0,),
        convention=(
            f"base frame; translation, then rotation vector about base axes, both added to the {reference}; "
            f"{GRIPPER_CONVENTION}"
        ),
    )


EE_DELTA = _twist("ee_delta", "last commanded pose, which leads the measured pose by a bounded distance")

EE_DELTA_MEASURED = _twist("ee_delta_measured", "measured pose")

EE_POSE = ActionSpace(
    name="ee_pose",
    components=("x", "y", "z", "qw", "qx", "qy", "qz", "gripper"),
    units=("m", "m", "m", "1", "1", "1", "1", "1"),
    # This box contains a ball with the reach of the Panda (0.855 m to the flange, Franka's data sheet) plus the tool.
    low=(-1.2, -1.2, -0.5, -1.0, -1.0, -1.0, -1.0, -1.0),
    high=(1.2, 1.2, 1.5, 1.0, 1.0, 1.0, 1.0, 1.0),
    scale=(1.0,) * 8,
    convention=(
        "base frame; absolute pose of the tool center point as position and quaternion (w, x, y, z), "
        f"normalized when applied; {GRIPPER_CONVENTION}"
    ),
)

JOINT_POSITION = ActionSpace(
    name="joint_position",
    components=_JOINTS,
    units=("rad",) * 7 + ("1",),
    # The joint limits of the Panda are narrower than these bounds. The controller enforces them.
    low=(-math.pi,) * 7 + (-1.0,),
    high=(math.pi,) * 3 + (math.pi,) * 2 + (4.0, math.pi, 1.0),
    scale=(1.0,) * 8,
    convention=f"absolute joint angles, base to flange; {GRIPPER_CONVENTION}",
)

JOINT_DELTA = ActionSpace(
    name="joint_delta",
    components=_JOINTS,
    units=("rad",) * 7 + ("1",),
    low=(-1.0,) * 8,
    high=(1.0,) * 8,
    scale=(JOINT_STEP_PER_UNIT_RAD,) * 7 + (1.0,),
    convention=f"joint steps, base to flange, added to the last commanded joint angles; {GRIPPER_CONVENTION}",
)

ACTION_SPACES: dict[str, ActionSpace] = {
    space.name: space for space in (EE_DELTA, EE_DELTA_MEASURED, EE_POSE, JOINT_POSITION, JOINT_DELTA)
}
"""Action spaces of betterbench's own scenes that do not depend on the motors of a specific robot."""

SO101_MOTORS = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")
"""Motors of the SO-101 as LeRobot names them, in the order of LeRobot's states and actions. The gripper is last."""
_SO101_RANGES = (1.91986, 1.74533, 1.69, 1.65806, math.pi)
"""Largest angle of each arm joint from the middle of its calibrated range [rad].

Source: TheRobotStudio's model with the new calibration. LeRobot calibrates ``wrist_roll`` as a full turn.
"""

_SO101_CALIBRATION = (
    "absolute positions of the motors as LeRobot's so101_follower names them, new calibration: zero in the middle of "
    "each joint's range; gripper: absolute opening, 0 closed to 100 fully open"
)


def _so101(name: str, units: tuple[float, ...], bounds: tuple[float, ...], meaning: str) -> ActionSpace:
    """Return an action space of the SO-101. ``units`` is the size of one unit of each arm component [rad]."""
    return ActionSpace(
        name=name,
        components=tuple(f"{motor}.pos" for motor in SO101_MOTORS),
        units=("rad",) * 5 + ("1",),
        low=(*(-bound for bound in bounds), 0.0),
        high=(*bounds, 100.0),
        scale=(*units, 0.01),
        convention=f"{meaning}; {_SO101_CALIBRATION}",
    )


SO101_DEGREES = _so101(
    "so101_degrees", (math.pi / 180.0,) * 5, tuple(math.degrees(most) for most in _SO101_RANGES), "arm in degrees"
)
"""Action space of LeRobot's ``so101_follower`` with ``use_degrees=True`` (``MotorNormMode.DEGREES``)."""

SO101_NORMALIZED = _so101(
    "so101_normalized",
    tuple(most / 100.0 for most in _SO101_RANGES),
    (100.0,) * 5,
    "arm from -100 to 100 over each joint's calibrated range",
)
"""Action space of LeRobot's ``so101_follower`` with ``use_degrees=False`` (``MotorNormMode.RANGE_M100_100``)."""

ROBOT_ACTION_SPACES: dict[str, ActionSpace] = {space.name: space for space in (SO101_DEGREES, SO101_NORMALIZED)}
"""Action spaces of betterbench's own scenes that use the motor units of a specific robot."""

JOINT_SPACES = frozenset({JOINT_POSITION.name, JOINT_DELTA.name, *ROBOT_ACTION_SPACES})
"""Action spaces with one number per arm joint."""

OPENING_SPACES = frozenset(ROBOT_ACTION_SPACES)
"""Action spaces whose gripper component sets the opening width instead of a direction of motion."""

PLANNED_SPACES = (EE_DELTA.name, JOINT_POSITION.name, *ROBOT_ACTION_SPACES)
"""Action spaces to which planned ``ee_delta`` motions can be converted: ``ee_delta`` itself, and spaces of absolute
joint angles.
"""

OWN_SPACES = (*ACTION_SPACES, *ROBOT_ACTION_SPACES)
"""All action spaces that betterbench's own scenes support."""

CALVIN_RELATIVE = ActionSpace(
    name="calvin_relative",
    components=("x", "y", "z", "roll", "pitch", "yaw", "gripper"),
    units=("m", "m", "m", "rad", "rad", "rad", "1"),
    low=(-1.0,) * 7,
    high=(1.0,) * 7,
    scale=(0.02,) * 3 + (0.05,) * 3 + (1.0,),
    convention=(
        "CALVIN's world frame; translation, then angles about the fixed axes x, y, z, each added to that of the last "
        "target; gripper: positive opens, anything else closes"
    ),
)
"""CALVIN's relative actions (calvin_env@797142c, ``robot/robot.py``: ``relative_to_absolute``, ``max_rel_pos``,
``max_rel_orn``). The gripper value is 1 or -1, as in CALVIN's wrapper ``play_lmp_wrapper.py``.
"""

_UNBOUNDED = 1000.0
"""Bound of components that a world does not clip. Larger values cannot be positions or angles and are rejected."""

_CALVIN_GRIPPER = "gripper: positive opens, anything else closes"


def _calvin(name: str, rotation: tuple[str, ...], convention: str) -> ActionSpace:
    """Return an action space of CALVIN, in meters and radians and without clipping."""
    components = ("x", "y", "z", *rotation, "gripper")
    units = ("m",) * 3 + ("rad" if len(rotation) == len("xyz") else "1",) * len(rotation) + ("1",)
    bound = (_UNBOUNDED,) * len(components)
    low = tuple(-v for v in bound)
    return ActionSpace(
        name, components, units, low, bound, (1.0,) * len(components), f"{convention}; {_CALVIN_GRIPPER}"
    )


CALVIN_ABSOLUTE = _calvin(
    "calvin_absolute",
    ("roll", "pitch", "yaw"),
    "CALVIN's world frame; absolute position, then angles about the fixed axes x, y, z",
)
"""CALVIN's absolute actions with Euler angles (calvin_env@797142c, ``robot/robot.py``: ``apply_action`` with three
parts).
"""

CALVIN_ABSOLUTE_QUATERNION = _calvin(
    "calvin_absolute_quaternion",
    ("qx", "qy", "qz", "qw"),
    "CALVIN's world frame; absolute position, then a quaternion (x, y, z, w)",
)
"""CALVIN's absolute actions with a quaternion in the order of PyBullet (x, y, z, w)."""

CALVIN_DELTA = _calvin(
    "calvin_delta",
    ("roll", "pitch", "yaw"),
    "CALVIN's world frame; meters and angles about the fixed axes x, y, z, added to the last commanded pose, which is "
    "the measured one where an instruction begins; the sum is executed as an absolute pose",
)
"""Delta actions, accumulated in the same way as in vla-evaluation-harness (``benchmarks/calvin/benchmark.py``:
``_process_delta_action``). Angles are kept in [-pi, pi), and the pose is rounded to float32 before it is applied.
"""

LIBERO_ABSOLUTE = ActionSpace(
    name="libero_absolute",
    components=_TWIST,
    units=("m", "m", "m", "rad", "rad", "rad", "1"),
    low=(-_UNBOUNDED,) * 7,
    high=(_UNBOUNDED,) * 7,
    scale=(1.0,) * 7,
    convention=(
        "LIBERO's world frame; absolute position of the controller's tool point, then its rotation vector; "
        f"{GRIPPER_CONVENTION}"
    ),
)
"""Absolute poses for robosuite's OSC_POSE controller with ``use_delta`` turned off after settling, as in X-VLA's client
and in vla-evaluation-harness (``absolute_action``) for LIBERO.
"""

WORLD_ACTION_SPACES: dict[str, ActionSpace] = {
    space.name: space
    for space in (CALVIN_RELATIVE, CALVIN_ABSOLUTE, CALVIN_ABSOLUTE_QUATERNION, CALVIN_DELTA, LIBERO_ABSOLUTE)
}
"""Action spaces of LIBERO and CALVIN that betterbench's own scenes do not support."""

PLAYED_IN: Mapping[str, tuple[str, ...]] = {
    "": (*ACTION_SPACES, *ROBOT_ACTION_SPACES),
    "libero": (EE_DELTA.name, LIBERO_ABSOLUTE.name),
    "calvin": tuple(name for name in WORLD_ACTION_SPACES if name.startswith("calvin_")),
}
"""Action spaces that each world supports, starting with the default. The empty name means betterbench's own scenes."""

_DELTAS = frozenset({EE_DELTA.name, EE_DELTA_MEASURED.name, JOINT_DELTA.name, CALVIN_RELATIVE.name, CALVIN_DELTA.name})


def action_space(name: str) -> ActionSpace:
    """Return the action space with the given name, either of betterbench's own scenes or of another world.

    Raises UnknownNameError if there is none.
    """
    known = ACTION_SPACES | ROBOT_ACTION_SPACES | WORLD_ACTION_SPACES
    try:
        return known[name]
    except KeyError:
        raise UnknownNameError("action space", name, known) from None
