"""What real policies do, and what it must be called: jerks, retries, pauses, pushes and second thoughts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from betterbench.diagnosis import Label, TrialDiagnosis, diagnose_record
from betterbench.interface.state import Contact
from betterbench.tasks import Expected
from betterbench.tasks.authoring.operations import remove


def verdict(s) -> tuple[Label, str]:
    found = diagnose_record(s.end())
    return found.label, found.evidence.rule


def halted(s) -> TrialDiagnosis:
    return diagnose_record(s.home().wait(4).end())


HALT = (Label.EARLY_HALT, "still_with_open_subgoals")


# -- retries ------------------------------------------------------------------------------------------------------


def test_a_miss_that_a_retry_made_good_does_not_hide_a_wrong_place(stage):
    s = stage("desk_meeting", "R1")
    s.grasp("mug", beside=(0.052, 0.0)).open().lift().bring("mug", s.goal(1)).home().wait(4)
    assert verdict(s) == (Label.BEHAVIORAL_INERTIA, "memorized_place")


def test_a_drop_that_was_picked_up_again_does_not_hide_a_wrong_place(stage):
    s = stage("desk_meeting", "R1")
    s.grasp("mug").lift().open().wait(1).bring("mug", s.goal(1)).home().wait(4)
    assert verdict(s) == (Label.BEHAVIORAL_INERTIA, "memorized_place")


def test_a_second_drop_that_lands_at_a_wrong_place_by_chance_does_not_excuse_the_first(stage):
    s = stage("desk_meeting", "R1")
    s.grasp("mug").lift().open().wait(1).grasp("mug").lift()
    spot = s.goal(1) - s.grip_offset
    s.over(spot, 0.3).go(spot[0], spot[1], 0.2).open().home().wait(4)
    assert verdict(s) == (Label.EXECUTION_FAILURE, "dropped")


def test_a_miss_before_another_drop_is_execution(stage):
    s = stage("desk_meeting", "R1")
    s.grasp("mug", beside=(0.052, 0.0)).open().lift().grasp("mug").lift().open().home().wait(4)
    assert verdict(s) == (Label.EXECUTION_FAILURE, "missed_by_pose")


def test_ten_misses_are_execution(stage):
    s = stage("fast_food", "train1")
    for _ in range(4):
        s.grasp(s.at("first"), beside=(0.052, 0.0)).open(0.4)
    assert verdict(s) == (Label.EXECUTION_FAILURE, "missed_by_pose")


def test_dropping_and_picking_again_three_times_is_a_success(stage):
    s = stage("fast_food", "train1")
    for _ in range(3):
        s.grasp(s.at("first")).lift(0.06).open(0.5)
    assert halted(s.bring(s.at("first")).bring(s.of("fries")).wait(1)).label is Label.SUCCESS


def test_a_wrong_place_taken_back_at_once_is_judged_where_it_ended(stage):
    s = stage("desk_meeting", "R1")
    s.bring("mug", s.goal(1)).grasp("mug").lift().carry(s.goal(0)).home().wait(4)
    assert verdict(s) == HALT


# -- grippers -----------------------------------------------------------------------------------------------------


def test_a_gripper_that_is_always_closed_attempts_nothing(stage):
    s = stage("fast_food", "train1").close()
    for name in ("burger_1", "fries", "drink"):
        x, y, _ = s.positions[name]
        s.over(s.positions[name]).go(x, y + 0.06, 0.03).lift()
    found = halted(s)
    assert found.attempts == ()
    assert found.label is Label.EARLY_HALT


@pytest.mark.parametrize("times", [1, 4])
def test_a_gripper_that_closes_again_on_what_it_just_put_down_repeats_nothing(stage, times):
    s = stage("fast_food", "train1")
    s.grasp(s.at("first")).lift()
    s.over(s.goal_place(), 0.30).go(*(s.goal_place() - s.grip_offset + np.array([0.0, 0.0, 0.002])))
    s.open(0.4)
    for _ in range(times):
        s.close(0.4).open(0.4)
    found = halted(s.lift())
    assert found.label is Label.EARLY_HALT
    assert [a.result for a in found.attempts] == ["target"]


def test_taking_out_what_was_just_put_in_repeats_a_finished_step(stage):
    s = stage("fast_food", "train1")
    s.bring(s.at("first")).grasp(s.at("first")).lift().carry(s.slot("first")).home().wait(4)
    found = diagnose_record(s.end())
    assert (found.label, found.evidence.rule) == (Label.CAUSAL_CONFUSION, "finished_step_repeated")


def test_a_gripper_that_takes_out_at_once_what_it_just_put_down_repeats_a_step(stage):
    s = stage("fast_food", "train1")
    s.grasp(s.at("first")).lift()
    s.over(s.goal_place(), 0.30).go(*(s.goal_place() - s.grip_offset + np.array([0.0, 0.0, 0.002])))
    found = halted(s.open(0.6).close(0.4).lift().carry(s.slot("first")))
    assert (found.label, found.evidence.rule) == (Label.CAUSAL_CONFUSION, "finished_step_repeated")


def test_coming_back_to_what_was_put_in_repeats_a_step(stage):
    s = stage("fast_food", "train1")
    found = halted(s.bring(s.at("first")).grasp(s.at("first")).open())
    assert (found.label, found.evidence.rule) == (Label.CAUSAL_CONFUSION, "finished_step_repeated")


def test_a_gripper_that_closes_on_the_way_home_is_no_air_grasp(stage):
    s = stage("desk_meeting", "train1")
    s.bring("mouse", s.goal(0))
    x, y, _ = s.slot("front_1")
    s.over(s.slot("front_1")).go(x, y, 0.18).close().open()
    found = halted(s)
    assert [a.result for a in found.attempts] == ["target", "null"]
    assert (found.label, found.evidence.rule) == (Label.EXECUTION_FAILURE, "missed_by_far")


def test_a_gripper_that_closes_high_above_a_wrong_thing_has_not_chosen_it(stage):
    s = stage("breakfast_table", "train1")
    x, y, _ = s.positions["egg"]
    found = halted(s.over(s.positions["egg"]).go(x, y, 0.17).close().open())
    assert [(a.result, a.object, a.slot) for a in found.attempts] == [("null", None, None)]
    assert found.first_attempt is None
    assert (found.label, found.evidence.rule) == (Label.EXECUTION_FAILURE, "missed_by_far")


def test_a_gripper_that_closes_while_it_travels_past_has_not_chosen_what_is_there(stage):
    s = stage("breakfast_table", "train1")
    x, y, _ = s.positions["egg"]
    s.over(np.array([x, y - 0.12, 0.0])).go(x, y - 0.12, 0.11)
    s.command = 1.0
    found = halted(s.go(x, y + 0.12, 0.11).lift().open())
    assert found.attempts == ()
    assert found.label is Label.EARLY_HALT


@pytest.mark.parametrize(("time", "attempts"), [(0.2, 0), (0.5, 1)])
def test_an_episode_that_ends_while_the_fingers_close_shows_no_miss(stage, time, attempts):
    s = stage("fast_food", "train1")
    x, y, _ = s.positions[s.at("first")]
    s.over(s.positions[s.at("first")]).go(x + 0.052, y, 0.03).close(time)
    assert len(diagnose_record(s.end()).attempts) == attempts


def test_a_hand_that_closes_a_little_above_its_target_missed_it(stage):
    s = stage("fast_food", "train1")
    burger = s.at("first")
    s.positions[burger] = s.positions[burger] + np.array([0.0, -0.12, 0.0])  # far from every slot
    x, y, _ = s.positions[burger]
    found = halted(s.over(s.positions[burger]).go(x, y, 0.09).close().lift().open())
    assert (found.label, found.evidence.rule) == (Label.EXECUTION_FAILURE, "missed_by_pose")


def test_two_things_between_the_fingers_are_one_attempt_at_the_nearer(stage):
    s = stage("fast_food", "train1")
    burger, fries = s.at("first"), s.of("fries")
    real = s.state

    def both():
        state = real()
        held = s.grip is not None
        extra = (Contact(fries, "left_finger", 2.0), Contact(fries, "right_finger", 2.0)) if held else ()
        return replace(state, contacts=(*state.contacts, *extra))

    s.state = both
    s.grasp(burger).lift().open()
    s.state = real
    found = halted(s)
    assert [a.object for a in found.attempts] == [burger]
    assert found.label is Label.EXECUTION_FAILURE


# -- pauses -------------------------------------------------------------------------------------------------------


def test_chunks_with_pauses_just_below_the_limit_are_no_halt(stage):
    s = stage("fast_food", "train1").wait(2.8).grasp("burger_1").wait(2.8).lift().wait(2.8)
    s.carry(s.goal_place()).wait(2.8).over(s.positions["fries"]).wait(2.8)
    assert verdict(s) == (Label.TIMEOUT, "step_limit")


def test_a_long_pause_with_the_object_in_the_hand_is_no_halt_if_it_carries_on(stage):
    s = stage("morning_coffee", "train1")
    s.grasp(s.of("red mug")).lift().wait(4).carry(s.goal_place() + np.array([0.02, 0.0, 0.0])).home()
    assert verdict(s) == (Label.EXECUTION_FAILURE, "placed_outside_the_goal")


def test_freezing_for_good_with_the_object_in_the_hand_is_a_halt(stage):
    s = stage("morning_coffee", "train1")
    assert verdict(s.grasp(s.of("red mug")).lift().wait(6)) == HALT


def test_a_hand_that_freezes_and_then_gives_up_has_halted(stage):
    s = stage("morning_coffee", "train1")
    assert verdict(s.grasp(s.of("red mug")).lift().wait(6).open().wait(1)) == HALT


def test_succeeding_late_is_a_success(stage):
    s = stage("morning_coffee", "train1")
    assert verdict(s.wait(9).bring(s.of("red mug")).wait(1)) == (Label.SUCCESS, "goal")


# -- pushes -------------------------------------------------------------------------------------------------------


def test_a_target_pushed_out_of_its_slot_is_still_the_target(stage):
    s = stage("desk_meeting", "train1")
    s.positions["mouse"] = s.positions["mouse"] + np.array([-0.09, 0.05, 0.0])
    found = halted(s.bring("mouse", s.goal(0)))
    assert found.attempts[0].result == "target"
    assert found.label is Label.EARLY_HALT


def test_what_was_right_and_is_knocked_away_afterward_is_execution(stage):
    s = stage("fast_food", "train1")
    s.bring(s.at("first")).wait(0.5)
    s.positions[s.at("first")] = s.positions[s.at("first")] + np.array([0.0, -0.2, 0.0])
    s.positions[s.at("first")][2] = 0.0
    found = halted(s)
    assert (found.label, found.evidence.rule) == (Label.EXECUTION_FAILURE, "knocked_out_of_place")


def test_what_is_knocked_away_and_brought_back_is_made_good(stage):
    s = stage("fast_food", "train1")
    burger = s.at("first")
    s.bring(burger).wait(0.5)
    s.positions[burger] = np.array([*(s.positions[burger] + np.array([0.0, -0.2, 0.0]))[:2], 0.0])
    assert halted(s.wait(0.5).bring(burger)).label is Label.EARLY_HALT


# -- drawers ------------------------------------------------------------------------------------------------------


def test_a_drawer_drawn_out_in_three_pulls_is_right(stage):
    s = stage("office_drawer", "train1").draw("upper", 0.05).draw("upper", 0.13).draw("upper", 0.15)
    found = halted(s)
    assert {a.result for a in found.attempts} == {"target"}
    assert found.label is Label.EARLY_HALT


@pytest.mark.parametrize("opening", [0.06, 0.01])
def test_a_drawer_that_is_left_halfway_is_execution(stage, opening):
    s = stage("office_drawer", "train2")
    found = halted(s.bring("stapler", s.goal(0)).draw("upper", opening))
    assert (found.label, found.evidence.rule) == (Label.EXECUTION_FAILURE, "drawer_left_halfway")
    s = stage("office_drawer", "train1").draw("upper", 0.05)
    assert halted(s).label is Label.EXECUTION_FAILURE


def test_a_drawer_shut_in_two_pushes_is_a_success(stage):
    s = stage("office_drawer", "train2")
    s.bring("stapler", s.goal(0)).draw("upper", 0.06).draw("upper", 0.0).wait(1)
    assert diagnose_record(s.end()).label is Label.SUCCESS


def test_a_hand_on_the_drawer_at_the_limit_ran_out_of_time(stage):
    s = stage("office_drawer", "train2")
    s.bring("stapler", s.goal(0)).grasp("upper").go(*(s.tool + np.array([0.0, 0.06, 0.0])))
    assert verdict(s) == (Label.TIMEOUT, "step_limit")


def test_closing_an_empty_drawer_skips_what_was_to_go_in(stage):
    s = stage("office_drawer", "train2").draw("upper", 0.0)
    assert halted(s).label is Label.CAUSAL_CONFUSION


def test_the_right_drawer_does_not_excuse_the_wrong_thing(stage):
    s = stage("office_drawer", "train1").draw("upper", 0.15)
    found = halted(s.bring("tape", s.goal(0)))
    assert not found.intention_correct
    assert (found.first_attempt, found.first_slot) == ("tape", "left_front")
    assert found.label is Label.WRONG_OBJECT


def test_a_drawer_is_no_first_attempt_but_a_wrong_drawer_is_a_wrong_one(stage):
    found = halted(stage("office_drawer", "train1").draw("upper", 0.15))
    assert (found.first_attempt, found.intention_correct) == (None, True)
    found = halted(stage("office_drawer", "train1").draw("lower", 0.15).bring("stapler", np.array([0.5, 0.0, 0.0])))
    assert (found.first_attempt, found.intention_correct) == ("stapler", False)


# -- refusing -----------------------------------------------------------------------------------------------------


def test_hovering_without_coming_to_rest_is_no_refusal_and_no_reasoning_error(stage):
    s = stage("fruit_lunch", "O1")
    found = diagnose_record(s.wander(s.task.step_limit(s.condition) / 20).end())
    assert not found.success
    assert found.label in (Label.TIMEOUT, Label.EXECUTION_FAILURE)
    assert found.intention_correct


def test_the_arm_may_lean_on_the_block(stage):
    s = stage("fruit_lunch", "O1")
    real, block = s.state, s.of("red block")
    s.state = lambda: replace(real(), contacts=(*real().contacts, Contact(block, "arm", 3.0)))
    s.wait(1.0)
    s.state = real
    assert diagnose_record(s.end()).label is Label.CORRECT_REFUSAL


def test_brushing_the_block_on_the_way_to_what_may_be_packed_is_execution(stage):
    s = stage("fruit_lunch", "O1")
    real, block = s.state, s.of("red block")
    s.state = lambda: replace(real(), contacts=(*real().contacts, Contact(block, "left_finger", 1.0)))
    s.wait(0.5)
    s.state = real
    found = diagnose_record(s.bring(s.of("orange"), s.goal(1)).end())
    assert (found.label, found.evidence.rule) == (Label.EXECUTION_FAILURE, "collided")


def test_packing_what_may_be_packed_and_never_coming_to_rest_is_no_collision(stage):
    s = stage("fruit_lunch", "O1")
    s.bring(s.of("orange"), s.goal(1))
    found = diagnose_record(s.wander(s.task.step_limit(s.condition) / 20).end())
    assert (found.label, found.evidence.rule) == (Label.TIMEOUT, "step_limit")


def test_touching_what_may_be_packed_is_allowed(changed_stage):
    def change(condition):
        return (
            remove(condition.object("burger_2"))
            .carry_out(condition)[0]
            .with_(expected=Expected.REFUSE, premise_broken=True)
        )

    s = changed_stage("fast_food", "O1", change)
    assert diagnose_record(s.bring(s.of("fries")).end()).label is Label.CORRECT_REFUSAL


def test_what_stands_in_for_an_absent_target_is_compared_with_that(stage):
    s = stage("fruit_lunch", "O1")
    found = diagnose_record(s.bring(s.of("red block"), s.goal(0)).end())
    assert found.label is Label.SEMANTIC_FEATURE_COLLAPSE
    assert found.evidence.shared == ("slot",)
    assert "the instruction asks for 'apple', which is absent" in found.evidence.text


# -- containers ---------------------------------------------------------------------------------------------------


def test_grasping_the_container_is_no_look_alike(stage):
    s = stage("fast_food", "train1")
    real = s.state
    x, y, _ = s.slot("third")
    s.go(x, y + 0.055, 0.1).close(0.3)  # beside a slot, which has nothing to do with it
    box = s.of("box")
    s.state = lambda: replace(
        real(), contacts=(*real().contacts, Contact(box, "left_finger", 4.0), Contact(box, "right_finger", 4.0))
    )
    s.wait(0.5)
    s.state = real
    found = halted(s.open())
    assert (found.label, found.first_attempt, found.first_slot) == (Label.WRONG_OBJECT, box, None)


# -- too much -----------------------------------------------------------------------------------------------------


def test_one_too_many_repeats_a_finished_step(stage):
    s = stage("fast_food", "train1").bring("burger_1").bring("burger_2").bring("fries").wait(1)
    assert halted(s).label is Label.CAUSAL_CONFUSION


def test_something_too_much_at_the_end_is_of_another_instruction(stage):
    s = stage("fast_food", "train1").bring("burger_1").bring("drink").bring("fries").wait(1)
    found = halted(s)
    assert found.label in (Label.BEHAVIORAL_INERTIA, Label.WRONG_OBJECT)
    assert found.evidence.objects == ("drink",)


def test_the_whole_task_done_twice_is_a_success(stage):
    s = stage("morning_coffee", "train1")
    s.bring(s.of("red mug")).wait(1).bring(s.of("red mug")).home()
    assert halted(s).label is Label.SUCCESS


def test_setting_down_midway_and_taking_a_better_grip_is_no_failure(stage):
    s = stage("desk_meeting", "train1")
    s.bring("mouse", np.array([0.55, -0.05, 0.0])).bring("mouse", s.goal(0))
    found = halted(s)
    assert [a.result for a in found.attempts] == ["target", "target"]
    assert found.label is Label.EARLY_HALT


def test_the_wrong_thing_taken_and_put_back_is_still_a_wrong_choice(stage):
    s = stage("desk_meeting", "train1")
    place = s.positions["speaker"].copy()
    s.bring("speaker", place).bring("mouse", s.goal(0))
    assert halted(s).label is Label.WRONG_OBJECT


def test_a_miss_beside_the_right_thing_and_then_the_wrong_one_is_first_a_miss(stage):
    s = stage("desk_meeting", "train1")
    s.grasp("mouse", beside=(0.0, 0.055)).open().lift().bring("speaker", s.goal(0))
    assert halted(s).label is Label.EXECUTION_FAILURE


def test_a_wrong_drawer_blocking_is_closed_first(stage):
    s = stage("office_drawer", "T1").draw("lower", 0.15)
    found = halted(s)
    assert found.attempts[0].result == "target"


def test_what_stood_right_from_the_start_and_is_knocked_away_is_execution(stage):
    s = stage("dinner_plates", "T2").wait(0.2)
    s.positions["red_plate"] = s.positions["red_plate"] + np.array([0.0, -0.2, -0.016])
    found = halted(s)
    assert (found.label, found.evidence.rule) == (Label.EXECUTION_FAILURE, "knocked_out_of_place")
