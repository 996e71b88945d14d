"""Policies of a protocol, and a thread that requests their actions so that the control loop never waits for them."""

from __future__ import annotations

import contextlib
import queue
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

import numpy as np

from betterbench.episodes.answers import answer
from betterbench.episodes.chunks import checked_chunk
from betterbench.errors import BetterError, InvalidInputError, PolicyError, described
from betterbench.interface import EpisodeStart, Observation, Policy, PolicyInfo
from betterbench.interface.actions import ActionSpace
from betterbench.policies.factory import PolicyFactory, check_action_space, close_policy
from betterbench.real.plan import RealPlan, RealPolicy

START_S = 120.0
"""Maximum time for a policy to become ready for a trial [s], including the time to load its weights."""
ANSWER_S = 30.0
"""Maximum time to wait for an answer of the policy [s]. After this time, the trial is aborted."""
_CHECK_S = 0.1
"""Interval between checks of the stop signal while a policy is loading [s]."""


def check_real_policy(address: str, info: PolicyInfo, space: ActionSpace, cameras: tuple[str, ...]) -> None:
    """Check that a policy can run on a real arm with the given action space and cameras.

    Raises:
        InvalidInputError: If the policy has a different action space, needs a camera that the robot lacks, or uses
            temporal ensembling.
    """
    check_action_space(address, info, space.name)
    missing = sorted(set(info.cameras or ()) - set(cameras))
    if missing:
        problem = f"the policy needs the camera {missing[0]!r}, but the robot has {', '.join(cameras) or 'none'}"
        raise InvalidInputError(address, problem, "Give the robot's cameras the names that the policy expects")
    if info.execution.ensemble is not None:
        problem = "temporal ensembling calls the policy at every step, and a real arm would have to wait"
        raise InvalidInputError(address, problem, "Remove ensemble from the policy address")


def require_images_suffice(policy: RealPolicy) -> None:
    """Raise InvalidInputError if a policy needs the simulator state, or UnknownNameError if it does not exist."""
    needs = PolicyFactory(policy.address).needs
    if needs.state or needs.trial:
        problem = f"{policy.address} reads the state of the simulator, which a real arm does not have"
        raise InvalidInputError(
            f"policy {policy.name}", problem, "Use a policy whose inputs are images and joint states"
        )


class RealPolicies:
    """Policies of a plan. Each policy is created at its first trial and reused for later trials."""

    def __init__(self, plan: RealPlan, cameras: tuple[str, ...], *, apart: bool = True) -> None:
        """Check the policy addresses without loading a policy.

        Args:
            plan: Plan of the protocol.
            cameras: Names of the robot's cameras.
            apart: Whether user code runs in a separate process.

        Raises:
            UnknownNameError: If a policy does not exist.
            InvalidInputError: If a policy needs the state of a simulator.
        """
        self._plan, self._cameras, self._apart = plan, cameras, apart
        self._made: dict[str, Policy] = {}
        for policy in plan.policies:
            require_images_suffice(policy)

    def get(self, name: str) -> Policy:
        """Return a policy by its name in the plan, and create it first if necessary.

        Errors that occur while the policy is created are passed on to the caller.
        """
        if name not in self._made:
            address = self._plan.address(name)
            made = PolicyFactory(address, apart=self._apart, timeout_s=ANSWER_S).take()
            try:
                check_real_policy(address, made.info, self._plan.action_space, self._cameras)
            except BetterError:
                close_policy(made)
                raise
            self._made[name] = made
        return self._made[name]

    def discard(self, name: str) -> None:
        """Close a policy that is still computing an answer for an earlier trial.

        The policy is created again for its next trial.
        """
        policy = self._made.pop(name, None)
        if policy is not None:
            close_policy(policy)

    def close(self) -> None:
        """Close all policies."""
        for policy in self._made.values():
            close_policy(policy)
        self._made.clear()


@dataclass(frozen=True, slots=True)
class _Answered:
    """Answer of the policy for one control step, or the error that was raised instead."""

    step: int
    actions: np.ndarray | None
    error: BetterError | None = None


class Asker:
    """Thread that requests action chunks from a policy. It provides one action per control step."""

    def __init__(self, policy: Policy, space: ActionSpace) -> None:
        """Start the thread."""
        self._policy, self._space, self._execution = policy, space, policy.info.execution
        self._questions: queue.Queue[tuple[int, EpisodeStart | Observation] | None] = queue.Queue()
        self._answers: queue.Queue[_Answered] = queue.Queue()
        self._actions: deque[np.ndarray] = deque()
        self._pending: int | None = None
        self._thread = threading.Thread(target=self._run, name="policy", daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """Wait for the pending answer, because the next trial may use the same policy."""
        self._questions.put(None)
        self._thread.join(timeout=ANSWER_S)

    @property
    def is_busy(self) -> bool:
        """Whether the policy is still computing an answer and cannot take another request."""
        return self._thread.is_alive()

    def start(self, start: EpisodeStart, *, check: Callable[[], None] = lambda: None) -> None:
        """Reset the policy, and wait until it is ready.

        ``check`` is called while waiting and may raise an exception. Raise PolicyError if the policy fails or is not
        ready in time.
        """
        self._questions.put((-1, start))
        end = time.monotonic() + START_S
        answered = None
        while answered is None:
            check()
            with contextlib.suppress(queue.Empty):
                answered = self._answers.get(timeout=_CHECK_S)
            if answered is None and time.monotonic() >= end:
                raise PolicyError(f"The policy was not ready after {START_S:.0f} s.")
        if answered.error is not None:
            raise answered.error

    def wants(self) -> bool:
        """Return whether the policy needs a new observation at this step."""
        return self._pending is None and len(self._actions) <= self._execution.ahead

    def ask(self, step: int, observation: Observation) -> None:
        """Send an observation to the policy and request its actions, beginning with the given control step."""
        self._pending = step
        self._questions.put((step, observation))

    def next(self, step: int, *, wait_s: float) -> np.ndarray | None:
        """Return the action for a step, (dim,), or None if it does not arrive within ``wait_s`` [s].

        Raises:
            PolicyError: If the policy failed.
            InvalidActionError: If the answer of the policy has a wrong shape or is not finite.
        """
        if self._pending is not None:
            with contextlib.suppress(queue.Empty):
                self._take(step, self._answers.get(timeout=0.0 if self._actions else wait_s))
        return self._actions.popleft() if self._actions else None

    def _take(self, step: int, answered: _Answered) -> None:
        self._pending = None
        if answered.error is not None:
            raise answered.error
        chunk = checked_chunk(np.asarray(answered.actions), self._space)
        # If requests are sent ahead, the first action belongs to the step of the observation, so the actions for steps
        # that have already passed are skipped. If not, the policy assumes that the arm waited, and no action is
        # skipped.
        passed = step - answered.step if self._execution.ahead else 0
        horizon = len(chunk) if self._execution.horizon is None else self._execution.horizon
        self._actions = deque(chunk[passed : passed + horizon])

    def _run(self) -> None:
        while (asked := self._questions.get()) is not None:
            step, seen = asked
            try:
                self._answers.put(_Answered(step, answer(self._policy, seen).actions))
            except BetterError as problem:
                self._answers.put(_Answered(step, None, problem))
            except BaseException as problem:  # noqa: BLE001 - of a user's policy, which must not leave the arm waiting
                self._answers.put(_Answered(step, None, PolicyError(described(problem))))
