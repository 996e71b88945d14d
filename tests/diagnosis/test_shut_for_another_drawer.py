"""An open drawer is shut for the wrong drawer below: the wrong target decides, not the shut drawer."""

from __future__ import annotations

import pytest

from betterbench.diagnosis import Label, diagnose_record


def shut_upper(s):
    """Shuts the upper drawer, which the instruction wants filled, and opens the lower one."""
    upper, lower = "upper", "lower"
    return s.draw(upper, 0.0).draw(lower, 0.15)


def test_content_that_is_brought_to_the_drawer_below_is_at_a_wrong_target(stage):
    s = shut_upper(stage("office_drawer", "train2"))
    s.bring(s.of("stapler"), s.place("inside", "lower")).draw("lower", 0.0)
    found = diagnose_record(s.home().wait(4).end())
    assert found.label is Label.WRONG_OBJECT
    assert "lower drawer" in found.evidence.text


def test_a_drawer_that_is_shut_without_its_content_is_a_skipped_step(stage):
    found = diagnose_record(shut_upper(stage("office_drawer", "train2")).home().wait(4).end())
    assert (found.label, found.evidence.rule) == (Label.CAUSAL_CONFUSION, "required_step_skipped")


@pytest.mark.parametrize("name", ["train2", "L1"])
def test_a_drawer_that_is_shut_for_a_wrong_object_belongs_to_the_choice_of_that_object(stage, name):
    s = shut_upper(stage("office_drawer", name))
    s.bring(s.of("tape"), s.place("inside", "lower")).draw("lower", 0.0)
    found = diagnose_record(s.home().wait(4).end())
    assert found.label is not Label.CAUSAL_CONFUSION
    assert found.evidence.objects[0] == s.of("tape")


def test_a_drawer_that_is_shut_before_its_own_content_is_taken_is_still_a_skipped_step(stage):
    s = stage("office_drawer", "train2").draw("upper", 0.0)
    s.grasp(s.of("tape")).lift().open().lift()
    found = diagnose_record(s.home().wait(4).end())
    assert (found.label, found.evidence.rule) == (Label.CAUSAL_CONFUSION, "required_step_skipped")
