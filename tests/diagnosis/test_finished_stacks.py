"""A gripper at a finished stack repeats the finished step, also if it takes hold of the plate below."""

from __future__ import annotations

import pytest

from betterbench.diagnosis.trial import diagnose_record
from betterbench.tasks.labels import Label

REPEATED = (Label.CAUSAL_CONFUSION, "finished_step_repeated")
OTHER = (Label.WRONG_OBJECT, "object_of_another_instruction")


def judged(s):
    found = diagnose_record(s.home().wait(4.0).end())
    return found.label, found.evidence.rule


def test_the_plate_below_a_finished_plate_stands_for_the_stack(stage):
    s = stage("dinner_plates", "T2").wait(0.2)  # red already lies on white, and blue is due
    found = diagnose_record(s.grasp("white_plate").lift().home().wait(4.0).end())
    assert (found.label, found.evidence.rule) == REPEATED
    assert "white plate" in found.evidence.text
    assert "red plate" in found.evidence.text


def test_the_upper_plate_of_a_finished_stack_is_a_finished_step(stage):
    assert judged(stage("dinner_plates", "T2").wait(0.2).grasp("red_plate").lift()) == REPEATED


def test_a_stack_that_the_policy_has_built_is_finished_too(stage):
    s = stage("dinner_plates", "T1")
    s.bring("red_plate", s.goal(0))
    assert judged(s.grasp("white_plate").lift()) == REPEATED


def test_a_target_on_which_nothing_lies_is_another_object(stage):
    assert judged(stage("dinner_plates", "T1").wait(0.2).grasp("white_plate").lift()) == OTHER


def test_a_plate_below_one_that_no_step_puts_there_is_not_a_finished_step(stage):
    s = stage("dinner_plates", "train3").wait(0.2)  # red lies on white from the start, and only blue is requested
    label, _ = judged(s.grasp("white_plate").lift())
    assert label is Label.SEMANTIC_FEATURE_COLLAPSE


@pytest.mark.parametrize(("task", "name", "target"), [("breakfast_table", "T1", "plate"), ("fast_food", "T1", "box")])
def test_objects_beside_or_in_a_target_make_no_stack(stage, task, name, target):
    s = stage(task, name)
    first = s.condition.resolve(s.condition.instruction.subgoals[0].reference)[0]
    s.bring(first, s.goal(0))
    assert s.done[0]
    s.between = lambda: target if s.grip is None else s.grip
    x, y = s.positions[target][:2]
    s.over((x, y)).go(x + 0.09, y, 0.03).close()
    assert judged(s.open().lift()) != REPEATED
