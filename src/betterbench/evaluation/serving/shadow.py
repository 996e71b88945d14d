"""Shadow simulations: for each client of a served expert, the server simulates a copy of the client's scene.

This is necessary because the expert needs the state of the scene, but clients send only observations. On the same kind
of machine, the same task, condition, seed and actions give bit-identical states, so a client only has to send its
trial and its control step. A client that executes only a part of a chunk, repeats a request, or reconnects (even to a
server that has been restarted) gets the same actions. The client's measurements are compared with the state of the
shadow simulation, to detect clients that have executed other actions.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from dataclasses import dataclass

import numpy as np

from betterbench.errors import InvalidInputError, PolicyError, PremiseError
from betterbench.evaluation.serving.memory import return_memory
from betterbench.geometry import normalize, to_axis_angle, turn_between
from betterbench.interface import Observation
from betterbench.interface.actions import (
    EE_DELTA_MEASURED,
    EE_POSE,
    JOINT_DELTA,
    JOINT_POSITION,
    USUAL_ROBOT,
    action_space,
)
from betterbench.interface.state import WorldState
from betterbench.policies.kinds import make_privileged
from betterbench.sim.robots import robot_space
from betterbench.sim.scenes import Scene
from betterbench.sim.scenes.stage import quality_preset
from betterbench.tasks import TrialId
from betterbench.tasks.interventions import resolve_condition

TOLERANCE = 1e-6
"""Maximum allowed difference between the client and the shadow simulation.

It applies to joint angles [rad], end-effector position [m], quaternion components and gripper width [m].
"""
KEPT = 64
"""Maximum number of simulations per server.

Each takes 20 MB. The simulations that have not been used for the longest time are dropped, and are run again if needed.
"""
SPARE = 4
"""Number of simulations that are kept for clients that reconnect, in addition to one per connected client."""


def require_within(trial: TrialId, step: int, step_limit: int) -> None:
    """Raise InvalidInputError if the requested control step is after the end of the trial."""
    if step >= step_limit:
        raise InvalidInputError(
            "better/step",
            f"{trial} ends after {step_limit} steps, but step {step} was requested",
            "Begin a new episode by opening a new connection, sending another prompt, or sending better/step 0",
        )


class ShadowSimulation:
    """Simulation of a trial with a privileged policy. It advances when later control steps are requested."""

    def __init__(self, policy: str, trial: TrialId, *, robot: str = USUAL_ROBOT) -> None:
        """Build the scene and reset it. The policy uses the standard action space of the robot.

        Raises:
            UnknownNameError: If the policy, task or condition does not exist.
            PolicyError: If the scene violates an assumption of the instruction.
        """
        found = resolve_condition(trial.task, trial.condition)
        self.trial, self.condition = trial, found.condition
        # The rendering quality does not affect the physics, so the client may use another one.
        self._scene = Scene(
            found.task,
            found.condition,
            seed=trial.seed,
            action_space=action_space(robot_space(robot)),
            quality=quality_preset("fast"),
            robot_name=robot,
        )
        self._spec = self._scene.compiled.robot
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
        """Return up to ``count`` actions of the policy, beginning at control step ``step``, as an array (n, dim).

        If the policy fails at a later step, only the actions before the failure are returned. If ``seen`` is given, the
        client's measurements in it are compared with the simulation at ``step``.

        Raises:
            InvalidInputError: If the trial ends before ``step``.
            PolicyError: If the client's state differs from the simulated state, or if the policy fails.
        """
        require_within(self.trial, step, self.step_limit)
        with self._lock:
            self._advance(step)
            if seen is not None:
                self._compare(step, seen)
            self._advance(step + count, needed=step)
            return np.array(self._actions[step : step + count])

    def observation(self, step: int) -> Observation:
        """Return the observation at a control step, without images. Raises the same errors as :meth:`actions`."""
        require_within(self.trial, step, self.step_limit)
        with self._lock:
            self._advance(step)
            numbers = self._measured[step]
        return Observation(
            instruction=self.condition.instruction.text,
            step=step,
            images={},
            joint_positions=numbers.joint_positions,
            joint_velocities=numbers.joint_velocities,
            ee_position=numbers.ee_position,
            ee_quaternion=numbers.ee_quaternion,
            gripper_width=numbers.gripper_width,
            depth={},
            masks={},
        )

    def in_space(self, space: str, step: int, actions: np.ndarray) -> np.ndarray:
        """Convert ``ee_delta`` actions (n, 7), the first for control step ``step``, to another action space (n, dim).

        A converted action commands the same pose or joint angles for the end of its control step as the original
        action. If ``space`` is the simulation's own action space, the actions are returned unchanged.
        """
        if space == self._scene.action_space.name:
            return actions
        rows = []
        for i, action in enumerate(actions.tolist(), start=step):
            before, after = self._commanded[i], self._commanded[i + 1]
            if space == EE_POSE.name:
                numbers = [*after.pose.position, *after.pose.quaternion]
            elif space == EE_DELTA_MEASURED.name:
                seen = self._measured[i]
                turn = turn_between(normalize(seen.ee_quaternion.tolist()), after.pose.quaternion)
                moved = [*(np.array(after.pose.position) - seen.ee_position), *to_axis_angle(turn)]
                numbers = (np.array(moved) / EE_DELTA_MEASURED.scale[:-1]).tolist()
            elif space == JOINT_POSITION.name:
                numbers = list(after.joints)
            else:
                numbers = ((np.array(after.joints) - before.joints) / JOINT_DELTA.scale[:-1]).tolist()
            rows.append([*numbers, action[-1]])
        return np.array(rows)

    def _advance(self, until: int, *, needed: int | None = None) -> None:
        """Continue the simulation until ``until`` actions are known.

        If the policy fails before that, its error is raised only if the action for control step ``needed`` is missing.
        If ``needed`` is None, the error is always raised.
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
        here = self._measured[step]
        if len(seen.joint_positions) != len(here.joint_positions):
            raise InvalidInputError(
                "better/joint_positions",
                f"the client's robot has {len(seen.joint_positions)} joints, but the served {self._spec.title} "
                f"has {len(here.joint_positions)}",
                "Use the same --robot for serving and evaluating",
            )
        joint = float(np.abs(seen.joint_positions - here.joint_positions).max())
        fingers = abs(seen.gripper_width - here.gripper_width)
        turned = float(np.abs(seen.ee_quaternion - here.ee_quaternion).max())
        if max(joint, fingers, turned, *np.abs(seen.ee_position - here.ee_position)) <= TOLERANCE:
            return
        tool = float(np.linalg.norm(seen.ee_position - here.ee_position))
        raise PolicyError(
            f"{self.trial} step {step}: the client's robot is not in the simulated state (the joints "
            f"differ by up to {joint:.3g} rad, the end effector is {tool:.3g} m off, the fingers {fingers:.3g} "
            "m). The client executed other actions, or uses a different version of betterbench or another kind of CPU"
        )


@dataclass(frozen=True, slots=True, eq=False)
class _Measurement:
    """Measurements of a robot at a control step. Names and units are the same as in :class:`Observation`."""

    joint_positions: np.ndarray
    joint_velocities: np.ndarray
    ee_position: np.ndarray
    ee_quaternion: np.ndarray
    gripper_width: float


def _measure(state: WorldState) -> _Measurement:
    pose = state.ee_pose
    return _Measurement(
        np.array(state.joint_positions),
        np.array(state.joint_velocities),
        np.array(pose.position),
        np.array(pose.quaternion),
        float(state.finger_width_m),
    )


class ShadowSimulations:
    """Shadow simulations for the clients of one served policy, with one simulation per trial."""

    def __init__(self, policy: str, *, robot: str = USUAL_ROBOT) -> None:
        self._policy, self._robot = policy, robot
        self.action_space = robot_space(robot)
        self._kept: OrderedDict[TrialId, ShadowSimulation] = OrderedDict()
        self._clients = 0
        # The lock also protects the construction of scenes, which fills caches that all scenes share.
        self._lock = threading.Lock()

    def of(self, trial: TrialId) -> ShadowSimulation:
        """Return the shadow simulation of a trial, and create it if necessary."""
        with self._lock:
            shadow = self._kept.get(trial)
            if shadow is None:
                shadow = self._kept[trial] = ShadowSimulation(self._policy, trial, robot=self._robot)
            self._kept.move_to_end(trial)
            self._drop_oldest()
            return shadow

    def client_came(self) -> None:
        """Count a new client."""
        with self._lock:
            self._clients += 1

    def client_left(self) -> None:
        """Count a client that has left, and drop simulations that are no longer needed."""
        with self._lock:
            self._clients -= 1
            dropped = self._drop_oldest()
        if dropped:
            return_memory()

    def _drop_oldest(self) -> bool:
        """Drop simulations that are no longer needed. Return whether any was dropped. The caller must hold the lock."""
        most = min(KEPT, self._clients + SPARE)
        dropped = len(self._kept) > most
        while len(self._kept) > most:
            self._kept.popitem(last=False)
        return dropped
