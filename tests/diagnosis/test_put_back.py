"""A correct object that is set down where it stood, before a wrong object is taken: the policy changed its mind."""

from __future__ import annotations

import numpy as np
import pytest

from betterbench.diagnosis import Kind, Label, diagnose_record


def lift_and_set_down(s, name, *, above=0.002, beside=(0.0, 0.0)):
    """Lifts an object and lets go of it near its place."""
    x, y, z = s.grip_point(name)
    s.grasp(name).lift()
    return s.go(x + beside[0], y + beside[1], s.tool[2]).go(x + beside[0], y + beside[1], z + above).open().lift()


@pytest.mark.parametrize(
    ("task", "name", "right", "wrong"),
    [
        ("desk_meeting", "train1", "mouse", "speaker"),
        ("desk_meeting", "L2", "mug", "mouse"),
        ("morning_coffee", "train1", "red mug", "blue mug"),
    ],
)
def test_a_wrong_object_after_the_right_one_was_put_back_is_a_failure_of_reasoning(stage, task, name, right, wrong):
    s = stage(task, name)
    found = diagnose_record(lift_and_set_down(s, s.of(right)).bring(s.of(wrong)).home().wait(4).end())
    assert found.kind is Kind.REASONING
    assert found.evidence.objects[0] == s.of(wrong)
    assert found.intention_correct  # the first attempt was right


def test_a_look_alike_after_the_right_object_was_put_back_is_a_feature_collapse(stage):
    s = stage("fast_food", "O1")
    found = diagnose_record(lift_and_set_down(s, s.of("burger")).bring(s.at("first")).home().wait(4).end())
    assert found.label is Label.SEMANTIC_FEATURE_COLLAPSE


def test_putting_the_right_object_back_for_good_is_a_failed_placement(stage):
    s = stage("desk_meeting", "train1")
    found = diagnose_record(lift_and_set_down(s, s.of("mouse")).home().wait(4).end())
    assert (found.label, found.evidence.rule) == (Label.EXECUTION_FAILURE, "placed_outside_the_goal")


@pytest.mark.parametrize(
    ("above", "beside", "rule"),
    [(0.08, (0.0, 0.0), "dropped"), (0.002, (-0.09, 0.0), "placed_outside_the_goal")],
)
def test_an_object_that_is_dropped_or_left_elsewhere_before_the_wrong_one_was_not_put_back(stage, above, beside, rule):
    s = stage("desk_meeting", "train1")
    found = diagnose_record(
        lift_and_set_down(s, s.of("mouse"), above=above, beside=beside).bring(s.of("speaker")).home().wait(4).end()
    )
    assert (found.label, found.evidence.rule) == (Label.EXECUTION_FAILURE, rule)


def test_putting_it_back_and_bringing_it_on_the_second_try_is_right(stage):
    s = stage("desk_meeting", "train1")
    s = lift_and_set_down(s, s.of("mouse"))
    found = diagnose_record(s.bring(s.of("mouse")).serve(1).wait(1).end())
    assert found.label is Label.SUCCESS
    assert np.isclose(found.progress, 1.0)
