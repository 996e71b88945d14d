"""A gripper that does not let go of the right thing at its place, and stays over look-alikes that prove no choice."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.daily import others_slow

from betterbench.diagnosis import Kind, Label, diagnose_record
from betterbench.geometry import Pose, from_yaw

NEVER = (Label.TIMEOUT, Kind.EXECUTION, "never_opens")


def asked(s):
    return s.condition.resolve(s.condition.instruction.subgoals[0].reference)[0]


def bring_over(s, *, above=0.03, beside=(0.0, 0.0)):
    """Takes the right thing, brings it over its place, or beside it, and keeps it in the gripper."""
    s.grasp(asked(s)).lift()
    x, y, z = s.goal(0) - s.grip_offset
    x, y = x + beside[0], y + beside[1]
    return s.over(np.array([x, y]), 0.3).go(x, y, z + above)


def jerk(s, seconds, *, every=1.8, by=0.012):
    """Stands where it is, and jerks up and back now and then."""
    x, y, z = s.tool
    for k in range(round(seconds * 20)):
        s.tool = np.array([x, y, z + by * (k % round(every * 20) in (1, 2))])
        s.tick()
    return s


def tremble(s, seconds, *, by=0.005):
    x, y, z = s.tool
    for k in range(round(seconds * 20)):
        s.tool = np.array([x + by * np.sin(0.9 * k), y + by * np.cos(0.9 * k), z])
        s.tick()
    return s


TASKS = ["morning_coffee", "fast_food", "desk_meeting", "dinner_plates", "fruit_lunch", "tidy_desk"]


@pytest.mark.parametrize("moves", [jerk, tremble])
@pytest.mark.parametrize("task", others_slow(TASKS, 3))
def test_small_movements_at_the_place_with_the_right_thing_in_the_gripper_are_no_halt(stage, task, moves):
    s = bring_over(stage(task, "train1"))
    found = diagnose_record(moves(s, 15).end())
    assert (found.label, found.kind, found.evidence.rule) == NEVER
    assert s.info.object(asked(s)).kind in found.evidence.text


@pytest.mark.parametrize("task", TASKS)
def test_standing_still_with_the_thing_in_the_gripper_is_a_halt_that_says_so(stage, task):
    s = bring_over(stage(task, "train1"))
    found = diagnose_record(s.wait(15).end())
    assert (found.label, found.evidence.rule) == (Label.EARLY_HALT, "still_with_open_subgoals")
    assert f"with the {s.info.object(asked(s)).kind} in the gripper" in found.evidence.text


def test_coming_to_rest_after_small_movements_is_a_halt(stage):
    s = bring_over(stage("morning_coffee", "train1"))
    found = diagnose_record(jerk(s, 8).wait(8).end())
    assert found.label is Label.EARLY_HALT
    assert "with the red mug in the gripper" in found.evidence.text


@pytest.mark.parametrize("moves", [jerk, tremble])
def test_small_movements_elsewhere_are_a_halt_that_says_what_is_held(stage, moves):
    s = stage("morning_coffee", "train1")
    s.grasp(asked(s)).lift(0.25)
    found = diagnose_record(moves(s, 15).end())
    assert found.label is Label.EARLY_HALT
    assert "with the red mug in the gripper" in found.evidence.text


def test_small_movements_with_nothing_in_the_gripper_are_a_halt_still(stage):
    s = stage("fast_food", "train1")
    s.bring(s.at("first")).home()
    found = diagnose_record(jerk(s, 15).end())
    assert found.label is Label.EARLY_HALT
    assert "in the gripper" not in found.evidence.text


@pytest.mark.parametrize(
    ("task", "off", "kept"),
    [
        ("fruit_lunch", (0.054, 0.09), True),
        ("fruit_lunch", (0.054, 0.15), False),
        ("fast_food", (0.08, 0.0), True),
        ("fast_food", (0.0, 0.09), False),
        ("dinner_plates", (0.0, 0.07), True),
        ("morning_coffee", (0.12, 0.07), False),
    ],
)
def test_a_wide_place_reaches_up_to_its_edge(stage, task, off, kept):
    """Over the lunchbox, for instance, 9 cm from the middle of its inside."""
    s = bring_over(stage(task, "train1"), above=0.2)
    target = s.condition.instruction.subgoals[0].target
    frame = Pose(tuple(s.positions[target]), from_yaw(s.yaws[target]))
    way = np.array(frame.apply((*off, 0.0))) - s.positions[asked(s)]
    s.go(*(s.tool[:2] + way[:2]), s.tool[2])
    found = diagnose_record(jerk(s, 15).end())
    assert (found.label is Label.TIMEOUT) is kept
    assert found.evidence.rule == ("never_opens" if kept else "still_with_open_subgoals")


def test_contacts_that_tremble_let_go_of_nothing(stage):
    s = stage("morning_coffee", "train1")
    real = s.state

    def state():
        seen = real()
        return replace(seen, held=None, contacts=()) if s.step % 25 == 0 else seen

    s.state = state
    found = diagnose_record(jerk(bring_over(s), 15).end())
    assert (found.label, found.kind, found.evidence.rule) == NEVER


def test_what_stands_at_its_place_between_the_fingers_is_not_let_go(stage):
    s = bring_over(stage("morning_coffee", "train1"), above=0.0)
    found = diagnose_record(jerk(s, 15, by=0.001).end())
    assert (found.label, found.kind, found.evidence.rule) == NEVER


def test_a_gripper_that_still_sinks_toward_the_place_is_slow_and_not_said_never_to_open(stage):
    s = bring_over(stage("fast_food", "train1"), above=0.15)
    x, y, z = s.tool
    found = diagnose_record(s.go(x, y, z - 0.14, speed=0.02).end())
    assert (found.label, found.evidence.rule) == (Label.TIMEOUT, "step_limit")
    assert "with the burger in the gripper" in found.evidence.text


def swing(s, times, *, at=(0.3, 0.3), above=0.10, first="right"):
    """Goes to and fro between the right mug and the can that looks like it."""
    names = [s.of("red mug"), s.at_look]
    names = names if first == "right" else names[::-1]
    for _ in range(times):
        for name in names:
            x, y, _ = s.positions[name]
            s.go(x, y, s.size(s.at_look)[2] + above).wait(at[name == s.at_look])
    return s


def coffee(stage):
    s = stage("morning_coffee", "O1")
    s.at_look = next(o.name for o in s.info.objects if o.category == "can")
    s.over(s.positions[s.at_look], 0.3)
    return s


@pytest.mark.parametrize("above", [0.05, 0.10, 0.115])
@pytest.mark.parametrize("first", ["right", "wrong"])
def test_to_and_fro_between_the_right_thing_and_a_taller_look_alike_chooses_neither(stage, first, above):
    """The look-alike is taller: the gripper comes over it where it is not over the right thing yet."""
    found = diagnose_record(swing(coffee(stage), 12, above=above, first=first).end())
    assert (found.label, found.evidence.rule) == (Label.PHASE_CONFLICT, "to_and_fro")


def test_coming_over_the_right_thing_as_often_but_for_less_time_chooses_nothing(stage):
    found = diagnose_record(swing(coffee(stage), 12, at=(0.4, 1.4)).end())
    assert found.label is not Label.SEMANTIC_FEATURE_COLLAPSE


@pytest.mark.parametrize("times", [0, 1, 2])
def test_staying_over_a_look_alike_is_still_a_choice_although_it_came_over_the_right_thing_before(stage, times):
    s = coffee(stage)
    swing(s, times)
    x, y, _ = s.positions[s.at_look]
    found = diagnose_record(tremble(s.go(x, y, s.size(s.at_look)[2] + 0.1), 14, by=0.015).end())
    assert found.label is Label.SEMANTIC_FEATURE_COLLAPSE
    assert found.evidence.objects == (s.at_look,)


@pytest.mark.parametrize("task", ["morning_coffee", "fast_food", "fruit_lunch", "tidy_desk"])
def test_a_thing_that_jams_on_the_open_fingers_is_a_failed_release_and_no_halt(stage, task):
    """The policy opened its gripper and went home: it has done its part, and its manipulation failed."""
    s = stage(task, "train1")
    s.jams = True
    s.grasp(asked(s)).lift().over(s.goal(0) - s.grip_offset, 0.3)
    found = diagnose_record(s.open().lift(0.05).wait(15).end())
    assert (found.label, found.kind) == (Label.EXECUTION_FAILURE, Kind.EXECUTION)
    assert found.evidence.rule == "stuck_on_fingers"
    assert "stays on its open fingers" in found.evidence.text
