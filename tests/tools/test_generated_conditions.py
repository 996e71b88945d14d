"""Measures of generated conditions: each planted fault is found, and a task of the suite has none."""

from __future__ import annotations

import dataclasses
import json
import sys
from dataclasses import replace
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "tools"))

import generated_conditions as tool
from betterbench.generation.building.proving import provisional
from betterbench.tasks import get_task
from betterbench.tasks.interventions import vary

TASK = "fruit_lunch"


def measured(task, condition=None):
    return tool.measure_trial(task, condition or task.training[0], 0, regime="training")


def failed(trial):
    assert not trial.problem
    return {check.name for check in tool.CHECKS if not check.passes(trial)}


def with_slot(task, name, **changes):
    """Return the task with one slot changed, also in its training conditions."""
    return replace(task, slots=tuple(replace(s, **changes) if s.name == name else s for s in task.slots))


@pytest.mark.render
def test_a_task_of_the_suite_passes_every_check_of_its_objects():
    trial = measured(get_task(TASK))
    assert failed(trial) - {check.name for check in tool.CHECKS if check.name.startswith("other")} == set()
    assert trial.margin_mm > 8.0
    assert set(trial.grasps.values()) == {""}
    assert trial.named.keys() & trial.others.keys() == set()


@pytest.mark.render
def test_objects_in_one_place_touch_and_move():
    task = get_task(TASK)
    first, second = (task.training[0].layout[name] for name in measured(task).named)
    at = task.slot(first)
    trial = measured(with_slot(task, second, x=at.x + 0.03, y=at.y))
    assert trial.touching
    assert {tool.TOUCHING, "overlap ≤ 1.5 mm"} <= failed(trial)


@pytest.mark.render
def test_an_object_out_of_view_is_out_of_reach_too():
    task = get_task(TASK)
    name = next(iter(measured(task).named))
    trial = measured(with_slot(task, task.training[0].layout[name], x=0.45, y=-0.95))
    assert trial.named[name] == (0.0, 0.0)
    assert trial.grasps[name]
    assert trial.margin_mm < 0.0
    found = {name for name in failed(trial) if name.startswith(("a grasp", "slots", "named"))}
    assert len(found) == 4


@pytest.mark.render
def test_what_is_preplaced_may_touch_its_target():
    task = get_task(TASK)
    preplaced = [vary(task, v)[0] for v in task.variations if vary(task, v)[0].preplaced]
    assert preplaced
    for condition in preplaced:
        assert measured(task, condition).touching == ()


@pytest.mark.render
def test_a_task_before_its_build_leaves_out_what_needs_demonstrations_and_its_result_is_kept(tmp_path):
    task = dataclasses.replace(get_task(TASK), id="lunch_before_its_build")
    task = replace(task, variations=task.variations[:1] + task.variations[-1:], training=task.training[:1])
    item = tool.Item(task.id, task.template.name, trials=1, balanced=0)
    with provisional(task) as known:
        result = tool.measure_task(known, item, built=False)
    preplaced = {v.name for v in task.variations if vary(task, v)[0].preplaced}
    assert set(result.left_out) == preplaced
    assert {t.condition for t in result.trials} == {"train1", *(v.name for v in task.variations)} - preplaced
    assert tool._RESULT.validate_json(tool._RESULT.dump_json(result)) == result
    text = tool.summary([result])
    assert f"{len(result.trials)}/{len(result.trials)}" in text
    assert json.loads(tool._RESULT.dump_json(result))["item"]["name"] == task.id


def test_a_failure_is_listed_with_its_trial_and_a_task_that_cannot_be_made_with_its_reason():
    item = tool.Item("lunch", "loose_packing", trials=1, balanced=0)
    bad = tool.Measured("L1", "variation", 3, touching=("apple and lemon",), margin_mm=20.0, gripper_px=900)
    lines = [*tool.failures([tool.Result(item, "lunch", (bad,)), tool.Result(item, "other", (), problem="no mug")])]
    assert lines == [
        f"lunch/L1 seed 3 (loose_packing, variation): {tool.TOUCHING} {{'touching': ('apple and lemon',)}}",
        "other (loose_packing): no task: no mug",
    ]
    assert f"| {tool.TOUCHING} | 0/1 |" in tool.summary([tool.Result(item, "lunch", (bad,))])
