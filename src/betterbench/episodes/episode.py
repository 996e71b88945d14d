"""The loop of an episode: observe, act, step, judge and record until it has ended."""

from __future__ import annotations

import gc
import logging
import time
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from betterbench.episodes.answers import AnyPolicy, Question, Reply, answer
from betterbench.episodes.chunks import Chunks
from betterbench.episodes.describe import TrialContext, describe, describe_foreign
from betterbench.episodes.observer import Observer
from betterbench.errors import InvalidActionError, PolicyError, PolicyKilledError, PolicyUnavailableError
from betterbench.interface import Execution
from betterbench.recording import Record, RecordBuilder, RecordMetadata, Termination
from betterbench.scenes import Scene
from betterbench.state import WorldState
from betterbench.tasks import GoalTracker, Truth
from betterbench.worlds import ForeignScene, ForeignTracker

logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class EpisodeResult:
    """What an episode leaves behind.

    Attributes:
        record: The privileged record, a pure function of trial and policy.
        wall: Wall-clock figures, which the record must not hold [s].
        states: The states of all rows of the record, for whoever goes on with them at once.
    """

    record: Record
    wall: dict[str, float]
    states: tuple[WorldState, ...]


_YOUNG_OBJECTS = 20_000
"""Objects that are made in an episode before garbage is looked for among them; the states of one are some 10 a step."""


@contextmanager
def _settled_heap() -> Iterator[None]:
    """Exclude everything that exists before an episode from garbage collection during it, and seldom look for more.

    A full collection over the modules and assets of a run takes some 10 ms, as long as a control step with images, and
    one over the states of an episode, none of which is garbage, a third of a millisecond.
    """
    young, *older = gc.get_threshold()
    frozen = bool(gc.get_freeze_count())  # by the caller
    if not frozen:
        gc.freeze()
    if young:
        gc.set_threshold(max(young, _YOUNG_OBJECTS), *older)
    try:
        yield
    finally:
        gc.set_threshold(young, *older)
        if not frozen:
            gc.unfreeze()


Steps = Generator[Question | None, Reply | None, EpisodeResult]
"""An episode that waits for its policy. It yields a question; where the question can wait (``wanted_in`` > 0) None is
sent back at once, and the reply when the episode yields None. A :class:`~betterbench.errors.PolicyError` is thrown in
where a reply would be sent."""

_PLAIN = Execution()

Disturbance = Callable[[np.ndarray], np.ndarray]
"""Returns what is executed in place of an action: for demonstrations whose label is the action without noise."""


def run_episode(
    scene: Scene | ForeignScene,
    policy: AnyPolicy,
    *,
    context: TrialContext,
    observer: Observer | None = None,
    disturb: Disturbance | None = None,
    on_step: Callable[[int], None] | None = None,
) -> EpisodeResult:
    """Run one episode from reset to its end, with a policy that answers in this thread.

    With an observer the policy is asked for ``act``, without one for ``act_on_state``. ``disturb`` is for demonstrators
    alone: the record then keeps their action as ``action`` and what was executed as ``applied``.

    Raises:
        PremiseError: If the scene does not show what the instruction presupposes.
        PolicyUnavailableError: If the policy's server cannot be reached.
        HandshakeError: If the policy has become another one.
    """
    execution = _PLAIN if observer is None else policy.info.execution  # type: ignore[union-attr]
    steps = episode_steps(
        scene, context=context, observer=observer, execution=execution, disturb=disturb, on_step=on_step
    )
    outcome: Reply | PolicyError | None = None
    kept: Reply | PolicyError | None = None
    with _settled_heap():
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
            outcome = kept = None  # an error refers to this frame, which holds the scene


def episode_steps(
    scene: Scene | ForeignScene,
    *,
    context: TrialContext,
    observer: Observer | None = None,
    execution: Execution = _PLAIN,
    disturb: Disturbance | None = None,
    on_step: Callable[[int], None] | None = None,
) -> Steps:
    """Run one episode from reset to its end, and stop wherever the policy has to answer first.

    So one thread can interleave many episodes. The result does not depend on how long an answer takes. Without an
    observer the policy is shown the privileged state. Yields a question, or None where the reply to the last one is
    needed now.

    Raises:
        PremiseError: If the scene does not show what the instruction presupposes.
        PolicyKilledError: If the process of the policy was ended from outside.
    """
    began = time.perf_counter()
    state = scene.reset()
    tracker, metadata = _tracked(scene, context)
    builder = RecordBuilder(metadata)
    truth = tracker.update(state)
    append_row(builder, scene, state, truth, action=None, applied=None)
    limit, foreign = scene.step_limit, scene if isinstance(scene, ForeignScene) else None
    chunks = Chunks(scene, observer, execution, limit=limit, began=began)
    termination: Termination = "step_limit"
    error: str | None = None
    try:
        if observer is not None:
            yield from chunks.begin()
        while state.step < limit and not truth.success and not (foreign is not None and foreign.over):
            action = yield from chunks.next(state)
            if foreign is not None:
                foreign.draw_next(wanted=chunks.looks_at(state.step + 1))
            applied = scene.step(action if disturb is None else disturb(action))
            if observer is not None:
                chunks.look(state.step + 1)
            state = scene.state()
            truth = tracker.update(state)
            append_row(builder, scene, state, truth, action=action, applied=applied)
            if on_step is not None:
                on_step(state.step)
            if foreign is not None and foreign.instructed_anew:
                yield from chunks.begin_again()
        if truth.success:
            termination = "success"
    except (PolicyUnavailableError, PolicyKilledError):
        raise
    except PolicyError as problem:
        termination, error = "policy_error", str(problem)
    except InvalidActionError as problem:
        termination, error = "policy_error", f"{type(problem).__name__}: {problem}"
    record = _finished(scene, builder, termination, error, success=truth.success)
    return EpisodeResult(record, chunks.wall_figures(), builder.states)


def _tracked(scene: Scene | ForeignScene, context: TrialContext) -> tuple[GoalTracker | ForeignTracker, RecordMetadata]:
    """Return what follows the goal of a scene that has been reset, and what its record says about itself."""
    if isinstance(scene, ForeignScene):
        return ForeignTracker(scene), describe_foreign(scene, context)
    tracker = GoalTracker(
        scene.condition, scene.info, template=scene.task.template, control_rate_hz=scene.control_rate_hz
    )
    return tracker, describe(scene, tracker, context)


def _finished(
    scene: Scene | ForeignScene,
    builder: RecordBuilder,
    termination: Termination,
    error: str | None,
    *,
    success: bool,
) -> Record:
    if error is not None:
        error = error.encode("utf-8", "backslashreplace").decode()  # file names may hold what a record cannot
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
    scene: Scene | ForeignScene,
    state: WorldState,
    truth: Truth,
    *,
    action: np.ndarray | None,
    applied: np.ndarray | None,
) -> None:
    """Append one row of an episode to its record: the state of the scene, its truth, and the action that led there."""
    simulator = scene.simulator_state()
    builder.append(
        state,
        qpos=simulator["qpos"],
        qvel=simulator["qvel"],
        act=simulator["act"],
        ctrl=simulator["ctrl"],
        action=action,
        applied=applied,
        predicates=truth.relations,
        subgoals=truth.subgoals,
        goal=truth.goal,
        forbidden=truth.forbidden,
    )
