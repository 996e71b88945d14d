"""How chunks are played: when a policy is asked, which action of which answer is applied, whatever its latency."""

from __future__ import annotations

import dataclasses
import re

import numpy as np
import pytest
from tests.looping import each

from betterbench.episodes import Observer, Question, Reply, TrialContext, answer, episode_steps, run_episode
from betterbench.errors import HandshakeError, InvalidInputError, PolicyError, PolicyUnavailableError
from betterbench.interface import EpisodeStart, Execution, PolicyInfo, observation_spec
from betterbench.interface.actions import EE_DELTA, EE_POSE, action_space
from betterbench.sim.scenes import Scene
from betterbench.sim.scenes.stage import quality_preset
from betterbench.tasks import get_task

pytestmark = pytest.mark.physics

STATE_ONLY = observation_spec("state_only")
STEPS = 23
UNIT = 0.001


class Telling:
    """Answers chunks that say when they were asked for and where each action stands in them."""

    def __init__(self, length: int = 8, **execution) -> None:
        self.info = PolicyInfo("telling", needs_images=False, execution=Execution(**execution))
        self.length, self.asked = length, []

    def reset(self, _start):
        self.asked.clear()

    def act(self, observation):
        self.asked.append(observation.step)
        chunk = np.zeros((self.length, 7))
        chunk[:, 0] = UNIT * observation.step
        chunk[:, 1] = UNIT * np.arange(self.length)
        chunk[:, 6] = -1.0
        return chunk


@pytest.fixture(scope="module")
def scene():
    template = dataclasses.replace(
        get_task("morning_coffee").template, base_steps=STEPS, steps_per_subgoal=0, still_steps=STEPS
    )
    task = dataclasses.replace(get_task("morning_coffee"), template=template)
    return Scene(task, task.training[0], seed=0, action_space=action_space("ee_delta"), quality=quality_preset("fast"))


def run(policy, scene):
    return run_episode(scene, policy, context=TrialContext("telling"), observer=Observer(STATE_ONLY)).record


def played(record) -> list[tuple[int, int]]:
    """Returns, per control step, when the chunk was asked for and which of its actions was played."""
    return [(round(a[0] / UNIT), round(a[1] / UNIT)) for a in record.action[1:]]


@pytest.mark.parametrize(
    ("options", "asked"),
    [
        ({}, [0, 8, 16]),
        ({"horizon": 5}, [0, 5, 10, 15, 20]),
        ({"horizon": 1}, list(range(STEPS))),
        ({"horizon": 100}, [0, 8, 16]),
        ({"ahead": 3}, [0, 5, 10, 15]),
        ({"horizon": 4, "ahead": 2}, [0, 2, 6, 10, 14, 18]),
        ({"horizon": 4, "ahead": 1}, [0, 3, 7, 11, 15, 19]),
        ({"ahead": 7}, [0, 1, 8, 9, 16]),
    ],
)
def test_a_policy_is_asked_when_its_execution_says_and_every_action_is_played_at_its_time(scene, options, asked):
    policy = Telling(**options)
    record = run(policy, scene)
    assert record.n_steps == STEPS
    assert policy.asked == asked
    assert all(index == step - told for step, (told, index) in enumerate(played(record)))
    horizon = options.get("horizon", policy.length)
    assert all(index < horizon + options.get("ahead", 0) for _, index in played(record))


def test_nobody_is_asked_for_actions_that_no_step_is_left_for(scene):
    policy = Telling(length=STEPS, ahead=5)
    run(policy, scene)
    assert policy.asked == [0]


def by_hand(scene, policy, *, late: bool) -> tuple[object, list[int]]:
    """Drives an episode with replies that are made at once, or only when the episode cannot go on without them."""
    steps = episode_steps(
        scene, context=TrialContext("telling"), observer=Observer(STATE_ONLY), execution=policy.info.execution
    )
    waits = []
    open_question: Question | None = None
    kept: Reply | None = None
    asked = next(steps)
    try:
        while True:
            if asked is None:
                sent = answer(policy, open_question.seen) if late else kept
            elif asked.wanted_in:
                waits.append(asked.wanted_in)
                open_question, kept, sent = asked, None if late else answer(policy, asked.seen), None
            else:
                sent = answer(policy, asked.seen)
            asked = steps.send(sent)
    except StopIteration as end:
        return end.value.record, waits


@pytest.mark.parametrize("options", [{"ahead": 3}, {"horizon": 4, "ahead": 2}])
def test_what_happens_does_not_depend_on_when_an_answer_comes(scene, options):
    soon, waits = by_hand(scene, Telling(**options), late=False)
    late, _ = by_hand(scene, Telling(**options), late=True)
    assert soon.same_bits(late)
    assert soon.same_bits(run(Telling(**options), scene))
    assert set(waits) == {options["ahead"]}


@pytest.mark.parametrize("rate", [0.0, 0.01, 0.5, -0.2])
def test_an_ensemble_plays_the_weighted_mean_of_all_that_was_predicted_for_a_step(scene, rate):
    policy = Telling(length=4, ensemble=rate)
    record = run(policy, scene)
    assert policy.asked == list(range(STEPS))
    for step in range(STEPS):
        told = list(range(max(0, step - 3), step + 1))  # the oldest first
        weights = [np.exp(-rate * i) for i in range(len(told))]
        assert record.action[1 + step, 0] == pytest.approx(UNIT * np.average(told, weights=weights))
        assert record.action[1 + step, 1] == pytest.approx(UNIT * np.average([step - t for t in told], weights=weights))
        assert record.action[1 + step, 6] == pytest.approx(-1.0)


def test_a_steep_rate_leaves_one_prediction_and_no_infinity():
    from betterbench.episodes.chunks import weighted_mean

    predictions = np.array([[float(n)] * EE_DELTA.dim for n in range(100)])
    assert weighted_mean(predictions, -50.0, EE_DELTA) == pytest.approx(predictions[-1])
    assert weighted_mean(predictions, 50.0, EE_DELTA) == pytest.approx(predictions[0])


def test_the_mean_of_a_rotation_and_itself_with_the_other_sign_is_that_rotation():
    from betterbench.episodes.chunks import weighted_mean

    pose = np.array([0.5, 0.0, 0.2, 0.6, 0.0, 0.8, 0.0, -1.0])
    flipped = pose.copy()
    flipped[3:7] *= -1.0
    assert weighted_mean(np.array([pose, flipped]), 0.1, EE_POSE) == pytest.approx(pose)


@each("execution", [{}, {"horizon": 2}, {"ahead": 1}, {"ensemble": 0.1}])
@each(
    "spoil, reason",
    [
        (lambda chunk: chunk[:, :6], r"shape \(8, 6\)"),
        (lambda chunk: chunk[:0], "at least one action"),
        (lambda chunk: np.where(np.arange(8)[:, None] == 6, np.nan, chunk), "x = nan.* action 7 of a chunk of 8"),
        (lambda chunk: chunk.astype(complex), "complex128"),
        (lambda chunk: chunk.astype(object), "object"),
        (lambda chunk: chunk.astype(str), "expected real numbers"),
    ],
)
def test_a_chunk_with_one_bad_number_is_refused_whole(scene, execution, spoil, reason):
    class Spoilt(Telling):
        def act(self, observation):
            return spoil(super().act(observation))

    record = run(Spoilt(**execution), scene)
    assert record.outcome.termination == "policy_error"
    assert record.n_steps == 0
    assert record.outcome.invalid_actions == 1

    assert re.search(reason, record.outcome.error), record.outcome.error


def test_a_chunk_shorter_than_what_is_asked_ahead_says_so(scene):
    record = run(Telling(length=2, ahead=3), scene)
    assert record.outcome.termination == "policy_error"
    assert "ahead" in record.outcome.error


def test_a_policy_that_reuses_its_array_spoils_no_action_that_waits(scene):
    buffer = np.zeros((8, 7))

    class Reusing(Telling):
        def act(self, observation):
            buffer[:] = super().act(observation)
            return buffer

    assert run(Reusing(ahead=3), scene).same_bits(run(Telling(ahead=3), scene))


def test_an_error_of_an_early_question_comes_up_when_its_answer_is_used(scene):
    class Breaking(Telling):
        def act(self, observation):
            if observation.step:
                raise RuntimeError("out of memory")
            return super().act(observation)

    record = run(Breaking(ahead=3), scene)
    assert record.n_steps == 8
    assert record.outcome.error.startswith("RuntimeError: out of memory (")


@pytest.mark.parametrize("problem", [PolicyUnavailableError("nobody there"), HandshakeError("it is another one")])
def test_what_concerns_the_whole_run_ends_no_trial_with_a_result(scene, problem):
    class Gone(Telling):
        def act(self, _observation):
            raise problem

    with pytest.raises(type(problem), match=str(problem)):
        run(Gone(), scene)


def test_a_policy_error_keeps_its_own_words(scene):
    class Refusing(Telling):
        def act(self, _observation):
            raise PolicyError("the server answered garbage")

    assert run(Refusing(), scene).outcome.error == "the server answered garbage"


def test_an_episode_that_is_dropped_leaves_the_scene_usable(scene):
    steps = episode_steps(scene, context=TrialContext("telling"), observer=Observer(STATE_ONLY))
    assert isinstance(next(steps).seen, EpisodeStart)
    steps.close()
    assert run(Telling(), scene).n_steps == STEPS


@pytest.mark.parametrize(
    "options",
    [
        {"horizon": 0},
        {"ahead": -1},
        {"horizon": 3, "ahead": 3},
        {"ensemble": float("inf")},
        {"ensemble": 0.1, "ahead": 1},
    ],
)
def test_an_execution_whose_numbers_do_not_go_together_is_refused(options):
    with pytest.raises(InvalidInputError):
        Execution(**options)
