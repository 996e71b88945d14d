"""Protocol between an episode and a policy that gets only observations, not the privileged state."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from types import NoneType
from typing import Protocol, runtime_checkable

import numpy as np

from betterbench.errors import InvalidInputError
from betterbench.interface.actions import action_space
from betterbench.interface.observation import Observation

_EXECUTION_KINDS: tuple[tuple[str, tuple[type, ...], str], ...] = (
    ("horizon", (int, np.integer, NoneType), "a whole number, or None for the whole chunk"),
    ("ahead", (int, np.integer), "a whole number"),
    ("ensemble", (int, float, np.number, NoneType), "a number, or None"),
)


@dataclass(frozen=True, slots=True)
class Execution:
    """Execution settings for action chunks: horizon, early requests, and temporal ensembling.

    Attributes:
        horizon: Number of actions executed from each chunk before the next request. If it is None, all are executed.
        ahead: Number of control steps between the request for the next chunk and the end of the current chunk. The
            rest of the current chunk is executed in the meantime. The same number of actions is dropped from the
            beginning of the new chunk, because they were meant for control steps that have passed. If ``ahead`` is 0,
            the simulation waits for every reply.
        ensemble: Rate m of temporal ensembling, or None for no ensembling. With ensembling, the policy is called at
            every step. The action for a step is the mean of all predictions for it, weighted by exp(-m i) with i = 0
            for the oldest prediction. See Zhao et al. 2023, "Learning Fine-Grained Bimanual Manipulation with Low-Cost
            Hardware", IV. A negative rate gives newer predictions more weight.
    """

    horizon: int | None = None
    ahead: int = 0
    ensemble: float | None = None

    def __post_init__(self) -> None:
        """Raise InvalidInputError if a value has a wrong type or is out of range, or if two settings conflict."""
        for name, kind, words in _EXECUTION_KINDS:
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, kind):
                raise InvalidInputError(f"Execution: {name}", f"it is of type {type(value).__name__}", f"Use {words}")
        if self.horizon is not None and self.horizon < 1:
            raise InvalidInputError(
                "horizon", f"{self.horizon} is out of range", "The execution horizon must be at least 1"
            )
        if self.ahead < 0 or (self.horizon is not None and self.ahead >= self.horizon):
            raise InvalidInputError(
                "ahead", f"{self.ahead} is out of range", "Use a number ≥ 0 that is less than the horizon"
            )
        if self.ensemble is not None and not math.isfinite(self.ensemble):
            raise InvalidInputError("ensemble", f"{self.ensemble:g} is out of range", "Use a rate such as 0.01")
        if self.ensemble is not None and (self.ahead or self.horizon is not None):
            raise InvalidInputError(
                "ensemble",
                "ensemble calls the policy at every step, so it cannot be combined with horizon or ahead",
                "Set either ensemble, or horizon and ahead",
            )


@dataclass(frozen=True, slots=True)
class EpisodeStart:
    """Message that a policy gets at the start of an episode.

    The message does not reveal whether the trial is a training trial.

    Attributes:
        instruction: Task instruction.
        episode: Number that a policy may use as a random seed (see :func:`episode_number`).
        action_space: Name of the current action space ("ee_delta").
    """

    instruction: str
    episode: int
    action_space: str


def episode_number(seed: int) -> int:
    """Return the episode number that policies get for a trial's seed, from 0 to 2**31 - 1.

    The number is a hash of the seed. A trial and its twin (the training trial with the same seed) get the same number.
    """
    return int.from_bytes(hashlib.sha256(f"betterbench episode {seed}".encode()).digest()[:4], "big") >> 1


@dataclass(frozen=True, slots=True)
class PolicyInfo:
    """Information that a policy provides about itself. It is stored with the run.

    Attributes:
        name: Address of the policy, such as "expert".
        action_space: Name of the action space of its actions.
        needs_images: False if the policy uses no images. In that case, no images are rendered.
        cameras: Cameras that the policy uses, or None for all. Other cameras are not rendered.
        metadata: Further information about the policy (checkpoint, revision, server), as a mapping from names to
            strings. The mapping is copied.
        execution: Execution settings for action chunks.
        heavy: True if the policy keeps large model weights in memory. If it supports batches (:class:`BatchPolicy`),
            all workers of a run share one instance. Otherwise, a run uses one worker by default.
    """

    name: str
    action_space: str = "ee_delta"
    needs_images: bool = True
    metadata: Mapping[str, str] = field(default_factory=dict)
    execution: Execution = Execution()
    heavy: bool = False
    cameras: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        """Raise InvalidInputError or UnknownNameError if a field is invalid."""
        for name, kind in (("name", str), ("action_space", str), ("metadata", Mapping), ("execution", Execution)):
            if not isinstance(getattr(self, name), kind):
                found = type(getattr(self, name)).__name__
                raise InvalidInputError(
                    f"PolicyInfo: {name}", f"it is of type {found}", f"Use a value of type {kind.__name__}"
                )
        entries: Iterable[tuple[object, object]] = self.metadata.items()
        for key, value in entries:
            if not isinstance(key, str) or not isinstance(value, str):
                raise InvalidInputError(
                    f"PolicyInfo: metadata[{key!r}]",
                    f"it is of type {type(value).__name__}",
                    "Use strings as keys and values",
                )
        for name in ("needs_images", "heavy"):
            if not isinstance(getattr(self, name), (bool, np.bool_)):
                found = type(getattr(self, name)).__name__
                raise InvalidInputError(f"PolicyInfo: {name}", f"it is of type {found}", "Use True or False")
        cameras: object = self.cameras
        if cameras is not None and not (
            isinstance(cameras, tuple | list) and all(isinstance(name, str) for name in cameras)
        ):
            raise InvalidInputError(
                "PolicyInfo: cameras",
                "expected a tuple of names",
                "Use a tuple of camera names, or None for all cameras",
            )
        # The mapping is copied to a dict, because some mapping types cannot be pickled.
        object.__setattr__(self, "metadata", dict(self.metadata))
        if self.action_space:  # empty for a replay policy, because each record has its own action space
            action_space(self.action_space)


class Policy(Protocol):
    """Policy that gets only an :class:`Observation`, not the privileged state."""

    @property
    def info(self) -> PolicyInfo:
        """Description of the policy, which is stored with the run."""

    def reset(self, start: EpisodeStart) -> None:
        """Reset the policy for a new episode."""

    def act(self, observation: Observation) -> np.ndarray:
        """Return the next actions in the order of execution (horizon, dim), or a single action (dim,)."""


@runtime_checkable
class BatchPolicy(Policy, Protocol):
    """Policy that processes the observations of several environments at once.

    The reply for an observation must not depend on the other observations. ``reset`` is called when an episode begins
    in any of the environments.
    """

    def act_batch(self, observations: Sequence[Observation]) -> Sequence[np.ndarray]:
        """Return one array for each observation, in order.

        Each array has the same form as the result of :meth:`Policy.act`.
        """


def require_policy(policy: object, where: str) -> None:
    """Check that an object implements :class:`Policy`.

    Raises:
        InvalidInputError: If the object is a class instead of an instance, or if it lacks ``info``, ``reset`` or
            ``act``.
    """
    if isinstance(policy, type):
        raise InvalidInputError(where, f"{policy.__name__} is a class", f"Pass an instance: {policy.__name__}(...)")
    name = type(policy).__name__
    for needed in ("info", "reset", "act"):
        if not hasattr(policy, needed):
            raise InvalidInputError(
                where, f"{name} has no {needed!r}", "Define info, reset(start) and act(observation)"
            )
    info = getattr(policy, "info", None)
    if not isinstance(info, PolicyInfo):
        raise InvalidInputError(
            where, f"info of {name} is of type {type(info).__name__}", "Return a betterbench.PolicyInfo"
        )
