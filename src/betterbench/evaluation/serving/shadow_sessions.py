"""Sessions of the policy server for the clients of an expert, with actions from shadow simulations."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from typing import Any

import numpy as np

from betterbench.errors import InvalidInputError, PolicyError
from betterbench.evaluation.serving.sessions import Counter, check_space
from betterbench.evaluation.serving.shadow import ShadowSimulation, ShadowSimulations, require_within
from betterbench.geometry import Quaternion, from_axis_angle, to_axis_angle, turn_between
from betterbench.interface import Observation
from betterbench.interface.actions import EE_DELTA
from betterbench.policies.conventions.adapter import Adapter
from betterbench.policies.conventions.presets import OPENPI_LIBERO
from betterbench.policies.conventions.proprioception import StateRule
from betterbench.policies.conventions.request import read_layout_request, read_request, read_states
from betterbench.sim.robots import robot as robot_named
from betterbench.tasks import Condition, TrialId, all_tasks
from betterbench.tasks.interventions import resolve_condition

SAME_STATE = 2e-6
"""Maximum difference between a client's state and a simulated state for the two to count as equal [m, rad].

The rounding of states to float32 by clients causes differences below this value.
"""
ASTRAY = 1e-3
"""Difference above which a client must have executed actions other than those it received [m, rad]."""

States = list[tuple[StateRule, np.ndarray]]
"""States in a request, each with its values as (size,)."""


class ShadowSession:
    """Session of a client of an expert.

    The session determines the client's trial and control step, and gets the actions from the shadow simulation of this
    trial.
    """

    def __init__(
        self, shadows: ShadowSimulations, chunk: int, trial: TrialId | None, layout: Adapter | None = None
    ) -> None:
        """Store the settings.

        Args:
            shadows: Shadow simulations of all clients.
            chunk: Maximum number of actions in one reply.
            trial: Trial of a client that does not name a trial. If None, the trial is determined from the instruction.
            layout: Layout of requests and replies. If None, clients may use the native layout and openpi's LIBERO
                layout.
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
            check_space(request.start, self._shadows.action_space, "this expert")
        trial = request.trial or self._fixed or trial_of(request.instruction)
        # The message is checked first, since building a scene takes a hundred times as long.
        found = resolve_condition(trial.task, trial.condition)
        instruction = found.condition.instruction.text
        if request.trial is not None and request.instruction != instruction:
            raise PolicyError(
                f"{trial}: the client's instruction is {request.instruction[:200]!r}, but this server's instruction is "
                f"{instruction!r}. Client and server have different versions of betterbench"
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
        """End the session. A few shadow simulations are kept for clients that reconnect."""
        self._shadows.client_left()

    def _located(self, states: States, shadow: ShadowSimulation, step: int, *, counted: bool) -> int:
        """Return the current control step of a client.

        If the client sends its control step (``counted``), this step is returned. Otherwise, the step must be found,
        because many clients execute only some of the received actions, or repeat a request before they execute any. The
        client's state is compared with the simulated states in the last chunk and at the end of this chunk. All states
        are taken relative to the state at the start of the episode. Raises PolicyError if no step matches.
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
                f"{shadow.trial} step {step}: the client's robot is not in the simulated state (its "
                f"state differs by {min(gaps):.3g} m or rad). The client executed other actions, or sends the "
                "state of another robot; a client without a state must send zeros"
            )
        return step


def state_gap(states: States, seen: Observation, first: Observation, states_then: States, layout: Adapter) -> float:
    """Return the largest difference between a client's states and a simulated observation [m, rad].

    Both are taken relative to the start of the episode. Rotation vectors are compared as rotations.

    Args:
        states: States sent by the client.
        seen: Simulated observation.
        first: Simulated observation at the start of the episode.
        states_then: States that the client sent at the start of the episode.
        layout: Adapter that defines the meaning of the numbers in a state.
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
    """Return the rotation, in the base frame, from the rotation vector ``before`` (3,) [rad] to ``now`` (3,) [rad]."""
    return turn_between(from_axis_angle(before.tolist()), from_axis_angle(now.tolist()))


def trial_of(instruction: str) -> TrialId:
    """Return the trial with seed 0 of the first training condition that has the given instruction.

    Raises InvalidInputError if no training condition has this instruction. The message lists the closest instructions.
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


def require_layout(layout: Adapter, robot: str, own_space: str) -> None:
    """Raise InvalidInputError if a layout cannot be used for a robot that is served in ``own_space``."""
    space, spec = layout.answer.space, robot_named(robot)
    if space != own_space and (own_space != EE_DELTA.name or space not in spec.action_spaces):
        raise InvalidInputError(
            "--layout",
            f"{layout.name} uses the action space {space!r}, but the {spec.title} is served with {own_space!r}",
            "Choose a layout with this action space, or omit --layout",
        )
