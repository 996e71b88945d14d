"""ShadowSimulations: a served expert acts as a local one, however its client asks, and notices a client that strays."""

from __future__ import annotations

import dataclasses
import threading
import weakref

import numpy as np
import pytest

from betterbench.episodes import Observer
from betterbench.errors import InvalidInputError, PolicyError, UnknownNameError
from betterbench.evaluation import named_trial
from betterbench.evaluation.serving import shadow as serving
from betterbench.evaluation.serving.shadow import KEPT, ShadowSimulation, ShadowSimulations
from betterbench.evaluation.serving.shadow_sessions import ShadowSession
from betterbench.interface import observation_spec
from betterbench.interface.actions import EE_DELTA
from betterbench.policies.conventions.presets import PRESETS
from betterbench.policies.conventions.request import read_request, read_states
from betterbench.policies.experts import make_expert
from betterbench.sim.scenes import Scene
from betterbench.sim.scenes.stage import quality_preset
from betterbench.tasks import TrialId
from betterbench.tasks.interventions import resolve_condition

TRIAL = TrialId("morning_coffee", "train1", 0)
STEPS = 60
"""Long enough for the gripper to come down to the first object."""


def watch(policy: str, steps: int):
    """Returns what a local policy does, and what a policy could see at each of its steps."""
    found = resolve_condition(TRIAL.task, TRIAL.condition)
    task, condition = found.task, found.condition
    scene = Scene(task, condition, seed=TRIAL.seed, action_space=EE_DELTA, quality=quality_preset("standard"))
    policy, observer = make_expert(policy, scene), Observer(observation_spec("state_only"))
    state = scene.reset()
    actions, seen = [], [observer.observe(scene, state)]
    for _ in range(steps):
        actions.append(policy.act_on_state(state))
        scene.step(actions[-1])
        state = scene.state()
        seen.append(observer.observe(scene, state))
    return np.array(actions), seen


@pytest.fixture(scope="module")
def local():
    return watch("expert", STEPS)


@pytest.mark.parametrize(("chunk", "executed"), [(8, 8), (8, 5), (1, 1), (16, 3), (STEPS, STEPS)])
def test_actions_are_those_of_the_local_expert_to_the_bit(local, chunk, executed):
    actions, seen = local
    shadow = ShadowSimulation("expert", TRIAL)
    for step in range(0, STEPS - executed + 1, executed):
        answer = shadow.actions(step, chunk, seen=seen[step])
        assert answer.dtype == np.float64
        assert 1 <= len(answer) <= chunk
        known = actions[step : step + chunk]
        np.testing.assert_array_equal(answer[: len(known)], known)


def test_the_expert_of_these_tests_moves(local):
    actions, seen = local
    assert np.abs(actions[:, :3]).max() > 0.2
    assert np.linalg.norm(seen[STEPS].ee_position - seen[0].ee_position) > 0.1


def test_a_question_is_answered_again_and_late_as_at_first(local):
    actions, seen = local
    shadow = ShadowSimulation("expert", TRIAL)
    first = shadow.actions(0, 8, seen=seen[0])
    np.testing.assert_array_equal(shadow.actions(0, 8, seen=seen[0]), first)
    restarted = ShadowSimulation("expert", TRIAL)
    np.testing.assert_array_equal(restarted.actions(40, 8, seen=seen[40]), actions[40:48])


@pytest.mark.parametrize(("component", "text"), [(0, "executed other actions"), (6, r"the fingers 0\.0\d+ m")])
def test_a_client_that_executed_other_actions_is_told(component, text):
    found = resolve_condition(TRIAL.task, TRIAL.condition)
    task, condition = found.task, found.condition
    scene = Scene(task, condition, seed=TRIAL.seed, action_space=EE_DELTA, quality=quality_preset("fast"))
    observer, shadow = Observer(observation_spec("state_only")), ShadowSimulation("expert", TRIAL)
    state = scene.reset()
    for action in shadow.actions(0, 8, seen=observer.observe(scene, state)):
        action[component] = 1.0
        scene.step(action)
    seen = observer.observe(scene, scene.state())
    with pytest.raises(PolicyError, match=rf"^morning_coffee/train1/0 step 8: .*{text}"):
        shadow.actions(8, 8, seen=seen)


def test_a_tenth_of_a_millimeter_shows(local):
    _, seen = local
    shadow = ShadowSimulation("expert", TRIAL)
    shadow.actions(0, 8, seen=seen[0])
    moved = dataclasses.replace(seen[8], ee_position=seen[8].ee_position + np.array([0.0, 1e-4, 0.0]))
    with pytest.raises(PolicyError, match=r"the end effector is 0\.0001 m off"):
        shadow.actions(8, 8, seen=moved)
    assert len(shadow.actions(8, 8, seen=seen[8])) == 8


def test_a_policy_that_breaks_down_does_so_at_its_step_and_not_earlier():
    shadow, given = ShadowSimulation("zoo:crash", TRIAL), []

    def play():
        while len(given) < shadow.step_limit:
            given.extend(shadow.actions(len(given), 64))

    with pytest.raises(PolicyError, match="RuntimeError: this faulty policy raises an error on purpose"):
        play()
    with pytest.raises(RuntimeError):
        watch("zoo:crash", len(given) + 1)
    np.testing.assert_array_equal(np.array(given), watch("zoo:crash", len(given))[0])


def test_the_end_of_the_trial_is_an_end():
    shadow = ShadowSimulation("expert", TRIAL)
    with pytest.raises(InvalidInputError, match=f"ends after {shadow.step_limit} steps"):
        shadow.actions(shadow.step_limit, 8)


def test_a_step_beyond_the_end_is_refused_before_anything_is_simulated_or_compared():
    """A client without joint angles is located on the path; the step that it names bounds the path that is built."""
    shadow = ShadowSimulation("expert", TRIAL)
    beyond = 2**31 - 1
    with pytest.raises(InvalidInputError, match="ends after"):
        shadow.observation(shadow.step_limit)
    prompt = shadow.condition.instruction.text
    state = {"observation/state": np.full(8, 0.1)}
    session = ShadowSession(ShadowSimulations("expert"), 8, TRIAL)
    for message in (
        {"prompt": prompt, "better/step": beyond, **state},
        {"prompt": prompt, "better/step": 0, **state},
        {"prompt": prompt, "better/step": beyond},
        {"prompt": prompt, "better/step": beyond, **state},
    ):
        if message["better/step"]:
            with pytest.raises(InvalidInputError, match="ends after"):
                session.answer(message)
        else:
            assert len(session.answer(message)["actions"])
    # Without a number the client is at the end of its last chunk, which was refused.
    assert len(session.answer({"prompt": prompt, **state})["actions"])


@pytest.mark.parametrize(
    ("prompt", "task", "error", "text"),
    [
        ("sing", TRIAL.task, PolicyError, "the client's instruction is 'sing'"),
        ("sing", "nowhere", UnknownNameError, "nowhere"),
        ("x" * 200_000, TRIAL.task, PolicyError, r"^[\s\S]{100,600}$"),
    ],
)
def test_no_scene_is_built_for_a_client_that_asks_for_something_else(monkeypatch, prompt, task, error, text):
    def built(*_, **__):
        raise AssertionError("a scene was built")

    monkeypatch.setattr(serving, "Scene", built)
    session = ShadowSession(ShadowSimulations("expert"), 8, None)
    episode = {"task": task, "condition": TRIAL.condition, "seed": 1, "episode": 0, "action_space": EE_DELTA.name}
    with pytest.raises(error, match=text):
        session.answer({"prompt": prompt, "better/step": 0, "better/episode": episode})
    episode["seed"] = 2
    beyond = {"better/step": 2**31 - 1, "better/episode": episode}
    told = resolve_condition(TRIAL.task, TRIAL.condition).condition.instruction.text
    if task == TRIAL.task:
        with pytest.raises(InvalidInputError, match="ends after"):
            session.answer({"prompt": told, **beyond})


@pytest.mark.parametrize("number", [1e308, -1e200, 1e155, 1e7])
def test_a_state_that_no_robot_measures_is_refused(number):
    state = np.full(8, 0.1)
    state[4] = number
    prompt = resolve_condition(TRIAL.task, TRIAL.condition).condition.instruction.text
    with pytest.raises(InvalidInputError, match="is out of range"):
        read_request({"prompt": prompt, "observation/state": state})
    with pytest.raises(InvalidInputError, match="is out of range"):
        read_states({"observation/state": state}, PRESETS["openpi_libero"])


def test_shadows_are_kept_by_trial_and_forgotten_in_order(monkeypatch):
    monkeypatch.setattr("betterbench.evaluation.serving.shadow.KEPT", 2)
    shadows = ShadowSimulations("expert")
    shadows.client_came()
    names = [dataclasses.replace(TRIAL, seed=seed) for seed in range(3)]
    first, second = shadows.of(names[0]), shadows.of(names[1])
    assert shadows.of(names[0]) is first
    shadows.of(names[2])
    assert shadows.of(names[0]) is first
    assert shadows.of(names[1]) is not second
    assert KEPT >= 32


def test_shadows_of_clients_that_have_left_are_given_back(monkeypatch):
    monkeypatch.setattr("betterbench.evaluation.serving.shadow.SPARE", 1)
    shadows = ShadowSimulations("expert")
    for _ in range(2):
        shadows.client_came()
    trials = [dataclasses.replace(TRIAL, seed=seed) for seed in range(3)]
    kept = [weakref.ref(shadows.of(trial)) for trial in trials]
    assert all(ref() is not None for ref in kept)
    for left in (2, 1):
        shadows.client_left()
        assert [ref() is not None for ref in kept] == [i >= 3 - left for i in range(3)]


def test_two_trials_at_once_do_not_disturb_each_other(local):
    actions, _ = local
    shadows = ShadowSimulations("expert")
    other = TrialId("morning_coffee", "train2", 3)
    alone = ShadowSimulation("expert", other).actions(0, 24)
    answers: dict[TrialId, list[np.ndarray]] = {TRIAL: [], other: []}

    def play(trial):
        for step in range(0, 24, 4):
            answers[trial].append(shadows.of(trial).actions(step, 4))

    threads = [threading.Thread(target=play, args=(trial,)) for trial in answers]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60)
    np.testing.assert_array_equal(np.concatenate(answers[TRIAL]), actions[:24])
    np.testing.assert_array_equal(np.concatenate(answers[other]), alone)


@pytest.mark.parametrize(
    ("arguments", "error", "text"),
    [
        (("fast_fod", None, 0), UnknownNameError, "fast_food"),
        (("fast_food", "T11", 0), UnknownNameError, "T1"),
        (("fast_food", "T1", -1), InvalidInputError, "--seed"),
    ],
)
def test_a_trial_that_does_not_exist_is_one_clear_line(arguments, error, text):
    with pytest.raises(error, match=text):
        named_trial(*arguments)


def test_a_trial_without_a_condition_is_the_first_of_training():
    assert str(named_trial("fast_food", None, 7)) == "fast_food/train1/7"
