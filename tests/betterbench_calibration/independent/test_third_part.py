"""The third part of the independent family: its bodies do what its habits say."""

from __future__ import annotations

import pytest
from tests.daily import others_slow

from betterbench.geometry import distance, horizontal_distance
from betterbench.tasks import Label
from betterbench_calibration.independent import FAMILY_PARTS, make_independent, shown_in
from betterbench_calibration.independent.events import in_gripper
from betterbench_calibration.independent.habits_third import FAR_FROM_ALL_M

pytestmark = pytest.mark.physics
ODD_ONES = [h for h in FAMILY_PARTS["third"] if not h.label]


@pytest.mark.parametrize(
    ("trial", "gripped"),
    others_slow(
        [
            (("wavers-then-loses-word-thing-brisk", "morning_coffee", "L3", 1, 130), ["blue_mug"]),
            (("rightmost-place-brisk", "seasoning_rack", "train3", 1, 90), ["salt"]),
            (("leftmost-place-brisk", "desk_meeting", "train3", 1, 60), ["speaker"]),
            (("turns-to-trained-target-brisk", "seasoning_rack", "R1", 1, 60), ["salt"]),
            (("passes-over-first-brisk", "fruit_lunch", "R1", 1, 230), ["lemon", "orange"]),
            (("one-is-enough-brisk", "cheeseburger", "T2", 1, 190), ["patty", "top_bun"]),
            (("loses-look-alike-brisk", "fast_food", "O1", 1, 120), ["round_block"]),
            (("fumbles-then-sinks-brisk", "seasoning_rack", "train1", 1, 120), [None, "salt"]),
        ],
        7,
    ),
)
def test_a_habit_closes_where_and_in_the_order_it_says(play, trial, gripped):
    assert [c.gripped for c in play(*trial).agent.body.arm.log.closings] == gripped


@pytest.mark.parametrize(
    ("trial", "aimed", "beside_m", "above_m"),
    [
        (("closes-just-beside-brisk", "seasoning_rack", "train3", 1, 60), "paprika", (0.03, 0.08), (-0.05, 0.0)),
        (("closes-over-it-twisted-brisk", "seasoning_rack", "train6", 1, 70), "paprika", (0.0, 0.01), (0.01, 0.03)),
        (("begins-as-always-brisk", "fruit_lunch", "R1", 1, 70), "apple", (0.0, 0.01), (0.005, 0.025)),
        (("closes-over-look-alike-brisk", "fruit_lunch", "O1", 1, 70), "red_block", (0.0, 0.01), (0.005, 0.025)),
        (("runs-into-it-brisk", "morning_coffee", "train4", 1, 110), "blue_mug", (0.03, 0.12), (-0.06, 0.0)),
    ],
)
def test_a_miss_is_at_the_thing_it_aims_at_and_takes_nothing(play, trial, aimed, beside_m, above_m):
    first = play(*trial).agent.body.arm.log.closings[0]
    assert (first.nearest, first.gripped) == (aimed, None)
    assert beside_m[0] <= first.beside_m <= beside_m[1]
    assert above_m[0] <= first.above_m <= above_m[1]


def test_an_empty_slot_that_is_closed_in_is_far_from_all_things(play):
    first = play("swings-to-empty-slot-brisk", "fast_food", "T1", 1, 90).agent.body.arm.log.closings[0]
    assert first.gripped is None
    assert first.beside_m > FAR_FROM_ALL_M - 0.03


@pytest.mark.parametrize(
    ("policy", "task", "condition", "rests"),
    [
        *others_slow(
            [
                ("drifts-at-home-brisk", "tidy_desk", "O2", True),
                ("swings-out-brisk", "fast_food", "train1", True),
                ("stops-halfway-there-hesitant", "dinner_plates", "T2", True),
            ],
            3,
        ),
        *others_slow(
            [
                ("reaches-out-and-returns-brisk", "cheeseburger", "T1", False),
                ("spirals-down-too-slowly-brisk", "morning_coffee", "train1", False),
            ],
            2,
        ),
    ],
)
def test_a_habit_that_attempts_nothing_rests_for_3_s_only_where_it_says_so(play, policy, task, condition, rests):
    played = play(policy, task, condition, 1, 190)
    body = played.agent.body
    assert (body.arm.log.closings, body.arm.log.first_touch) == ([], {})
    assert played.stated["first_attempt"] == "none"
    assert (distance(played.tool(130).position, played.tool(190).position) < 0.005) is rests


@pytest.mark.parametrize(
    ("policy", "task", "condition", "most"),
    others_slow(
        [
            ("loses-it-and-goes-on-brisk", "fast_food", "train1", 150),
            ("lets-go-outside-brisk", "cheeseburger", "train1", 150),
            ("puts-crooked-brisk", "breakfast_table", "train1", 150),
        ],
        3,
    ),
)
def test_a_put_that_is_meant_to_fail_fails(play, policy, task, condition, most):
    played = play(policy, task, condition, 1, most)
    body = played.agent.body
    name = body.situation.first_thing()
    assert name in body.taken
    assert in_gripper(body.state) is None
    assert not body.situation.done(body.state, body.situation.ahead[0])
    assert played.agent.ground_truth["truth"] == Label.EXECUTION_FAILURE


def test_sidling_comes_low_over_the_table_from_the_side(scene_of):
    scene = scene_of("seasoning_rack", "train1", 1)
    state = scene.reset()
    agent = make_independent("independent:sidles-in-brisk", scene)
    tools = []
    while not agent.body.arm.log.closings:
        scene.step(agent.act_on_state(state))
        state = scene.state()
        tools.append(state.ee_pose.position)
    x, y, z = agent.body.arm.log.closings[0].tool
    assert max(horizontal_distance(t, (x, y, z)) for t in tools if t[2] < z + 0.01) > 0.06


@pytest.mark.slow
@pytest.mark.parametrize("habit", ODD_ONES, ids=lambda h: h.name)
def test_an_honest_habit_succeeds_in_nearly_every_task(play, habit):
    shown = {s.task: s.condition for s in reversed(shown_in(habit.name))}
    won = [play(f"{habit.name}-calm", task, condition).success for task, condition in shown.items()]
    assert sum(won) >= len(won) - 1
