"""The plan: which trials, decided before the first one starts."""

from __future__ import annotations

import dataclasses
import json
import time

import pytest
from tests.looping import each

from betterbench.diagnosis.run import read_plan
from betterbench.errors import InvalidInputError, RecordError, UnknownNameError
from betterbench.evaluation import make_plan
from betterbench.evaluation.planning.schedule import Schedule
from betterbench.records import RunFolder
from betterbench.sim.robots import robot, robot_names
from betterbench.statistics import decide, smallest_paired_difference
from betterbench.tasks import all_tasks, get_task, suite_tasks
from betterbench.tasks.interventions import vary

TASKS = tuple(get_task(name) for name in suite_tasks("better60"))


@each("trials", [1, 3, 20])
@each("task", TASKS, name=lambda t: t.id)
def test_every_variation_gets_its_trials_and_training_gets_as_many_in_all(task, trials):
    plan = make_plan("noop", tasks=[task.id], trials=trials)
    for v in task.variations:
        assert [t.seed for t in plan.trials if t.variation == v.name] == list(range(trials))
    trained = [t for t in plan.trials if t.variation is None]
    assert len(trained) >= trials * len(task.variations)
    shares = [sum(t.condition == c.name for t in trained) for c in task.training]
    assert len(set(shares)) == 1
    assert shares[0] >= trials
    assert sum(shares) < trials * len(task.variations) + max(trials, 1) * len(task.training)


@pytest.mark.parametrize("names", [[], ["T1"], ["fast_food/L1", "morning_coffee/O1"]])
def test_every_trial_has_its_twin_of_the_same_seed(names):
    plan = make_plan("noop", variations=names, trials=3, seed=5)
    keys = [(t.task, t.condition, t.seed) for t in plan.trials]
    assert len(set(keys)) == len(keys), "no trial is planned twice"
    for t in plan.trials:
        if t.variation is not None:
            assert (t.task, t.base_condition, t.seed) in keys
        assert t.seed >= 5


def test_the_default_is_the_whole_suite():
    plan = make_plan("noop", trials=1)
    assert {t.task for t in plan.trials} == {t.id for t in TASKS}
    assert {(t.task, t.variation) for t in plan.trials if t.variation} == {
        (t.id, v.name) for t in TASKS for v in t.variations
    }


def test_seeds_start_where_they_are_told_to():
    a, b = make_plan("noop", trials=3, seed=0), make_plan("noop", trials=3, seed=100)
    assert [dataclasses.replace(t, seed=t.seed + 100) for t in a.trials] == list(b.trials)


def test_selecting_one_variation_runs_its_base_and_no_other_training():
    plan = make_plan("noop", tasks=["morning_coffee"], variations=["L3"], trials=2)
    assert {t.condition for t in plan.trials} == {"L3", "train4"}
    assert len(plan.trials) == 4


def test_a_task_named_twice_is_run_once():
    assert make_plan("noop", tasks=["fast_food", "fast_food"], trials=1) == make_plan(
        "noop", tasks=["fast_food"], trials=1
    )


@each("task", TASKS, name=lambda t: t.id)
def test_trials_resolve_to_what_the_task_says(task):
    for trial in make_plan("noop", tasks=[task.id], trials=1).trials:
        found = trial.resolve()
        condition = found.condition
        assert found.task is task
        assert condition.name == trial.condition
        assert condition.expected.value == trial.expected
        if trial.variation is None:
            assert found.variation is None
            assert trial.axis is None
        else:
            assert condition == vary(task, task.variation(trial.variation))[0]
            assert trial.axis == task.variation(trial.variation).axis.value
            assert found.variation is task.variation(trial.variation)


def test_the_plan_is_json_and_holds_every_version_and_convention():
    form = make_plan("noop", trials=2).to_json()
    assert json.loads(json.dumps(form))["policy"] == "noop"
    assert form["task_versions"] == {t.id: get_task(t.id).version for t in TASKS}
    for name in (
        "plan_version",
        "package_version",
        "suite_version",
        "engine",
        "policy",
        "action_space",
        "observation",
        "quality",
        "robot",
        "control_rate_hz",
        "trials",
    ):
        assert name in form
    assert make_plan("noop", trials=2).to_json() == form


BAD = {
    "no trials": ({"trials": 0}, InvalidInputError, "--trials: 0 is out of range. Use a number ≥ 1"),
    "negative seed": ({"seed": -1}, InvalidInputError, "--seed: -1 is out of range. Use a number ≥ 0"),
    "unknown task": ({"tasks": ["fastfood"]}, UnknownNameError, "Did you mean 'fast_food'"),
    "unknown variation": (
        {"tasks": ["fast_food"], "variations": ["Q1"]},
        UnknownNameError,
        "variation of fast_food 'Q1'",
    ),
    "variation of an unknown task": ({"variations": ["fastfood/L1"]}, UnknownNameError, "Did you mean 'fast_food'"),
    "variation of another task": (
        {"tasks": ["fast_food"], "variations": ["morning_coffee/L1"]},
        InvalidInputError,
        "no task of this run has the variation",
    ),
    "action space": ({"action_space": "ee_detla"}, UnknownNameError, "Did you mean 'ee_delta'"),
    "robot": ({"robot": "so100"}, UnknownNameError, "robot 'so100'.*Did you mean 'so101'"),
    "action space of another robot": (
        {"action_space": "so101_degrees"},
        UnknownNameError,
        "action space for the Franka .* 'so101_degrees'",
    ),
    "joint space of another robot": (
        {"robot": "so101", "action_space": "joint_delta"},
        UnknownNameError,
        "so101_degrees",
    ),
    "observation": ({"observation": "defualt"}, UnknownNameError, "observation preset"),
    "quality": ({"quality": "ultra"}, UnknownNameError, "quality"),
}


@each("arguments, error, text", BAD.values())
def test_bad_arguments_are_named_before_anything_runs(arguments, error, text):
    with pytest.raises(error, match=text):
        make_plan("noop", **arguments)


@pytest.mark.parametrize("name", robot_names())
def test_the_robot_is_a_value_of_the_plan_and_gives_the_action_space(name):
    task = next(task.id for task in all_tasks() if task.robot == name)
    plan = make_plan("expert", tasks=(task,), trials=1)
    assert plan == make_plan("expert", tasks=(task,), trials=1, robot=name)
    assert (plan.to_json()["robot"], plan.action_space) == (name, robot(name).action_spaces[0])
    for space in robot(name).action_spaces:
        assert make_plan("expert", tasks=(task,), trials=1, robot=name, action_space=space).action_space == space


def test_looks_are_a_value_of_the_plan():
    seen, unseen = (make_plan("expert", tasks=("fast_food",), trials=1, looks=name) for name in ("seen", "unseen"))
    assert seen == make_plan("expert", tasks=("fast_food",), trials=1)
    assert (seen.to_json()["looks"], unseen.to_json()["looks"]) == ("seen", "unseen")
    with pytest.raises(UnknownNameError, match="unseen"):
        make_plan("expert", tasks=("fast_food",), trials=1, looks="unsen")


def test_twenty_thousand_planned_trials_are_not_quadratic(tmp_path):
    trials = [{"task": "fast_food", "condition": "train1", "seed": seed} for seed in range(20_000)]
    run = RunFolder(tmp_path, {"policy": "noop", "trials": [*trials, trials[-1]]}, {})
    began = time.process_time()
    with pytest.raises(RecordError, match="train1/19999 is planned twice"):
        read_plan(run)
    found = smallest_paired_difference(100_000, opposite=0.1)
    assert time.process_time() - began < 8.0  # 100 s, and 50 s, with the square of their number
    assert found.value == pytest.approx(0.005, abs=0.001)


def test_decisions_are_worked_out_once_a_round(monkeypatch):
    plan = make_plan("noop", tasks=["fast_food"], trials=20, until_decided=True)
    done, calls = set(), []

    def counted(*args, **options):
        calls.append(1)
        return decide(*args, **options)

    monkeypatch.setattr("betterbench.evaluation.planning.schedule.decide", counted)
    schedule = Schedule(plan, is_done=done.__contains__, succeeded=lambda trial: trial.condition.startswith("train"))
    rounds = 0
    for trials in schedule.rounds():
        rounds += 1
        for trial in trials:
            done.add(trial.id)
            found = schedule.decisions
    assert found.decided == len(found.answers)
    assert len(calls) <= 2 * rounds + 2
