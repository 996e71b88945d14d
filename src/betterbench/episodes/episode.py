"""The loop: observe, act, step, judge, record, until the episode has ended."""

from __future__ import annotations

import gc
import logging
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np

from betterbench.episodes.describe import TrialContext, describe
from betterbench.episodes.observer import Observer, Views
from betterbench.errors import InvalidActionError, PolicyError
from betterbench.interface import EpisodeStart, Observation, Policy
from betterbench.recording import Record, RecordBuilder, Termination
from betterbench.scenes import Scene
from betterbench.state import PrivilegedPolicy, WorldState
from betterbench.tasks import GoalTracker, Truth

logger = logging.getLogger(__name__)

Mind = Policy | PrivilegedPolicy


@dataclass(frozen=True, slots=True)
class EpisodeResult:
    """What an episode leaves behind.

    Attributes:
        record: The privileged record, a pure function of trial and policy.
        wall: Wall-clock figures, which the record must not hold [s].
    """

    record: Record
    wall: dict[str, float]


@dataclass
class _Answers:
    """Asks a mind for actions and plays out the chunks it answers with."""

    mind: Mind
    scene: Scene
    observer: Observer | None
    chunk: list[np.ndarray] = field(default_factory=list)
    latencies: list[float] = field(default_factory=list)
    observe_s: float = 0.0
    views: Views | None = None

    def next(self, state: WorldState) -> np.ndarray:
        """Return the next action.

        Raises:
            InvalidActionError: If the answer is no array of actions.
            PolicyError: If the policy breaks.
        """
        if not self.chunk:
            actions = self._ask(state)
            dim = self.scene.action_space.dim
            if actions.shape == (dim,):
                return actions
            if actions.ndim != 2 or actions.shape[1] != dim or len(actions) == 0:
                msg = (
                    f"the policy answered an array of shape {actions.shape}. {self.scene.action_space.name} wants "
                    f"({dim},) or (horizon, {dim}) with at least one action."
                )
                raise InvalidActionError(msg)
            self.chunk = list(actions)
        return self.chunk.pop(0)

    def reset(self) -> None:
        """Tell a policy that an episode begins.

        Raises:
            PolicyError: If it breaks.
        """
        if self.observer is not None:
            start = EpisodeStart(
                self.scene.condition.instruction.text,
                self.scene.seed,
                self.scene.action_space.name,
                task=self.scene.task.id,
                condition=self.scene.condition.name,
            )
            with _boundary():
                self.mind.reset(start)  # type: ignore[union-attr]

    def look(self) -> None:
        """Take the pictures of the next question, if it comes at once, before anything else is done with the state.

        Drawing leaves cold caches behind; all that follows, up to the next action, then shares the way back.
        """
        if self.observer is not None and not self.chunk:
            began = time.perf_counter()
            self.views = self.observer.look(self.scene)
            self.observe_s += time.perf_counter() - began

    def _ask(self, state: WorldState) -> np.ndarray:
        began = time.perf_counter()
        observation: Observation | None = None
        if self.observer is not None:
            views, self.views = self.views, None
            observation = self.observer.observe(self.scene, state, views=views)
            self.observe_s += time.perf_counter() - began
            began = time.perf_counter()
        with _boundary():
            answer = (
                self.mind.act_on_state(state)  # type: ignore[union-attr]
                if observation is None
                else self.mind.act(observation)  # type: ignore[union-attr]
            )
            actions = np.asarray(answer)
        self.latencies.append(time.perf_counter() - began)
        return actions


@contextmanager
def _settled_heap() -> Iterator[None]:
    """Keep the garbage collector from searching, in the middle of an episode, what was there before it.

    A full collection over the modules and assets of a run takes some 10 ms, as long as a control step with pictures.
    What an episode itself leaves behind is collected as ever.
    """
    if gc.get_freeze_count():
        yield  # somebody has frozen the heap already, and knows when to release it
        return
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()


@contextmanager
def _boundary() -> Iterator[None]:
    """Turn whatever a policy does wrong into a :class:`PolicyError`: the trial ends, the run goes on."""
    try:
        yield
    except (Exception, SystemExit) as problem:
        raise PolicyError(f"{type(problem).__name__}: {problem}") from problem


def run_episode(
    scene: Scene,
    mind: Mind,
    *,
    context: TrialContext,
    observer: Observer | None = None,
    on_step: Callable[[int], None] | None = None,
) -> EpisodeResult:
    """Run one episode from reset to its end.

    Args:
        scene: The scene; it is reset first, and its premise is checked.
        mind: The policy. With an observer it is asked for ``act``, without one for ``act_on_state``.
        context: What the trial is called within the run.
        observer: Makes observations; None for a privileged policy.
        on_step: Called with the number of each control step.

    Returns:
        The record and the wall-clock figures.

    Raises:
        PremiseError: If the scene does not show what the instruction presupposes.
    """
    began = time.perf_counter()
    state = scene.reset()
    tracker = GoalTracker(
        scene.condition, scene.info, template=scene.task.template, control_rate_hz=scene.control_rate_hz
    )
    builder = RecordBuilder(describe(scene, tracker, context))
    truth = tracker.update(state)
    _append(builder, scene, state, truth, action=None, applied=None)
    answers = _Answers(mind, scene, observer)
    limit = scene.task.step_limit(scene.condition)
    termination: Termination = "step_limit"
    error: str | None = None
    clipped = 0
    try:
        with _settled_heap():
            answers.reset()
            while state.step < limit and not truth.success:
                action = np.asarray(answers.next(state))
                applied = scene.step(action)
                answers.look()
                clipped += applied.tolist() != action.tolist()
                state = scene.state()
                truth = tracker.update(state)
                _append(builder, scene, state, truth, action=action.astype(np.float64), applied=applied)
                if on_step is not None:
                    on_step(state.step)
        if truth.success:
            termination = "success"
    except PolicyError as problem:
        termination, error = "policy_error", str(problem)
    except InvalidActionError as problem:
        termination, error = "policy_error", f"{type(problem).__name__}: {problem}"
    if error is not None:
        logger.warning("%s seed %d: %s", scene.condition.id, scene.seed, error)
    record = builder.finish(
        termination=termination,
        success=truth.success and termination == "success",
        error=error,
        clipped_actions=clipped,
        invalid_actions=int(termination == "policy_error" and (error or "").startswith("InvalidActionError")),
    )
    return EpisodeResult(record, _wall_figures(answers, time.perf_counter() - began))


def _append(
    builder: RecordBuilder,
    scene: Scene,
    state: WorldState,
    truth: Truth,
    *,
    action: np.ndarray | None,
    applied: np.ndarray | None,
) -> None:
    data = scene.data
    builder.append(
        state,
        qpos=data.qpos,
        qvel=data.qvel,
        ctrl=data.ctrl,
        act=data.act,
        action=action,
        applied=applied,
        predicates=truth.relations,
        subgoals=truth.subgoals,
        goal=truth.goal,
        forbidden=truth.forbidden,
    )


def _wall_figures(answers: _Answers, total: float) -> dict[str, float]:
    latencies = np.array(answers.latencies or [0.0])
    return {
        "duration_s": round(total, 6),
        "policy_s": round(float(latencies.sum()), 6),
        "policy_latency_p50_s": round(float(np.median(latencies)), 6),
        "policy_latency_max_s": round(float(latencies.max()), 6),
        "observe_s": round(answers.observe_s, 6),
    }
