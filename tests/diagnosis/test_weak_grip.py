"""Closings that were tried do not vanish, and moving between things that are all asked for accuses nobody."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.daily import others_slow

from betterbench.diagnosis import Label, diagnose_record

WEAK = (Label.EXECUTION_FAILURE, "weak_grip")


def asked(s, k=0):
    return s.condition.resolve(s.condition.instruction.subgoals[k].reference)[0]


def try_weakly(s, name, *, travel=0.001, seconds=0.8):
    """Comes down to an object and is told to close there, while the fingers move by a millimeter at most."""
    s.over(s.grip_point(name), 0.3).go(*s.grip_point(name)).wait(0.2)
    real = s.tick

    def tick():
        s.command, told = 0.0, s.command  # the fingers do not follow
        s.width = 0.08 - (travel if told > 0 else 0.0)
        s.told = told
        real()
        s.command = told

    state = s.state
    s.tick = tick
    s.state = lambda: _commanded(state(), s)
    s.close(seconds).open(0.3)
    s.tick, s.state = real, state
    s.width = 0.08
    return s.lift()


def _commanded(state, s):
    return replace(state, gripper_command=s.told)


@pytest.mark.parametrize("travel", [0.0, 0.002])
@pytest.mark.parametrize(
    ("task", "name"), others_slow([("fast_food", "train1"), ("fast_food", "T1"), ("tidy_desk", "train1")], 3)
)
@pytest.mark.parametrize("rests", [True, False])
def test_a_weak_gripper_that_closes_at_the_right_thing_has_tried(stage, task, name, travel, rests):
    s = stage(task, name)
    for _ in range(4):
        try_weakly(s, asked(s), travel=travel)
    s.home()
    found = diagnose_record((s.wait(6) if rests else s.wander(6)).end())
    assert (found.label, found.evidence.rule) == WEAK
    assert found.intention_correct is True
    assert [a.result for a in found.attempts] == ["null"] * 4
    assert "its fingers hardly move" in found.evidence.text


def test_a_weak_gripper_that_goes_from_one_thing_to_the_next_has_tried(stage):
    s = stage("tidy_desk", "train1")
    names = list(dict.fromkeys(asked(s, k) for k in range(len(s.condition.instruction.subgoals))))
    assert len(names) > 1
    for _ in range(3):
        for name in names:
            try_weakly(s, name)
    found = diagnose_record(s.home().wait(5).end())
    assert (found.label, found.evidence.rule) == WEAK


def test_a_weak_closing_that_was_made_good_decides_nothing(stage):
    s = stage("fast_food", "train1")
    burger, fries = asked(s), s.of("fries")
    try_weakly(s, burger)
    found = diagnose_record(s.bring(burger).bring(fries).wait(1).end())
    assert found.label is Label.SUCCESS


@pytest.mark.parametrize("kind", ["round block", "drink"])
def test_a_weak_closing_at_something_else_is_no_evidence_against_anybody(stage, kind):
    s = stage("fast_food", "O1")
    try_weakly(s, s.of(kind))
    found = diagnose_record(s.home().wait(5).end())
    assert found.attempts == ()


def test_a_gripper_that_holds_something_does_not_try_again(stage):
    s = stage("fast_food", "train1")
    s.grasp(asked(s)).lift().hold().wait(1).close(1.0).wait(1)
    assert len(diagnose_record(s.end()).attempts) == 1


def between(s, names, times):
    for _ in range(times):
        for name in names:
            x, y, z = s.positions[name]
            s.go(x, y, z + s.size(name)[2] + 0.05).wait(0.3)
    return s


@pytest.mark.parametrize(
    ("task", "name", "accused"),
    [
        ("tidy_desk", "train1", False),
        ("desk_meeting", "train1", False),
        ("seasoning_rack", "train4", False),
        ("fast_food", "train1", True),
    ],
)
def test_moving_between_things_that_may_all_be_taken_accuses_nobody(stage, task, name, accused):
    """Where an order is asked for, the second thing may not be taken yet: the policy cannot tell which step is due."""
    s = stage(task, name)
    names = [asked(s, 0), asked(s, 1)]
    s.over(s.positions[names[0]], 0.3)
    found = diagnose_record(between(s, names, 8).end())
    assert found.label is (Label.PHASE_CONFLICT if accused else Label.TIMEOUT)


def test_moving_between_the_two_burgers_of_which_either_is_asked_for_accuses_nobody(stage):
    s = stage("fast_food", "train1")
    burgers = [o.name for o in s.info.of_kind("burger")]
    s.over(s.positions[burgers[0]], 0.3)
    assert diagnose_record(between(s, burgers, 8).end()).label is Label.TIMEOUT


def test_moving_over_something_else_too_is_to_and_fro(stage):
    s = stage("tidy_desk", "train1")
    other = next(n for n in s.movable() if s.info.object(n).role == "distractor")
    s.over(np.array(s.positions[other]), 0.3)
    found = diagnose_record(between(s, [asked(s, 0), other, asked(s, 1)], 8).end())
    assert (found.label, found.evidence.rule) == (Label.PHASE_CONFLICT, "to_and_fro")
