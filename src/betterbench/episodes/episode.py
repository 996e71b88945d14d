"""Episode loop: observe, act, simulate, judge and record."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Generator
from dataclasses import dataclass

import numpy as np

from betterbench.episodes.answers import Question, Reply, answer
from betterbench.episodes.chunks import Chunks
from betterbench.episodes.description import TrialContext, describe
from betterbench.episodes.heap import settled_heap
from betterbench.episodes.observer import Observer
from betterbench.errors import (
    InvalidActionError,
    PolicyError,
    PolicyKilledError,
    PolicyUnavailableError,
    encodable,
)
from betterbench.interface import Execution
from betterbench.interface.state import AnyPolicy, PrivilegedPolicy, WorldState
from betterbench.records import Record, RecordBuilder, Termination
from betterbench.sim.worlds import Tracker, TrialScene
from betterbench.tasks import Truth

logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class EpisodeResult:
    """Result of an episode.

    Attributes:
        record: Record of the episode including privileged state. It depends only on the trial and the policy.
        wall: Wall-clock times of the episode and its parts [s] (see ``Chunks.wall_figures``). They are not part of the
            record, which must be reproducible.
        states: Simulation state for each row of the record.
    """

    record: Record
    wall: dict[str, float]
    states: tuple[WorldState, ...]


_LONGEST_BLOCK = 20
"""Maximum number of states in a block, which limits the duration of the control step in which a block is judged."""

Steps = Generator[Question | None, Reply | None, EpisodeResult]
"""Generator that runs an episode, yields requests to the policy, and returns the result.

The caller sends the reply to each request into the generator. For a request that can wait (``wanted_in`` > 0), the
caller first sends None, and sends the reply when the generator yields None. If the policy fails, the caller throws a
:class:`~betterbench.errors.PolicyError` into the generator instead.
"""

_PLAIN = Execution()

Disturbance = Callable[[np.ndarray], np.ndarray]
"""Function that adds noise to an action before it is executed. The record contains both actions."""


def run_episode(
    scene: TrialScene,
    policy: AnyPolicy,
    *,
    context: TrialContext,
    observer: Observer | None = None,
    disturb: Disturbance | None = None,
    on_step: Callable[[int], None] | None = None,
) -> EpisodeResult:
    """Run one episode from the reset to its end, with a policy that is called in this thread.

    Args:
        scene: Scene of the trial.
        policy: Policy to run. Its method ``act`` is called if an observer is given, and otherwise ``act_on_state``.
        context: Information about the trial for the metadata of the record.
        observer: Observer that creates the observations, or None for a policy that uses the privileged state.
        disturb: Function that adds noise to the actions of a demonstration. The record then contains the action of the
            demonstrator as ``action``, and the executed action as ``applied``.
        on_step: Function that is called with the step number after each control step.

    Raises:
        PremiseError: If the scene violates a premise of the instruction.
        PolicyUnavailableError: If the policy's server cannot be reached.
        HandshakeError: If the policy's server now serves a different policy.
    """
    execution = _PLAIN if observer is None else policy.info.execution  # type: ignore[union-attr]
    steps = episode_steps(
        scene,
        context=context,
        observer=observer,
        execution=execution,
        disturb=disturb,
        on_step=on_step,
        privileged=policy if observer is None else None,  # type: ignore[arg-type]
    )
    outcome: Reply | PolicyError | None = None
    kept: Reply | PolicyError | None = None
    with settled_heap():
        try:
            question = next(steps)
            while True:
                if question is None:
                    outcome, kept = kept, None
                else:
                    try:
                        outcome = answer(policy, question.seen)
                    except PolicyUnavailableError:
                        raise
                    except PolicyError as problem:
                        outcome = problem
                    if question.wanted_in:
                        outcome, kept = None, outcome
                question = steps.throw(outcome) if isinstance(outcome, PolicyError) else steps.send(outcome)
        except StopIteration as end:
            result: EpisodeResult = end.value
            return result
        finally:
            steps.close()
            outcome = kept = None  # break the reference cycle of error and frame, which would keep the scene in memory


def episode_steps(
    scene: TrialScene,
    *,
    context: TrialContext,
    observer: Observer | None = None,
    execution: Execution = _PLAIN,
    disturb: Disturbance | None = None,
    on_step: Callable[[int], None] | None = None,
    privileged: PrivilegedPolicy | None = None,
) -> Steps:
    """Run one episode from the reset to its end, and yield the requests to the policy.

    As a generator, it allows one thread to run many episodes concurrently. The result does not depend on the time that
    replies take. If an observer is given, the generator yields each request. It yields None when it cannot go on
    without the reply to an earlier request. Without an observer, it yields nothing, but calls the policy ``privileged``
    directly with the privileged state. See :func:`run_episode` for the other arguments.

    Raises:
        PremiseError: If the scene violates a premise of the instruction.
        PolicyKilledError: If the process of the policy was killed by another process.
    """
    began = time.perf_counter()
    state = scene.reset()
    tracker = scene.tracker()
    judge = _Judge(tracker, RecordBuilder(describe(scene, tracker, context)), scene)
    judge.see(state, None, None)
    limit = scene.step_limit
    chunks = Chunks(scene, observer, execution, limit=limit, began=began)
    termination: Termination = "step_limit"
    error: str | None = None
    try:
        if observer is not None:
            yield from chunks.begin()
        while state.step < limit and not judge.success and not scene.over:
            action = yield from chunks.next(state, privileged)
            executed = action if disturb is None else disturb(action)
            applied = (
                _drawing_step(scene, chunks, executed, state.step + 1) if scene.draws_in_step else scene.step(executed)
            )
            if observer is not None:
                chunks.look(state.step + 1)
            state = scene.state()
            judge.see(state, action, applied)
            if on_step is not None:
                on_step(state.step)
            if scene.instructed_anew:
                yield from chunks.begin_again()
        if judge.success:
            termination = "success"
    except (PolicyUnavailableError, PolicyKilledError):
        raise
    except PolicyError as problem:
        termination, error = "policy_error", str(problem)
    except InvalidActionError as problem:
        termination, error = "policy_error", f"{type(problem).__name__}: {problem}"
    builder, success = judge.finished()
    record = _finished(scene, builder, termination, error, success=success)
    return EpisodeResult(record, chunks.wall_figures(), builder.states)


def _drawing_step(scene: TrialScene, chunks: Chunks, action: np.ndarray, step: int) -> np.ndarray:
    """Execute the control step that ends at step number ``step``, in a scene that renders during the step."""
    drawn = chunks.looks_at(step)
    scene.draw_next(wanted=drawn)
    began = time.perf_counter()
    applied = scene.step(action)
    chunks.note_world_step(time.perf_counter() - began, drawn=drawn)
    return applied


class _Judge:
    """Recorder and judge of the states of an episode.

    For speed, states are judged in blocks instead of one at a time. After a physics step, the CPU caches contain other
    data, so judging a single state takes two to three times as long as judging one state of a block. A goal must hold
    for some time before it counts as success, so a block can end before the next possible success, and the episode
    still stops at the same step. With blocks, the episode loop takes 1.15 to 1.16 times as long as the physics alone,
    and without blocks 1.21 to 1.32 times as long (measured by ``make bench ARGS="--only step"`` on 2026-11-26, minimum
    time per block, three tasks).
    """

    def __init__(self, tracker: Tracker, builder: RecordBuilder, scene: TrialScene) -> None:
        self.success = False
        self._builder, self._tracker, self._simulator_state = builder, tracker, scene.simulator_state
        self._waiting: list[WorldState] = []
        self._block = 1

    def see(self, state: WorldState, action: np.ndarray | None, applied: np.ndarray | None) -> None:
        """Record the next state and the action that led to it. Update ``success`` when a block is complete."""
        self._builder.append_state(state, **self._simulator_state(), action=action, applied=applied)
        self._waiting.append(state)
        if len(self._waiting) >= self._block:
            self._judge()

    def finished(self) -> tuple[RecordBuilder, bool]:
        """Judge the remaining states. Return the record builder, and whether the goal was reached at the last state."""
        self._judge()
        return self._builder, self.success

    def _judge(self) -> None:
        for state in self._waiting:
            truth = self._tracker.update(state)
            _append_truth(self._builder, truth)
            self.success = truth.success
        self._waiting.clear()
        self._block = min(_LONGEST_BLOCK, 1 + self._tracker.undecided_states)


def _finished(
    scene: TrialScene,
    builder: RecordBuilder,
    termination: Termination,
    error: str | None,
    *,
    success: bool,
) -> Record:
    if error is not None:
        error = encodable(error)  # replace characters that a record cannot store, e.g. in file names
        logger.warning("%s seed %d: %s", scene.condition.id, scene.seed, error)
    return builder.finish(
        termination=termination,
        success=success and termination == "success",
        error=error,
        clipped_actions=scene.action_space.count_clipped(builder.actions),
        invalid_actions=int(termination == "policy_error" and (error or "").startswith("InvalidActionError")),
    )


def append_row(
    builder: RecordBuilder,
    scene: TrialScene,
    state: WorldState,
    truth: Truth,
    *,
    action: np.ndarray | None,
    applied: np.ndarray | None,
) -> None:
    """Append a row to a record: state of the scene, ground truth of the goal, and the action that led to the state.

    ``action`` is the action of the policy, and ``applied`` is the executed action. Both are None for the first row.
    """
    builder.append_state(state, **scene.simulator_state(), action=action, applied=applied)
    _append_truth(builder, truth)


def _append_truth(builder: RecordBuilder, truth: Truth) -> None:
    builder.append_truth(
        predicates=truth.relations, subgoals=truth.subgoals, goal=truth.goal, forbidden=truth.forbidden
    )
