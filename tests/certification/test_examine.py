"""The five clauses, each made to fail by a setting that breaks it."""

from __future__ import annotations

import dataclasses

import pytest
from tests.daily import TODAY, others_slow
from tests.robots import ROBOTS, task_of

from betterbench.certification import summaries
from betterbench.certification.examine import _premise, _why_not, examine, examine_condition
from betterbench.tasks import Expected, GoalTracker, Slot, Support, TrialId, all_tasks, get_task

pytestmark = pytest.mark.physics


def coffee(slot: Slot | None = None, *, put: str = "red_mug"):
    """The task of the coffee machine with one more slot, and its first training condition with a mug moved there."""
    task = get_task("morning_coffee")
    condition = task.train("train1")
    if slot is None:
        return task, condition
    return (
        dataclasses.replace(task, slots=(*task.slots, slot)),
        condition.with_(layout={**condition.layout, put: slot.name}),
    )


def failed(found) -> tuple[str, ...]:
    return found.failed


@pytest.mark.parametrize("name", ROBOTS)
def test_a_sound_trial_passes_with_its_margins(name):
    task = get_task(task_of(name))
    seen = next(v.name for v in task.variations if (v.support, v.expected) == (Support.SEEN, Expected.SUCCEED))
    found = examine(TrialId(task.id, seen, 0))
    assert found.passed, {letter: found.clauses[letter].text for letter in found.failed}
    assert not found.training
    assert 0 < found.steps < found.step_limit
    assert 0.0 <= found.penetration_mm < 0.5
    assert found.drift_mm < 0.1
    assert 0.0 < found.joint_margin_rad < 3.0
    assert -1.0 <= found.support_slack_mm <= 15.0
    assert len(found.primitives) == 2
    assert found.expert_s > 0.0


@pytest.mark.parametrize("name", others_slow(ROBOTS, 2))
def test_examining_twice_finds_the_same(name):
    def without_time(found):
        return dataclasses.replace(found, expert_s=0.0, total_s=0.0)

    subject = TrialId(task_of(name), "T1", 1)
    assert without_time(examine(subject)) == without_time(examine(subject))


def test_staying_still_is_right_where_nothing_is_to_be_done():
    found = examine(TrialId("morning_coffee", "T1", 0))
    assert found.passed
    assert found.primitives == ("finds red_mug on_ring coffee machine",)
    assert found.clauses["d"].text == "no object needs to be grasped"
    assert found.joint_margin_rad is None
    assert found.support_slack_mm is None


@pytest.mark.slow
def test_refusing_is_right_where_the_premise_is_broken_on_purpose():
    found = examine(TrialId("fruit_lunch", "O1", 0))
    assert found.passed
    assert "broken on purpose: no apple" in found.clauses["e"].text


SEEN = [(t.id, v.name) for t in all_tasks() for v in t.variations if v.support is Support.SEEN]
QUICK = [("fast_food", "T2"), ("fruit_lunch", "T1"), ("office_drawer", "R1"), ("morning_coffee", "T1")][TODAY % 2 :: 2]
"""A container that is filled up, a drawer that was trained with another object, and what is pre-placed; half a day."""


@pytest.mark.parametrize(
    ("task_id", "name"),
    [pytest.param(*c, marks=() if c in QUICK else pytest.mark.slow, id="/".join(c)) for c in SEEN],
)
def test_every_variation_that_claims_to_be_seen_is_certified(task_id, name):
    found = examine(TrialId(task_id, name, 1))
    assert found.passed, {letter: found.clauses[letter].text for letter in found.failed}


def test_a_slot_that_training_never_used_has_to_be_declared():
    task, condition = coffee(Slot("aside", 0.50, -0.30, yaw=-1.5708))
    found = examine_condition(task, condition, 0)
    assert failed(found) == ("b",)
    assert "outside every pick slot of the training distribution" in found.clauses["b"].text
    declared = examine_condition(task, condition, 0, support=Support.NOVEL)
    assert declared.passed
    assert declared.clauses["b"].text.startswith("declared novel: ")
    assert declared.support_slack_mm == found.support_slack_mm < 0.0


def test_an_overlapping_start_fails():
    task, condition = coffee()
    other = task.slot(condition.layout["blue_mug"])
    clash = dataclasses.replace(other, name="clash", x=other.x - 0.03)
    found = examine_condition(*coffee(clash), 0)
    assert "c" in failed(found)
    assert "overlap by" in found.clauses["c"].text
    assert found.penetration_mm > 1.5


def test_what_is_watched_until_the_limit_has_no_share_of_it(trial):
    (summary,) = summaries([trial(watched=True, steps=200, step_limit=200)])
    assert summary.steps_share is None


def test_an_object_out_of_reach_fails():
    found = examine_condition(*coffee(Slot("yonder", 0.95, -0.45, yaw=-1.5708)), 0)
    assert {"a", "d"} <= set(failed(found))
    assert "red_mug: no free grasp of red_mug: red_mug at (0.9" in found.clauses["d"].text
    assert "m is out of reach of the Franka Emika Panda" in found.clauses["d"].text
    assert "not solved after" in found.clauses["a"].text


def test_what_was_missing_names_steps_and_harm(start, posed):
    task, condition, state = start("morning_coffee")
    tracker = GoalTracker(condition, state.info, template=task.template, control_rate_hz=20.0)
    tracker.update(state)
    pushed = posed(state, {"blue_mug": state.pose("blue_mug").translated(y=0.08)}, contacts=(("blue_mug", "table"),))
    truth = tracker.update(pushed)
    text = _why_not(condition, state.info, tracker, truth, 7)
    assert text.startswith("not solved after 7 steps: ")
    assert text.endswith("; the blue mug was moved out of its place by more than 5 cm")


def test_an_object_out_of_its_slot_breaks_the_premise(start, posed):
    _, condition, state = start("morning_coffee")
    assert _premise(condition, state).passed
    moved = posed(state, {"red_mug": state.pose("red_mug").translated(x=0.06)})
    found = _premise(condition, moved)
    assert not found.passed
    assert "red_mug does not stand in its slot" in found.text


def test_a_premise_that_is_declared_broken_has_to_be_broken(start):
    _, condition, state = start("morning_coffee")
    assert not _premise(condition.with_(premise_broken=True), state).passed


@pytest.mark.slow
def test_a_shut_drawer_is_named_in_the_clause_that_success_proves():
    found = examine(TrialId("office_drawer", "train1", 0))
    assert found.passed
    assert "shown by the expert's success" in found.clauses["d"].text
    assert "upper" in found.clauses["d"].text
