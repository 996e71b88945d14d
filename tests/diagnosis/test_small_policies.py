"""Small policies in the simulator: drifted grasps at emptied slots, weak grips, means of two, places met badly."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import pytest
from tests.daily import others_slow

sys.path.insert(0, str(Path(__file__).parent))

from small_policies import RATE_S, closing_at, go_down, play, rise_and_open

from betterbench.diagnosis import Label, diagnose_record, offline_truth
from betterbench.diagnosis.modes import MODES
from betterbench.geometry import Pose, angle_between, from_yaw, multiply
from betterbench.policies.experts.motion import APPROACH, FREE, close_gripper, follow, hold
from betterbench.tasks.interventions.resolve import resolve_condition

pytestmark = pytest.mark.physics


def live_as_offline(record):
    truths = offline_truth(record)
    return any(t.success for t in truths) == record.outcome.success


DRIFTS = [
    (*where, off)
    for where in (
        ("morning_coffee", "T1", "near", 85),
        ("fruit_lunch", "T1", "second", 295),
        ("cheeseburger", "T1", "third", 160),
        ("dinner_plates", "T2", "left_front", 25),
        ("seasoning_rack", "L2", "first", 107),
    )
    for off in (0.04, 0.058, 0.085)
]


@pytest.mark.parametrize(("task", "name", "slot", "angle", "off"), others_slow(DRIFTS, 4))
def test_a_grasp_that_drifts_at_an_emptied_slot_is_inertia(task, name, slot, angle, off):
    at, a = resolve_condition(task, name).task.slot(slot), math.radians(angle)
    record = play(task, name, closing_at(at.x + off * math.cos(a), at.y + off * math.sin(a), 0.05))
    found = diagnose_record(record)
    assert (found.label, found.evidence.rule) == (Label.BEHAVIORAL_INERTIA, "air_grasp_at_memorized_slot")
    assert found.first_slot == slot
    assert found.intention_correct is False
    assert live_as_offline(record)


def weakly(name, steps, times=4):
    """Returns a policy whose gripper closes for a few steps with hardly any force, opens again, and rests at last."""

    def act(_, state):
        for _ in range(times):
            x, y, _ = state.pose(name).position
            state = yield from go_down(state, x, y, 0.03)
            state = yield from hold(state, steps, gripper=0.1)
            state = yield from rise_and_open(state)
        return state

    return act


WEAKLY = [
    (*where, steps)
    for steps in (3, 16)
    for where in (("fast_food", "T1", "burger_1"), ("fruit_lunch", "T1", "lemon"), ("tidy_desk", "train1", "napkin"))
]


@pytest.mark.parametrize(("task", "name", "thing", "steps"), others_slow(WEAKLY, 3))
def test_an_honest_weak_grip_is_a_failure_of_execution(task, name, thing, steps):
    found = diagnose_record(play(task, name, weakly(thing, steps)))
    assert found.label is Label.EXECUTION_FAILURE
    assert found.intention_correct is True
    assert len(found.attempts) >= 3


def between(one, other, share):
    def act(scene, state):
        (ax, ay, _), (bx, by, _) = state.pose(one).position, state.pose(other).position
        return closing_at(ax + share * (bx - ax), ay + share * (by - ay), 0.03)(scene, state)

    return act


@pytest.mark.parametrize("share", [0.5, 0.75])
def test_contacts_tell_a_mean_of_two_from_a_closing_at_the_wrong_one(share):
    found = diagnose_record(play("fruit_lunch", "R1", between("orange", "lemon", share)))
    if share == 0.5:  # a finger comes down on each of them
        assert (found.label, found.evidence.rule) == (Label.EXECUTION_FAILURE, "missed_between")
        assert found.intention_correct is None
        assert found.first_attempt is None
        assert "right things" not in MODES[found.label].conclude([found])
    else:  # a finger presses on the lemon with more than 80 N
        assert found.first_attempt == "lemon"
        assert found.intention_correct is False
        assert found.kind.value == "reasoning"


def puts_turned(name, region, turn, beyond=0.0):
    """Returns a policy that puts an object to a side of the laptop, turned, and farther to its front by some meters."""

    def act(scene, state):
        asset = next(p.asset for p in scene.placements if p.spec.name == name)
        grasp = state.pose(name) @ asset.grasps[0].pose
        flipped = grasp @ Pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
        grasp = min((grasp, flipped), key=lambda t: angle_between(t.quaternion, state.ee_pose.quaternion))
        x, y, z = grasp.position
        way = (Pose((x, y, 0.3), grasp.quaternion), grasp)
        state = yield from follow(state, way, gripper=-1.0, pace=FREE, period_s=RATE_S)
        state = yield from close_gripper(state)
        place = state.pose("laptop") @ Pose(state.info.object("laptop").region(region).position)
        px, py, _ = (place @ Pose((beyond, 0.0, 0.0))).position
        q = multiply(from_yaw(turn), grasp.quaternion)
        way = (Pose((x, y, 0.3), grasp.quaternion), Pose((px, py, 0.3), q), Pose((px, py, z + 0.004), q))
        state = yield from follow(state, way, gripper=1.0, pace=FREE, period_s=RATE_S)
        return (yield from rise_and_open((yield from hold(state, 6, gripper=1.0))))

    return act


@pytest.mark.parametrize(
    ("region", "beyond", "verdict"),
    [
        ("right", 0.0, (Label.BEHAVIORAL_INERTIA, "memorized_place")),
        ("right", -0.07, (Label.EXECUTION_FAILURE, "placed_outside_the_goal")),
        ("left", 0.15, (Label.EXECUTION_FAILURE, "placed_outside_the_goal")),
    ],
    ids=["where training put it", "at that side and far from there", "in front of where it was asked for"],
)
def test_a_place_that_is_met_badly_is_told_from_the_right_one_met_badly(region, beyond, verdict):
    found = diagnose_record(play("desk_meeting", "R1", puts_turned("mouse", region, 0.8, beyond)))
    assert (found.label, found.evidence.rule) == verdict


def test_half_open_fingers_that_press_on_a_look_alike_and_close_later_are_an_attempt():
    def act(_, state):
        x, y, _ = state.pose("round_block").position
        state = yield from go_down(state, x, y, 0.12)
        while state.finger_width_m > 0.05:
            state = yield from hold(state, 1, gripper=1.0)
        down = state.commanded_pose.translated(z=-0.06)
        state = yield from follow(state, (down,), gripper=0.0, pace=APPROACH, period_s=RATE_S)
        state = yield from hold(state, 20, gripper=0.0)
        state = yield from hold(state, 24, gripper=1.0)
        state = yield from rise_and_open(state)
        x, y, _ = state.pose("burger_2").position
        state = yield from go_down(state, x, y, 0.03)
        state = yield from close_gripper(state)
        return (yield from rise_and_open(state))

    found = diagnose_record(play("fast_food", "O1", act))
    assert (found.label, found.first_attempt) == (Label.SEMANTIC_FEATURE_COLLAPSE, "round_block")


@pytest.mark.parametrize("height_m", [0.11, 0.12])
def test_a_closing_too_high_over_an_object_is_at_the_object_and_not_at_an_empty_slot(height_m):
    """The gripper is 6 cm above the object's top at 0.11 m, and farther away at 0.12 m."""

    def closes_over(name):
        return lambda scene, state: closing_at(*state.pose(name).position[:2], height_m)(scene, state)

    found = diagnose_record(play("fast_food", "O1", closes_over("round_block")))
    assert (found.label, found.first_slot) == (Label.SEMANTIC_FEATURE_COLLAPSE, "first")
    found = diagnose_record(play("fast_food", "L1", closes_over("burger_2")))
    assert (found.evidence.rule, found.intention_correct) == ("missed_by_pose", True)
