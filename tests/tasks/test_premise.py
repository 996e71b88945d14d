"""The premise: each way in which a scene can fail to show what its instruction presupposes is found and named."""

from __future__ import annotations

import pytest
from tests.daily import part_of_today

from betterbench.geometry import Pose, from_axis_angle
from betterbench.tasks import Expected, all_tasks, broken_premises, get_task
from betterbench.tasks.interventions import vary
from betterbench.tasks.judging.premise import SLOT_TOLERANCE_M

CONDITIONS = [(t.id, c.name) for t in all_tasks() for c in (*t.training, *t.variations)]


def condition_of(task_id, name):
    task = get_task(task_id)
    return task.train(name) if name.startswith("train") else vary(task, task.variation(name))[0]


@pytest.mark.parametrize(
    "conditions", [part_of_today(CONDITIONS, 3), pytest.param(CONDITIONS, marks=pytest.mark.slow)], ids=["part", "all"]
)
def test_every_condition_keeps_its_premise(at_reset, conditions):
    for task_id, name in conditions:
        assert broken_premises(condition_of(task_id, name), at_reset(task_id, name)) == (), (task_id, name)


def found(condition, state):
    return " | ".join(broken_premises(condition, state))


def test_an_object_out_of_its_slot(at_reset, posed):
    state, condition = at_reset("fast_food", "train1"), condition_of("fast_food", "train1")
    slot = state.info.slot("third").position
    z = state.pose("fries").position[2]
    for meters, broken in ((SLOT_TOLERANCE_M - 1e-4, False), (SLOT_TOLERANCE_M + 1e-4, True)):
        moved = posed(state, poses={"fries": Pose((slot[0] + meters, slot[1], z))})
        assert ("fries does not stand in its slot 'third'" in found(condition, moved)) is broken


def test_an_object_that_has_fallen_over(at_reset, posed):
    state, condition = at_reset("fast_food", "train1"), condition_of("fast_food", "train1")
    fallen = Pose(state.pose("drink").position, from_axis_angle((1.5, 0.0, 0.0)))
    assert found(condition, posed(state, poses={"drink": fallen})) == "drink does not stand upright"


def test_a_fixed_thing_need_not_be_upright(at_reset, posed):
    state, condition = at_reset("morning_coffee", "train1"), condition_of("morning_coffee", "train1")
    leaning = Pose(state.pose("coffee_machine").position, from_axis_angle((1.5, 0.0, 0.0)))
    assert "coffee_machine" not in found(condition, posed(state, poses={"coffee_machine": leaning}))


def test_a_named_thing_that_is_not_there(at_reset):
    """O1 holds one burger: asked for two, the sentence presupposes what the scene does not show."""
    two = condition_of("fast_food", "T2").instruction
    condition = condition_of("fast_food", "O1").with_(instruction=two)
    assert found(condition, at_reset("fast_food", "O1")) == ("the instruction names 'burger', but the scene has 1 of 2")


def test_a_goal_that_is_reached_already(at_reset):
    state = at_reset("morning_coffee", "T1")
    condition = condition_of("morning_coffee", "T1").with_(expected=Expected.SUCCEED)
    assert found(condition, state) == "the goal is already reached"


def test_something_left_to_do_where_nothing_should_be(at_reset):
    condition = condition_of("morning_coffee", "train1").with_(expected=Expected.STAY_STILL)
    assert (
        found(condition, at_reset("morning_coffee", "train1")) == "nothing should be left to do, but a subgoal is open"
    )


def test_a_preplaced_thing_that_is_not_at_its_target(at_reset, posed):
    state, condition = at_reset("morning_coffee", "T1"), condition_of("morning_coffee", "T1")
    x, y, z = state.pose("red_mug").position
    off = posed(state, poses={"red_mug": Pose((x + 0.03, y, z), state.pose("red_mug").quaternion)})
    assert "red_mug is not at coffee_machine although it was placed there" in found(condition, off)


def test_several_flaws_are_all_named(at_reset, posed):
    state, condition = at_reset("fast_food", "train1"), condition_of("fast_food", "train1")
    fallen = Pose(state.pose("drink").position, from_axis_angle((1.5, 0.0, 0.0)))
    state = posed(state, poses={"fries": Pose((0.2, 0.5, 0.0)), "drink": fallen})
    assert len(broken_premises(condition, state)) == 2


def test_a_premise_broken_on_purpose_still_asks_for_a_scene_that_stands(at_reset, posed):
    state = at_reset("fast_food", "O1")
    condition = condition_of("fast_food", "O1").with_(
        premise_broken=True, instruction=condition_of("fast_food", "T2").instruction
    )
    assert broken_premises(condition, state) == ()
    fallen = Pose(state.pose("drink").position, from_axis_angle((1.5, 0.0, 0.0)))
    assert found(condition, posed(state, poses={"drink": fallen})) == "drink does not stand upright"
