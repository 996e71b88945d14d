"""LeRobot policies that run in this process. The policy address is ``lerobot:CHECKPOINT`` (a folder or a hub ID).

The checkpoint declares the images, the state and the action size of its training data. The adapter, which converts
observations and actions, is derived from these declarations unless the address names an adapter. The checkpoint's own
processors normalize the inputs and outputs.

:mod:`betterbench.policies.clients.lerobot_types` lists the policy types and their requirements. Policies that predict a
chunk from a single observation (ACT, pi0, pi0.5, SmolVLA) process batches, so one instance serves many environments.
The actions for an environment do not depend on the other environments in the batch. To ensure this for flow policies,
their initial noise is seeded with the observation. All other types (diffusion, VQ-BeT, TD-MPC and policies with an
observation history) are called at every step and execute their chunks themselves, as in LeRobot's evaluation. Each
environment needs its own instance, but all instances share the weights.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, get_args

import numpy as np

from betterbench.errors import HandshakeError, InvalidInputError, one_line
from betterbench.interface import EpisodeStart, Execution, Observation, Policy, PolicyInfo
from betterbench.interface.actions import OWN_SPACES, ROBOT_ACTION_SPACES, action_space
from betterbench.policies.address import EXECUTION, PolicyAddress
from betterbench.policies.clients.checkpoint import CHUNK_TYPES, NOISE_TYPES, Checkpoint, Features, load_checkpoint
from betterbench.policies.clients.remote import AdaptedPolicy, check_start, describe_remote_policy
from betterbench.policies.conventions.adapter import Adapter, InstructionRule
from betterbench.policies.conventions.answers import AnswerPart, AnswerRule
from betterbench.policies.conventions.handshake import Declaration
from betterbench.policies.conventions.image_rule import ImageRule
from betterbench.policies.conventions.presets import adapter_of
from betterbench.policies.conventions.proprioception import MotorPart, StatePart, StateRule

_TASK = ("task",)
_ACTION = ("action",)
_STATES: Mapping[str, tuple[StatePart, ...]] = {
    "ee": ("ee_position", "ee_axis_angle", "gripper_fingers"),
    "joints": ("joint_positions", "gripper_width"),
}
"""Parts of the state vector for each value of the option ``state``, as in betterbench's LeRobot environment.

If the actions are motor positions, a third layout, "motors", contains the motor positions in the same units.
"""

_CAMERAS = ("front", "wrist", "left_shoulder", "right_shoulder", "front_official")
_KNOWN_AS = {"image": "front", "agentview": "front", "agentview_image": "front", "image2": "wrist"}
"""Name of betterbench's camera, by the name of the image in LeRobot's LIBERO data sets."""

_MOST_SHOWN = 12
"""Maximum number of differences listed in one message."""

_WRIST_WORDS = ("wrist", "hand", "gripper")


class LerobotPolicy(AdaptedPolicy):
    """LeRobot policy that predicts an action chunk from a single observation. One instance serves many environments."""

    def __init__(self, address: PolicyAddress, checkpoint: Checkpoint) -> None:
        self._address, self._checkpoint = address, checkpoint
        self._where = f"policy {address}"
        features = checkpoint.features
        # Derive an adapter from the checkpoint unless the address names one.
        self.adapter = adapter_of(address, None if address.names_adapter else derive_adapter(address, features))
        compare_features(self.adapter, features, self._where)
        self.server = Declaration(
            self._where, cameras={key: (size[1], size[0]) for key, size in features.images.items()}
        )
        info = describe_remote_policy(address, self.adapter, {})
        self.info: PolicyInfo = replace(
            info,
            metadata={
                **info.metadata,
                "policy type": checkpoint.type,
                "device": checkpoint.device,
                "checkpoint": f"sha256 {checkpoint.fingerprint}",
                **{f"{name} version": version for name, version in checkpoint.versions.items()},
            },
            execution=self._execution(),
            heavy=True,
        )

    def _execution(self) -> Execution:
        """Return the settings for executing chunks. By default, chunks are executed as in LeRobot's evaluation."""
        if self._address.given(EXECUTION):
            return self._address.execution()
        config = self._checkpoint.config
        rate = getattr(config, "temporal_ensemble_coeff", None)
        if rate is not None:
            return Execution(ensemble=float(rate))
        return Execution(horizon=max(1, int(getattr(config, "n_action_steps", 1))))

    def reset(self, start: EpisodeStart) -> None:
        """Begin an episode in one environment. Raises HandshakeError if the episode uses a different action space."""
        check_start(self.adapter, start, self._where)

    def act(self, observation: Observation) -> np.ndarray:
        """Return the next action chunk, (horizon, dim) float64.

        Raises PolicyError if the policy's output cannot be used.
        """
        return self.act_batch([observation])[0]

    def act_batch(self, observations: Sequence[Observation]) -> list[np.ndarray]:
        """Return the next action chunk of each environment, each (horizon, dim) float64."""
        noisy = self._checkpoint.type in NOISE_TYPES
        seeds = [seed_of(seen) for seen in observations] if noisy else []
        chunks = self._checkpoint.chunks(self._batch(observations), seeds)
        return [
            self.adapter.actions({_ACTION[0]: chunk}, seen) for chunk, seen in zip(chunks, observations, strict=True)
        ]

    def _batch(self, observations: Sequence[Observation]) -> dict[str, Any]:
        """Return the input for LeRobot's processors: tensors with a leading batch axis, and a list of instructions."""
        tensor = self._checkpoint.tensor
        batch: dict[str, Any] = {}
        shown = [self.adapter.images(seen) for seen in observations]
        for key in shown[0]:
            images = np.stack([one[key] for one in shown]).transpose(0, 3, 1, 2)
            batch[key[0]] = tensor(images.astype(np.float32) / 255.0)
        for rule in self.adapter.states:
            values = [self.adapter.state(rule, seen) for seen in observations]
            batch[rule.key[0]] = tensor(np.stack([np.atleast_1d(value) for value in values]).astype(np.float32))
        batch[_TASK[0]] = [seen.instruction for seen in observations]
        return batch


class LerobotStepPolicy(AdaptedPolicy):
    """LeRobot policy that is called at every step, for example because it uses an observation history.

    Each environment needs its own instance. All instances share the weights.
    """

    def __init__(self, address: PolicyAddress, checkpoint: Checkpoint) -> None:
        given = address.given(EXECUTION)
        if given:
            raise address.error(
                f"a policy of type {checkpoint.type} gets every observation and executes its chunks itself",
                f"Omit {', '.join(given)}. The checkpoint's n_action_steps sets the horizon",
            )
        self._inner = LerobotPolicy(address, checkpoint)
        self._checkpoint, self._policy = checkpoint, checkpoint.sibling()
        self.adapter, self.server = self._inner.adapter, self._inner.server
        self.info: PolicyInfo = replace(self._inner.info, execution=Execution())
        self._seed = 0

    def reset(self, start: EpisodeStart) -> None:
        """Clear the observation history and the queued actions for a new episode.

        Raises HandshakeError if the episode uses a different action space.
        """
        self._inner.reset(start)
        self._policy.reset()
        self._seed = start.episode

    def act(self, observation: Observation) -> np.ndarray:
        """Return the next action, (1, dim) float64. Raises PolicyError if the policy's output cannot be used."""
        batch = self._inner._batch([observation])
        seed = seed_of(observation, self._seed)
        return self.adapter.actions({_ACTION[0]: self._checkpoint.step(self._policy, batch, seed)}, observation)


def load_lerobot(address: PolicyAddress) -> Policy:
    """Load the policy of a LeRobot checkpoint.

    The policy supports batches if it predicts an action chunk from a single observation. Raises the errors of
    :class:`Checkpoint` and :func:`derive_adapter`, and HandshakeError if the address names an adapter that does not
    match the checkpoint.
    """
    checkpoint = load_checkpoint(address)
    remembers = int(getattr(checkpoint.config, "n_obs_steps", 1)) > 1
    if checkpoint.type in CHUNK_TYPES and not remembers:
        return LerobotPolicy(address, checkpoint)
    return LerobotStepPolicy(address, checkpoint)


def derive_adapter(address: PolicyAddress, features: Features) -> Adapter:
    """Derive an adapter from the features of a checkpoint.

    The options ``state``, ``action_space`` and ``camera.KEY`` of the policy address set conventions that the checkpoint
    does not declare.

    Raises:
        InvalidInputError: If a convention is unknown. The message names the option that sets the convention.
        UnknownNameError: If the value of an option is not one of the allowed names.
    """
    where = f"policy {address}"
    answer = _answer(address, features, where)
    motors = next((part for part in get_args(MotorPart) if part == answer.space), None)
    known = _STATES if motors is None else {**_STATES, "motors": (motors,)}
    layout = address.choice("state", tuple(known), "ee" if motors is None else "motors")
    states = []
    for key, size in features.states.items():
        rule = StateRule((key,), known[layout])
        if size != rule.size:
            raise InvalidInputError(
                where,
                f"its {one_line(key, most=100)} has {size} numbers, but the known state layout has {rule.size}",
                "Add adapter=FILE, where FILE describes the parts of the state",
            )
        states.append(rule)
    views = tuple(
        ImageRule((key,), _camera(key, address, where), width, height)
        for key, (height, width) in features.images.items()
    )
    shared = {rule.camera for rule in views if sum(other.camera == rule.camera for other in views) > 1}
    if shared:
        keys = ", ".join(rule.key[0] for rule in views if rule.camera in shared)
        raise InvalidInputError(
            where,
            f"the camera {min(shared)} would be used for several inputs: {one_line(keys)}",
            "Add camera.KEY=NAME to the policy address for each of these inputs",
        )
    return Adapter(
        "lerobot",
        views=views,
        states=tuple(states),
        instruction=InstructionRule(_TASK),
        answer=answer,
    )


def compare_features(adapter: Adapter, features: Features, where: str) -> None:
    """Raise a HandshakeError if an adapter does not provide the inputs and actions that a checkpoint declares.

    The message lists the differences.
    """
    wanted = {
        **{key: f"an image of {width} x {height}" for key, (height, width) in features.images.items()},
        **{key: f"{size} numbers" for key, size in features.states.items()},
        "action": f"{features.action} numbers",
    }
    given = {
        **{"/".join(r.key): f"an image of {r.width or 'any'} x {r.height or 'any'}" for r in adapter.views},
        **{"/".join(rule.key): f"{rule.size} numbers" for rule in adapter.states},
        **{"/".join(key): f"{size} numbers" for key, size in adapter.answer.columns.items()},
    }
    found = [
        f"{one_line(key, most=100)}: the checkpoint declares {wanted.get(key, 'nothing')}, "
        f"the adapter {given.get(key, 'nothing')}"
        for key in sorted({*wanted, *given})
        if wanted.get(key) != given.get(key) and not (key in features.images and "any" in given.get(key, ""))
    ]
    if adapter.instruction.key != _TASK or adapter.instruction.depth:
        found.append("the instruction: LeRobot takes it as a string under 'task'")
    if found:
        raise HandshakeError(
            f"{where} and the adapter {adapter.name!r} declare different features. {'; '.join(found[:_MOST_SHOWN])}. "
            "Correct the adapter, or remove it from the address."
        )


def seed_of(observation: Observation, salt: int = 0) -> int:
    """Compute a random seed from an observation.

    The seed does not depend on the other observations in a batch, so the actions do not either. Pass a different
    ``salt`` in each episode, so that equal observations in different episodes have different seeds.
    """
    digest = hashlib.sha256(f"lerobot|{salt}|{observation.step}|{observation.instruction}".encode())
    digest.update(np.asarray(observation.joint_positions, np.float64).tobytes())
    digest.update(np.asarray(observation.ee_position, np.float64).tobytes())
    for name, image in sorted(observation.images.items()):
        digest.update(name.encode())
        digest.update(np.ascontiguousarray(image).tobytes())
    return int.from_bytes(digest.digest()[:8], "little") >> 1


def _camera(key: str, address: PolicyAddress, where: str) -> str:
    """Return the name of the betterbench camera for an image input of the checkpoint."""
    given = address.options.get(f"camera.{key}")
    if given is not None:
        return given
    name = key.rpartition(".")[2].lower()
    if name in _CAMERAS:
        return name
    if name in _KNOWN_AS:
        return _KNOWN_AS[name]
    if any(word in name for word in _WRIST_WORDS):
        return "wrist"
    shown = one_line(key, most=100)
    raise InvalidInputError(
        where,
        f"the camera for {shown} is unknown",
        f"Add camera.{shown}=NAME to the policy address, where NAME is one of {', '.join(_CAMERAS)}",
    )


def _answer(address: PolicyAddress, features: Features, where: str) -> AnswerRule:
    """Return the rule that converts the policy's output to actions.

    Raises InvalidInputError if the action space is neither given nor implied by the action size of the checkpoint.
    """
    space = address.options.get("action_space", "ee_delta" if features.action == 7 else "")
    turned = "quaternion_wxyz" if space == "ee_pose" else "axis_angle"
    parts: tuple[AnswerPart, ...]
    if space in ROBOT_ACTION_SPACES:
        parts = (AnswerPart(_ACTION, "action"),)
    elif space.startswith("joint"):
        parts = (AnswerPart(_ACTION, "joints"), AnswerPart(_ACTION, "gripper"))
    else:
        parts = (AnswerPart(_ACTION, "translation"), AnswerPart(_ACTION, "rotation"), AnswerPart(_ACTION, "gripper"))
    if not space:
        sized = ", ".join(name for name in OWN_SPACES if action_space(name).dim == features.action)
        raise InvalidInputError(
            where,
            f"the meaning of the {features.action} numbers in an action is unknown",
            f"Add action_space=NAME to the policy address ({sized}), or adapter=FILE"
            if sized
            else "Add adapter=FILE, where FILE describes the parts of the answer",
        )
    return AnswerRule(space, parts, rotation=turned)  # type: ignore[arg-type]
