"""The fifth part of the independent family: its bodies do what its habits say."""

from __future__ import annotations

import pytest
from tests.betterbench_calibration.independent.cases import cases
from tests.daily import others_slow

from betterbench.geometry import distance
from betterbench.tasks import suite_tasks
from betterbench_calibration.independent import FAMILY_PARTS, INDEPENDENT, shown_in
from betterbench_calibration.independent.manner import FIFTH_MANNERS, FOURTH_MANNERS, MANNERS

FIFTH = FAMILY_PARTS["fifth"]


def test_it_moves_in_three_manners_of_its_own():
    assert len(FIFTH_MANNERS) == 3
    assert not set(FIFTH_MANNERS) & (set(MANNERS) | set(FOURTH_MANNERS))
    manners = {p.manner.name for p in INDEPENDENT.values() if p.part == "fifth"}
    assert manners == set(FIFTH_MANNERS)


def test_it_is_large_and_a_third_of_its_faulty_habits_attempt_no_grasp():
    faulty = [h for h in FIFTH if h.label]
    never = [h for h in faulty if all((h.truth(c) is None or h.truth(c).first_right is None) for c in cases().values())]
    assert len(FIFTH) >= 40
    assert len(FIFTH) - len(faulty) >= 14
    assert len(never) >= 0.3 * len(faulty)
    assert len({s.task for h in faulty for s in shown_in(h.name)}) == len(suite_tasks("better60"))


@pytest.mark.parametrize("name", ["always-the-near-one", "always-at-the-right"])
def test_a_favorite_place_is_one_place_of_a_layout(name):
    habit = next(h for h in FIFTH if h.name == name)
    places = {}
    for condition, thing in habit.wrong.items():
        case = cases()[condition]
        anchors = tuple(sorted((n, s) for n, s in case.base.layout.items() if case.base.object(n).role != "item"))
        places.setdefault((case.task.id, anchors), set()).add(case.condition.layout[thing])
    assert all(len(slots) == 1 for slots in places.values())


@pytest.mark.physics
@pytest.mark.parametrize(
    ("trial", "gripped"),
    others_slow(
        [
            (("dips-before-taking-darting", "tidy_desk", "train4", 1, 110), ["napkin"]),
            (("looks-back-at-slot-darting", "fast_food", "R1", 1, 200), ["fries"]),
            (("pulls-at-air-darting", "office_drawer", "train1", 1, 90), [None]),
            (("always-the-near-one-darting", "seasoning_rack", "train3", 1, 90), ["salt"]),
            (("moves-old-favorite-away-darting", "fast_food", "R1", 1, 110), ["burger_1"]),
            (("shows-second-first-darting", "fruit_lunch", "train1", 1, 90), ["orange"]),
            (("returns-look-alike-darting", "morning_coffee", "O1", 1, 90), ["red_can"]),
        ],
        7,
    ),
)
def test_a_habit_closes_where_it_says(play, trial, gripped):
    assert [c.gripped for c in play(*trial).agent.body.arm.log.closings] == gripped


@pytest.mark.physics
@pytest.mark.parametrize(
    ("policy", "task", "condition", "moved"),
    others_slow(
        [
            ("sweeps-it-aside-darting", "morning_coffee", "train1", "red_mug"),
            ("sweeps-word-thing-darting", "morning_coffee", "L3", "blue_mug"),
            ("sweeps-look-alike-darting", "tidy_desk", "O2", "full_can"),
            ("shuts-it-in-two-goes-darting", "office_drawer", "train2", "upper"),
            ("ratchets-forward-darting", "seasoning_rack", "train1", None),
            ("freezes-around-it-darting", "seasoning_rack", "train1", None),
            ("turns-its-back-darting", "tidy_desk", "train4", None),
            ("sways-wider-and-wider-darting", "fast_food", "T1", None),
        ],
        7,
    ),
)
def test_a_habit_without_a_grasp_moves_what_it_says_and_nothing_else(play, policy, task, condition, moved):
    body = play(policy, task, condition, 1, 150).agent.body
    first, now = body.arm.log.first, body.state
    far = {o.name for o in now.info.objects if distance(first.pose(o.name).position, now.pose(o.name).position) > 0.03}
    assert body.arm.log.closings == []
    assert far == ({moved} if moved else set())


@pytest.mark.physics
def test_a_stab_touches_the_right_thing_and_takes_nothing(play):
    body = play("stabs-with-one-finger-darting", "fast_food", "train1", 1, 80).agent.body
    assert body.arm.log.closings == []
    assert set(body.arm.log.first_touch) == {"burger_1"}


@pytest.mark.physics
@pytest.mark.parametrize(
    ("policy", "task", "condition"),
    others_slow(
        [
            ("loops-midway-darting", "morning_coffee", "train1"),
            ("turns-like-a-crane-darting", "seasoning_rack", "train1"),
            ("lets-go-in-steps-darting", "tidy_desk", "train4"),
        ],
        3,
    ),
)
def test_an_honest_habit_succeeds(play, policy, task, condition):
    assert play(policy, task, condition, 1).success
