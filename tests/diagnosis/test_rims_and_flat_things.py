"""Where a gripper is at a thing: at the rim of a plate, low over what is flat, and never measured to a middle alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.daily import others_slow

from betterbench.diagnosis import Label, diagnose_record
from betterbench.diagnosis.analysis.approaches import find_stays
from betterbench.diagnosis.analysis.trace import trace_of
from betterbench.records import RecordBuilder
from betterbench.tasks import GoalTracker

PARTLY = (Label.EXECUTION_FAILURE, "closed_in_part")

FLAT = [
    ("dinner_plates", "train1", 0),
    ("breakfast_table", "train1", 0),
    ("cheeseburger", "train1", 0),
    ("cheeseburger", "train1", 1),
]


def asked(s, k=0):
    return s.condition.resolve(s.condition.instruction.subgoals[k].reference)[0]


def low(s, name):
    """Where fingers take an object, at the height at which they touch the table."""
    x, y, z = s.grip_point(name)
    return x, y, max(z, s.positions[name][2] + 0.026)


def close_in_part(s, name, width, *, opens):
    """Comes down to where an object is taken, closes to a width, and rises before the fingers open again, or after."""
    x, y, z = low(s, name)
    s.over(np.array([x, y]), 0.1).wait(0.6).go(x, y, z).wait(0.4)
    s.command = 1.0
    while s.width > width + 1e-6:
        s.tick()
    s.hold().wait(0.4)
    if opens == "there":
        s.open(0.4)
    s.go(x, y, 0.1)
    return s.open(0.4).lift()


@pytest.mark.parametrize("opens", ["there", "above"])
@pytest.mark.parametrize("width", [0.07, 0.06])
@pytest.mark.parametrize("case", others_slow([(case,) for case in FLAT], 2))
def test_a_weak_grip_around_a_flat_thing_has_tried(stage, case, width, opens):
    task, name, k = case
    s = stage(task, name)
    for before in range(k):
        s.serve(before)
    thing = asked(s, k)
    for _ in range(3):
        close_in_part(s, thing, width, opens=opens)
    found = diagnose_record(s.home().wait(8).end())
    assert (found.label, found.evidence.rule) == PARTLY
    assert found.evidence.objects == (thing,)
    assert found.intention_correct is not False


def test_widths_that_tremble_hide_no_try(stage):
    """The fingers are wider by a hair somewhere on the way than where they begin to close."""
    s = stage("dinner_plates", "train1")
    real = s.state

    def state():
        seen = real()
        hair = 0.0002 if s.step < 10 else -0.0003 * (s.step % 7 == 0)
        return replace(seen, finger_width_m=seen.finger_width_m + hair)

    s.state = state
    thing = asked(s)
    for _ in range(3):
        close_in_part(s, thing, 0.06, opens="above")
    found = diagnose_record(s.home().wait(8).end())
    assert (found.label, found.evidence.rule) == PARTLY
    assert [a.result for a in found.attempts] == ["null"] * 3


def test_a_wide_gripper_over_a_flat_thing_has_not_closed_around_it(stage):
    s = stage("dinner_plates", "train1")
    x, y, _ = low(s, asked(s))
    for _ in range(3):
        s.over(np.array([x, y]), 0.12)
        s.command = 1.0
        while s.width > 0.06:
            s.tick()
        s.hold().wait(0.8).open(0.4).lift()
    found = diagnose_record(s.home().wait(8).end())
    assert found.label is Label.EARLY_HALT


def put(s, name, *place):
    """Has an object stand somewhere else from the start."""
    s.positions[name] = np.array(place)
    s.previous = s.places()
    s.builder = RecordBuilder(s.metadata)
    s.tracker = GoalTracker(s.condition, s.info, template=s.task.template, control_rate_hz=s.metadata.control_rate_hz)
    s._append()


@pytest.mark.parametrize("gap", [0.005, 0.02])
def test_the_thing_that_a_gripper_is_over_is_the_one_below_it_and_not_the_nearest_middle(stage, looks, gap):
    """At the rim of a plate, the middle of a small thing beside it is nearer than that of the plate."""
    looks["fork"] = ((0.03, 0.03, 0.06), "silver", "irregular")
    s = stage("breakfast_table", "train1")
    plate = next(n for n in s.movable() if "plate" in s.info.object(n).category or "bowl" in s.info.object(n).category)
    other = next(n for n in s.movable() if s.info.object(n).category == "fork")
    x, y, _ = s.positions[plate]
    rim = x - 0.5 * s.size(plate)[0] + 0.004
    put(s, other, rim - 0.5 * s.size(other)[0] - gap, y, 0.0)
    s.over(np.array([rim, y]), 0.1).wait(3.0)
    record = s.end()
    stays = find_stays(trace_of(record, s.condition, step_limit=s.task.step_limit(s.condition)), 0)
    assert {s.info.objects[stay.object].name for stay in stays} == {plate}
