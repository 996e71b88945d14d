"""ShadowSimulations: a served expert steps its own copy of the client's scene, because a client has observations only.

A trial is a pure function of its name: the same task, condition, seed and actions give the same state to the last bit
on the same machine. So a shadow needs nothing from its client but the number of the control step, and a client that
executes fewer actions of a chunk than it got, that asks again, or that comes back after a lost connection or to a
restarted server gets the same actions as before. What the client measures is compared with the shadow's own state: the
first action that was not one of the answered ones shows.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from dataclasses import dataclass

import numpy as np

from betterbench.errors import InvalidInputError, PolicyError, PremiseError, UnknownNameError
from betterbench.experts import make_expert
from betterbench.interface import Observation
from betterbench.interface.actions import EE_DELTA
from betterbench.interventions import vary
from betterbench.scenes import Scene
from betterbench.scenes.stage import quality_preset
from betterbench.state import WorldState
from betterbench.tasks import Condition, Task, get_task

TOLERANCE = 1e-6
"""Largest difference between client and shadow: joint angles [rad], end effector [m] and distance of the pads [m]."""
KEPT = 64
"""Simulations that a server keeps at once. Further clients are served too, but their simulations start anew."""


@dataclass(frozen=True, slots=True)
class TrialName:
    """What makes a trial.

    Attributes:
        task: Task id.
        condition: Name of a variation or of a training condition.
        seed: Seed.
    """

    task: str
    condition: str
    seed: int

    @classmethod
    def of(cls, task: str, condition: str | None, seed: int) -> TrialName:
        """Return the name of a trial that exists.

        Args:
            task: Task id.
            condition: Name of the condition, or None for the first training condition.
            seed: Seed.

        Raises:
            UnknownNameError: If there is no such task or condition.
            InvalidInputError: If the seed is negative.
        """
        if seed < 0:
            raise InvalidInputError("--seed", f"{seed} is negative", "Give 0 or more")
        trial = cls(task, condition or get_task(task).training[0].name, seed)
        trial.resolve()
        return trial

    def __str__(self) -> str:
        """Return the name for people."""
        return f"{self.task}/{self.condition} seed {self.seed}"

    def resolve(self) -> tuple[Task, Condition]:
        """Return task and condition.

        Raises:
            UnknownNameError: If there is no such task or condition.
        """
        task = get_task(self.task)
        return task, named_condition(task, self.condition)


def named_condition(task: Task, name: str) -> Condition:
    """Return a condition of a task by name: a variation's test condition or a training condition.

    Raises:
        UnknownNameError: If the task has neither.
    """
    for variation in task.variations:
        if variation.name == name:
            return vary(task, variation)[0]
    if name in {c.name for c in task.training}:
        return task.train(name)
    raise UnknownNameError(f"condition of {task.id}", name, (*(c.name for c in task.training), *_variations(task)))


def _variations(task: Task) -> tuple[str, ...]:
    return tuple(v.name for v in task.variations)


class ShadowSimulation:
    """One trial as one privileged policy plays it, as far as anybody has asked."""

    def __init__(self, policy: str, trial: TrialName) -> None:
        """Build the scene at its start.

        Args:
            policy: Address of the privileged policy.
            trial: The trial.

        Raises:
            UnknownNameError: If there is no such policy, task or condition.
            PolicyError: If the scene does not show what its instruction presupposes.
        """
        task, condition = trial.resolve()
        self.trial, self.condition = trial, condition
        # Physics does not depend on the quality, so that the client's may be another one.
        self._scene = Scene(task, condition, seed=trial.seed, action_space=EE_DELTA, quality=quality_preset("fast"))
        self.step_limit = task.step_limit(condition)
        self._mind = make_expert(policy, self._scene)
        try:
            self._state: WorldState = self._scene.reset()
        except PremiseError as problem:
            raise PolicyError(str(problem)) from problem
        self._actions: list[np.ndarray] = []
        self._measured = [_measure(self._state)]
        self._end: Exception | None = None
        self._lock = threading.Lock()

    def actions(self, step: int, count: int, *, seen: Observation | None = None) -> np.ndarray:
        """Return what the policy does from a control step on.

        Args:
            step: Control steps that the client has taken since reset.
            count: Number of actions wanted; fewer come where the policy breaks down on the way.
            seen: What the client measures at that step, to be compared, or None.

        Returns:
            (1 to count, 7) float64 actions.

        Raises:
            InvalidInputError: If the trial has ended by that step.
            PolicyError: If the client's state is another one than the shadow's, or the policy itself breaks down.
        """
        if step >= self.step_limit:
            raise InvalidInputError(
                "better/step",
                f"{self.trial} ends after {self.step_limit} steps, and this is step {step}",
                "A new episode is a new connection, another prompt, or better/step 0",
            )
        with self._lock:
            self._advance(step)
            if seen is not None:
                self._compare(step, seen)
            self._advance(step + count, needed=step)
            return np.array(self._actions[step : step + count])

    def position(self, step: int) -> np.ndarray:
        """Return where the end effector is at a step that has been reached, (3,) in the robot base frame [m]."""
        return self._measured[step][7:10]

    def _advance(self, until: int, *, needed: int | None = None) -> None:
        """Play on until that many actions are known.

        Args:
            until: Number of actions.
            needed: Number of the action that has to be known; if None, all of them.
        """
        while len(self._actions) < until and self._end is None:
            try:
                action = np.asarray(self._mind.act_on_state(self._state), dtype=np.float64).copy()
                self._scene.step(action)
            except Exception as problem:  # noqa: BLE001 - a policy that breaks down does so at its step, not earlier
                self._end = problem
                break
            self._state = self._scene.state()
            self._actions.append(action)
            self._measured.append(_measure(self._state))
        if self._end is not None and len(self._actions) < (until if needed is None else needed + 1):
            raise PolicyError(f"{type(self._end).__name__}: {self._end}")

    def _compare(self, step: int, seen: Observation) -> None:
        theirs = np.array([*seen.joint_positions, *seen.ee_position, *seen.ee_quaternion, seen.gripper_width])
        gap = np.abs(theirs - self._measured[step])
        if gap.max() <= TOLERANCE:
            return
        joint, hand = gap[:7].max(), float(np.linalg.norm(theirs[7:10] - self._measured[step][7:10]))
        raise PolicyError(
            f"{self.trial} step {step}: the client's robot is not where the answered actions lead (joints differ by up "
            f"to {joint:.3g} rad, the end effector is {hand:.3g} m off, the fingers {gap[14]:.3g} m). The client has "
            "executed other actions than those answered, or it runs another version or another machine's arithmetic"
        )


def _measure(state: WorldState) -> np.ndarray:
    """Return (15,) joint angles, end-effector position and quaternion, and distance of the finger pads."""
    pose = state.ee_pose
    return np.array([*state.joint_positions, *pose.position, *pose.quaternion, state.finger_width_m])


class ShadowSimulations:
    """The shadows of one served policy, by trial."""

    def __init__(self, policy: str) -> None:
        """Prepare for one privileged policy."""
        self._policy = policy
        self._kept: OrderedDict[TrialName, ShadowSimulation] = OrderedDict()
        # Building scenes fills caches that are shared by all of them.
        self._lock = threading.Lock()

    def of(self, trial: TrialName) -> ShadowSimulation:
        """Return the shadow of a trial, a new one where none is kept.

        Raises:
            UnknownNameError: If there is no such task or condition.
            PolicyError: If the scene does not show what its instruction presupposes.
        """
        with self._lock:
            shadow = self._kept.get(trial)
            if shadow is None:
                shadow = self._kept[trial] = ShadowSimulation(self._policy, trial)
            self._kept.move_to_end(trial)
            while len(self._kept) > KEPT:
                self._kept.popitem(last=False)
            return shadow
