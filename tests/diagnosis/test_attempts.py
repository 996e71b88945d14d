"""What is one grasp attempt, and what is none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.daily import others_slow

from betterbench.diagnosis import diagnose_record
from betterbench.diagnosis.analysis.trace import trace_of
from betterbench.tasks.interventions.resolve import resolve_condition
from betterbench.tasks.judging.motion import Motion, closing_of, tool_distances
from betterbench.tasks.judging.restraint import first_hover, hovered_over
from betterbench.tasks.labels import Label
from betterbench.tasks.thresholds import HOVER_TIME


def test_closing_at_home_is_no_attempt(stage):
    assert diagnose_record(stage("fast_food", "train1").close().open().wait(1).end()).attempts == ()


def test_closing_far_from_everything_is_shown_and_chooses_nothing(stage):
    found = diagnose_record(stage("fast_food", "train1").go(0.5, 0.0, 0.15).close().open().end())
    assert [(a.result, a.object, a.slot, a.secured) for a in found.attempts] == [("null", None, None, False)]
    assert (found.first_attempt, found.first_slot) == (None, None)
    assert diagnose_record(stage("fast_food", "train1").go(0.42, -0.3, 0.3).close().open().end()).attempts == ()


def test_a_command_that_the_fingers_do_not_follow_is_no_attempt(stage):
    s = stage("fast_food", "T1").go(0.4, 0.0, 0.4).close()
    place = s.slot("second")
    s.go(*place[:2], 0.3).go(*place[:2], 0.05)
    real = s.state
    s.state = lambda: replace(real(), gripper_command=-1.0)  # asked to open for a second, and jammed
    s.wait(1.0)
    s.state = real
    assert diagnose_record(s.wait(1.0).end()).attempts == ()


def test_fingers_that_are_held_half_open_have_not_closed_yet(stage):
    s = stage("seasoning_rack", "train1")
    names = sorted(s.movable(), key=s.grip_width)
    near, narrow = names[-1], names[0]
    s.over(s.positions[near]).go(*s.positions[near][:2], 0.12).close(0.15).hold().wait(1.0)
    s.over(s.grip_point(narrow)).go(*s.grip_point(narrow)).close().hold().lift()
    found = diagnose_record(s.end())
    assert [(a.object, a.secured) for a in found.attempts] == [(narrow, True)]


def test_a_held_object_stays_held_without_a_command(stage):
    s = stage("fast_food", "train1")
    s.grasp(s.at("first")).hold().lift().wait(1.0).close().hold().wait(1.0)
    assert [a.object for a in diagnose_record(s.end()).attempts] == [s.at("first")]


def test_chatter_is_one_attempt(stage):
    s = stage("fast_food", "train1")
    name = s.at("first")
    s.over(s.positions[name]).go(*s.positions[name][:2], 0.03)
    for _ in range(4):
        s.close(0.1).open(0.1)
    assert len(diagnose_record(s.close().lift().end()).attempts) == 1


def test_closing_again_on_a_held_object_is_no_new_attempt(stage):
    s = stage("fast_food", "train1")
    s.grasp(s.at("first")).lift()
    keep = s.tick
    width = s.width

    def tick_without_letting_go():
        s.command, asked = 1.0, s.command  # a gripper too slow to follow a short wish to open
        s.width = width + (0.004 if asked < 0 else 0.0)
        s.asked = asked
        keep()

    s.tick, s.asked = tick_without_letting_go, -1.0
    real = s.state
    s.state = lambda: replace(real(), gripper_command=s.asked)
    s.command = -1.0
    for _ in range(8):
        s.command = -1.0
        s.tick()
    for _ in range(8):
        s.command = 1.0
        s.tick()
    s.tick, s.state = keep, real
    found = diagnose_record(s.carry(s.goal_place()).bring(s.of("fries")).wait(1).end())
    assert len(found.attempts) == 2
    assert found.success


def test_a_command_of_zero_keeps_the_last_one(stage):
    s = stage("fast_food", "train1")
    name = s.at("first")
    s.over(s.positions[name]).go(*s.positions[name][:2], 0.03)
    s.close(0.05)
    real = s.state
    s.state = lambda: replace(real(), gripper_command=0.0)  # one short command, and the fingers keep closing
    s.wait(0.6).lift()
    s.state = real
    found = diagnose_record(s.close(0.05).carry(s.goal_place()).bring(s.of("fries")).wait(1).end())
    assert [(a.object, a.secured) for a in found.attempts] == [(name, True), (s.of("fries"), True)]


def test_an_attempt_without_a_lift_is_not_secured(stage):
    s = stage("fast_food", "train1")
    name = s.at("first")
    attempt = diagnose_record(s.grasp(name).open().lift().wait(1).end()).attempts[0]
    assert (attempt.object, attempt.result, attempt.secured) == (name, "target", False)


def test_an_attempt_lies_within_its_window(stage):
    s = stage("fast_food", "train1")
    attempt = diagnose_record(s.bring(s.at("first")).end()).attempts[0]
    assert 0.0 < attempt.end_s - attempt.start_s <= 1.0


def test_a_retry_is_a_second_attempt(stage):
    s = stage("fast_food", "train1")
    name = s.at("first")
    s.grasp(name, beside=(0.052, 0.0)).open().bring(name).bring(s.of("fries")).wait(1)
    found = diagnose_record(s.end())
    assert [a.result for a in found.attempts] == ["null", "target", "target"]
    assert found.success


def test_closing_high_above_an_object_is_no_attempt(stage):
    s = stage("fast_food", "train1")
    place = np.array([*s.positions[s.at("first")][:2], 0.12])
    found = diagnose_record(s.over(place).go(*place).close().open().end())
    assert [a.object for a in found.attempts] in ([], [None])
    assert all(a.result == "null" for a in found.attempts)


def commanded(s, told):
    """Has the gripper told something else at each step than what its motion asks for, unless ``told`` is None."""
    tick = s.tick

    def change():
        command = s.command
        s.command = told(s)
        tick()
        s.command = command

    if told is not None:
        s.tick = change
    return s


@pytest.mark.parametrize("every", [2, 3, 4, 7])
@pytest.mark.parametrize(
    ("task", "name", "kind"), others_slow([("fast_food", "O1", "round block"), ("fruit_lunch", "O1", "red block")], 2)
)
def test_an_open_gripper_that_flickers_hides_no_attempt(stage, task, name, kind, every):
    """A closing command in between, one control step long, moves the fingers by a few millimeters and means nothing."""

    def flicker(s):
        return 1.0 if s.command < 0.0 and s.grip is None and s.step % every == 0 else s.command

    found = []
    for told in (None, flicker):
        s = commanded(stage(task, name), told)
        s.grasp(s.of(kind)).lift().wait(0.5).open().home()
        found.append(diagnose_record(s.wait(1.0).end()))
    steady, flickering = found
    assert [a.object for a in flickering.attempts] == [a.object for a in steady.attempts]
    assert flickering.label is steady.label is Label.SEMANTIC_FEATURE_COLLAPSE
    assert flickering.intention_correct is steady.intention_correct is False


@pytest.mark.parametrize("seconds", [0.05, 0.10, 0.20])
def test_a_closing_that_is_taken_back_on_the_way_is_no_attempt_at_a_slot(stage, seconds):
    s = stage("fast_food", "T1")
    slot = s.slot("second")
    s.over(slot).go(*slot[:2], 0.12).close(seconds).open().home()
    assert diagnose_record(s.end()).attempts == ()


def test_an_attempt_that_chatter_precedes_is_the_one_that_got_hold_of_something(stage):
    s = stage("fast_food", "train1")
    name = s.at("first")
    s.over(s.positions[name])
    for _ in range(8):
        s.close(0.15).open(0.15)
    s.go(*s.positions[name][:2], 0.03)
    for _ in range(4):
        s.close(0.15).open(0.15)
    attempts = diagnose_record(s.close().lift().end()).attempts
    assert [(a.object, a.secured) for a in attempts] == [(name, True)]


PULSES = {
    "one zero": (1, 1, 1, 0),
    "every other zero": (1, 0),
    "two of three": (1, 1, -1),
    "mostly zero": (1, 0, 0, 0, 0, 0),
}


@pytest.mark.parametrize("pulses", PULSES.values(), ids=PULSES)
@pytest.mark.parametrize(
    ("task", "name", "kind"), [("fast_food", "O1", "round block"), ("seasoning_rack", "O1", "pill bottle")]
)
def test_however_a_gripper_is_told_to_close_what_it_lifts_was_attempted(stage, task, name, kind, pulses):
    def pulse(s):
        if s.command <= 0.0:
            return s.command
        return 0.0 if s.grip is not None and s.step % 3 else float(pulses[s.step % len(pulses)])

    found = []
    for told in (None, pulse):
        s = commanded(stage(task, name), told)
        s.over(s.grip_point(s.of(kind))).go(*s.grip_point(s.of(kind))).close(4.0).lift().wait(0.5).open().home()
        found.append(diagnose_record(s.wait(1.0).end()))
    steady, pulsing = found
    assert [(a.object, a.slot, a.secured) for a in pulsing.attempts] == [
        (a.object, a.slot, a.secured) for a in steady.attempts
    ]
    assert steady.attempts
    assert pulsing.label is steady.label
    assert pulsing.intention_correct is steady.intention_correct


def test_clean_commands_are_told_as_they_are_and_flicker_is_not():
    width, free = np.full(60, 0.05), np.zeros(60, dtype=np.bool_)
    for rate_hz in (5.0, 10.0, 20.0, 50.0):
        clean = np.where((np.arange(60) // 20) % 2 == 1, 1.0, -1.0)
        assert (closing_of(clean, width, free, rate_hz=rate_hz) == (clean > 0.0)).all()
    for every in (3, 4, 5, 9):
        flicker = np.where(np.arange(60) % every == every - 1, 1.0, -1.0)
        assert not closing_of(flicker, width, free, rate_hz=20.0).any()
        assert closing_of(-flicker, width, free, rate_hz=20.0)[every:].all()


@pytest.mark.parametrize("seed", range(4))
def test_the_first_hover_is_that_of_a_look_at_every_row(stage, seed):
    rng, rows, forbidden = np.random.default_rng(seed), 300, (1, 3)
    info = stage("fruit_lunch", "O1", seed=seed).info
    n = len(info.objects)
    positions = np.tile(rng.normal([0.5, 0.0, 0.0], [0.1, 0.2, 0.02], (n, 3)), (rows, 1, 1))
    turns = rng.normal(0.0, 1.0, (n, 4))
    quaternions = np.tile(turns / np.linalg.norm(turns, axis=1, keepdims=True), (rows, 1, 1))
    offsets = rng.uniform(0.0, 0.3, (12, 1)) * rng.normal(0.0, 1.0, (12, 3))  # it stays in twelve places
    tool = positions[:, rng.choice(forbidden)] + offsets.repeat(25, axis=0)
    closing, none = rng.random(rows) < 0.01, np.zeros((rows, n))
    motion = Motion(
        info=info, rate_hz=20.0, tool=tool, width=np.full(rows, 0.08), closing=closing, positions=positions,
        quaternions=quaternions, left=none > 0, right=none > 0, held=np.full(rows, -1, dtype=np.int16), force=none,
        there=none > 0, picked=(),
    )  # fmt: skip
    near = [
        None if closing[row] else hovered_over(info, tool[row], positions[row], quaternions[row], forbidden)
        for row in range(rows)
    ]
    assert {at is None for at in near} == {True, False}
    stay = motion.steps(HOVER_TIME)
    stays = (row for row in range(stay, rows) if None not in near[row - stay : row + 1])
    row = next(stays, None)
    assert first_hover(motion, forbidden) == (None if row is None else (row - stay, row, near[row]))


def test_distances_of_the_tool_are_the_same_for_all_rows_at_once_and_row_by_row(stage):
    record = stage("desk_meeting", "train1").wander(1.0).home().end()
    condition = resolve_condition("desk_meeting", "train1").condition
    trace = trace_of(record, condition, step_limit=len(record))
    turned = np.random.default_rng(0).normal(size=trace.quaternions.shape)
    turned /= np.linalg.norm(turned, axis=2, keepdims=True)
    trace = replace(trace, quaternions=turned)
    found = tool_distances(trace)
    for row, tool in enumerate(trace.tool):
        assert np.array_equal(found.boxes[row], trace.box_distances(row, tool))
        assert np.array_equal(found.centers[row], trace.center_distances(row, tool))
        assert np.array_equal(found.reach[row], trace.within_reach(row, tool))
