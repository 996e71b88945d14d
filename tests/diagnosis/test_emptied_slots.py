"""A closing at a slot from which its object was taken away is measured from where demonstrations close there."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from tests.daily import others_slow

from betterbench.diagnosis import Label, diagnose_record, offline_truth
from betterbench.tasks.authoring.operations import remove
from betterbench.tasks.interventions.resolve import resolve_condition
from betterbench.tasks.judging.picked_slots import EMPTY_SLOT_REACH, closing_points, picked_slots

EMPTY = (Label.BEHAVIORAL_INERTIA, "air_grasp_at_memorized_slot")
FAR = (Label.EXECUTION_FAILURE, "missed_by_far")


def closes(s, x, y, z=0.04):
    """Closes the gripper at a point of the table, opens it again and goes home."""
    return s.over(np.array([x, y])).go(x, y, z).close().lift().open().home()


def verdict(record):
    found = diagnose_record(record)
    return found.label, found.evidence.rule


def slot_of(s, name):
    return next(slot for slot in picked_slots(s.metadata.task, s.info) if slot.name == name)


def away_from_all(s, slot):
    """Returns the direction from a slot in which the nearest object is farthest away."""
    angles = np.linspace(0.0, 2.0 * math.pi, 24, endpoint=False)
    others = np.array([p[:2] for p in s.positions.values()])

    def room(angle):
        spot = np.array(slot.middle) + 0.1 * np.array([math.cos(angle), math.sin(angle)])
        return np.linalg.norm(others - spot, axis=1).min()

    best = max(angles, key=room)
    return np.array([math.cos(best), math.sin(best)])


@pytest.mark.parametrize("off", [0.0, 0.03, 0.045, 0.06, 0.08, 0.095])
def test_a_closing_about_an_empty_slot_is_at_that_slot(stage, off):
    """Learned policies close 4 to 10 cm beside the middle of a slot that they find empty."""
    s = stage("fast_food", "T1")
    x, y = np.array(slot_of(s, "second").middle) + off * away_from_all(s, slot_of(s, "second"))
    record = closes(s, x, y).wait(4).end()
    assert verdict(record) == EMPTY
    assert diagnose_record(record).first_slot == "second"


def test_a_closing_farther_off_than_any_drift_may_have_missed_anything(stage):
    s = stage("fast_food", "T1")
    slot = slot_of(s, "second")
    (x, y), spread = slot.middle, slot.closings[0][2]
    dx, dy = (EMPTY_SLOT_REACH + spread + 0.01) * away_from_all(s, slot)
    record = closes(s, x + dx, y + dy).wait(4).end()
    assert verdict(record) == FAR
    assert diagnose_record(record).first_slot is None


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("category", others_slow(["mug", "fork", "spoon", "cup", "dinner_plate"], 2))
def test_where_demonstrations_close_beside_the_middle_the_closing_is_measured_from_there(
    changed_stage, category, share
):
    """The expert itself takes handles, grips and rims 3 to 8 cm beside the middle of their slots."""
    task, name, slot_name = {
        "mug": ("morning_coffee", "train1", "far"),
        "fork": ("breakfast_table", "train1", "left_edge"),
        "spoon": ("breakfast_table", "train1", "right_edge"),
        "cup": ("breakfast_table", "train1", "front"),
        "dinner_plate": ("dinner_plates", "train1", "left_front"),
    }[category]
    gone = resolve_condition(task, name).condition.occupant(slot_name)
    s = changed_stage(task, name, lambda c: remove(c.object(gone)).carry_out(c)[0])
    assert gone not in s.positions
    slot = slot_of(s, slot_name)
    x, y, _ = max(slot.closings[1:], key=lambda c: min(math.dist(c[:2], p[:2]) for p in s.positions.values()))
    middle = np.array(slot.middle)
    out = (np.array([x, y]) - middle) / max(1e-9, math.dist((x, y), middle))
    spot = np.array([x, y]) + share * 0.05 * out
    found = diagnose_record(closes(s, *spot).wait(4).end())
    assert (found.label, found.evidence.rule) == EMPTY
    assert found.attempts[0].slot == slot_name


def test_closing_points_are_those_of_the_library(stage):
    points = closing_points()
    assert {"mug", "fork", "spoon", "cup", "dinner_plate", "burger"} <= points.keys()
    assert all(math.hypot(x, y) < 5.0 for x, y, _ in points["burger"])
    assert all(math.hypot(x, y) > 25.0 for x, y, _ in points["mug"])
    assert len(points["dinner_plate"]) == 8, "a plate is taken anywhere at its rim"
    (handle,) = points["mug"]
    s = stage("morning_coffee", "T1")
    near = slot_of(s, "near")
    assert near.closings[1][1] == pytest.approx(near.middle[1] - 0.001 * handle[0], abs=1e-6), "turned with its slot"


@pytest.mark.parametrize(("dx", "dy"), [(0.0, -0.055), (0.058, 0.0), (-0.058, 0.0), (0.0, -0.09), (0.03, -0.08)])
def test_where_it_is_to_stay_still_a_closing_about_an_emptied_slot_is_no_success(stage, dx, dy):
    """It is decided live, from where demonstrations closed, as it is from the record."""
    s = stage("morning_coffee", "T1")
    x, y = slot_of(s, "near").middle
    record = closes(s, x + dx, y + dy, 0.06).end()
    assert not record.outcome.success
    assert record.forbidden.any()
    found = diagnose_record(record)
    assert found.label is Label.BEHAVIORAL_INERTIA
    assert found.attempts[0].slot == "near"
    assert not found.intention_correct
    truths = offline_truth(record)
    assert np.array_equal([t.forbidden for t in truths], record.forbidden)
    assert any(t.success for t in truths) == record.outcome.success


def test_where_it_is_to_stay_still_a_closing_far_from_every_slot_is_a_success_live_and_offline(stage):
    record = closes(stage("morning_coffee", "T1"), 0.60, -0.32).end()
    assert record.outcome.success
    assert diagnose_record(record).label is Label.CORRECT_FREEZE


@pytest.mark.parametrize(
    ("angle", "off"), others_slow(itertools.product(range(0, 360, 45), (0.05, 0.06, 0.07, 0.08)), 5)
)
def test_a_miss_of_what_is_asked_for_is_a_miss_beside_an_empty_slot_too(stage, angle, off):
    """Whoever misses the right thing by up to 8 cm is accused of nothing, on whatever side it is."""
    for task, name in (("fast_food", "T1"), ("fruit_lunch", "T1"), ("office_drawer", "train1")):
        s = stage(task, name)
        goal = s.condition.instruction.subgoals[-1 if task == "fruit_lunch" else 0]
        thing = s.condition.resolve(goal.reference)[0]
        x, y, _ = s.positions[thing]
        a = math.radians(angle)
        if task == "office_drawer":
            s.draw(goal.target, 0.15)
        found = diagnose_record(closes(s, x + off * math.cos(a), y + off * math.sin(a)).wait(4).end())
        assert found.evidence.rule != EMPTY[1], (task, found.evidence)


def test_a_slot_in_which_something_stands_is_not_empty(stage):
    """A wrong object stands there, out of reach: nothing says what was missed."""
    s = stage("morning_coffee", "L3")
    blue = s.of("blue mug")
    x, y, _ = s.positions[blue]
    found = diagnose_record(closes(s, x + 0.12, y - 0.06).wait(4).end())
    assert (found.label, found.evidence.rule) == FAR


def test_a_closing_above_the_rim_of_the_requested_plate_is_not_at_the_empty_slot_beside_it(stage):
    """The rim of a plate in the empty slot would reach to 3 cm from the rim of the requested plate."""
    s = stage("dinner_plates", "L1")
    red = s.of("red plate")
    s.positions[red][:2] = s.slot("left_front")[:2] + np.array([0.0, 0.014])  # as near as it stands in some seeds
    x, y, _ = s.positions[red]
    width, top = s.size(red)[1], s.size(red)[2]
    record = closes(s, x, y + 0.5 * width - 0.005, top + 0.047).wait(4).end()
    found = diagnose_record(record)
    assert (found.label, found.evidence.rule, found.first_slot) == (*FAR, None)


def test_a_closing_above_the_middle_of_an_empty_slot_is_at_that_slot(stage):
    """However near the requested plate is: the slot is nearer."""
    s = stage("dinner_plates", "L1")
    x, y = slot_of(s, "right_front").middle
    assert verdict(closes(s, x, y, 0.06).wait(4).end()) == EMPTY
