"""What shows a choice, or none, where no grasp attempt does: stays, pushes, ways to and fro, pauses, far misses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.daily import others_slow

from betterbench.diagnosis import Kind, Label, diagnose_record
from betterbench.diagnosis.modes import MODES

ABOVE = 0.05
"""Height over the top of an object at which an open gripper hovers [m]."""


def over(s, name, *, above=ABOVE):
    """Moves the open gripper over an object."""
    x, y, z = s.positions[name]
    return s.over(s.positions[name]).go(x, y, z + s.size(name)[2] + above)


def tremble(s, seconds, *, by=0.015):
    """Stays about a place without ever standing still."""
    x, y, z = s.tool
    for k in range(round(seconds * 20)):
        s.go(x + by * np.sin(0.9 * k), y + by * np.cos(0.9 * k), z)
    return s


def between(s, a, b, times, *, speed=0.5):
    """Goes to and fro between two objects."""
    for _ in range(times):
        for name in (a, b):
            x, y, z = s.positions[name]
            s.go(x, y, z + s.size(name)[2] + ABOVE, speed=speed).wait(0.3)
    return s


# -- stays ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("still", [True, False])
def test_hovering_over_a_look_alike_is_a_choice(stage, still):
    s = stage("fast_food", "O1")
    over(s, s.at("first"))
    found = diagnose_record((s.wait(8) if still else tremble(s, 8)).end())
    assert found.label is Label.SEMANTIC_FEATURE_COLLAPSE
    assert found.evidence.objects == (s.at("first"),)
    assert "stays over it" in found.evidence.text
    assert found.attempts == ()
    assert not found.intention_correct


def test_a_wide_look_alike_is_hovered_over_at_its_rim(stage):
    s = stage("dinner_plates", "O1")
    bowl = next(o.name for o in s.info.objects if "bowl" in o.kind)
    x, y, z = s.positions[bowl]
    rim = 0.5 * s.size(bowl)[0] - 0.005
    found = diagnose_record(s.over(s.positions[bowl]).go(x + rim, y, z + s.size(bowl)[2] + 0.035).wait(8).end())
    assert found.label is Label.SEMANTIC_FEATURE_COLLAPSE
    assert found.evidence.objects == (bowl,)


def test_the_target_is_no_choice_of_an_object(stage):
    s = stage("dinner_plates", "train1")
    plate = s.goal_place()
    found = diagnose_record(tremble(s.over(plate).go(*plate[:2], plate[2] + 0.08), 5).end())
    assert "stays over" not in found.evidence.text


def test_hovering_over_what_another_instruction_means_is_a_wrong_object(stage):
    s = stage("morning_coffee", "L3")
    found = diagnose_record(tremble(over(s, s.of("blue mug")), 8).end())
    assert found.label is Label.WRONG_OBJECT


def test_hovering_over_the_right_thing_is_the_right_course(stage):
    s = stage("morning_coffee", "L3")
    found = diagnose_record(tremble(over(s, s.of("red mug")), 8).end())
    assert found.label is Label.TIMEOUT
    assert "stays over the red mug" in found.evidence.text


def test_standing_still_over_the_right_thing_is_a_halt(stage):
    s = stage("morning_coffee", "L3")
    assert diagnose_record(over(s, s.of("red mug")).wait(8).end()).label is Label.EARLY_HALT


def test_approaches_that_are_broken_off_again_and_again_are_a_choice(stage):
    s = stage("fast_food", "O1")
    for _ in range(5):
        over(s, s.at("first"), above=0.02).wait(0.3).lift(0.3)
    found = diagnose_record(s.end())
    assert found.label is Label.SEMANTIC_FEATURE_COLLAPSE


def test_a_stay_that_a_grasp_follows_decides_nothing(stage):
    """A feint: it stays over one thing and takes another, and the grasp is what it chose."""
    s = stage("fast_food", "O1")
    over(s, s.at("first")).wait(2.5)
    found = diagnose_record(s.bring(s.of("burger")).home().wait(4).end())
    assert found.label is Label.EARLY_HALT
    assert found.intention_correct


def test_passing_slowly_over_other_things_is_no_choice(stage):
    s = stage("fast_food", "train1")
    x, y, z = s.positions[s.of("drink")]
    s.over(np.array([x, y - 0.2, 0.0])).go(x, y - 0.2, z + 0.2).go(x, y + 0.2, z + 0.2, speed=0.03)
    found = diagnose_record(s.end())
    assert found.label is Label.TIMEOUT


@pytest.mark.parametrize("speed", [0.015, 0.03, 0.1])
def test_a_limit_that_comes_while_it_passes_over_a_look_alike_shows_no_choice(stage, speed):
    s = stage("fast_food", "O1")
    x, y, z = s.positions[s.at("first")]
    z += s.size(s.at("first"))[2] + ABOVE
    s.over(np.array([x, y - 0.2, 0.0])).go(x, y - 0.2, z).go(x, y + 0.02, z, speed=speed)
    assert diagnose_record(s.end()).label is Label.TIMEOUT


def test_what_was_put_at_its_target_is_stayed_over_by_nobody(stage):
    s = stage("fast_food", "train1")
    s.bring(s.at("first"))
    found = diagnose_record(tremble(over(s, s.at("first")), 6, by=0.002).end())
    assert found.label in (Label.EARLY_HALT, Label.TIMEOUT, Label.PHASE_CONFLICT)
    assert "stays over" not in found.evidence.text


# -- to and fro -----------------------------------------------------------------------------------------------------


def test_swaying_between_two_things_is_a_phase_conflict(stage):
    s = stage("fast_food", "train1")
    over(s, s.at("first"))
    found = diagnose_record(between(s, s.at("first"), s.of("fries"), 8).end())
    assert (found.label, found.evidence.rule) == (Label.PHASE_CONFLICT, "to_and_fro")
    assert "between the" in found.evidence.text


def test_fidgeting_after_the_first_step_is_a_phase_conflict(stage):
    s = stage("fast_food", "train1")
    s.bring(s.at("first")).home()
    found = diagnose_record(tremble(s, 12, by=0.04).end())
    assert (found.label, found.evidence.rule) == (Label.PHASE_CONFLICT, "to_and_fro")
    assert found.kind is Kind.REASONING


@pytest.mark.parametrize("rows", [1, 2, 4])
def test_fingers_that_open_slowly_do_not_hide_the_motion_after_them(stage, rows):
    """While fingers open, they still hold the object for a few rows."""
    s = stage("fast_food", "train1")
    s.grasp(s.at("first")).lift()
    x, y, z = s.goal_place() - s.grip_offset
    s.over(np.array([x, y]), 0.30).go(x, y, z + 0.01)
    s.jams, s.command = True, -1.0
    s.wait(rows / 20)
    s.jams = False
    s.open(0.4).lift().home()
    found = diagnose_record(tremble(s, 12, by=0.04).end())
    assert (found.label, found.evidence.rule) == (Label.PHASE_CONFLICT, "to_and_fro")


def test_carrying_an_object_to_and_fro_to_the_end_is_no_motion_of_an_empty_gripper(stage):
    s = stage("fast_food", "train1")
    s.grasp(s.at("first")).lift()
    found = diagnose_record(tremble(s, 12, by=0.04).end())
    assert found.evidence.rule != "to_and_fro"


def test_trembling_in_place_to_the_end_is_a_halt(stage):
    s = stage("fast_food", "train1")
    s.bring(s.at("first")).home()
    found = diagnose_record(tremble(s, 12, by=0.005).end())
    assert (found.label, found.evidence.rule) == (Label.EARLY_HALT, "still_with_open_subgoals")
    s = stage("fast_food", "train1")
    s.bring(s.at("first")).home()
    going_on = tremble(s, 6, by=0.005).bring(s.of("fries")).home()
    assert diagnose_record(going_on.wait(1).end()).label is not Label.EARLY_HALT


def test_a_way_between_misses_is_not_to_and_fro(stage):
    s = stage("fast_food", "train1")
    x, y, _ = s.positions[s.at("first")]
    for _ in range(6):
        s.over(np.array([x, y, 0.0])).go(x - 0.12, y, 0.03).close().home().open()
    found = diagnose_record(s.end())
    assert (found.label, found.evidence.rule) == (Label.EXECUTION_FAILURE, "missed_by_far")


def test_a_slow_straight_way_is_a_timeout(stage):
    s = stage("fast_food", "train1")
    x, y, z = s.positions[s.at("first")]
    found = diagnose_record(s.go(x, y, z + 0.25, speed=0.02).end())
    assert found.label is Label.TIMEOUT
    assert "on the way" in found.evidence.text


def test_detours_of_an_honest_policy_are_not_to_and_fro(stage):
    s = stage("fast_food", "train1")
    x, y, _ = s.positions[s.at("first")]
    s.go(0.45, 0.25, 0.4, speed=0.1).go(0.55, -0.2, 0.35, speed=0.1).go(x, y, 0.3, speed=0.1)
    assert diagnose_record(s.end()).label is Label.TIMEOUT


def zigzag(s, start, goal, *, seconds, swing=0.15, period=2.5):
    """Goes from a point to another at an even pace, swinging to both sides all the way."""
    start, goal = np.array(start), np.array(goal)
    ahead = np.array([*(goal - start)[:2], 0.0])
    side = np.array([-ahead[1], ahead[0], 0.0]) / max(np.linalg.norm(ahead), 1e-9)
    s.go(*start)
    for k in range(round(seconds * 20)):
        share = k / (seconds * 20)
        s.tool = start + share * (goal - start) + swing * (4 * abs(share * seconds / period % 1.0 - 0.5) - 1) * side
        s.tick()
    return s


@pytest.mark.parametrize("way", ["there", "past it", "away", "about it"])
def test_swings_that_come_nearer_to_the_right_thing_all_the_time_are_a_slow_way(stage, way):
    s = stage("fast_food", "train1")
    near = s.positions[s.of("burger")][:2].copy()
    far = near + np.array([-0.1, 0.4])
    if way == "past it":
        far, near = near + np.array([0.0, 0.2]), near - np.array([0.0, 0.2])
    if way == "about it":
        far = near + np.array([-0.05, 0.0])
    start, goal = (near, far) if way == "away" else (far, near)
    found = diagnose_record(zigzag(s, (*start, 0.42), (*goal, 0.42), seconds=40).end())
    assert found.label is (Label.TIMEOUT if way == "there" else Label.PHASE_CONFLICT)


# -- pauses ---------------------------------------------------------------------------------------------------------


def test_a_pause_after_which_the_arm_goes_on_is_no_halt(stage):
    s = stage("fast_food", "train1")
    x, y, _ = s.positions[s.at("first")]
    s.go(x, y, 0.4).wait(5).go(x, y + 0.3, 0.4, speed=0.2).go(x, y, 0.35, speed=0.2)
    found = diagnose_record(s.end())
    assert found.label is Label.TIMEOUT


@pytest.mark.parametrize(("speed", "label"), [(0.001, Label.EARLY_HALT), (0.008, Label.TIMEOUT)])
def test_an_arm_that_drifts_unseen_has_halted_and_one_that_creeps_on_has_not(stage, speed, label):
    s = stage("fast_food", "train1")
    x, y, z = s.tool
    assert diagnose_record(s.go(x, y, z - 50 * speed, speed=speed).end()).label is label


@pytest.mark.parametrize("rest", [8, 1])
def test_an_arm_that_slows_down_and_comes_to_rest_has_halted(stage, rest):
    """It creeps for 6 s, which is slower than a moving arm, and then stands still."""
    s = stage("fast_food", "train1")
    x, y, z = s.go(0.45, 0.0, 0.4).tool
    found = diagnose_record(s.go(x, y, z - 0.05, speed=0.008).wait(rest).end())
    assert found.label is (Label.EARLY_HALT if rest >= 3 else Label.TIMEOUT)


def test_noise_around_zero_is_a_halt(stage):
    s, rng = stage("fast_food", "train1"), np.random.default_rng(0)
    for _ in range(1000):
        s.tool = s.tool + rng.normal(0.0, 0.0012, 3)
        s.tick()
    assert diagnose_record(s.end()).label is Label.EARLY_HALT


def test_one_pause_more_is_no_halt(stage):
    """It goes 3 cm, pauses for 3.5 s, and so on: the limit comes in a pause."""
    s = stage("fast_food", "train1")
    for k in range(8):
        s.go(0.35 + 0.04 * k, 0.0, 0.4).wait(3.5)
    assert diagnose_record(s.end()).label is Label.TIMEOUT
    assert diagnose_record(s.wait(4).end()).label is Label.EARLY_HALT


def test_a_halt_lasts_to_the_end(stage):
    s = stage("fast_food", "train1")
    x, y, _ = s.positions[s.at("first")]
    s.go(x, y, 0.4).wait(5).go(x, y + 0.3, 0.4).wait(5)
    found = diagnose_record(s.end())
    assert found.label is Label.EARLY_HALT
    assert found.evidence.start_s > 5.0, "the pause before is none"


# -- pushes ---------------------------------------------------------------------------------------------------------


def test_pushing_a_look_alike_is_a_choice(stage):
    s = stage("fast_food", "O1")
    found = diagnose_record(s.push(s.at("first"), 0.0, -0.12).home().end())
    assert found.label is Label.SEMANTIC_FEATURE_COLLAPSE
    assert "(pushed)" in found.evidence.text


def test_pushing_the_right_thing_is_a_failed_manipulation(stage):
    s = stage("morning_coffee", "L3")
    found = diagnose_record(s.push(s.of("red mug"), 0.0, 0.12).home().end())
    assert (found.label, found.evidence.rule) == (Label.EXECUTION_FAILURE, "pushed")
    assert "12 cm" in found.evidence.text


def test_what_is_pushed_out_of_the_way_is_an_accident(stage):
    s = stage("fast_food", "O1")
    s.push(s.at("first"), 0.0, -0.12)
    found = diagnose_record(s.bring(s.of("burger")).home().wait(4).end())
    assert found.label is Label.EXECUTION_FAILURE
    assert found.intention_correct


def test_what_slides_ahead_of_the_gripper_is_pushed(stage):
    """Contacts are seen at some of the rows only, and the first one after the thing has begun to move."""
    s = stage("fast_food", "O1")
    name = s.at("first")
    real, touches = s.state, {0: 0}

    def state():
        seen = real()
        touches[0] += 1
        finger = {"left_finger", "right_finger"}
        kept = tuple(c for c in seen.contacts if not finger & {c.a, c.b} or touches[0] % 7 == 0)
        return replace(seen, contacts=kept)

    s.state = state
    found = diagnose_record(s.close().push(name, 0.0, 0.14).home().wait(4).end())
    assert found.label is Label.SEMANTIC_FEATURE_COLLAPSE
    assert "pushed" in found.evidence.text


def shove(s, name, x, y):
    """Pushes an object with a fist, and the object rolls off aside."""
    s.push(name, x, y)
    s.positions[name] = s.positions[name] + np.array([y, -x, 0.0])
    return s.wait(0.3)


@pytest.mark.parametrize("shut", [False, True])
@pytest.mark.parametrize("rolls", [False, True])
def test_pushing_about_is_no_mere_way_to_and_fro(stage, rolls, shut):
    """Whatever way the thing takes: it is come to again and again."""
    for task, name, kind, label in (
        ("fast_food", "O1", "round block", Label.SEMANTIC_FEATURE_COLLAPSE),
        ("morning_coffee", "L3", "red mug", Label.EXECUTION_FAILURE),
    ):
        s = stage(task, name)
        if shut:
            s.close()
        for k in range(8):
            (shove if rolls else type(s).push)(s, s.of(kind), 0.0, 0.10 if k % 2 else -0.10)
        assert diagnose_record(s.end()).label is label


@pytest.mark.parametrize("shut", [False, True])
def test_shoving_the_right_thing_aside_twice_is_a_failed_manipulation(stage, shut):
    """The thing gives way each time, by less than a push; the rest is a way to and fro between the two."""
    s = stage("morning_coffee", "L3")
    if shut:
        s.close()
    for k in range(2):
        s.push(s.of("red mug"), 0.0, 0.06 if k else -0.06)
    x, y, _ = s.tool
    while s.step < s.task.step_limit(s.condition):
        s.go(x + 0.1, y, 0.25).go(x - 0.1, y, 0.25)
    found = diagnose_record(s.end())
    assert (found.label, found.evidence.rule) == (Label.EXECUTION_FAILURE, "pushed")
    assert "repeatedly" in found.evidence.text


@pytest.mark.parametrize("shut", [False, True])
def test_what_is_run_into_twice_was_not_gone_for(stage, shut):
    s = stage("fast_food", "O1")
    if shut:
        s.close()
    for k in range(2):
        shove(s, s.at("first"), 0.0, 0.05 if k else -0.05)
    assert diagnose_record(s.home().wait(8).end()).label is not Label.SEMANTIC_FEATURE_COLLAPSE


def test_a_short_push_is_none(stage):
    s = stage("morning_coffee", "L3")
    found = diagnose_record(s.push(s.of("blue mug"), 0.0, 0.04).home().wait(5).end())
    assert found.label is Label.EARLY_HALT


def test_what_is_taken_along_on_leaving_what_was_just_put_is_knocked_away(stage):
    s = stage("cheeseburger", "train1")
    name = s.at("second") if s.of("patty") == s.at("second") else s.of("patty")
    s.grasp(name).lift()
    x, y, z = s.goal_place()
    s.over(s.goal_place(), 0.30).go(x, y, z + 0.002 - s.grip_offset[2]).open(0.4)
    s.pushing = name
    for _ in range(8):
        s.tool = s.tool + np.array([0.015, 0.0, 0.0])
        s.positions[name] = s.positions[name] + np.array([0.015, 0.0, 0.0])
        s.tick()
    s.pushing = ""
    s.positions[name][2] = 0.0
    found = diagnose_record(s.lift().home().wait(5).end())
    assert (found.label, found.evidence.rule) == (Label.EXECUTION_FAILURE, "knocked_out_of_place")


def test_what_is_hit_with_a_thing_in_the_gripper_was_not_gone_for(stage):
    s = stage("fast_food", "O1")
    other = s.at("first")
    s.grasp(s.of("burger")).lift(0.004)
    start = s.positions[other][:2] - np.array([0.0, 0.08])
    s.go(*start, s.tool[2])
    s.pushing = other
    real = s.state
    s.state = lambda: replace(real(), held=None)  # dragged over the table, which counts as not held
    for _ in range(10):
        s.tool = s.tool + np.array([0.0, 0.014, 0.0])
        s.positions[other] = s.positions[other] + np.array([0.0, 0.014, 0.0])
        s.tick()
    s.pushing, s.state = "", real
    found = diagnose_record(s.lift().open().wait(5).end())
    assert found.label is Label.EXECUTION_FAILURE
    assert found.intention_correct


# -- coming and going, closing in part, fists -----------------------------------------------------------------------


def comes_and_goes(s, name, times):
    """Comes over an object with the open gripper and goes away again."""
    for _ in range(times):
        over(s, name).wait(0.4).go(*HOME_PLACE)
    return s


HOME_PLACE = (0.35, 0.0, 0.4)


def test_coming_over_the_right_thing_and_going_away_is_a_phase_conflict_in_a_half_finished_scene(stage):
    s = stage("fast_food", "T1")
    found = diagnose_record(comes_and_goes(s, s.of("burger"), 6).end())
    assert (found.label, found.evidence.rule) == (Label.PHASE_CONFLICT, "to_and_fro")
    assert "repeatedly" in found.evidence.text


def test_elsewhere_it_is_the_right_course(stage):
    s = stage("fast_food", "train1")
    assert diagnose_record(comes_and_goes(s, s.of("burger"), 6).end()).label is Label.TIMEOUT


def test_coming_back_once_is_no_conflict(stage):
    s = stage("fast_food", "T1")
    found = diagnose_record(tremble(over(comes_and_goes(s, s.of("burger"), 1), s.of("burger")), 6).end())
    assert found.label is Label.TIMEOUT


@pytest.mark.parametrize(("task", "name"), [("fast_food", "train1"), ("fast_food", "T1")])
def test_fingers_that_close_around_the_right_thing_without_touching_it_have_failed(stage, task, name):
    s = stage(task, name)
    burger = s.of("burger")
    for _ in range(3):
        s.over(s.positions[burger]).go(*s.grip_point(burger)).close(0.05).hold().wait(0.3).lift().open(0.3)
    found = diagnose_record(s.end())
    assert (found.label, found.evidence.rule) == (Label.EXECUTION_FAILURE, "closed_in_part")


def test_fingers_that_close_by_a_few_millimeters_around_a_wide_thing_have_failed(stage):
    s = stage("fast_food", "train1").hold()
    burger = s.of("burger")
    for _ in range(3):
        s.over(s.positions[burger]).go(*s.grip_point(burger)).wait(0.3)
        s.width = 0.076
        s.wait(0.3).lift()
        s.width = 0.08
    found = diagnose_record(s.end())
    assert (found.label, found.evidence.rule) == (Label.EXECUTION_FAILURE, "closed_in_part")


def test_fingers_that_are_brought_to_the_width_of_a_thing_above_it_have_not_failed(stage):
    s = stage("fast_food", "train1")
    burger = s.of("burger")
    over(s, burger).close(0.05).hold().wait(0.3)
    found = diagnose_record(tremble(s, 8).end())
    assert found.label is Label.TIMEOUT


def goes_through(s, name, act):
    """Comes down to an object again and again, does something there, and goes over the target."""
    while s.step < s.task.step_limit(s.condition) - 100:
        x, y, _ = s.grip_point(name)
        act(s.over(np.array([x, y])).go(x, y, s.size(name)[2] + 0.01, speed=0.2).wait(0.2))
        s.lift().over(s.goal_place(), 0.3).wait(0.2)
    return s


def stab(s, name, *, touches=True, rises=0.1):
    """Comes down so that a finger of the open gripper meets the top of an object, or stops short of it, and rises."""
    x, y, z = s.positions[name]
    top = z + s.size(name)[2]
    s.go(*s.tool[:2], max(s.tool[2], top)).go(x, y + 0.03, max(s.tool[2], top)).go(x, y + 0.03, top, speed=0.1)
    s.pushing = name if touches else ""
    s.wait(0.4)
    s.pushing = ""
    return s.lift(rises).wait(0.3)


@pytest.mark.parametrize("name", ["train1", "T1"])
@pytest.mark.parametrize("second", [False, True])
def test_an_open_gripper_that_runs_into_the_right_thing_again_and_again_has_failed(stage, name, second):
    s = stage("fast_food", name)
    if second:
        s.bring(s.of("burger"))
    thing = s.of("fries" if second else "burger")
    for _ in range(6):
        stab(s, thing)
    found = diagnose_record(s.end())
    assert (found.label, found.evidence.rule) == (Label.EXECUTION_FAILURE, "run_into")
    assert found.evidence.objects == (thing,)


@pytest.mark.parametrize(("times", "how"), [(6, {"touches": False}), (2, {}), (6, {"rises": 0.01})])
def test_who_does_not_run_into_the_right_thing_again_and_again_is_slow(stage, times, how):
    """It stops short of it, meets it twice, or stays at it and touches it now and then."""
    s = stage("fast_food", "train1")
    for _ in range(times):
        stab(s, s.of("burger"), **how)
    assert diagnose_record(tremble(s, 4).end()).label is Label.TIMEOUT


@pytest.mark.parametrize("name", ["train1", "T1"])
@pytest.mark.parametrize("opens", [False, True])
def test_fingers_that_are_shut_before_they_come_to_the_right_thing_have_failed(stage, name, opens):
    """They are never opened, or opened where they should close and closed where they should open."""
    s = stage("fast_food", name)
    act = (lambda s: s.open().lift().close()) if opens else (lambda s: s)
    found = diagnose_record(goes_through(s.close(), s.of("burger"), act).end())
    assert (found.label, found.evidence.rule) == (Label.EXECUTION_FAILURE, "comes_shut")


def test_a_shut_gripper_over_a_look_alike_has_chosen_it(stage):
    s = stage("fast_food", "O1")
    found = diagnose_record(goes_through(s.close(), s.at("first"), lambda s: s).end())
    assert found.label is Label.SEMANTIC_FEATURE_COLLAPSE


@pytest.mark.parametrize(("times", "label"), [(1, Label.TIMEOUT), (4, Label.EXECUTION_FAILURE)])
def test_a_gripper_that_closes_and_opens_again_and_again_is_not_about_to_lift(stage, times, label):
    s = stage("fast_food", "train1")
    s.grasp(s.of("burger"))
    for _ in range(times):
        s.open().close()
    assert diagnose_record(s.end()).label is label


@pytest.mark.parametrize(("times", "label"), [(1, Label.TIMEOUT), (4, Label.EXECUTION_FAILURE)])
def test_what_is_let_go_of_again_and_again_is_not_about_to_be_brought(stage, times, label):
    s = stage("fast_food", "train1")
    for _ in range(times):
        s.grasp(s.of("burger")).lift(0.05).open()
    assert diagnose_record(s.grasp(s.of("burger")).lift().end()).label is label


def test_a_fist_that_is_to_push_a_drawer_shut_grasps_at_nothing(stage):
    """Beside the other drawer, and with the right one drawn out far."""
    s = stage("office_drawer", "train1")
    goals = s.condition.instruction.subgoals
    shut = next(k for k, g in enumerate(goals) if g.relation == "closed")
    for k in range(shut):
        s.serve(k)
    other = next(d for d in s.rails if d != s.condition.resolve(goals[shut].reference)[0])
    x, y, z = s.grip_point(other)
    before = s.step / 20.0
    s.over(s.grip_point(other), 0.3).go(x, y - 0.03, z).close().lift().go(0.4, -0.2, 0.1)
    found = diagnose_record(s.end())
    assert found.label in (Label.TIMEOUT, Label.EARLY_HALT, Label.EXECUTION_FAILURE)
    assert [a for a in found.attempts if a.start_s > before] == []


def fist(s):
    """Serves all but the closing of the drawer, and makes a fist in front of it; returns the drawer."""
    goals = s.condition.instruction.subgoals
    shut = next(k for k, g in enumerate(goals) if g.relation == "closed")
    for k in range(shut):
        s.serve(k)
    drawer = s.condition.resolve(goals[shut].reference)[0]
    x, y, z = s.grip_point(drawer)
    s.over(np.array([x, y, z]), 0.3).go(x - 0.1, y - 0.1, 0.06).close()
    return drawer


def test_a_fist_that_leaves_the_drawer_open_has_failed_at_execution(stage):
    s = stage("office_drawer", "train1")
    drawer = fist(s)
    x, y, z = s.grip_point(drawer)
    found = diagnose_record(s.go(x - 0.05, y - 0.05, z).wait(1.0).open().go(0.4, -0.2, 0.3).wander(20).end())
    assert (found.label, found.evidence.rule) == (Label.EXECUTION_FAILURE, "drawer_left_halfway")


@pytest.mark.parametrize("moves", [True, False])
def test_a_fist_under_which_the_drawer_still_moves_at_the_limit_ran_out_of_time(stage, moves):
    s = stage("office_drawer", "train1")
    drawer = fist(s)
    shut, out = s.rails[drawer]
    left = s.task.step_limit(s.condition) - s.step
    for k in range(left):
        s.tool = np.array([0.35 + 0.02 * np.sin(0.5 * k), 0.02 * np.cos(0.5 * k), 0.1])
        s.positions[drawer] = shut + (0.15 - 0.12 * k / left * moves) * out
        s.tick()
    found = diagnose_record(s.end())
    assert found.label is (Label.TIMEOUT if moves else Label.EXECUTION_FAILURE)


def shut(s, *, with_fist=True):
    """Pushes the drawer shut that the first step is to fill, and returns its name."""
    drawer = s.condition.instruction.subgoals[0].target
    home, out = s.rails[drawer]
    if with_fist:
        s.close()
    s.over(s.grip_point(drawer), 0.3).go(*(s.grip_point(drawer) + 0.03 * out))
    s.pushing, way = drawer, (home - s.positions[drawer]) / 30
    moved = [drawer, *(n for n in s.movable() if s.support(n)[1] == drawer)]
    for _ in range(30):
        for name in moved:
            s.positions[name] = s.positions[name] + way
        s.tool = s.tool + way
        s.tick()
    s.pushing = ""
    return drawer


@pytest.mark.parametrize("with_fist", [True, False])
def test_a_drawer_that_is_shut_empty_for_good_is_a_skipped_step(stage, with_fist):
    s = stage("office_drawer", "train2")
    drawer = shut(s, with_fist=with_fist)
    found = diagnose_record(s.home().wait(8).end())
    assert (found.label, found.evidence.rule) == (Label.CAUSAL_CONFUSION, "required_step_skipped")
    assert found.evidence.objects == (drawer,)
    assert "shuts" in found.evidence.text


@pytest.mark.parametrize("then", ["draws it out again", "takes the thing", "goes on"])
def test_a_drawer_that_an_open_gripper_runs_into_is_no_skipped_step(stage, then):
    s = stage("office_drawer", "train2")
    drawer = shut(s, with_fist=False)
    if then == "draws it out again":
        s.home().draw(drawer, 0.15).home()
    elif then == "takes the thing":
        s.home().grasp(s.condition.resolve(s.condition.instruction.subgoals[0].reference)[0]).lift()
    else:
        s.go(0.4, -0.2, 0.4, speed=0.02)
    assert diagnose_record(s.end()).label is not Label.CAUSAL_CONFUSION


@pytest.mark.parametrize("lets_go", [True, False])
def test_a_drawer_that_a_fist_shuts_empty_is_a_skipped_step_although_the_thing_is_brought_then(stage, lets_go):
    s = stage("office_drawer", "train2")
    thing = s.condition.resolve(s.condition.instruction.subgoals[0].reference)[0]
    drawer = shut(s)
    s.home().open().grasp(thing).lift().over(s.grip_point(drawer), 0.3)
    found = diagnose_record((s.open().home() if lets_go else s).wait(8).end())
    assert (found.label, found.evidence.rule) == (Label.CAUSAL_CONFUSION, "required_step_skipped")
    assert "before" in found.evidence.text


def test_a_drawer_that_a_fist_shuts_after_the_thing_was_missed_is_no_skipped_step(stage):
    s = stage("office_drawer", "train2")
    thing = s.condition.resolve(s.condition.instruction.subgoals[0].reference)[0]
    s.grasp(thing).open().lift()
    shut(s)
    found = diagnose_record(s.home().open().grasp(thing).lift().home().wait(8).end())
    assert found.label is not Label.CAUSAL_CONFUSION


def test_a_drawer_that_is_shut_after_it_was_filled_is_no_skipped_step(stage):
    s = stage("office_drawer", "train2")
    s.serve(0)
    shut(s)
    assert diagnose_record(s.home().wait(8).end()).label is not Label.CAUSAL_CONFUSION


# -- misses ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("beside", "above"), [(0.09, 0.0), (0.11, 0.0), (0.0, 0.09)])
def test_a_gripper_that_shuts_far_from_everything_missed_and_shows_no_reasoning(stage, beside, above):
    s = stage("morning_coffee", "L3")
    x, y, z = s.positions[s.of("red mug")]
    height = z + (s.size(s.of("red mug"))[2] + above if above else 0.04)
    x = x - 0.04 - beside if beside else x
    s.over(np.array([x, y, 0.0])).go(x, y, height).close().open().home().wait(5)
    found = diagnose_record(s.end())
    assert (found.label, found.evidence.rule) == (Label.EXECUTION_FAILURE, "missed_by_far")
    assert [(a.result, a.object) for a in found.attempts] == [("null", None)]
    assert "cm from the" in found.evidence.text
    assert "the instruction asks for" in found.evidence.text


def test_fingers_that_close_when_the_limit_comes_have_missed_nothing(stage):
    s = stage("fast_food", "train1")
    x, y, _ = s.positions[s.at("first")]
    found = diagnose_record(s.over(np.array([x, y, 0.0])).go(x - 0.1, y, 0.03).close(0.35).end())
    assert found.label is Label.TIMEOUT


def test_a_far_miss_that_a_wrong_grasp_follows_does_not_hide_it(stage):
    s = stage("fast_food", "O1")
    x, y, _ = s.positions[s.at("first")]
    s.over(np.array([x - 0.13, y, 0.0])).go(x - 0.13, y, 0.03).close().open()
    found = diagnose_record(s.bring(s.at("first")).wait(5).end())
    assert found.label is Label.SEMANTIC_FEATURE_COLLAPSE


def test_a_miss_that_was_made_good_does_not_decide(stage):
    """The retry took the thing and holds it at the limit: there was no time left."""
    s = stage("fast_food", "train1")
    name = s.at("first")
    s.grasp(name, beside=(0.052, 0.0)).lift().open()
    found = diagnose_record(s.grasp(name).lift().wait(1).end())
    assert found.label is Label.TIMEOUT
    assert "in the gripper" in found.evidence.text


def test_a_goal_that_is_met_right_before_the_limit_ran_out_of_time(stage):
    s = stage("fast_food", "train1")
    s.bring(s.at("first")).bring(s.of("fries"))
    while not s.builder._truths[-1][2]:
        s.tick()
    found = diagnose_record(s.tick() or s.end(termination="step_limit"))
    assert not found.success
    assert found.label is Label.TIMEOUT


# -- what an evidence says ------------------------------------------------------------------------------------------


def miss(s):
    return s.grasp(s.at("first"), beside=(0.052, 0.0)).lift().open().wait(5)


def drop(s):
    return s.grasp(s.at("first")).lift(0.3).open().home().wait(4)


@pytest.mark.parametrize(
    ("task", "name", "act"),
    [
        ("fast_food", "train1", miss),
        ("fast_food", "train1", drop),
        ("fast_food", "train1", lambda s: s.go(0.5, 0.0, 0.15).close().open()),
        ("fast_food", "train1", lambda s: s.wait(6)),
        ("fast_food", "train1", lambda s: s.go(0.5, 0.0, 0.4, speed=0.05)),
        ("fast_food", "train1", lambda s: s.wander(10)),
        ("fast_food", "O1", lambda s: s.bring(s.at("first"))),
        ("fast_food", "O1", lambda s: over(s, s.at("first")).wait(6)),
        ("fast_food", "R1", lambda s: s.bring(s.at("first"))),
        ("fast_food", "T1", lambda s: s.air_grasp("second").wait(4)),
        ("morning_coffee", "L3", lambda s: s.bring(s.of("blue mug"))),
        ("morning_coffee", "L3", lambda s: s.push(s.of("red mug"), 0.0, 0.12)),
        ("morning_coffee", "T1", lambda s: s.grasp(s.of("red mug")).lift()),
        ("cheeseburger", "train1", lambda s: s.bring(s.of("cheese"), s.goal(0))),
    ],
)
def test_every_evidence_names_time_place_and_what_was_asked(stage, task, name, act):
    s = stage(task, name)
    found = diagnose_record(act(s).end())
    text = found.evidence.text
    assert not found.success
    assert f" Time: {found.evidence.start_s:.1f} s" in text, text
    assert "next step: " in text or "steps left: " in text or "the instruction asks for" in text, text
    for thing in found.evidence.objects:
        assert s.info.object(thing).kind in text, text
    if found.evidence.objects:
        assert "slot '" in text or " cm" in text or "location: the " in text, text


# -- grippers that never close, or never open ------------------------------------------------------------------------


def _come_to(s, name):
    """Goes down to an object with an open gripper, again and again, until the limit."""
    for _ in range(6):
        s.over(s.grip_point(name), 0.1).go(*s.grip_point(name)).wait(2.5)
    return diagnose_record(s.end(termination="step_limit"))


def _keep(s, name):
    """Brings an object to its place and does not let go of it."""
    s.grasp(name).lift()
    place = s.goal(0) - s.grip_offset
    s.over(place, 0.3).go(*place[:2], place[2] + 0.01).wait(3.0)
    for _ in range(12):
        s.over(place, 0.3).wander(2.0)
    return diagnose_record(s.end(termination="step_limit"))


def _asked(s):
    return s.condition.resolve(s.condition.instruction.subgoals[0].reference)[0]


@pytest.mark.parametrize("task", others_slow(["morning_coffee", "fast_food", "desk_meeting"], 3))
def test_a_gripper_that_never_closes_is_said_not_to(stage, task):
    s = stage(task, "train1")
    found = _come_to(s, _asked(s))
    assert (found.label, found.evidence.rule) == (Label.TIMEOUT, "never_closes")
    assert "never closed" in found.evidence.text
    assert MODES[Label.TIMEOUT].conclude([found]).endswith("its gripper never closes on them.")


@pytest.mark.parametrize("task", others_slow(["morning_coffee", "fast_food", "desk_meeting", "dinner_plates"], 4))
def test_a_gripper_that_never_opens_is_said_not_to(stage, task):
    s = stage(task, "train1")
    found = _keep(s, _asked(s))
    assert (found.label, found.evidence.rule) == (Label.TIMEOUT, "never_opens")
    assert "never opened" in found.evidence.text
    assert MODES[Label.TIMEOUT].conclude([found]).endswith("its gripper never opens there.")


def test_who_is_slow_on_the_way_has_a_gripper_that_works(stage):
    s = stage("fast_food", "train1")
    s.grasp(_asked(s)).lift().over(s.goal(0), 0.3)
    found = diagnose_record(s.end(termination="step_limit"))
    assert (found.label, found.evidence.rule) == (Label.TIMEOUT, "step_limit")
    assert "with the burger in the gripper" in found.evidence.text


def test_who_has_closed_once_is_not_said_never_to_close(stage):
    s = stage("morning_coffee", "train1")
    s.close().open()
    found = _come_to(s, _asked(s))
    assert found.evidence.rule != "never_closes"


# -- coming to the right thing again and again, and never taking it ---------------------------------------------------


def _next_due(s):
    """The object of the first step that is still to be done."""
    k = next(k for k, done in enumerate(s.done) if not done)
    return s.condition.resolve(s.condition.instruction.subgoals[k].reference)[0]


def _visit(s, name, *, above=0.0, wait=0.6, times=6):
    """Comes to where an object is grasped, or above it, with the fingers as they are, and goes far away again."""
    for _ in range(times):
        x, y, z = s.grip_point(name)
        s.over(np.array([x, y]), 0.3).go(x, y, z + above).wait(wait).lift(0.3).go(0.45, 0.0, 0.45)
    return s


MID_TASK = [("dinner_plates", "T2"), ("fast_food", "T1"), ("cheeseburger", "T1"), ("fruit_lunch", "T1")]
COMES_AGAIN = [("dinner_plates", "train1"), ("breakfast_table", "train1"), *MID_TASK]


@pytest.mark.parametrize("wait", [0.1, 0.6, 2.0])
@pytest.mark.parametrize(("task", "name"), others_slow(COMES_AGAIN, 3))
def test_a_gripper_that_comes_to_the_right_thing_again_and_again_never_closes(stage, task, name, wait):
    """Also at the rim of a plate, and in a scene that looks half finished: it knows what to take."""
    s = stage(task, name)
    found = diagnose_record(_visit(s, _next_due(s), wait=wait).end())
    assert (found.label, found.kind, found.evidence.rule) == (Label.TIMEOUT, Kind.EXECUTION, "never_closes")


@pytest.mark.parametrize(
    ("task", "name"), [("desk_meeting", "train1"), ("fruit_lunch", "train1"), ("fast_food", "train1")]
)
def test_an_open_gripper_that_trembles_around_the_right_object_has_not_halted(stage, task, name):
    s = stage(task, name)
    x, y, z = s.grip_point(_next_due(s))
    s.over(np.array([x, y]), 0.3).go(x, y, z)
    for noise in np.random.default_rng(0).normal(0.0, 0.0012, (600, 3)).tolist():
        s.go(x + noise[0], y + noise[1], z + noise[2])
    found = diagnose_record(s.end(termination="step_limit"))
    assert (found.label, found.evidence.rule) == (Label.TIMEOUT, "never_closes")


@pytest.mark.parametrize(("task", "name"), [("desk_meeting", "train1"), ("fast_food", "train1")])
def test_an_open_gripper_that_stands_still_at_the_right_object_has_halted(stage, task, name):
    s = stage(task, name)
    x, y, z = s.grip_point(_next_due(s))
    found = diagnose_record(s.over(np.array([x, y]), 0.3).go(x, y, z).wait(15.0).end(termination="step_limit"))
    assert found.label is Label.EARLY_HALT


@pytest.mark.parametrize(("task", "name"), others_slow([("dinner_plates", "train1"), *MID_TASK], 3))
def test_a_gripper_that_closed_once_by_accident_does_not_close_on_the_right_thing(stage, task, name):
    s = stage(task, name)
    s.close(0.5).open(0.5)
    found = diagnose_record(_visit(s, _next_due(s)).end())
    assert (found.label, found.evidence.rule) == (Label.TIMEOUT, "does_not_close")
    assert MODES[Label.TIMEOUT].conclude([found]).endswith("its gripper does not close on them.")


def test_a_gripper_that_does_one_step_and_does_not_close_for_the_next_is_said_not_to(stage):
    s = stage("fast_food", "train1")
    s.serve(0)
    found = diagnose_record(_visit(s, s.of("fries")).end())
    assert (found.label, found.evidence.rule) == (Label.TIMEOUT, "does_not_close")
    assert "came down to the fries" in found.evidence.text


@pytest.mark.parametrize(("task", "name"), others_slow([("morning_coffee", "train1"), *MID_TASK[1:]], 2))
def test_coming_down_to_something_else_as_often_is_no_proof_that_it_never_closes(stage, task, name):
    s = stage(task, name)
    due = _next_due(s)
    goals = s.condition.instruction.subgoals
    asked = {due, *(g.target for g in goals), *(n for g in goals for n in s.condition.resolve(g.reference))}
    other = next(o.name for o in s.info.objects if o.slot and not o.fixed and o.name not in asked)
    for _ in range(4):
        _visit(s, due, times=1)
        _visit(s, other, times=1)
    assert diagnose_record(s.end()).evidence.rule != "never_closes"


@pytest.mark.parametrize("wait", [0.6, 2.0])
@pytest.mark.parametrize(("task", "name"), [("dinner_plates", "train1"), ("fast_food", "train1")])
def test_a_gripper_that_hovers_over_the_right_thing_does_not_come_down(stage, task, name, wait):
    s = stage(task, name)
    found = diagnose_record(_visit(s, _next_due(s), above=0.08, wait=wait).end())
    assert (found.label, found.evidence.rule) == (Label.TIMEOUT, "never_descends")
    assert "does not come down to it" in found.evidence.text
    assert MODES[Label.TIMEOUT].conclude([found]).endswith("does not come down to them.")


def test_who_comes_down_slowly_is_not_said_to_stay_above(stage):
    s = stage("morning_coffee", "train1")
    x, y, z = s.positions[s.of("red mug")]
    top = z + s.size(s.of("red mug"))[2]
    found = diagnose_record(s.over(np.array([x, y]), top + 0.12).go(x, y, top + 0.03, speed=0.015).end())
    assert (found.label, found.evidence.rule) == (Label.TIMEOUT, "step_limit")


@pytest.mark.parametrize(
    ("task", "name"), others_slow([("fast_food", "train1"), ("fast_food", "T1"), ("dinner_plates", "train1")], 3)
)
@pytest.mark.parametrize("holds", [True, False])
def test_fingers_that_never_open_after_one_grasp_have_failed(stage, task, name, holds):
    """They lose the thing and come back to it shut, or keep it to the end."""
    s = stage(task, name)
    due = _next_due(s)
    s.grasp(due).lift()
    if holds:
        s.over(s.goal(next(k for k, d in enumerate(s.done) if not d)) - s.grip_offset, 0.3).wander(9.0)
    else:
        s.lose().lift()
        _visit(s, due, above=0.02)
    found = diagnose_record(s.end())
    assert found.kind is Kind.EXECUTION
