"""Sessions: each answers one connection to a server of this package."""

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
from betterbench.evaluation.serving.shadow import ShadowSimulation, ShadowSimulations
from betterbench.interface import EpisodeStart, Observation, Policy, episode_number
from betterbench.interface.actions import EE_DELTA, action_space
from betterbench.policies.request import Request, read_request
from betterbench.tasks import Condition, TrialId, all_tasks

logger = logging.getLogger(__name__)

SAME_PLACE_M = 2e-6
"""Distance below which two positions of the end effector are the same [m]; clients send them as float32."""
ASTRAY_M = 1e-3
"""Distance above which a client has left the path of the answered actions [m]."""


class ShadowSession:
    """One client of a served expert: finds its trial and its step, and asks the shadow simulation."""

    def __init__(self, shadows: ShadowSimulations, chunk: int, trial: TrialId | None) -> None:
        """Prepare; ``trial`` is that of a client that names none, or None to find it by the instruction."""
        self._shadows, self._chunk, self._fixed = shadows, chunk, trial
        self._counter = Counter()
        self._origin = np.zeros(3)
        self._chunk_began = 0
        self._warned = False
        shadows.client_came()

    def answer(self, message: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the next actions of the expert."""
        request = read_request(message)
        if request.start is not None:
            _check_space(request.start, EE_DELTA.name, "an expert")
        trial = request.trial or self._fixed or trial_of(request.instruction)
        step = self._counter.step(request, trial)
        shadow = self._shadows.of(trial)
        instruction = shadow.condition.instruction.text
        if request.trial is not None and request.instruction != instruction:
            raise PolicyError(
                f"{trial}: the client's instruction is {request.instruction!r} and this server's is {instruction!r}. "
                "They run different versions"
            )
        if request.step is None and request.observation is not None:
            step = self._located(request.observation, shadow, step)
        seen = request.observation if request.measured else None
        actions = shadow.actions(step, self._chunk, seen=seen)
        self._counter.answered(step, len(actions))
        return {"actions": actions}

    def close(self) -> None:
        """Forget the connection; a few shadows stay, for clients that connect again."""
        self._shadows.client_left()

    def _located(self, seen: Observation, shadow: ShadowSimulation, step: int) -> int:
        """Return the control step of a client that sends no step: the end of the last chunk, or an earlier one.

        Many clients execute fewer actions than they were answered. Such a client is at the step of the chunk where the
        end effector was that it reports, relative to where it was at the start of the episode.
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
    """Counts the control steps of a client that may not send them, and notices where an episode begins."""

    def __init__(self) -> None:
        self._episode: object = None
        self._next = 0
        self.begins = False

    def step(self, request: Request, episode: object) -> int:
        """Return the control step of a request, and set ``begins``; ``episode`` differs between episodes."""
        key = (episode, request.instruction)
        self.begins = key != self._episode or request.step == 0
        if self.begins:
            self._episode, self._next = key, 0
        if request.step is not None:
            self._next = request.step
        return self._next

    def answered(self, step: int, count: int) -> None:
        """Note that ``count`` actions from ``step`` on were answered; a client without steps executes them all."""
        self._next = step + count


def _check_space(start: EpisodeStart, space: str, who: str) -> None:
    if start.action_space != space:
        raise InvalidInputError(
            "better/episode: action_space",
            f"the client executes {start.action_space!r} and {who} answers in {space!r}",
            f"Evaluate with --action-space {space}",
        )


def trial_of(instruction: str) -> TrialId:
    """Return the first trial of the suite that has an instruction: of a training condition, with seed 0.

    InvalidInputError names the closest instructions if no training condition has it.
    """
    conditions: dict[str, Condition] = {}
    for task in all_tasks():
        for condition in task.training:
            conditions.setdefault(condition.instruction.text, condition)
    found = conditions.get(instruction)
    if found is not None:
        return TrialId(found.task, found.name, 0)
    folded = {text.casefold(): text for text in conditions}
    close = difflib.get_close_matches(instruction.casefold(), folded, n=3, cutoff=0.0)
    listed = "; ".join(f"{folded[c]!r} ({conditions[folded[c]].id})" for c in close)
    raise InvalidInputError(
        "prompt",
        f"no training condition says {instruction[:200]!r}. The closest are {listed}",
        "Send one of them, name the trial in better/episode, or serve with --task, --condition and --seed",
    )


class PolicySession:
    """One client of a policy that sees observations."""

    def __init__(
        self, policy: Policy, trial: TrialId | None, *, within: bool = False, on_close: Callable[[], None] | None = None
    ) -> None:
        """Prepare for a connection with a policy of its own, or one that answers each observation independently.

        ``trial`` is the one whose episode number a policy is told by a client that sends none. ``within`` is True for
        the workers of a run: an error is reported in the text that goes into a record.
        """
        self._policy, self._trial, self._within, self._on_close = policy, trial, within, on_close
        self._counter = Counter()

    def answer(self, message: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the next actions of the policy."""
        request = read_request(message)
        if request.observation is None:
            raise InvalidInputError(
                "the request",
                "holds no observation",
                "Send better/joint_positions and its like (preset native), or observation/state (preset openpi_libero)",
            )
        space = self._policy.info.action_space
        number = episode_number(self._trial.seed if self._trial else 0)
        start = request.start or EpisodeStart(request.instruction, number, space)
        _check_space(start, space, "the policy")
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
        """Call ``on_close``."""
        if self._on_close is not None:
            self._on_close()
