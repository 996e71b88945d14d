"""The goal over time: order, exclusiveness, dwell, and what is forbidden where nothing is to be done."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from tests.daily import part_of_today
from tests.tasks.conftest import change
from tests.tasks.posing import Course

from betterbench.geometry import Pose, multiply, normalize, rotate
from betterbench.tasks import THRESHOLDS, Expected, GoalTracker, Instruction, Reference, Subgoal, get_task
from betterbench.tasks.interventions import vary

RATE_HZ = 20.0
DWELL = 10
"""Control steps of 0.5 s at 20 Hz."""
SPOTS = {
    "burger_1": (-0.05, -0.07),
    "burger_2": (0.05, 0.07),
    "fries": (0.04, -0.08),
    "drink": (-0.04, 0.08),
    "round_block": (0.0, 0.0),
}
"""A place in the bag for each thing [m]."""


def condition_of(task_id, name):
    task = get_task(task_id)
    return task.train(name) if name.startswith("train") else vary(task, task.variation(name))[0]


def tracker_for(state, condition, rate=RATE_HZ):
    return GoalTracker(condition, state.info, template=get_task(condition.task).template, control_rate_hz=rate)


@pytest.fixture
def packed(posed):
    """A state in which the named things are in the bag."""

    def make(state, *names, **fields):
        bag = state.pose("box")
        floor = state.info.object("box").region("inside")
        z = floor.position[2] - floor.half_size[2]
        return posed(state, poses={n: Pose(bag.apply((*SPOTS[n], z)), bag.quaternion) for n in names}, **fields)

    return make


def start(at_reset, name, task_id="fast_food", rate=RATE_HZ):
    state, condition = at_reset(task_id, name), condition_of(task_id, name)
    tracker = tracker_for(state, condition, rate)
    return state, tracker, Course(tracker, rate)


def test_nothing_is_done_at_the_start(at_reset):
    state, tracker, course = start(at_reset, "train1")
    truth = course.see(state)
    assert not any(truth.relations)
    assert truth.subgoals == (False, False)
    assert tracker.subgoal_names == ("pack_burger", "pack_fries")
    assert len(truth.relations) == len(tracker.relation_names)
    assert not truth.goal
    assert truth.in_order
    assert not truth.success


def test_relations_are_named_after_what_they_judge(at_reset, packed):
    state, tracker, course = start(at_reset, "train1")
    truth = course.see(packed(state, "drink"))
    assert [n for n, holds in zip(tracker.relation_names, truth.relations, strict=True) if holds] == [
        "inside(drink, box)"
    ]


@pytest.mark.parametrize("burger", ["burger_1", "burger_2"])
def test_either_of_two_alike_will_do(at_reset, packed, burger):
    state, _, course = start(at_reset, "train1")
    course.see(state)
    assert course.see(packed(state, burger)).subgoals == (True, False)
    assert course.see(packed(state, burger, "fries")).goal


@pytest.mark.parametrize("rate", [20.0, 10.0, 50.0])
def test_success_comes_exactly_after_half_a_second_of_dwell(at_reset, packed, rate):
    state, _, course = start(at_reset, "train1", rate=rate)
    course.see(packed(state, "burger_1"))
    done = packed(state, "burger_1", "fries")
    steps = round(0.5 * rate)
    truths = [course.see(done) for _ in range(steps + 1)]
    assert all(t.goal for t in truths)
    assert [t.success for t in truths] == [False] * steps + [True], "0.5 s lie between first and last of the states"


def test_dwell_starts_again_when_the_goal_is_lost(at_reset, packed):
    state, _, course = start(at_reset, "train1")
    course.see(packed(state, "burger_1"))
    done = packed(state, "burger_1", "fries")
    course.see(done, DWELL)
    x, y, z = done.pose("fries").position
    pushed = change(done, poses={"fries": Pose((x + 0.004, y, z), done.pose("fries").quaternion)})
    assert not course.next(pushed).goal
    assert not course.see(done, course.rest_steps).goal
    assert not course.see(done, DWELL).success
    assert course.see(done).success


def test_wrong_order_is_never_forgiven(at_reset, packed):
    state, _, course = start(at_reset, "train1")
    course.see(state)
    assert not course.see(packed(state, "fries")).in_order
    truth = course.see(packed(state, "fries", "burger_1"), 3 * DWELL)
    assert truth.subgoals == (True, True)
    assert not truth.in_order
    assert not truth.goal
    assert not truth.success
    again = course.see(state)
    assert not again.in_order
    assert not course.see(packed(state, "burger_1", "fries"), 3 * DWELL).success


def test_order_counts_only_where_it_is_asked(at_reset, packed):
    state, condition = at_reset("fast_food", "train1"), condition_of("fast_food", "train1")
    free = condition.with_(instruction=Instruction("Any order.", condition.instruction.subgoals, ordered=False))
    course = Course(tracker_for(state, free))
    course.see(packed(state, "fries"))
    assert course.see(packed(state, "fries", "burger_1"), DWELL + 1).success


def test_both_at_once_is_in_order(at_reset, packed):
    state, _, course = start(at_reset, "train1")
    course.see(state)
    assert course.see(packed(state, "burger_2", "fries")).in_order


@pytest.mark.parametrize(("extra", "forgiven"), [("drink", False), ("burger_2", True)])
def test_a_wrong_extra_object_spoils_the_goal_and_only_one_that_was_meant_may_be_taken_out(
    at_reset, packed, extra, forgiven
):
    state, _, course = start(at_reset, "train1")
    course.see(packed(state, "burger_1"))
    truth = course.see(packed(state, "burger_1", "fries", extra), 3 * DWELL)
    assert all(truth.subgoals)
    assert not truth.goal
    assert not truth.success
    assert course.see(packed(state, "burger_1", "fries"), DWELL + 1).success is forgiven


def test_a_look_alike_in_the_bag_spoils_the_goal_and_stands_for_nothing(at_reset, packed):
    state, _, course = start(at_reset, "O1")
    course.see(state)
    assert course.see(packed(state, "round_block")).subgoals == (False, False)
    course.see(packed(state, "round_block", "burger_2"))
    assert not course.see(packed(state, "round_block", "burger_2", "fries"), 3 * DWELL).success


def test_a_subgoal_needs_release(at_reset, packed):
    state, _, course = start(at_reset, "train1")
    course.see(packed(state, "burger_1"))
    truth = course.see(packed(state, "burger_1", "fries", contacts=(("left_finger", "fries"),)), 3 * DWELL)
    assert truth.subgoals == (True, False)
    assert not truth.success


def test_a_subgoal_needs_rest(at_reset, packed):
    state, _, course = start(at_reset, "train1")
    course.see(packed(state, "burger_1"))
    done = packed(state, "burger_1", "fries")
    x, y, z = done.pose("fries").position
    for k in range(3 * DWELL):
        truth = course.next(change(done, poses={"fries": Pose((x + 0.004 * (k % 2), y, z))}))
        assert truth.subgoals == (True, False)
        assert not truth.success


def test_a_finished_burger_succeeds_though_its_contacts_tremble(at_reset, packed):
    """Seven of eleven finished burgers failed: the engine gave 0.3 to 1.0 rad/s to what moved by 0.06 mm in 6 s."""
    state, _, course = start(at_reset, "train1")
    course.see(packed(state, "burger_1"))
    done = packed(state, "burger_1", "fries", turning={"fries": 1.0}, speeds={"fries": 0.05})
    assert course.see(done, DWELL + 1).success


def test_the_second_of_two_equal_steps_needs_a_second_object(at_reset, packed):
    state, tracker, course = start(at_reset, "T2")
    assert tracker.subgoal_names == ("pack_burger", "pack_burger_2", "pack_fries", "pack_drink")
    assert course.see(packed(state, "burger_2")).subgoals == (True, False, False, False)
    assert course.see(packed(state, "burger_2", "burger_1")).subgoals == (True, True, False, False)
    course.see(packed(state, "burger_2", "burger_1", "fries"))
    assert course.see(packed(state, "burger_2", "burger_1", "fries", "drink"), DWELL + 1).success


def test_the_chain_with_fries_before_the_second_burger_is_out_of_order(at_reset, packed):
    state, _, course = start(at_reset, "T2")
    course.see(packed(state, "burger_2"))
    course.see(packed(state, "burger_2", "fries"))
    course.see(packed(state, "burger_2", "fries", "burger_1"))
    truth = course.see(packed(state, "burger_2", "burger_1", "fries", "drink"), 3 * DWELL)
    assert all(truth.subgoals)
    assert not truth.success


# ----------------------------------------------------------------------------------------------- where to stay still


def last_steps(course, still, *, before=0):
    """Stays still until the step limit of `morning_coffee/T1`."""
    limit = get_task("morning_coffee").step_limit(condition_of("morning_coffee", "T1"))
    return course.see(still, limit - course.step - before)


def test_staying_still_succeeds_at_the_limit_and_not_before(at_reset):
    state, _, course = start(at_reset, "T1", "morning_coffee")
    assert course.see(state).goal
    truth = last_steps(course, state, before=1)
    assert not truth.success
    assert not truth.forbidden
    assert course.see(state).success


def test_touching_anything_is_forbidden_for_good(at_reset, posed):
    for part, thing in (("left_finger", "red_mug"), ("hand", "coffee_machine"), ("right_finger", "blue_mug")):
        state, _, course = start(at_reset, "T1", "morning_coffee")
        assert course.see(posed(state, contacts=((part, thing),))).forbidden
        truth = last_steps(course, state)
        assert truth.forbidden
        assert not truth.success


def test_moving_early_is_allowed_but_the_end_must_be_still(at_reset):
    state, _, course = start(at_reset, "T1", "morning_coffee")
    moving = dataclasses.replace(state, joint_velocities=(0.2, *state.joint_velocities[1:]))
    course.see(moving, 20)
    assert last_steps(course, state).success
    state, _, course = start(at_reset, "T1", "morning_coffee")
    last_steps(course, state, before=5)
    assert not course.see(moving, 5).success


def test_settling_at_the_end_takes_a_whole_second(at_reset):
    settle = round(THRESHOLDS.settle_time * RATE_HZ)
    for still_for, expected in ((settle, True), (settle - 1, False)):
        state, _, course = start(at_reset, "T1", "morning_coffee")
        moving = dataclasses.replace(state, joint_velocities=(0.2, *state.joint_velocities[1:]))
        last_steps(course, moving, before=still_for)
        assert course.see(state, still_for).success is expected


def test_a_goal_that_was_undone_on_the_way_is_no_correct_freeze(at_reset, posed):
    state, _, course = start(at_reset, "T1", "morning_coffee")
    off = Pose((0.6, -0.2, 0.0))
    course.see(posed(state, poses={"red_mug": off}))
    assert not last_steps(course, state).success


# -------------------------------------------------------------------------------------------------------- to refuse


@pytest.fixture
def refusal(at_reset):
    """A burger is asked for and a block of its look stands there instead: refuse, but the fries may be packed."""
    state = at_reset("fast_food", "O1")
    goals = (
        Subgoal("pack_apple", "inside", Reference(kind="apple"), "box", "apple"),
        Subgoal("pack_fries", "inside", Reference(kind="fries"), "box", "fries"),
    )
    condition = condition_of("fast_food", "O1").with_(
        expected=Expected.REFUSE, premise_broken=True, instruction=Instruction("Pack the apple, then the fries.", goals)
    )
    limit = get_task("fast_food").step_limit(condition)
    return state, Course(tracker_for(state, condition)), limit


def test_refusing_by_standing_still_succeeds_at_the_limit(refusal):
    state, course, limit = refusal
    assert not course.see(state, limit).success
    assert course.see(state).success


def test_what_is_there_and_asked_for_may_be_packed(refusal, posed, packed):
    state, course, limit = refusal
    course.see(posed(state, contacts=(("left_finger", "fries"), ("right_finger", "fries"))), 50)
    truth = course.see(packed(state, "fries"), limit - course.step)
    assert not truth.forbidden
    assert truth.success


@pytest.mark.parametrize("thing", ["round_block", "drink", "burger_2"])
def test_touching_what_is_not_asked_for_is_no_refusal(refusal, posed, thing):
    state, course, limit = refusal
    assert course.see(posed(state, contacts=(("left_finger", thing),))).forbidden
    assert not course.see(state, limit - course.step).success


def test_touching_the_bag_is_no_attempt_at_the_block(refusal, posed):
    state, course, _ = refusal
    assert not course.see(posed(state, contacts=(("hand", "box"),))).forbidden


def test_on_ring_goal_over_time(at_reset, posed):
    """The same tracker serves every template: coffee succeeds by its own relation."""
    state, _, course = start(at_reset, "train1", "morning_coffee")
    done = at_reset("morning_coffee", "T1")
    assert not course.see(state).goal
    machine = state.pose("coffee_machine")
    ring = state.info.object("coffee_machine").region("ring").position

    def placed(name):
        base = state.info.object(name).region("base").position
        x, y, z = rotate(machine.quaternion, base)
        gx, gy, gz = machine.apply(ring)
        return Pose((gx - x, gy - y, gz - z), normalize(multiply(machine.quaternion, (1.0, 0.0, 0.0, 0.0))))

    assert not course.see(posed(state, poses={"blue_mug": placed("blue_mug")}), 3 * DWELL).success
    state, _, course = start(at_reset, "train1", "morning_coffee")
    course.see(state)
    assert course.see(posed(state, poses={"red_mug": placed("red_mug")}), DWELL + 1).success
    assert done.info.object("red_mug").kind == "red mug"
    assert math.isclose(done.time_s, 0.0)


@pytest.mark.parametrize(
    "seeds", [part_of_today(range(20), 4), pytest.param(range(20), marks=pytest.mark.slow)], ids=len
)
@pytest.mark.parametrize("setting", ["fast_food/train1", "fast_food/L1", "morning_coffee/T1", "fast_food/T2"])
def test_no_state_succeeds_that_was_said_not_to_decide_anything(at_reset, packed, posed, setting, seeds):
    """An episode judges its states in blocks of so many, so it would not notice."""
    succeeded, (task_id, _, name) = 0, setting.partition("/")
    for seed in seeds:
        rng = np.random.default_rng(seed)
        state, tracker, course = start(at_reset, name, task_id)
        limit = get_task(task_id).step_limit(condition_of(task_id, name))
        loose = [o.name for o in state.info.objects if not o.fixed and o.name in SPOTS]
        course_of = [state, posed(state, contacts=(("left_finger", state.info.objects[0].name),))]
        if task_id == "fast_food":
            course_of += [packed(state, "burger_1"), packed(state, *loose)] + 4 * [packed(state, "burger_1", "fries")]
        else:
            course_of += 10 * [state]
        undecided = 0
        while course.step < limit:
            now = course_of[int(rng.integers(len(course_of)))]
            for _ in range(min(int(rng.integers(1, 15)), limit - course.step)):
                truth = course.see(now)
                assert not (undecided and truth.success)
                succeeded += truth.success
                undecided = tracker.undecided_states if not undecided else undecided - 1
    assert name != "train1" or succeeded
