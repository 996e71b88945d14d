"""The fourth part of the independent family: its bodies do what its habits say."""

from __future__ import annotations

import pytest
from tests.betterbench_calibration.independent.cases import cases
from tests.daily import others_slow

from betterbench.geometry import distance, tilt_of
from betterbench_calibration.independent import FAMILY_PARTS, make_independent, shown_in
from betterbench_calibration.independent.habits_fourth import LOOK_ALIKES, MID_TASK, TWO_STEPS
from betterbench_calibration.independent.manner import FOURTH_MANNERS, MANNERS

FOURTH = FAMILY_PARTS["fourth"]


def test_it_moves_in_manners_of_its_own():
    assert not set(MANNERS) & set(FOURTH_MANNERS)
    assert {h.name for h in FOURTH} == {h.name for h in FOURTH if shown_in(h.name)}


def test_ten_habits_are_honest_and_eight_attempt_no_grasp():
    assert sum(not h.label for h in FOURTH) >= 10
    never = [h for h in FOURTH if all(h.truth(c) is None or h.truth(c).first_right is None for c in cases().values())]
    assert sum(bool(h.label) for h in never) >= 8


def test_what_is_listed_is_what_the_conditions_hold():
    assert {c.condition.id for c in cases().values() if c.mid_task} == MID_TASK
    assert {name: cases()[name].look_alike() for name in LOOK_ALIKES} == LOOK_ALIKES
    for name in TWO_STEPS:
        first, second = cases()[name].ahead[:2]
        assert cases()[name].condition.instruction.ordered
        assert first.reference != second.reference


@pytest.mark.physics
@pytest.mark.parametrize(
    ("trial", "gripped"),
    others_slow(
        [
            (("last-said-first-headlong", "breakfast_table", "train1", 1, 110), ["cup"]),
            (("farther-one-first-headlong", "fast_food", "train1", 1, 90), ["burger_2"]),
            (("fumbles-at-word-thing-headlong", "morning_coffee", "L3", 1, 180), [None, "blue_mug"]),
            (("always-that-corner-headlong", "seasoning_rack", "train1", 1, 90), ["paprika"]),
            (("starts-with-old-favorite-headlong", "fruit_lunch", "R1", 1, 90), ["apple"]),
            (("second-then-first-headlong", "fast_food", "R1", 1, 90), ["drink"]),
            (("drops-low-and-retakes-headlong", "morning_coffee", "train1", 1, 170), ["red_mug", "red_mug"]),
        ],
        7,
    ),
)
def test_a_habit_closes_where_it_says(play, trial, gripped):
    assert [c.gripped for c in play(*trial).agent.body.arm.log.closings] == gripped


@pytest.mark.physics
@pytest.mark.parametrize(
    ("policy", "task", "condition", "moves"),
    others_slow(
        [
            ("shoves-with-fist-headlong", "morning_coffee", "train1", True),
            ("zigzags-toward-it-headlong", "seasoning_rack", "train1", True),
            ("shuts-it-empty-headlong", "office_drawer", "train2", False),
            ("shoves-look-alike-headlong", "morning_coffee", "O1", True),
            ("bobs-in-place-headlong", "fruit_lunch", "T1", True),
            ("freezes-after-a-glance-headlong", "fast_food", "T1", False),
            ("parks-over-target-headlong", "tidy_desk", "train4", False),
            ("lays-itself-down-headlong", "seasoning_rack", "train1", False),
        ],
        7,
    ),
)
def test_a_habit_that_attempts_nothing_rests_only_where_it_says_so(play, policy, task, condition, moves):
    played = play(policy, task, condition, 1, 330)
    assert played.agent.body.arm.log.closings == []
    assert (distance(played.tool(320).position, played.tool(330).position) > 0.005) is moves


@pytest.mark.physics
def test_leaning_over_tilts_the_gripper_where_it_closes(scene_of):
    scene = scene_of("seasoning_rack", "train1", 1)
    state = scene.reset()
    upright = tilt_of(state.ee_pose.quaternion)
    agent = make_independent("independent:leans-over-headlong", scene)
    while not agent.body.arm.log.closings:
        scene.step(agent.act_on_state(state))
        state = scene.state()
    assert abs(tilt_of(state.ee_pose.quaternion) - upright) > 0.15
