"""Sessions: what answers one connection to a server of ours."""

from __future__ import annotations

import dataclasses
import difflib
import logging
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from betterbench.episodes import POLICY_BOUNDARY
from betterbench.episodes.chunks import checked_chunk
from betterbench.errors import InvalidInputError, PolicyError
from betterbench.evaluation.serving.shadow import ShadowSimulation, ShadowSimulations, TrialName
from betterbench.interface import EpisodeStart, Observation, Policy
from betterbench.interface.actions import EE_DELTA, action_space
from betterbench.policies.request import Request, read_request
from betterbench.tasks import Condition, all_tasks

logger = logging.getLogger(__name__)

SAME_PLACE_M = 2e-6
"""Distance below which two positions of the end effector are the same [m]; clients send them as float32."""
ASTRAY_M = 1e-3
"""Distance above which a client has left the way of the answered actions [m]."""


class ShadowSession:
    """One client of a served expert: finds its trial and its step, and asks the shadow."""

    def __init__(self, shadows: ShadowSimulations, chunk: int, trial: TrialName | None) -> None:
        """Prepare for a connection.

        Args:
            shadows: The shadows of the policy.
            chunk: Actions in one answer.
            trial: Trial of a client that names none, or None to find it by the sentence.
        """
        self._shadows, self._chunk, self._fixed = shadows, chunk, trial
        self._counter = Counter()
        self._origin = np.zeros(3)
        self._chunk_began = 0
        self._warned = False

    def answer(self, message: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the next actions of the expert.

        Raises:
            InvalidInputError: If the request is malformed, or its sentence belongs to no trial.
            UnknownNameError: If it names no trial of the suite.
            PolicyError: If the client has left the way of the answered actions.
        """
        request = read_request(message)
        trial = _named(request.start) if request.start else self._fixed or trial_of(request.instruction)
        step = self._counter.step(request, trial)
        shadow = self._shadows.of(trial)
        said = shadow.condition.instruction.text
        if request.start is not None and request.instruction != said:
            raise PolicyError(
                f"{trial}: the client says {request.instruction!r} and this server {said!r}. They run other versions"
            )
        if request.step is None and request.observation is not None:
            step = self._located(request.observation, shadow, step)
        seen = request.observation if request.measured else None
        actions = shadow.actions(step, self._chunk, seen=seen)
        self._counter.answered(step, len(actions))
        return {"actions": actions}

    def close(self) -> None:
        """Forget the connection; the shadows stay, for a client that comes back."""

    def _located(self, seen: Observation, shadow: ShadowSimulation, step: int) -> int:
        """Return the control step that a client which does not count is at: the end of the last chunk, or before it.

        Many clients execute fewer actions than they were answered. Where the end effector has moved exactly as far as
        up to an earlier step of the chunk, they are there; its origin is the client's own.
        """
        if self._counter.begins:
            self._origin = seen.ee_position - shadow.position(0)
            self._chunk_began = 0
            return step
        began, self._chunk_began = self._chunk_began, step
        gaps = [
            float(np.abs(seen.ee_position - self._origin - shadow.position(i)).max())
            for i in range(began + 1, step + 1)
        ]
        if not gaps or gaps[-1] <= SAME_PLACE_M:
            return step
        nearest = int(np.argmin(gaps))
        if gaps[nearest] <= SAME_PLACE_M:
            self._chunk_began = began + 1 + nearest
            return self._chunk_began
        if gaps[-1] > ASTRAY_M and not self._warned:
            self._warned = True
            logger.warning(
                "%s step %d: the client's end effector is %.3f m from where the answered actions lead. Either it sends "
                "no state of its own, or it executes other actions than those answered",
                shadow.trial,
                step,
                gaps[-1],
            )
        return step


class Counter:
    """Counts the control steps of a client that may or may not count itself, and notices where an episode begins."""

    def __init__(self) -> None:
        """Begin."""
        self._episode: object = None
        self._next = 0
        self.begins = False

    def step(self, request: Request, episode: object) -> int:
        """Return the control step of a request; ``begins`` then tells whether an episode begins with it.

        Args:
            request: The request.
            episode: What tells its episode from another one.
        """
        key = (episode, request.instruction)
        self.begins = key != self._episode or request.step == 0
        if self.begins:
            self._episode, self._next = key, 0
        if request.step is not None:
            self._next = request.step
        return self._next

    def answered(self, step: int, count: int) -> None:
        """Note what was answered: a client that does not count has executed it all when it asks again.

        Args:
            step: Control step of the first action.
            count: Number of actions.
        """
        self._next = step + count


def _named(start: EpisodeStart) -> TrialName:
    if start.action_space != EE_DELTA.name:
        raise InvalidInputError(
            "better/episode: action_space",
            f"the client executes {start.action_space!r} and an expert answers in {EE_DELTA.name!r}",
            f"Evaluate with --action-space {EE_DELTA.name}",
        )
    return TrialName(start.task, start.condition, start.seed)


def trial_of(sentence: str) -> TrialName:
    """Return the first trial of the suite that a sentence belongs to: a training condition, seed 0.

    Raises:
        InvalidInputError: If no training condition has the sentence; the text names the closest ones.
    """
    conditions: dict[str, Condition] = {}
    for task in all_tasks():
        for condition in task.training:
            conditions.setdefault(condition.instruction.text, condition)
    found = conditions.get(sentence)
    if found is not None:
        return TrialName(found.task, found.name, 0)
    by_small_letters = {text.casefold(): text for text in conditions}
    close = difflib.get_close_matches(sentence.casefold(), by_small_letters, n=3, cutoff=0.0)
    listed = "; ".join(f"{by_small_letters[c]!r} ({conditions[by_small_letters[c]].id})" for c in close)
    raise InvalidInputError(
        "prompt",
        f"no training condition says {sentence[:200]!r}. The closest are {listed}",
        "Send one of them, name the trial in better/episode, or serve with --task, --condition and --seed",
    )


class PolicySession:
    """One client of a policy that sees observations."""

    def __init__(
        self,
        policy: Policy,
        trial: TrialName | None,
        *,
        within: bool = False,
        on_close: Callable[[], None] | None = None,
    ) -> None:
        """Prepare for a connection.

        Args:
            policy: The policy; this session's own, or one that answers each observation for itself.
            trial: Trial of a client that names none; its seed is what a policy that draws random numbers is told.
            within: True for the workers of a run: whatever goes wrong is told in the words that a record has for it.
            on_close: Called when the client has left.
        """
        self._policy, self._trial, self._within, self._on_close = policy, trial, within, on_close
        self._counter = Counter()

    def answer(self, message: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the next actions of the policy.

        Raises:
            InvalidInputError: If the request is malformed.
            PolicyError: If the policy answers something that is no chunk of actions.
        """
        request = read_request(message)
        if request.observation is None:
            raise InvalidInputError(
                "the request",
                "it holds no observation",
                "Send better/joint_positions and its like (preset native), or observation/state (preset openpi_libero)",
            )
        space = self._policy.info.action_space
        start = request.start or EpisodeStart(request.instruction, self._trial.seed if self._trial else 0, space)
        if start.action_space != space:
            raise InvalidInputError(
                "better/episode: action_space",
                f"the client executes {start.action_space!r} and the policy answers in {space!r}",
                f"Evaluate with --action-space {space}",
            )
        step = self._counter.step(request, request.start)
        if self._counter.begins:
            self._policy.reset(start)
        observation = request.observation
        if request.step is None:
            observation = dataclasses.replace(observation, step=step)
        if self._within:
            with POLICY_BOUNDARY:
                actions = checked_chunk(np.asarray(self._policy.act(observation)), action_space(space))
        else:
            actions = np.asarray(self._policy.act(observation))
        if actions.ndim == 1:
            actions = actions[None]
        if actions.ndim != 2 or not len(actions) or actions.dtype.kind not in "fiu":
            raise PolicyError(f"the policy answered {actions.dtype} {actions.shape} instead of (horizon, dim) numbers")
        self._counter.answered(step, len(actions))
        return {"actions": np.ascontiguousarray(actions, dtype=np.float64)}

    def close(self) -> None:
        """Forget the connection."""
        if self._on_close is not None:
            self._on_close()
