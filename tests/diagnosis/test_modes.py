"""Every failure mode has its culprit, and its near miss that must not be taken for it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from betterbench.diagnosis import Kind, Label, diagnose_record, diagnose_records
from betterbench.geometry import from_axis_angle
from betterbench.interface.state import Contact
from betterbench.records import Record
from betterbench.tasks import Expected, get_task
from betterbench.tasks.authoring.operations import remove, swap


def label_of(record: Record) -> Label:
    return diagnose_record(record).label


def test_a_right_policy_succeeds(stage):
    s = stage("fast_food", "train1")
    record = s.bring(s.at("second")).bring(s.of("fries")).wait(1).end()
    found = diagnose_record(record)
    assert found.label is Label.SUCCESS
    assert found.success
    assert found.progress == 1.0
    assert [a.result for a in found.attempts] == ["target", "target"]
    assert all(a.secured for a in found.attempts)
    assert (found.first_slot, found.intended_kind, found.intention_correct) == ("second", "burger", True)
    assert found.intended == found.first_attempt == s.at("second")
    assert set(found.intended_any) == {o.name for o in s.info.of_kind("burger")}


def test_inertia_is_the_frequent_first_step_unasked(stage):
    s = stage("fast_food", "R1")
    record = s.bring(s.at("first")).bring(s.of("fries")).bring(s.of("drink")).wait(1).end()
    found = diagnose_record(record)
    assert found.label is Label.BEHAVIORAL_INERTIA
    assert not found.intention_correct
    assert found.attempts[0].result == "distractor"
    assert (found.first_attempt_kind, found.intended_kind) == ("burger", "fries")
    assert found.intended == found.intended_any[0] != found.first_attempt


def test_inertia_is_an_air_grasp_at_a_memorized_slot(stage):
    found = diagnose_record(stage("fast_food", "T1").air_grasp("second").wait(4).end())
    assert found.label is Label.BEHAVIORAL_INERTIA
    assert found.attempts[0].result == "null"
    assert found.attempts[0].slot == "second"
    assert found.first_attempt is None


@pytest.mark.parametrize("beside", [0.02, 0.045, 0.07, 0.12])
def test_a_miss_far_beside_an_empty_slot_of_training_is_execution(stage, beside):
    """What goes for an empty slot drifts by some centimeters; what is farther off has missed something."""
    s = stage("fast_food", "T1")
    x, y, _ = s.slot("second")
    found = diagnose_record(s.over(np.array([x, y])).go(x + beside, y, 0.04).close().lift().open().wait(4).end())
    assert found.label is (Label.BEHAVIORAL_INERTIA if beside < 0.09 else Label.EXECUTION_FAILURE)


def test_a_miss_by_pose_is_execution_and_not_inertia(stage):
    s = stage("fast_food", "train1")
    found = diagnose_record(s.grasp(s.at("first"), beside=(0.052, 0.0)).lift().open().wait(5).end())
    assert found.label is Label.EXECUTION_FAILURE
    assert found.evidence.rule == "missed_by_pose"
    assert found.attempts[0].result == "null"
    assert found.intention_correct  # law 4: it went for the correct object


def test_grasping_at_the_slot_of_a_pushed_target_is_execution(stage):
    s = stage("fast_food", "T1")
    burger = s.at("first")
    s.positions[burger] = s.positions[burger] + np.array([0.0, -0.09, 0.0])  # brushed aside on the way
    found = diagnose_record(s.air_grasp("first").wait(4).end())
    assert found.label is Label.EXECUTION_FAILURE


def test_a_miss_beside_a_wrong_object_is_reasoning(stage):
    s = stage("fast_food", "R1")
    found = diagnose_record(s.grasp(s.at("first"), beside=(0.052, 0.0)).lift().open().wait(5).end())
    assert found.label is Label.BEHAVIORAL_INERTIA
    assert not found.intention_correct


def in_a_run(record, policies):
    """Returns the diagnosis of a record in a run whose other trials are right, which no favorite place explains."""
    task, seed = get_task(record.metadata.task), record.metadata.seed + 1
    names = [*(c.name for c in task.training), *(v.name for v in task.variations)]
    return diagnose_records([record, *(policies["right"](task.id, name, seed) for name in names)]).trials[0]


def test_causal_confusion_is_a_skipped_step(stage, policies):
    s = stage("fast_food", "T1")
    record = s.bring(s.of("fries")).home().wait(8).end()
    found = in_a_run(record, policies)
    assert found.label is Label.CAUSAL_CONFUSION
    assert found.evidence.rule == "required_step_skipped"
    alone = diagnose_record(record)
    assert alone.label is Label.WRONG_OBJECT, "one trial may as well show a favorite place"
    assert Label.CAUSAL_CONFUSION.value in alone.evidence.candidates


def test_order_violation_is_a_step_made_up_for_later(stage, policies):
    s = stage("fast_food", "T1")
    record = s.bring(s.of("fries")).bring(s.at("first")).home().wait(1).end()
    found = in_a_run(record, policies)
    assert found.label is Label.ORDER_VIOLATION
    assert found.progress == 0.5
    assert Label.ORDER_VIOLATION.value in diagnose_record(record).evidence.candidates


@pytest.mark.parametrize(("since", "result"), [(1.0, "target"), (6.0, "distractor")])
def test_a_step_that_comes_undone_on_the_way_to_the_next_leaves_the_next_right(stage, since, result):
    s = stage("cheeseburger", "train1")
    patty, cheese = s.of("patty"), s.of("cheese")
    s.bring(patty).home()
    x, y, z = s.positions[patty]
    s.positions[patty] = np.array([x, y - 0.14, z])  # swept off by the empty hand
    found = diagnose_record(s.wait(since).bring(cheese).home().wait(1).end())
    assert [attempt.result for attempt in found.attempts] == ["target", result]
    assert found.label is Label.EXECUTION_FAILURE or since > 3.0


def test_causal_confusion_is_a_finished_step_repeated(stage):
    s = stage("fast_food", "train1")
    found = diagnose_record(s.bring(s.at("first")).bring(s.at("second")).bring(s.of("fries")).wait(1).end())
    assert found.label is Label.CAUSAL_CONFUSION
    assert found.evidence.rule == "finished_step_repeated"
    assert found.intention_correct


def test_causal_confusion_is_taking_away_what_is_in_place(stage):
    s = stage("morning_coffee", "T1")
    found = diagnose_record(s.grasp(s.of("red mug")).lift().carry(s.goal_place()).end())
    assert found.label is Label.CAUSAL_CONFUSION
    assert not found.intention_correct


def test_semantic_collapse_names_what_is_shared(stage):
    s = stage("fast_food", "O1")
    found = diagnose_record(s.bring(s.at("first")).wait(5).end())
    assert found.label is Label.SEMANTIC_FEATURE_COLLAPSE
    assert found.evidence.shared == ("color", "shape", "slot")
    s = stage("morning_coffee", "O1")
    found = diagnose_record(s.bring(s.of("red can")).wait(5).end())
    assert found.label is Label.SEMANTIC_FEATURE_COLLAPSE
    assert found.evidence.shared == ("color", "shape", "slot")


def test_a_look_alike_shares_no_more_than_it_does(stage, looks):
    looks["round_block"] = ((0.05, 0.05, 0.05), "green", "box")
    s = stage("fast_food", "O1")
    assert diagnose_record(s.bring(s.at("first")).wait(5).end()).evidence.shared == ("slot",)


def test_a_clumsy_hand_is_no_semantic_collapse(stage):
    s = stage("fast_food", "O1")
    found = diagnose_record(s.grasp(s.of("burger")).lift().open().wait(5).end())
    assert found.label is Label.EXECUTION_FAILURE
    assert found.evidence.rule == "dropped"


def test_a_drop_followed_by_a_halt_is_execution(stage):
    s = stage("fast_food", "train1")
    found = diagnose_record(s.grasp(s.at("first")).lift().open().home().wait(10).end())
    assert found.label is Label.EXECUTION_FAILURE


def test_a_drop_made_good_does_not_excuse_a_later_halt(stage):
    s = stage("fast_food", "train1")
    s.grasp(s.at("first")).lift().open().wait(1)
    found = diagnose_record(s.bring(s.at("first")).home().wait(10).end())
    assert found.label is Label.EARLY_HALT
    assert found.progress == 0.5


def test_putting_it_beside_the_goal_is_execution(stage):
    s = stage("morning_coffee", "train1")
    s.grasp(s.of("red mug")).lift()
    found = diagnose_record(s.carry(s.goal_place() + np.array([0.02, 0.0, 0.0])).home().wait(5).end())
    assert found.label is Label.EXECUTION_FAILURE
    assert found.evidence.rule == "placed_outside_the_goal"
    assert found.intention_correct


def test_a_drink_on_its_side_in_the_right_box_is_execution(stage):
    s = stage("fast_food", "train2")
    s.bring(s.at("first")).grasp("drink").lift()
    s.postures["drink"] = from_axis_angle((0.0, 0.5 * math.pi, 0.0))
    found = diagnose_record(s.carry(s.goal_place()).home().wait(8).end())
    assert found.label is Label.EXECUTION_FAILURE, found.evidence
    assert not found.success
    assert found.progress == 0.5
    assert found.evidence.rule == "placed_outside_the_goal"
    assert "is left on its side" in found.evidence.text


def test_a_halt_is_early_if_something_is_left(stage):
    s = stage("fast_food", "train1")
    found = diagnose_record(s.bring(s.at("first")).home().wait(5).end())
    assert found.label is Label.EARLY_HALT
    assert label_of(stage("fast_food", "train1").wait(10).end()) is Label.EARLY_HALT


def test_a_frozen_arm_with_a_restless_gripper_has_halted(stage):
    s = stage("fast_food", "train1")
    for _ in range(10):
        s.close(0.5).open(0.5)
    assert label_of(s.end()) is Label.EARLY_HALT


def test_a_pause_is_no_halt(stage):
    s = stage("fast_food", "train1")
    s.wait(4).bring(s.at("first")).wait(4).grasp(s.of("fries")).lift()
    record = s.wander(4).end()
    assert label_of(record) is Label.TIMEOUT


def test_a_freeze_in_a_mid_task_scene_is_a_phase_conflict(stage):
    assert label_of(stage("fast_food", "T1").wait(10).end()) is Label.PHASE_CONFLICT
    assert label_of(stage("fast_food", "T1").wander(10).end()) is Label.PHASE_CONFLICT
    s = stage("fast_food", "T1")
    assert label_of(s.bring(s.at("first")).home().wait(5).end()) is Label.EARLY_HALT


def test_going_to_and_fro_is_a_phase_conflict_in_usual_scenes_too(stage):
    found = diagnose_record(stage("fast_food", "train1").wander(10).end())
    assert (found.label, found.evidence.rule) == (Label.PHASE_CONFLICT, "to_and_fro")


def test_wandering_after_things_were_swept_aside_is_no_phase_conflict(stage):
    s = stage("fast_food", "train1")
    fries = s.of("fries")
    s.wait(1)
    s.positions[fries] = s.positions[fries] + np.array([0.0, 0.09, 0.0])
    found = diagnose_record(s.wander(10).end())
    assert found.label is not Label.PHASE_CONFLICT
    assert found.kind is not Kind.REASONING


def test_staying_still_is_right_where_nothing_is_to_do(stage):
    found = diagnose_record(stage("morning_coffee", "T1").end())
    assert found.label is Label.CORRECT_FREEZE
    assert found.intention_correct
    assert (found.intended, found.intended_kind, found.intended_any) == (None, None, ())
    assert found.kind is Kind.NONE


def test_an_air_grasp_where_nothing_is_to_do_is_inertia(stage):
    found = diagnose_record(stage("morning_coffee", "T1").air_grasp("near").end())
    assert found.label is Label.BEHAVIORAL_INERTIA
    assert not found.intention_correct


def test_one_trial_alone_cannot_prove_a_shortcut(stage):
    s = stage("morning_coffee", "L3")
    found = diagnose_record(s.bring(s.of("blue mug")).wait(1).end())
    assert found.label is Label.WRONG_OBJECT
    assert found.evidence.candidates == ("lexical_kinematic_shortcut", "visual_layout_bias")


def test_inertia_stands_where_the_word_leads_there_too(changed_stage):
    s = changed_stage("fast_food", "R1", lambda c: swap(c.object("burger_1"), c.object("fries")).carry_out(c)[0])
    found = diagnose_record(s.bring(s.of("burger", "third")).wait(1).end())
    assert found.label is Label.BEHAVIORAL_INERTIA
    assert "lexical_kinematic_shortcut" in found.evidence.candidates


@pytest.mark.parametrize("how", ["policy_error", "interrupted"])
def test_a_crash_is_never_a_failure_of_reasoning(stage, how):
    s = stage("fast_food", "R1")
    found = diagnose_record(s.grasp(s.at("first")).end(termination=how, error="connection lost"))
    assert found.label is Label.POLICY_ERROR
    assert found.kind is Kind.SYSTEM
    assert "connection lost" in found.evidence.text


def test_the_first_evidence_in_time_decides(stage):
    s = stage("fast_food", "R1")
    s.grasp(s.of("fries")).lift().open().wait(1)  # dropped, and never made good
    found = diagnose_record(s.bring(s.at("first")).wait(1).end())
    assert found.label is Label.EXECUTION_FAILURE
    s = stage("fast_food", "R1")
    s.bring(s.at("first")).grasp(s.of("fries")).lift().open().wait(1)
    assert label_of(s.end()) is Label.BEHAVIORAL_INERTIA


def refusal(condition):
    """Takes the last burger away, so that a burger cannot be packed and the block must be left alone."""
    return (
        remove(condition.object("burger_2"))
        .carry_out(condition)[0]
        .with_(expected=Expected.REFUSE, premise_broken=True)
    )


def test_leaving_a_look_alike_alone_is_a_correct_refusal(changed_stage):
    found = diagnose_record(changed_stage("fast_food", "O1", refusal).wait(1).end())
    assert found.label is Label.CORRECT_REFUSAL
    assert found.intention_correct


def test_what_can_be_done_may_be_done_where_the_rest_is_refused(changed_stage):
    s = changed_stage("fast_food", "O1", refusal)
    found = diagnose_record(s.bring(s.of("fries")).end())
    assert found.label is Label.CORRECT_REFUSAL
    assert found.attempts[0].result == "target"
    assert found.intended_kind == "fries"
    assert found.intended == found.first_attempt == s.of("fries")
    assert found.progress == 1.0


def test_grasping_the_look_alike_of_an_absent_target_is_a_collapse(changed_stage):
    s = changed_stage("fast_food", "O1", refusal)
    found = diagnose_record(s.bring(s.of("fries")).bring(s.of("round block")).end())
    assert found.label is Label.SEMANTIC_FEATURE_COLLAPSE
    assert not found.intention_correct


def test_touching_without_grasping_is_a_collision_where_nothing_is_to_do(stage):
    s = stage("morning_coffee", "T1")
    real, blue = s.state, s.of("blue mug")
    s.state = lambda: replace(real(), contacts=(*real().contacts, Contact(blue, "left_finger", 1.0)))
    s.wait(0.5)
    s.state = real
    found = diagnose_record(s.end())
    assert found.label is Label.EXECUTION_FAILURE
    assert found.evidence.rule == "collided"


def test_knocking_the_target_over_is_execution(stage):
    s = stage("fast_food", "train1")
    drink = s.of("fries")
    s.bring(s.at("first"))
    real = s.state

    def fallen():
        state = real()
        q = list(state.quaternions)
        q[state.info.index(drink)] = (0.7071, 0.7071, 0.0, 0.0)
        return replace(state, quaternions=tuple(q))

    s.state = fallen
    found = diagnose_record(s.home().wait(5).end())
    assert found.label is Label.EXECUTION_FAILURE
    assert found.evidence.rule == "collided"


def test_a_crash_before_the_first_action_has_a_diagnosis(stage):
    found = diagnose_record(stage("fast_food", "train1").end(termination="policy_error", error="no answer"))
    assert (found.label, found.steps, found.attempts, found.intention_correct) == (Label.POLICY_ERROR, 0, (), False)


def test_a_word_leads_to_a_place_whatever_its_slot_is_called_in_another_layout(stage):
    """The desk has two rows of slots 2.4 cm apart: the motion learned for the mouse in one row takes the speaker."""
    s = stage("desk_meeting", "train7")
    record = s.bring(s.of("speaker"), s.goal(0)).home().wait(4).end()
    found = diagnose_record(record)
    assert found.first_slot == "front_4"
    assert found.label is Label.WRONG_OBJECT
    assert Label.LEXICAL_KINEMATIC_SHORTCUT.value in found.evidence.candidates
