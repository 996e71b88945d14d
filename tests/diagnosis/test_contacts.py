"""Contacts decide before distances; a closing between two objects tells of neither."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from betterbench.diagnosis import Label, diagnose_record, diagnose_records
from betterbench.diagnosis.modes import MODES
from betterbench.interface.state import Contact


def pressing(s, name, force, *, rows=None, finger="left_finger"):
    """Lets a finger press on an object while the gripper is told to close, for some rows at most."""
    real, seen = s.state, [0]

    def state():
        found = real()
        if s.command <= 0.0 or (rows is not None and seen[0] >= rows):
            return found
        seen[0] += 1
        return replace(found, contacts=(*found.contacts, Contact(name, finger, force)))

    s.state = state
    return s


def close_between(s, one, other, share=0.5):
    """Closes on nothing on the way from one object to another."""
    (ax, ay, _), (bx, by, _) = s.positions[one], s.positions[other]
    x, y = ax + share * (bx - ax), ay + share * (by - ay)
    return s.over(np.array([x, y])).go(x, y, 0.03).close().lift().open().home()


def near_each_other(s, one, other, *, apart=0.10):
    """Stands one object, which is asked for and may be moved, beside another."""
    s.positions[one] = s.positions[other] + np.array([0.0, apart, 0.0])
    return s


@pytest.mark.parametrize(("force", "rows"), [(85.0, None), (85.0, 3), (12.0, 4), (3.0, None)])
def test_what_a_finger_presses_on_was_attempted_whatever_is_nearer(stage, force, rows):
    s = stage("fruit_lunch", "train1")
    asked, other = s.of("apple"), s.of("lemon")
    near_each_other(s, asked, other)
    close_between(pressing(s, other, force, rows=rows), asked, other, 0.55)
    found = diagnose_record(s.wait(5).end())
    assert found.attempts[0].object == other
    assert found.attempts[0].result == "distractor"
    assert found.intention_correct is False
    assert found.kind.value == "reasoning"


@pytest.mark.parametrize(("force", "rows"), [(1.0, None), (85.0, 1), (3.0, 4)])
def test_a_graze_by_an_honest_miss_is_no_attempt(stage, force, rows):
    s = stage("fruit_lunch", "train1")
    asked, other = s.of("apple"), s.of("lemon")
    near_each_other(s, asked, other, apart=0.14)
    close_between(pressing(s, other, force, rows=rows), asked, other, 0.38)
    found = diagnose_record(s.wait(5).end())
    assert (found.label, found.evidence.rule) == (Label.EXECUTION_FAILURE, "missed_by_pose")
    assert found.intention_correct


def test_what_both_fingers_touch_is_nearer_than_what_one_presses_on(stage):
    s = stage("fruit_lunch", "train1")
    asked, other = s.of("apple"), s.of("lemon")
    near_each_other(s, asked, other)
    pressing(s, other, 85.0)
    found = diagnose_record(s.grasp(asked).open().lift().home().wait(5).end())
    assert found.attempts[0].object == asked


@pytest.mark.parametrize("share", [0.45, 0.5, 0.6])
def test_a_closing_between_two_objects_tells_of_neither(stage, share):
    s = stage("fruit_lunch", "train1")
    asked, other = s.of("apple"), s.of("lemon")
    near_each_other(s, asked, other, apart=0.11)
    found = diagnose_record(close_between(s, asked, other, share).wait(5).end())
    assert (found.label, found.evidence.rule) == (Label.EXECUTION_FAILURE, "missed_between")
    assert "the apple, the correct object, and the lemon, which is as near" in found.evidence.text
    assert "either may have been the target" in found.evidence.text
    assert found.intention_correct is None
    assert (found.first_attempt, found.first_slot) == (None, None)


def test_a_closing_beside_the_right_thing_is_a_miss_of_it(stage):
    s = stage("fruit_lunch", "train1")
    asked, other = s.of("apple"), s.of("lemon")
    near_each_other(s, asked, other, apart=0.16)
    found = diagnose_record(close_between(s, asked, other, 0.33).wait(5).end())
    assert (found.label, found.evidence.rule) == (Label.EXECUTION_FAILURE, "missed_by_pose")
    assert found.intention_correct is True


@pytest.mark.parametrize("apart", [0.11, 0.18])
def test_a_mean_of_two_objects_is_not_said_to_go_for_the_right_things(stage, apart):
    """Whether both are within reach of the gripper or neither is."""
    records = []
    for seed in range(5):
        s = stage("fruit_lunch", "train1", seed=seed)
        asked, other = s.of("apple"), s.of("lemon")
        near_each_other(s, asked, other, apart=apart)
        records.append(close_between(s, asked, other).wait(5).end())
    found = diagnose_records(records)
    assert {t.label for t in found.trials} == {Label.EXECUTION_FAILURE}
    assert {t.intention_correct for t in found.trials} == {None}
    said = [MODES[Label.EXECUTION_FAILURE].conclude(found.trials), *found.findings]
    assert not any("right thing" in text or "correct object" in text for text in said), said
    assert "its target is unknown" in said[0]
    accuracy = found.metric("intention_accuracy", "training")
    assert (accuracy.k, accuracy.n) == (0, 5), "no attempt is proven right, and none leaves the denominator"


def test_some_closings_that_tell_nothing_are_counted(stage):
    trials = []
    for seed in range(6):
        s = stage("fruit_lunch", "train1", seed=seed)
        asked, other = s.of("apple"), s.of("lemon")
        near_each_other(s, asked, other, apart=0.11)
        if seed < 3:
            close_between(s, asked, other)
        else:
            s.grasp(asked).lift(0.2).open().home()
        trials.append(diagnose_record(s.wait(5).end()))
    said = MODES[Label.EXECUTION_FAILURE].conclude(trials)
    assert said.startswith("Its manipulation fails; in 3 of 6 of these trials it closes between two objects")
