"""Shadow simulations: a served expert steps its own copy of the client's scene, because clients send only observations.

A trial is a pure function of its id: on the same machine, the same task, condition, seed and actions give bit-identical
states. A shadow simulation therefore needs only the control step from its client. A client that executes only a part of
a chunk, repeats a request, or reconnects (even to a restarted server) gets the same actions. A comparison of the
client's measurements with the shadow's state reveals a client that executed other actions.
"""

from __future__ import annotations

import threading
from collections import OrderedDict

import numpy as np

from betterbench.errors import InvalidInputError, PolicyError, PremiseError
from betterbench.evaluation.serving.memory import return_memory
from betterbench.geometry import normalize, to_axis_angle, turn_between
from betterbench.interface import Observation
from betterbench.interface.actions import EE_DELTA, EE_DELTA_MEASURED, EE_POSE, JOINT_DELTA, JOINT_POSITION
from betterbench.interface.state import WorldState
from betterbench.policies.kinds import make_privileged
from betterbench.sim.scenes import Scene
from betterbench.sim.scenes.stage import quality_preset
from betterbench.tasks import TrialId
from betterbench.tasks.interventions import resolve_condition

TOLERANCE = 1e-6
"""Largest difference between client and shadow: joint angles [rad], end effector [m] and distance of the pads [m]."""
KEPT = 64
"""Maximum number of simulations of a server, 20 MB each.

For further clients, the oldest simulations are dropped and repeated when needed.
"""
SPARE = 4
"""Number of simulations kept in addition to one per client, for clients that reconnect."""


def require_within(trial: TrialId, step: int, step_limit: int) -> None:
    """Raise InvalidInputError if a trial is over at a control step."""
    if step >= step_limit:
        raise InvalidInputError(
            "better/step",
            f"{trial} ends after {step_limit} steps, and this is step {step}",
            "Begin a new episode with a new connection, another prompt, or better/step 0",
        )


class ShadowSimulation:
    """One trial with one privileged policy, simulated up to the last requested step."""

    def __init__(self, policy: str, trial: TrialId) -> None:
        """Build the scene and reset it.

        Raises:
            UnknownNameError: If no such policy, task or condition exists.
            PolicyError: If the scene contradicts the instruction's premise.
        """
        found = resolve_condition(trial.task, trial.condition)
        self.trial, self.condition = trial, found.condition
        # physics does not depend on the render quality, so the client may use another preset
        self._scene = Scene(
            found.task, found.condition, seed=trial.seed, action_space=EE_DELTA, quality=quality_preset("fast")
        )
        self.step_limit = found.task.step_limit(found.condition)
        self._expert = make_privileged(policy, self._scene)
        try:
            self._state: WorldState = self._scene.reset()
        except PremiseError as problem:
            raise PolicyError(str(problem)) from problem
        self._actions: list[np.ndarray] = []
        self._measured = [_measure(self._state)]
        self._commanded = [self._scene.controller.state()]
        self._end: Exception | None = None
        self._lock = threading.Lock()

    def actions(self, step: int, count: int, *, seen: Observation | None = None) -> np.ndarray:
        """Return the policy's actions from a control step on, (1 to ``count``, 7).

        There are fewer actions if the policy fails earlier.

        ``seen`` is the client's measurement at that step, for comparison.

        Raises:
            InvalidInputError: If the trial has ended by that step.
            PolicyError: If the client's state differs from the shadow's, or the policy fails.
        """
        require_within(self.trial, step, self.step_limit)
        with self._lock:
            self._advance(step)
            if seen is not None:
                self._compare(step, seen)
            self._advance(step + count, needed=step)
            return np.array(self._actions[step : step + count])

    def observation(self, step: int) -> Observation:
        """Return the observation at a control step, without images; raise the errors of :meth:`actions`."""
        require_within(self.trial, step, self.step_limit)
        with self._lock:
            self._advance(step)
            numbers = self._measured[step]
        return Observation(
            instruction=self.condition.instruction.text,
            step=step,
            images={},
            joint_positions=numbers[:7],
            joint_velocities=numbers[15:],
            ee_position=numbers[7:10],
            ee_quaternion=numbers[10:14],
            gripper_width=float(numbers[14]),
            depth={},
            masks={},
        )

    def in_space(self, space: str, step: int, actions: np.ndarray) -> np.ndarray:
        """Convert actions executed from a control step on, (n, 7), to another action space, (n, dim).

        The converted actions command the same poses and joint angles one step later.
        """
        if space == EE_DELTA.name:
            return actions
        rows = []
        for i, action in enumerate(actions.tolist(), start=step):
            before, after = self._commanded[i], self._commanded[i + 1]
            if space == EE_POSE.name:
                numbers = [*after.pose.position, *after.pose.quaternion]
            elif space == EE_DELTA_MEASURED.name:
                seen = self._measured[i]
                turn = turn_between(normalize(seen[10:14].tolist()), after.pose.quaternion)
                moved = [*(np.array(after.pose.position) - seen[7:10]), *to_axis_angle(turn)]
                numbers = (np.array(moved) / EE_DELTA_MEASURED.scale[:-1]).tolist()
            elif space == JOINT_POSITION.name:
                numbers = list(after.joints)
            else:
                numbers = ((np.array(after.joints) - before.joints) / JOINT_DELTA.scale[:-1]).tolist()
            rows.append([*numbers, action[-1]])
        return np.array(rows)

    def _advance(self, until: int, *, needed: int | None = None) -> None:
        """Simulate until ``until`` actions are known. Action ``needed`` must be among them.

        If ``needed`` is None, all actions are required.
        """
        while len(self._actions) < until and self._end is None:
            try:
                action = np.asarray(self._expert.act_on_state(self._state), dtype=np.float64).copy()
                self._scene.step(action)
            except Exception as problem:  # noqa: BLE001 - a failure is reported at the step where it happens
                self._end = problem
                break
            self._state = self._scene.state()
            self._actions.append(action)
            self._measured.append(_measure(self._state))
            self._commanded.append(self._scene.controller.state())
        if self._end is not None and len(self._actions) < (until if needed is None else needed + 1):
            raise PolicyError(f"{type(self._end).__name__}: {self._end}")

    def _compare(self, step: int, seen: Observation) -> None:
        theirs = np.array([*seen.joint_positions, *seen.ee_position, *seen.ee_quaternion, seen.gripper_width])
        gap = np.abs(theirs - self._measured[step][:15])
        if gap.max() <= TOLERANCE:
            return
        joint, tool = gap[:7].max(), float(np.linalg.norm(theirs[7:10] - self._measured[step][7:10]))
        raise PolicyError(
            f"{self.trial} step {step}: the client's robot is not where the answered actions lead (joints differ by up "
            f"to {joint:.3g} rad, the end effector is {tool:.3g} m off, the fingers {gap[14]:.3g} m). The client "
            "executed actions that were not in the answers, or runs another version or on another kind of CPU"
        )


def _measure(state: WorldState) -> np.ndarray:
    """Return (22,) joint angles, end-effector position and quaternion, distance of the pads, joint velocities."""
    pose = state.ee_pose
    tool = (*pose.position, *pose.quaternion, state.finger_width_m)
    return np.array([*state.joint_positions, *tool, *state.joint_velocities])


class ShadowSimulations:
    """The shadow simulations of one served policy, by trial."""

    def __init__(self, policy: str) -> None:
        self._policy = policy
        self._kept: OrderedDict[TrialId, ShadowSimulation] = OrderedDict()
        self._clients = 0
        # lock, because building a scene fills caches shared by all scenes
        self._lock = threading.Lock()

    def of(self, trial: TrialId) -> ShadowSimulation:
        """Return the shadow simulation of a trial, or a new simulation if it was dropped."""
        with self._lock:
            shadow = self._kept.get(trial)
            if shadow is None:
                shadow = self._kept[trial] = ShadowSimulation(self._policy, trial)
            self._kept.move_to_end(trial)
            self._drop_oldest()
            return shadow

    def client_came(self) -> None:
        """Count a new client."""
        with self._lock:
            self._clients += 1

    def client_left(self) -> None:
        """Count the departure of a client, and drop surplus simulations."""
        with self._lock:
            self._clients -= 1
            dropped = self._drop_oldest()
        if dropped:
            return_memory()

    def _drop_oldest(self) -> bool:
        """Drop surplus simulations, and return whether there were any. The caller must hold the lock."""
        most = min(KEPT, self._clients + SPARE)
        dropped = len(self._kept) > most
        while len(self._kept) > most:
            self._kept.popitem(last=False)
        return dropped
