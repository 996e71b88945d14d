"""Execution of action chunks: requests for chunks, and selection of the action for each control step."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Generator
from typing import TYPE_CHECKING

import numpy as np

from betterbench.episodes.answers import Question, Reply, answer
from betterbench.errors import InvalidActionError
from betterbench.interface import EpisodeStart, Execution, Observation, episode_number
from betterbench.interface.actions import ActionSpace
from betterbench.interface.state import PrivilegedPolicy, WorldState

if TYPE_CHECKING:  # this module must not import the simulator, because policy servers use it to check chunks
    from betterbench.episodes.observer import Observer, Views
    from betterbench.sim.worlds import TrialScene


class Chunks:
    """Controller that requests action chunks and returns the action for each control step.

    If ``execution.ahead`` is set, the next chunk is requested before all actions of the current chunk have been
    executed. When the next chunk is used, its actions for steps that have already passed are dropped. The results
    therefore do not depend on the inference time of the policy.
    """

    def __init__(
        self, scene: TrialScene, observer: Observer | None, execution: Execution, *, limit: int, began: float
    ) -> None:
        """Prepare an episode of at most ``limit`` steps.

        ``began`` is the time at which the episode started [s], as measured by ``time.perf_counter``.
        """
        self._scene, self._observer, self._execution, self._limit = scene, observer, execution, limit
        self._queue: deque[np.ndarray] = deque()
        self._asked = False
        self._passing = 0  # number of actions to drop from the next reply, because their steps will have passed
        self._predictions: deque[tuple[int, np.ndarray]] = deque()
        self._views: Views | None = None
        self._latencies: list[float] = []
        self._observe_s = 0.0
        self._began = self._resumed = began
        self._simulation_s = 0.0
        self._world_steps: dict[bool, list[float]] = {
            False: [],
            True: [],
        }  # step durations [s] without (False) and with (True) rendering, in scenes that render during steps

    def begin(self) -> Generator[Question | None, Reply | None, None]:
        """Yield the request that announces the start of an episode to the policy."""
        scene = self._scene
        start = EpisodeStart(scene.condition.instruction.text, episode_number(scene.seed), scene.action_space.name)
        yield from self._pause(Question(start))

    def begin_again(self) -> Generator[Question | None, Reply | None, None]:
        """Announce a new instruction to the policy, and drop the queued actions of the previous instruction."""
        if self._asked:
            yield from self._pause(None)
        self._asked, self._views = False, None
        self._queue.clear()
        self._predictions.clear()
        yield from self.begin()

    def next(
        self, state: WorldState, privileged: PrivilegedPolicy | None = None
    ) -> Generator[Question | None, Reply | None, np.ndarray]:
        """Return the action for the current control step. If a new chunk is needed, yield the request for it.

        If ``privileged`` is given, this policy is called directly, and no requests are yielded. Raises
        InvalidActionError if a reply is not an array of actions.
        """
        if privileged is not None:
            return self._next_of(privileged, state)
        queue = self._queue
        if self._execution.ensemble is not None:
            return (yield from self._mean(state))
        if not queue:
            question, passed = (None, self._passing) if self._asked else (Question(self._see(state)), 0)
            self._asked = False
            actions = self._answered((yield from self._pause(question)))
            if not self._execution.ahead and actions.shape == (self._scene.action_space.dim,):
                return actions  # the caller checks the action and applies it immediately
            self._queue_up(actions, passed)
        if self._asks_ahead(state.step):
            self._asked, self._passing = True, len(queue)
            yield from self._pause(Question(self._see(state), wanted_in=len(queue)))
        return queue.popleft()

    def _next_of(self, policy: PrivilegedPolicy, state: WorldState) -> np.ndarray:
        if self._queue:
            return self._queue.popleft()
        reply = answer(policy, state)
        self._simulation_s -= reply.took_s  # the clock of the simulation runs during this call, so correct its time
        actions = self._answered(reply)
        if actions.shape == (self._scene.action_space.dim,):
            return actions  # the caller checks the action and applies it immediately
        self._queue_up(actions, 0)
        return self._queue.popleft()

    def look(self, step: int) -> None:
        """Render the images for the next request, if it is made at this step.

        Call this immediately after a simulation step, before the state is used. Rendering evicts other data from the
        CPU caches, so data that was loaded before would have to be loaded again.
        """
        if self.looks_at(step):
            began = time.perf_counter()
            self._views = None if self._observer is None else self._observer.look(self._scene)
            self._observe_s += time.perf_counter() - began

    def looks_at(self, step: int) -> bool:
        """Return whether the policy will get a request at the given control step, which must be the next one."""
        if self._observer is None:
            return False
        return self._asks_ahead(step) if self._queue else not self._asked

    def note_world_step(self, seconds: float, *, drawn: bool) -> None:
        """Store the duration of one step of a scene that renders images during its steps.

        Args:
            seconds: Duration of the step [s].
            drawn: Whether images were rendered during this step.
        """
        self._world_steps[drawn].append(seconds)

    def _drawn_in_world_s(self) -> float:
        """Estimate the total rendering time [s] in scenes that render during steps.

        The estimate is the number of steps with images times the difference between the median durations of steps with
        and without images. If all steps have images, rendering cannot be separated from simulation, and the result is
        0.
        """
        plain, drawn = self._world_steps[False], self._world_steps[True]
        return max(0.0, float(np.median(drawn) - np.median(plain))) * len(drawn) if plain and drawn else 0.0

    def wall_figures(self) -> dict[str, float]:
        """Return the wall-clock times of the episode and its parts [s], and the number of replies."""
        now = time.perf_counter()
        drawn_s = self._drawn_in_world_s()
        simulated = self._simulation_s + now - self._resumed - self._observe_s - drawn_s
        latencies = np.array(self._latencies or [0.0])
        return {
            "duration_s": round(now - self._began, 6),
            "policy_s": round(float(latencies.sum()), 6),
            "policy_answers": float(len(self._latencies)),
            "policy_latency_p50_s": round(float(np.median(latencies)), 6),
            "policy_latency_max_s": round(float(latencies.max()), 6),
            "observe_s": round(self._observe_s + drawn_s, 6),
            "simulation_s": round(max(0.0, simulated), 6),
        }

    def _asks_ahead(self, step: int) -> bool:
        """Return whether the next chunk must be requested now, although actions of the current chunk are left.

        If the current chunk lasts until the step limit of the episode, no further chunk is requested.
        """
        left = len(self._queue)
        return not self._asked and 0 < left <= self._execution.ahead and step + left < self._limit

    def _pause(self, question: Question | None) -> Generator[Question | None, Reply | None, Reply | None]:
        """Yield a request, and return the reply. The waiting time is excluded from the simulation time."""
        self._simulation_s += time.perf_counter() - self._resumed
        try:
            return (yield question)
        finally:
            self._resumed = time.perf_counter()

    def _see(self, state: WorldState) -> Observation | WorldState:
        """Return the input of the policy: an observation, or the state if there is no observer."""
        if self._observer is None:
            return state
        began = time.perf_counter()
        views, self._views = self._views, None
        observation = self._observer.observe(self._scene, state, views=views)
        self._observe_s += time.perf_counter() - began
        return observation

    def _answered(self, reply: Reply | None) -> np.ndarray:
        """Store the latency of a reply, and return the array in the reply."""
        if reply is None:
            raise AssertionError("unreachable: a reply was due")
        self._latencies.append(reply.took_s)
        return reply.actions

    def _queue_up(self, answer: np.ndarray, passed: int) -> None:
        """Queue the actions in a reply, but drop the first ``passed`` actions, whose control steps have passed."""
        queue = self._queue
        chunk = checked_chunk(answer, self._scene.action_space)
        horizon = self._limit if self._execution.horizon is None else self._execution.horizon
        queue.extend(chunk[passed : passed + horizon])
        if not queue:
            msg = (
                f"the policy returned {len(chunk)} actions, but {passed} steps had passed, so no action is left. "
                "Reduce ahead."
            )
            raise InvalidActionError(msg)

    def _mean(self, state: WorldState) -> Generator[Question | None, Reply | None, np.ndarray]:
        """Request a chunk, and return the weighted mean of the predictions of all chunks for this step."""
        space, predictions, step = self._scene.action_space, self._predictions, state.step
        answer = self._answered((yield from self._pause(Question(self._see(state)))))
        predictions.append((step, checked_chunk(answer, space)))
        while predictions[0][0] + len(predictions[0][1]) <= step:
            predictions.popleft()
        actions = np.array([chunk[step - first] for first, chunk in predictions if step - first < len(chunk)])
        return weighted_mean(actions, float(self._execution.ensemble or 0.0), space)


def checked_chunk(answer: np.ndarray, space: ActionSpace) -> np.ndarray:
    """Check the array that a policy returned, and convert it to a new array (horizon, dim) float64.

    Raises:
        InvalidActionError: If the array is neither an action (dim,) nor a chunk (horizon, dim) of numbers, or if it
            contains a non-finite number.
    """
    if answer.ndim == 0 and answer.dtype.kind not in "fiub":
        msg = (
            "expected an array of numbers from the policy, got None, a string, a dict or another object. "
            f"Return an array of shape ({space.dim},) or (horizon, {space.dim}) for {space.name}."
        )
        raise InvalidActionError(msg)
    actions = answer[None, :] if answer.shape == (space.dim,) else answer
    if actions.ndim != 2 or actions.shape[1] != space.dim or len(actions) == 0:
        msg = (
            f"the policy returned an array of shape {answer.shape}. {space.name} needs ({space.dim},) or "
            f"(horizon, {space.dim}) with at least one action."
        )
        raise InvalidActionError(msg)
    if actions.dtype.kind not in "fiu":
        space.clip(actions[0])
    chunk = np.array(actions, dtype=np.float64)
    bad = np.flatnonzero(~np.isfinite(chunk).all(axis=1))
    if len(bad):
        try:
            space.clip(chunk[bad[0]])
        except InvalidActionError as problem:
            raise InvalidActionError(f"{problem} It is action {bad[0] + 1} of a chunk of {len(chunk)}.") from None
    return chunk


def weighted_mean(actions: np.ndarray, rate: float, space: ActionSpace) -> np.ndarray:
    """Return the weighted mean (dim,) of several predictions (n, dim) for one step, ordered from oldest to newest.

    Prediction i has the weight exp(-m i), where m is ``rate`` and i = 0 is the oldest prediction, as in ACT's temporal
    ensembling. A quaternion and its negative describe the same rotation, so quaternions are negated where necessary to
    have the same sign before they are averaged.
    """
    if "qw" in space.components:
        first = space.components.index("qw")
        turns = actions[:, first : first + 4]
        turns[turns @ turns[0] < 0.0] *= -1.0
    exponents = -rate * np.arange(len(actions))
    weights = np.exp(exponents - exponents.max())
    mean: np.ndarray = weights @ actions / weights.sum()
    return mean
