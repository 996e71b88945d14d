"""Manipulations of learned policies that two judges read from films and the diagnosis read differently."""

from __future__ import annotations

import numpy as np
import pytest

from betterbench.diagnosis import Kind, Label, diagnose_record

SWAPPED = (
    "seasoning_rack",
    "L1",
)  # the salt stands where the pepper was in training, and the pepper where the salt was


def hole(s, number):
    return s.place("in_hole", s.of("rack"), f"hole_{number}")


def tried_again(s, name):
    """Closes on an object that slips out before it is lifted, and grasps it again."""
    s.grasp(name).lose()
    return s.open().grasp(name).lift()


def sunk(s, place):
    """Sets an object down at a place, where it leaves the gripper although the gripper stays closed."""
    x, y, z = place - s.grip_offset
    s.over(np.array([x, y]), 0.3).go(x, y, z).wait(1.0)
    return s.lose().wait(1.0).open().lift()


def dragged(s, place):
    """Sets an object down at a place without opening, drags it off, and lets go of it on the table."""
    x, y, z = place - s.grip_offset
    s.over(np.array([x, y]), 0.3).go(x, y, z).wait(1.0)
    return s.go(x + 0.1, y, z).go(x + 0.1, y, 0.002 - s.grip_offset[2]).open().lift()


def test_closings_on_nothing_of_an_arm_that_stays_in_place_are_no_halt(stage):
    s = stage("seasoning_rack", "train5")
    s.over(np.array([0.5, -0.35])).go(0.5, -0.35, 0.06).wait(0.2)
    for _ in range(8):
        s.close(1.0).open(1.5)
    found = diagnose_record(s.end())
    assert (found.label, found.evidence.rule) == (Label.EXECUTION_FAILURE, "missed_by_far")


def test_standing_still_after_a_closing_on_nothing_is_judged_by_the_closing(stage):
    s = stage("seasoning_rack", "train5")
    s.over(np.array([0.5, -0.35])).go(0.5, -0.35, 0.06).wait(4.0)
    found = diagnose_record(s.close().wait(15).end())
    assert (found.label, found.evidence.rule) == (Label.EXECUTION_FAILURE, "missed_by_far")


def test_standing_still_without_a_closing_stays_a_halt(stage):
    s = stage("seasoning_rack", "train5")
    found = diagnose_record(s.over(np.array([0.5, -0.35])).go(0.5, -0.35, 0.06).wait(15).end())
    assert found.label is Label.EARLY_HALT


def test_an_object_that_moves_off_its_target_while_the_arm_rests_was_knocked_away(stage):
    s = stage("dinner_plates", "train1")
    s.bring(s.of("red plate")).wait(0.3)
    s.positions[s.of("red plate")] = s.positions[s.of("red plate")] + np.array([0.04, -0.04, 0.0])
    found = diagnose_record(s.wait(8).end(termination="step_limit"))
    assert found.label is not Label.EARLY_HALT


@pytest.mark.parametrize("brought", [lambda s, at: s.carry(at), sunk, dragged])
@pytest.mark.parametrize("taken", [lambda s, name: s.grasp(name).lift(), tried_again])
def test_an_object_in_the_place_of_another_is_the_word_however_it_got_into_the_gripper_and_out(stage, taken, brought):
    s = stage(*SWAPPED)
    taken(s, s.of("pepper jar"))
    found = diagnose_record(brought(s, hole(s, 1)).home().wait(4).end())
    assert found.kind is Kind.REASONING
    assert Label.LEXICAL_KINEMATIC_SHORTCUT in found.evidence.candidates  # one trial cannot tell a word from a slot


def test_an_object_that_falls_out_of_the_gripper_over_a_wrong_place_was_not_put_there(stage):
    s = stage(*SWAPPED)
    s.grasp(s.of("pepper jar")).lift()
    x, y, z = hole(s, 1) - s.grip_offset
    s.over(np.array([x, y]), 0.3).go(x, y, z + 0.06)
    found = diagnose_record(s.lose().wait(1.0).open().lift().home().wait(4).end())
    assert (found.label, found.evidence.rule) == (Label.EXECUTION_FAILURE, "dropped")
