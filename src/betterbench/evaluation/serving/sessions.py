"""Sessions of the server, each of which serves one connection."""

from __future__ import annotations

import dataclasses
import difflib
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from betterbench.episodes import POLICY_BOUNDARY
from betterbench.episodes.chunks import checked_chunk
from betterbench.errors import InvalidInputError, PolicyError
from betterbench.evaluation.serving.shadow import ShadowSimulation, ShadowSimulations, require_within
from betterbench.geometry import Quaternion, from_axis_angle, to_axis_angle, turn_between
from betterbench.interface import EpisodeStart, Observation, Policy, episode_number
from betterbench.interface.actions import action_space
from betterbench.policies.conventions.adapter import Adapter
from betterbench.policies.conventions.presets import OPENPI_LIBERO
from betterbench.policies.conventions.proprioception import StateRule
from betterbench.policies.conventions.request import Request, read_layout_request, read_request, read_states
from betterbench.tasks import Condition, TrialId, all_tasks
from betterbench.tasks.interventions import resolve_condition

SAME_STATE = 2e-6
"""Maximum difference of two equal states [m, rad], because clients send float32."""
ASTRAY = 1e-3
"""Difference above which a client is considered not to have executed the answered actions [m, rad]."""

States = list[tuple[StateRule, np.ndarray]]
"""States of a request, each as (size,)."""


class ShadowSession:
    """Session for a client of an expert, which identifies trial and step and gets actions from a shadow simulation."""

    def __init__(
        self, shadows: ShadowSimulations, chunk: int, trial: TrialId | None, layout: Adapter | None = None
    ) -> None:
        """Prepare.

        Args:
            shadows: The simulations of all clients.
            chunk: Maximum actions in one answer.
            trial: Trial for a client that names none, or None to find the trial by the instruction.
            layout: Layout of requests and answers; None for native and openpi's LIBERO layout.
        """
        self._shadows, self._chunk, self._fixed, self._layout = shadows, chunk, trial, layout
        self._counter = Counter()
        self._start: tuple[Observation, States] | None = None
        self._chunk_began = 0
        shadows.client_came()

    def answer(self, message: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the next actions of the expert."""
        layout = self._layout
        request = read_request(message) if layout is None else read_layout_request(message, layout)
        states: States = [] if request.measured else read_states(message, layout or OPENPI_LIBERO)
        if request.start is not None:
            _check_space(request.start, self._shadows.action_space, "this expert")
        trial = request.trial or self._fixed or trial_of(request.instruction)
        # check the message before building a scene, which takes a hundred times as long
        found = resolve_condition(trial.task, trial.condition)
        instruction = found.condition.instruction.text
        if request.trial is not None and request.instruction != instruction:
            raise PolicyError(
                f"{trial}: the client's instruction is {request.instruction[:200]!r} and this server's is "
                f"{instruction!r}. They run different versions"
            )
        if request.step is not None:
            require_within(trial, request.step, found.task.step_limit(found.condition))
        step = self._counter.step(request, trial)
        shadow = self._shadows.of(trial)
        if states:
            step = self._located(states, shadow, step, counted=request.step is not None)
        seen = request.observation if request.measured else None
        actions = shadow.actions(step, self._chunk, seen=seen)
        self._counter.answered(step, len(actions))
        if layout is None:
            return {"actions": actions}
        return layout.reply(shadow.in_space(layout.answer.space, step, actions), shadow.observation(step))

    def close(self) -> None:
        """Close the connection. A few shadow simulations are kept for clients that reconnect."""
        self._shadows.client_left()

    def _located(self, states: States, shadow: ShadowSimulation, step: int, *, counted: bool) -> int:
        """Return a client's control step: as sent, the end of the last chunk, or an earlier step of this chunk.

        Many clients execute only some of the received actions, or none before they repeat a request. For a client that
        does not send its step, the state relative to the start of the episode determines the step in the chunk.

        Raises PolicyError if no step matches.
        """
        if self._counter.begins or self._start is None:
            self._start = (shadow.observation(step), states)
            self._chunk_began = step
            return step
        began, self._chunk_began = self._chunk_began, step
        layout = self._layout or OPENPI_LIBERO
        steps = [step] if counted else list(range(min(began, step), step + 1))
        gaps = [state_gap(states, shadow.observation(i), *self._start, layout) for i in steps]
        if gaps[-1] <= SAME_STATE:
            return step
        nearest = int(np.argmin(gaps))
        if gaps[nearest] <= SAME_STATE:
            self._chunk_began = steps[nearest]
            return self._chunk_began
        if min(gaps) > ASTRAY:
            raise PolicyError(
                f"{shadow.trial} step {step}: the client's robot is not where the answered actions lead (its state "
                f"differs by {min(gaps):.3g} m or rad). The client executed actions that were not in the answers, or "
                "sends a state that is not its own; a client without a state sends zeros"
            )
        return step


def state_gap(states: States, seen: Observation, first: Observation, states_then: States, layout: Adapter) -> float:
    """Return the difference between a client's states and an observation, both relative to the start of the episode.

    This is the largest difference of all numbers [m, rad], with rotation vectors compared as rotations.

    Args:
        states: States sent by the client.
        seen: The observation.
        first: The observation at the start.
        states_then: States sent by the client at the start.
        layout: Adapter that defines the numbers of a state.
    """
    worst = 0.0
    then = {rule.key: sent for rule, sent in states_then}
    for rule, sent in states:
        now, before = (np.atleast_1d(np.asarray(layout.state(rule, o), dtype=np.float64)) for o in (seen, first))
        sent_then = then.get(rule.key, sent)
        for part, at in rule.columns():
            if part == "ee_axis_angle":
                theirs = _turn(sent_then[at], sent[at])
                gap = np.linalg.norm(to_axis_angle(turn_between(_turn(before[at], now[at]), theirs)))
            else:
                gap = np.abs((sent[at] - sent_then[at]) - (now[at] - before[at])).max()
            worst = max(worst, float(gap))
    return worst


def _turn(before: np.ndarray, now: np.ndarray) -> Quaternion:
    """Return the rotation from one rotation vector, (3,), to another, in the base frame."""
    return turn_between(from_axis_angle(before.tolist()), from_axis_angle(now.tolist()))


class Counter:
    """Counter of a client's control steps, which also detects the start of an episode."""

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
        """Record that ``count`` actions starting at ``step`` were sent; a client without steps executes all of them."""
        self._next = step + count


def _check_space(start: EpisodeStart, space: str, who: str) -> None:
    if start.action_space != space:
        raise InvalidInputError(
            "better/episode: action_space",
            f"the client executes {start.action_space!r} and {who} answers in {space!r}",
            f"Evaluate with --action-space {space}",
        )


def trial_of(instruction: str) -> TrialId:
    """Return the first training condition of the suite with an instruction, as a trial with seed 0.

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
        f"no training condition has the instruction {instruction[:200]!r}. The closest are {listed}",
        "Send one of these instructions, name the trial in better/episode, or serve with --task, --condition and "
        "--seed",
    )


class PolicySession:
    """Session for a client of a policy that uses observations."""

    def __init__(
        self, policy: Policy, trial: TrialId | None, *, within: bool = False, on_close: Callable[[], None] | None = None
    ) -> None:
        """Prepare a connection with its own policy, or a policy that answers each observation independently.

        ``trial`` gives the episode number if a client sends none. ``within`` is True for a run's workers, where
        errors have the message for the record.
        """
        self._policy, self._trial, self._within, self._on_close = policy, trial, within, on_close
        self._counter = Counter()

    def answer(self, message: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the next actions of the policy."""
        request = read_request(message)
        if request.observation is None:
            raise InvalidInputError(
                "the request",
                "contains no observation",
                "Send better/joint_positions etc. (preset native), or observation/state (preset openpi_libero)",
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
