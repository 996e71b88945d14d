"""What the evidence says in words: a reader who sees the film has to find it there."""

from __future__ import annotations

import numpy as np

from betterbench.diagnosis import Label, diagnose_record, diagnose_records
from betterbench.diagnosis.trial import read_trial
from betterbench.tasks import get_task


def said_of(s):
    return diagnose_record(s.home().wait(4).end()).evidence.text


def test_verbs_agree_with_the_fries(stage):
    s = stage("fast_food", "R1")
    text = said_of(s.bring(s.of("fries"), s.goal(0) + np.array([-0.2, 0.0, 0.0])))
    assert "The fries, the correct object, are released outside the target region" in text


def test_what_was_harmed_is_said_with_the_place(stage):
    s = stage("desk_meeting", "R2")
    text = said_of(s.bring(s.of("mug"), s.place("beside", "laptop", "behind")))
    assert "the mug is at the laptop (behind) without" in text


def test_a_wrong_place_is_said_with_the_right_one(stage):
    """Before, "elsewhere" left open where."""
    s = stage("seasoning_rack", "R1")
    text = said_of(s.bring(s.of("salt jar"), s.place("in_hole", "rack", "hole_1")))
    assert "brought to the rack (hole 1), as in training, although the instruction puts it at the rack (hole " in text
    s = stage("seasoning_rack", "R1")
    text = said_of(s.bring(s.of("salt jar"), s.place("in_hole", "rack", "hole_2")))
    assert "brought to the rack (hole 2), although the instruction puts it at the rack (hole " in text


def test_a_drawer_has_the_name_of_what_training_put_there_and_no_coordinates(stage):
    s = stage("office_drawer", "R1")
    text = said_of(s.draw("upper", 0.15).bring("stapler", s.place("inside", "upper")))
    assert "into which training put the stapler, although the instruction puts it at the lower drawer" in text
    assert "at (" not in text


def test_a_slot_is_said_once(stage):
    s = stage("fast_food", "R1")
    text = said_of(s.bring(s.at("first")))
    assert text.count("slot 'first'") == 1


def test_what_is_left_to_do_is_listed(stage):
    text = diagnose_record(stage("fast_food", "T2").wait(60).end()).evidence.text
    assert "; steps left: " in text
    assert " and 'drink'" in text
    assert "next step" not in text


def test_a_step_that_came_next_in_training_is_memorized_order(stage):
    """Two burgers were asked for: after the first it goes on with the drink, as in training."""
    s = stage("fast_food", "T2")
    s.bring(s.at("first")).bring(s.of("drink")).bring(s.at("second")).home().wait(1)
    found = diagnose_record(s.end())
    assert (found.label, found.evidence.rule) == (Label.ORDER_VIOLATION, "memorized_order")
    assert "in training the drink came next after the burger" in found.evidence.text


def test_another_wrong_order_is_none_of_training(stage, policies):
    s = stage("fast_food", "T1")
    record = s.bring(s.of("fries")).bring(s.at("first")).home().wait(1).end()
    task = get_task("fast_food")
    names = [*(c.name for c in task.training), *(v.name for v in task.variations)]
    found = diagnose_records([record, *(policies["right"]("fast_food", name, 1) for name in names)]).trials[0]
    assert (found.label, found.evidence.rule) == (Label.ORDER_VIOLATION, "attempted_in_wrong_order")


def test_the_target_of_the_task_is_no_look_alike(stage):
    """The white plate is what the red one is put on: an instruction names it, so it is no object of no instruction."""
    s = stage("dinner_plates", "train4")
    found = diagnose_record(s.grasp(s.of("white plate")).lift().open().home().wait(4).end())
    assert found.label is Label.WRONG_OBJECT
    assert "no instruction" not in found.evidence.text


def evidence_for(label, record):
    """Returns what a record shows for a label, whatever a run proves."""
    return dict(read_trial(record).findings)[label]


def test_a_place_rule_says_what_was_done(stage):
    """The mug is taken for the mouse: "it is at the mug although 'mug' was asked for" explained nothing."""
    s = stage("desk_meeting", "L1")
    s.bring(s.of("mug"), s.goal(0)).bring(s.of("mouse"), s.goal(1)).home().wait(4)
    text = evidence_for(Label.VISUAL_LAYOUT_BIAS, s.end()).text
    assert "it takes the mug and brings it to the target of 'mouse'" in text


def test_a_word_rule_says_what_the_film_shows(stage):
    s = stage("morning_coffee", "L3")
    evidence = evidence_for(Label.LEXICAL_KINEMATIC_SHORTCUT, s.bring(s.of("blue mug")).wait(1).end())
    assert "it is at the blue mug, which 'red' does not mean here" in evidence.text
    assert evidence.shared == ("shape",)


def test_what_slips_out_just_above_the_table_was_not_let_go(stage):
    """Before, "let go outside the goal" was said of a gripper that was still closed."""
    s = stage("fast_food", "R1")
    spot = s.goal(0) + np.array([-0.2, 0.0, 0.0])
    s.grasp(s.of("fries")).lift().over(spot, 0.3).go(*(spot - s.grip_offset + np.array([0.0, 0.0, 0.01]))).lose().lift()
    verdict = diagnose_record(s.home().wait(4).end())
    assert verdict.evidence.rule == "dropped"
    assert (
        "The fries, the correct object, slip out of the closed gripper and stay outside the goal"
        in verdict.evidence.text
    )


def test_an_arm_that_had_nothing_to_do_was_on_the_way_to_no_attempt(stage):
    s = stage("morning_coffee", "T1")
    x, y, z = s.tool
    for k in range(200):
        s.tool = np.array([x + 0.03 * np.sin(0.2 * k), y, z])
        s.tick()
    verdict = diagnose_record(s.end())
    assert verdict.label is Label.TIMEOUT
    assert "had no step left and did not stay still" in verdict.evidence.text
