"""Adapters, which convert observations to a policy's inputs and a policy's answers to actions.

An adapter consists of data only, so users can write one as a JSON file.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import TypeAdapter

from betterbench.errors import InvalidInputError, PolicyError, UnknownNameError
from betterbench.interface import EpisodeStart, Observation
from betterbench.interface.actions import CONTROL_RATE_HZ, PANDA_OPENING_M
from betterbench.json_form import NO_TRUTH, read_bounded, read_form, strict_form
from betterbench.policies.conventions.answers import AnswerRule
from betterbench.policies.conventions.image_rule import EVERY_CAMERA, ImageRule
from betterbench.policies.conventions.proprioception import StateRule

if TYPE_CHECKING:  # policy processes must not import the tasks, which take long to load
    from betterbench.tasks import TrialId


@strict_form
@dataclass(frozen=True, slots=True)
class InstructionRule:
    """Format of the instruction in a request.

    Attributes:
        key: Path of the instruction in the request.
        depth: Nesting of the instruction: 0 for a string, 1 for a list of one string (batch), 2 for a list of lists
            (batch, time).
        template: Prompt template of the training data, in which ``{}`` is replaced by the instruction.
    """

    key: tuple[str, ...]
    depth: Annotated[Literal[0, 1, 2], NO_TRUTH] = 0
    template: str = "{}"

    def __post_init__(self) -> None:
        """Check that the template contains ``{}`` exactly once."""
        if self.template.count("{}") != 1:
            raise InvalidInputError(
                f"instruction {'/'.join(self.key)}: template",
                f"{self.template!r} does not contain {{}}",
                "Write {} once in the template",
            )

    def write(self, instruction: str) -> str:
        """Insert an instruction into the template."""
        return self.template.replace("{}", instruction)

    def read(self, text: str) -> str:
        """Extract the instruction from a text. If the text does not match the template, return the text unchanged."""
        before, _, after = self.template.partition("{}")
        follows = text.startswith(before) and text.endswith(after) and len(text) > len(before) + len(after)
        return text[len(before) : len(text) - len(after)] if follows else text


@strict_form
@dataclass(frozen=True, slots=True)
class ConstantRule:
    """Request entry with a constant value, such as the name of the normalization statistics.

    Attributes:
        key: Path of the entry in the request.
        value: Value of the entry. With None, there is no safe default, and the policy address must set the value with
            ``send.KEY=VALUE``.
    """

    key: tuple[str, ...]
    value: bool | int | float | str | None = None


@strict_form
@dataclass(frozen=True, slots=True)
class DepthRule:
    """Depth image that a policy uses as input, (height, width) float32 [m]. It is not resized."""

    key: tuple[str, ...]
    camera: str


@strict_form
@dataclass(frozen=True, slots=True)
class Feedback:
    """Rule that replaces the first values of a state input by the last executed action.

    The first request of an episode contains the measured state.

    Attributes:
        state_key: Path of the state in the request.
        answer_key: Path of the action array in the reply.
        size: Number of values that are replaced. The new values are the first values of the last executed action.
    """

    state_key: tuple[str, ...]
    answer_key: tuple[str, ...]
    size: int


@strict_form
@dataclass(frozen=True, slots=True)
class Adapter:
    """Conversion of observations to the inputs of a policy, and of the policy's answers to actions.

    An adapter does not normalize values. The policy server normalizes inputs and outputs itself.

    Attributes:
        name: Name of the adapter for messages.
        views: Image inputs of the policy.
        states: State inputs of the policy.
        instruction: Format of the instruction.
        answer: Rule that converts answers to actions.
        leading_axes: Number of leading axes of length 1 that are added to images and states: 1 for a batch axis, 2 for
            batch and time axes.
        ee_offset_m: Offset that is added to the end-effector position in the robot's base frame [m], for a policy whose
            positions have a different origin. For policies that use the world frame of LIBERO's table scenes, it is
            (-0.66, 0, 0.912) m.
        tool_offset_m: Position of the policy's tool point in betterbench's tool frame [m]. It is used for positions in
            states and for absolute poses, whereas deltas are applied at betterbench's tool point. LIBERO's tool point
            is 6.4 mm closer to the hand, at (0, 0, -0.0064) m.
        gripper_opening_m: Opening width of a fully open gripper [m].
        control_rate_hz: Control rate for which the policy was trained [Hz].
        episode_key: Path of the episode information in requests to betterbench's own servers, or None.
        constants: Request entries with constant values.
        depths: Depth images that the policy uses as inputs. The run must render them (``--observation calvin_depth``).
            GR00T does not use them.
        feedback: Rule that includes the last executed action in a state, or None. Only servers with ``POST /act`` use
            it.
        horizon: Default execution horizon, i.e. number of actions executed per chunk, as in the policy's own client.
            With None, the complete chunk is executed.
    """

    name: str
    views: tuple[ImageRule, ...]
    states: tuple[StateRule, ...]
    instruction: InstructionRule
    answer: AnswerRule = field(default_factory=AnswerRule)
    leading_axes: Annotated[Literal[0, 1, 2], NO_TRUTH] = 0
    ee_offset_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gripper_opening_m: float = PANDA_OPENING_M
    control_rate_hz: float = CONTROL_RATE_HZ
    episode_key: tuple[str, ...] | None = None
    tool_offset_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    horizon: int | None = None
    constants: tuple[ConstantRule, ...] = ()
    feedback: Feedback | None = None
    depths: tuple[DepthRule, ...] = ()

    def __post_init__(self) -> None:
        """Check that keys are unique, values are in range, and the feedback rule matches the state and the answer."""
        if self.feedback is not None:
            sizes = {rule.key: rule.size for rule in self.states}
            columns = self.answer.columns
            if self.feedback.size > min(
                sizes.get(self.feedback.state_key, 0), columns.get(self.feedback.answer_key, 0)
            ):
                raise InvalidInputError(
                    f"adapter {self.name}: feedback",
                    f"{self.feedback.size} numbers do not fit into the state "
                    f"{'/'.join(self.feedback.state_key)!r} and the answer "
                    f"{'/'.join(self.feedback.answer_key)!r}",
                    "Name a state and an answer that the adapter has, and a size that does not exceed either of them",
                )
        keys = [p.key for p in self.views] + [s.key for s in self.states] + [self.instruction.key]
        keys += [rule.key for rule in self.depths]
        keys += [] if self.episode_key is None else [self.episode_key]
        keys += [constant.key for constant in self.constants]
        for i, key in enumerate(keys):
            if not key or not all(key):
                raise InvalidInputError(
                    f"adapter {self.name}", "a key is empty", "Use a key with at least one name for each entry"
                )
            if any(key[: len(other)] == other or other[: len(key)] == key for other in keys[:i]):
                raise InvalidInputError(
                    f"adapter {self.name}",
                    f"two entries use the key {'/'.join(key)!r}",
                    "Use a different key for each entry",
                )
        for name in ("gripper_opening_m", "control_rate_hz"):
            if not 0.0 < getattr(self, name) < float("inf"):
                raise InvalidInputError(
                    f"adapter {self.name}: {name}", "the value is out of range", "Use a number greater than 0"
                )
        for name, offset in (("ee_offset_m", self.ee_offset_m), ("tool_offset_m", self.tool_offset_m)):
            if not all(abs(v) < 100.0 for v in offset):
                raise InvalidInputError(
                    f"adapter {self.name}: {name}", "the value is out of range", "Write the offset in meters"
                )
        if self.horizon is not None and self.horizon < 1:
            raise InvalidInputError(
                f"adapter {self.name}: horizon", f"{self.horizon} is out of range", "Use a number of at least 1"
            )

    @property
    def cameras(self) -> tuple[str, ...]:
        """Names of the required cameras, without duplicates. ``*`` means all cameras."""
        return tuple(dict.fromkeys([rule.camera for rule in self.views] + [rule.camera for rule in self.depths]))

    def images(self, observation: Observation) -> dict[tuple[str, ...], np.ndarray]:
        """Return the policy's image inputs, each (height, width, 3) uint8, by path in the request.

        Raises PolicyError if the run does not render a required camera.
        """
        shown = {}
        for rule in self.views:
            for camera in observation.images if rule.camera == EVERY_CAMERA else (rule.camera,):
                if camera not in observation.images:
                    there = ", ".join(observation.images) or "none"
                    raise PolicyError(
                        f"adapter {self.name} needs the camera {camera!r}, but the run renders {there}. Select "
                        "an observation that has this camera with --observation, or add "
                        f"camera.{'/'.join(rule.key)}=NAME to the policy's address."
                    )
                shown[rule.named(camera)] = rule.show(observation.images[camera])
        return shown

    def state(self, rule: StateRule, observation: Observation) -> np.ndarray | float | int:
        """Return a state input of the policy as an array (size,) of type ``rule.dtype``, or a number for a scalar."""
        return rule.read(
            observation,
            ee_offset_m=self.ee_offset_m,
            tool_offset_m=self.tool_offset_m,
            gripper_opening_m=self.gripper_opening_m,
        )

    def request(
        self, observation: Observation, start: EpisodeStart | None = None, trial: TrialId | None = None
    ) -> dict[str, Any]:
        """Convert an observation to a request. Keys that consist of several names become nested maps.

        If the adapter has an ``episode_key``, the request contains ``start`` and, for servers that run a shadow
        simulation (served experts), ``trial``. Raises PolicyError if the run does not render a required camera.
        """
        message: dict[str, Any] = {}
        for key, image in self.images(observation).items():
            set_entry(message, key, image.reshape((1,) * self.leading_axes + image.shape))
        for depth in self.depths:
            if depth.camera not in observation.depth:
                raise PolicyError(
                    f"adapter {self.name} needs the depth of the camera {depth.camera!r}, but the run does not "
                    "render it. In CALVIN, use --observation calvin_depth."
                )
            drawn = observation.depth[depth.camera]
            set_entry(message, depth.key, drawn.reshape((1,) * self.leading_axes + drawn.shape))
        for rule in self.states:
            value = self.state(rule, observation)
            if isinstance(value, np.ndarray):
                value = value.reshape((1,) * self.leading_axes + value.shape)
            set_entry(message, rule.key, value)
        instruction: Any = self.instruction.write(observation.instruction)
        for _ in range(self.instruction.depth):
            instruction = [instruction]
        set_entry(message, self.instruction.key, instruction)
        for constant in self.constants:
            set_entry(message, constant.key, constant.value)
        if self.episode_key is not None and start is not None:
            set_entry(message, self.episode_key, asdict(start) | ({} if trial is None else asdict(trial)))
        return message

    def actions(self, reply: object, observation: Observation) -> np.ndarray:
        """Convert a reply to actions, (horizon, dim) float64 in the action space ``answer.space``.

        Raises PolicyError if the reply is malformed. The message names the key and describes the value.
        """
        if not isinstance(reply, Mapping):
            raise PolicyError(f"expected a map with actions as the reply, got {type(reply).__name__}.")
        return self.answer.read(
            reply,
            observation,
            ee_offset_m=self.ee_offset_m,
            tool_offset_m=self.tool_offset_m,
            control_rate_hz=self.control_rate_hz,
        )

    def named(self, reply: object, who: str) -> Mapping[Any, Any]:
        """Convert a policy's reply to a map.

        Some servers return a bare array of actions. It becomes a map with the adapter's answer key. Raises PolicyError
        if the reply is not a map but the adapter expects several keys.
        """
        if isinstance(reply, Mapping):
            return reply
        keys = list(self.answer.columns)
        if len(keys) > 1 or len(keys[0]) > 1:
            wanted = ", ".join("/".join(key) for key in keys)
            raise PolicyError(f"{who} returns an array, but adapter {self.name} reads {wanted}.")
        return {keys[0][0]: reply}

    def reply(self, actions: np.ndarray, observation: Observation) -> dict[str, Any]:
        """Convert actions to a reply in the format of this adapter. This method is the inverse of :meth:`actions`."""
        message: dict[str, Any] = {}
        written = self.answer.write(
            actions,
            observation,
            ee_offset_m=self.ee_offset_m,
            tool_offset_m=self.tool_offset_m,
            control_rate_hz=self.control_rate_hz,
        )
        for key, array in written.items():
            set_entry(message, key, array)
        return message

    def with_cameras(self, cameras: Mapping[str, str]) -> Adapter:
        """Return a copy of the adapter with other cameras for some image inputs.

        ``cameras`` maps the key of an image input to the name of a camera. The names in a nested key are joined by "/".
        Raises UnknownNameError if the adapter has no image input with a given key.
        """
        known = {"/".join(rule.key): rule for rule in self.views}
        for key in cameras:
            if key not in known:
                raise UnknownNameError(f"image of adapter {self.name}", key, known)
        changed = tuple(replace(rule, camera=cameras[key]) if key in cameras else rule for key, rule in known.items())
        return replace(self, views=changed)

    def with_constants(self, values: Mapping[str, bool | int | float | str]) -> Adapter:
        """Return a copy of the adapter with changed or added constants. The names in a nested key are joined by "/"."""
        known = {"/".join(rule.key): rule for rule in self.constants}
        known |= {key: ConstantRule(tuple(key.split("/")), value) for key, value in values.items()}
        return replace(self, constants=tuple(known.values()))

    def in_space(self, space: str) -> Adapter:
        """Return a copy of the adapter whose answers are in another action space.

        Raises UnknownNameError if the action space does not exist, and InvalidInputError if the columns of the answer
        do not form an action in that space.
        """
        return replace(self, answer=self.answer.in_space(space))

    def to_json(self) -> dict[str, Any]:
        """Return the adapter as a JSON-serializable dict that includes all defaults.

        Keys that consist of one name are written as strings, and all other keys as lists of names.
        """
        form: dict[str, Any] = _shorter(_ADAPTER.dump_python(self, mode="json"))
        return form

    @classmethod
    def from_json(cls, form: object, *, where: str = "adapter") -> Adapter:
        """Create an adapter from a JSON value. ``where`` is its name for error messages.

        Raises InvalidInputError if a field is missing, unknown or malformed, and UnknownNameError for an unknown action
        space.
        """
        return read_form(_ADAPTER, _longer(form), where=where, cure=_CURE)

    @classmethod
    def load(cls, path: Path) -> Adapter:
        """Read an adapter from a JSON file. The default name of the adapter is the name of the file.

        Raises InvalidInputError if the file cannot be read or a field is invalid. The message names the field.
        """
        where = f"adapter {path}"
        form = read_form(
            _ANYTHING, read_bounded(path, max_bytes=_MAX_BYTES, cure="Use a JSON file"), where=where, cure=_CURE
        )
        return cls.from_json({"name": path.stem, **form}, where=where)


_ANYTHING = TypeAdapter(dict[str, Any])
_MAX_BYTES = 1_000_000
_CURE = "See the examples in docs/policies.md and docs/calvin.md, or run better doctor --policy P --json"
_ADAPTER = TypeAdapter(Adapter)
_KEYS = ("key", "episode_key", "state_key", "answer_key")


def set_entry(message: dict[str, Any], key: tuple[str, ...], value: object) -> None:
    """Store a value in a nested message, and create missing maps along the key."""
    *way, last = key
    for name in way:
        message = message.setdefault(name, {})
    message[last] = value


def _shorter(form: Any) -> Any:  # noqa: ANN401 - a JSON value
    """Replace each key that consists of a single name by a string."""
    return _with_keys(form, lambda key: key[0] if isinstance(key, list) and len(key) == 1 else key)


def _longer(form: Any) -> Any:  # noqa: ANN401 - a JSON value
    """Replace each key that is a string by a list with one name."""
    return _with_keys(form, lambda key: [key] if isinstance(key, str) else key)


def _with_keys(form: Any, change: Callable[[Any], Any]) -> Any:  # noqa: ANN401 - a JSON value
    if isinstance(form, list):
        return [_with_keys(value, change) for value in form]
    if not isinstance(form, dict):
        return form
    return {name: change(value) if name in _KEYS else _with_keys(value, change) for name, value in form.items()}
