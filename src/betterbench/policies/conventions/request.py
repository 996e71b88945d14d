"""Parsing and validation of requests to a betterbench policy server.

A request contains an observation in one of two layouts. The *native* layout (keys ``better/...``) contains the complete
:class:`Observation`. openpi's LIBERO layout contains two images, an eight-dimensional state and the instruction. It
lacks joint positions, which are therefore set to NaN, so that they cannot be mistaken for measurements.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from betterbench.errors import InvalidInputError
from betterbench.geometry import from_axis_angle
from betterbench.interface import EpisodeStart, Observation, episode_number
from betterbench.policies.conventions.adapter import Adapter
from betterbench.policies.conventions.image_rule import LARGEST_SIDE_PX
from betterbench.policies.conventions.proprioception import StateRule

if TYPE_CHECKING:  # policy processes must not import the tasks, which take long to load
    from betterbench.tasks import TrialId

_MOST_LISTS = 3
NATIVE_IMAGES = "better/images/"
_LARGEST = 2**31 - 1
_LARGEST_NUMBER = 1e6
"""Largest allowed absolute value of positions, angles and velocities [m, rad, m/s, rad/s].

The square of a much larger number would overflow.
"""
_MEASURED = {"joint_positions": None, "joint_velocities": None, "ee_position": 3, "ee_quaternion": 4}
"""Number of values of each measurement. None means one value per joint of the client's robot."""
_MOST_JOINTS = 32
_LIBERO_CAMERAS = {"observation/image": "front", "observation/wrist_image": "wrist"}


@dataclass(frozen=True, slots=True)
class Request:
    """Validated request of a client.

    Attributes:
        instruction: Instruction for the policy.
        step: Number of control steps since the reset, or None if the client does not send it.
        start: Start of the episode, or None if the client does not send it.
        trial: Trial that the client evaluates, or None if the client does not send it. Only experts need the trial.
        observation: Observation of the client, or None if the client sends neither joint positions nor a state.
        measured: Whether the observation contains joint positions. If so, the server compares them with its shadow
            simulation.
    """

    instruction: str
    step: int | None
    start: EpisodeStart | None
    trial: TrialId | None
    observation: Observation | None
    measured: bool


def read_request(message: Mapping[Any, Any]) -> Request:
    """Parse a request in the native layout or in openpi's LIBERO layout.

    Raises InvalidInputError if a field is missing or malformed. The message names the field.
    """
    message = {key: value for key, value in message.items() if isinstance(key, str)}
    instruction = message.get("prompt")
    if isinstance(instruction, np.ndarray) and instruction.size == 1 and instruction.dtype.kind == "U":
        instruction = instruction.item()  # openpi's transforms convert the prompt to an array
    if not isinstance(instruction, str) or not instruction.strip():
        raise InvalidInputError("prompt", "the instruction is missing", "Send the instruction as a string")
    step = None if "better/step" not in message else _whole(message["better/step"], "better/step")
    start, trial = None, None
    if "better/episode" in message:
        start, trial = _episode(message["better/episode"], instruction)
    native = any(key.startswith("better/joint") for key in message)
    if native:
        observation: Observation | None = _native(message, instruction, step or 0)
    elif "observation/state" in message:
        observation = _libero(message, instruction, step or 0)
    else:
        observation = None
    return Request(instruction, step, start, trial, observation, native)


def read_layout_request(message: Mapping[Any, Any], layout: Adapter) -> Request:
    """Parse a request in the layout of an adapter. Only the instruction and, if present, the control step are read.

    Raises InvalidInputError if one of them is missing or malformed. The message names the field.
    """
    instruction = _entry(message, layout.instruction.key)
    for _ in range(_MOST_LISTS):
        if isinstance(instruction, (list, tuple)) and len(instruction) == 1:
            instruction = instruction[0]
    if not isinstance(instruction, str) or not instruction.strip():
        where = "/".join(layout.instruction.key)
        raise InvalidInputError(
            where, "the instruction is missing", f"Send it in the format of the preset {layout.name}"
        )
    step = _whole(message["better/step"], "better/step") if "better/step" in message else None
    return Request(layout.instruction.read(instruction), step, None, None, None, measured=False)


def read_states(message: Mapping[Any, Any], layout: Adapter) -> list[tuple[StateRule, np.ndarray]]:
    """Return the states in a request in the layout of an adapter, each with its rule and its values (size,) float64.

    If all values of all states are zero, they are treated as placeholders, and the result is an empty list. Raises
    InvalidInputError if a state is malformed. The message names the field.
    """
    found = []
    for rule in layout.states:
        sent = _entry(message, rule.key)
        if sent is not None:
            found.append((rule, _numbers(sent, "/".join(rule.key), rule.size)))
    return found if any(numbers.any() for _, numbers in found) else []


def _entry(message: Mapping[Any, Any], key: tuple[str, ...]) -> object:
    """Return the value at a path in a message, or None if there is none."""
    found: object = message
    for name in key:
        found = found.get(name) if isinstance(found, Mapping) else None
    return found


def _episode(form: object, instruction: str) -> tuple[EpisodeStart, TrialId | None]:
    """Parse the start of an episode, and the trial if the client sends it."""
    if not isinstance(form, Mapping):
        raise InvalidInputError(
            "better/episode", f"expected a map, got a {type(form).__name__}", "Send a map with action_space and episode"
        )
    trial = None
    if {"task", "condition", "seed"} & set(form):
        from betterbench.tasks import TrialId  # noqa: PLC0415 - needed only for experts

        seed = _whole(form.get("seed"), "better/episode: seed")
        trial = TrialId(_name(form, "task"), _name(form, "condition"), seed)
    number = form.get("episode", None if trial is None else episode_number(trial.seed))
    given = form.get("instruction", instruction)
    start = EpisodeStart(
        given if isinstance(given, str) else instruction,
        _whole(number, "better/episode: episode"),
        _name(form, "action_space"),
    )
    return start, trial


def _name(form: Mapping[Any, Any], key: str) -> str:
    value = form.get(key)
    if not isinstance(value, str):
        raise InvalidInputError(f"better/episode: {key}", "expected a string", "Send the name as a string")
    return value


def _native(message: Mapping[str, Any], instruction: str, step: int) -> Observation:
    numbers = {name: _numbers(message.get(f"better/{name}"), f"better/{name}", n) for name, n in _MEASURED.items()}
    joints, speeds = (len(numbers[f"joint_{name}"]) for name in ("positions", "velocities"))
    if joints != speeds:
        problem = f"expected {joints} numbers, one per joint position, got {speeds}"
        raise InvalidInputError("better/joint_velocities", problem, "Send one position and one velocity per joint")
    if np.signbit(numbers["ee_quaternion"][0]):
        numbers["ee_quaternion"] *= -1.0  # the same rotation with w >= 0, as in all observations
    return Observation(
        instruction=instruction,
        step=step,
        images={
            key.removeprefix(NATIVE_IMAGES): _image(value, key)
            for key, value in message.items()
            if key.startswith(NATIVE_IMAGES)
        },
        gripper_width=float(_numbers(message.get("better/gripper_width"), "better/gripper_width", 1)[0]),
        depth={},
        masks={},
        native={},
        **numbers,
    )


def _libero(message: Mapping[str, Any], instruction: str, step: int) -> Observation:
    state = _numbers(message["observation/state"], "observation/state", 8)
    unknown = np.full(7, math.nan)  # LIBERO's robot is a Panda with seven joints
    return Observation(
        instruction=instruction,
        step=step,
        images={name: _image(message[key], key) for key, name in _LIBERO_CAMERAS.items() if key in message},
        joint_positions=unknown,
        joint_velocities=unknown.copy(),
        ee_position=state[:3],
        ee_quaternion=np.array(from_axis_angle(state[3:6].tolist())),
        # The two finger positions of LIBERO's gripper have opposite signs.
        gripper_width=float(state[6] - state[7]),
        depth={},
        masks={},
    )


def _whole(value: object, where: str) -> int:
    if isinstance(value, np.ndarray) and value.size == 1:
        value = value.item()
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or not 0 <= int(value) <= _LARGEST:
        raise InvalidInputError(where, f"{str(value)[:40]!r} is not an integer ≥ 0", "Send an integer")
    return int(value)


def _numbers(value: object, where: str, count: int | None) -> np.ndarray:
    """Convert a value to a flat float64 array, and check that it contains plausible measurements of a robot.

    All values must be finite and within the allowed range. ``count`` is the required number of values. With None, from
    1 to 32 values are accepted, one per joint.
    """
    try:
        array = np.array(value, dtype=np.float64).reshape(-1)  # a copy: received arrays are read-only
    except (TypeError, ValueError, OverflowError):
        array = np.full(0, math.nan)
    fits = 1 <= len(array) <= _MOST_JOINTS if count is None else len(array) == count
    if not fits or not np.isfinite(array).all():
        wanted, shape = (
            ("one finite number per joint", "joints") if count is None else (f"{count} finite numbers", count)
        )
        raise InvalidInputError(where, f"expected {wanted}", f"Send a float array of shape ({shape},)")
    if np.abs(array).max(initial=0.0) > _LARGEST_NUMBER:
        problem = f"the value {array[np.abs(array).argmax()]:g} is out of range"
        raise InvalidInputError(where, problem, "Send values in meters and radians")
    return array


def _image(value: object, where: str) -> np.ndarray:
    if (
        not isinstance(value, np.ndarray)
        or value.dtype != np.uint8
        or value.ndim != 3
        or value.shape[2] != 3
        or not 1 <= min(value.shape[:2]) <= max(value.shape[:2]) <= LARGEST_SIDE_PX
    ):
        found = f"{value.dtype} {value.shape}" if isinstance(value, np.ndarray) else type(value).__name__
        raise InvalidInputError(where, f"got {found}", "Send an upright RGB image, (height, width, 3) uint8")
    return value.copy()  # received arrays are read-only, and a policy may modify them
