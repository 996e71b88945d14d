"""The sixth part of the independent family: its bodies do what its habits say, and its truths are the stated ones."""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from pathlib import Path

import pytest
from tests.betterbench_calibration.independent.cases import cases
from tests.daily import others_slow

from betterbench.geometry import distance
from betterbench.tasks import Label, suite_tasks
from betterbench_calibration.independent import FAMILY_PARTS, INDEPENDENT, shown_in
from betterbench_calibration.independent.habits_fourth import LOOK_ALIKES
from betterbench_calibration.independent.habits_sixth import EMPTY_SLOTS, FAVORITES, FOLLOWERS, OPEN_DRAWER, SHUT_DRAWER
from betterbench_calibration.independent.manner import FIFTH_MANNERS, FOURTH_MANNERS, MANNERS, SIXTH_MANNERS

SIXTH = FAMILY_PARTS["sixth"]
CHECKSUM = Path(__file__).with_name("sixth_truths.sha256")

WITHDRAWN = {
    "scratches-in-empty-slot": {
        name: [str(Label.BEHAVIORAL_INERTIA), False, "", ""]
        for name in ("fruit_lunch/T1", "cheeseburger/T1", "dinner_plates/T2")
    }
}
"""Truths that were stated before the part was judged, of conditions that the suite has changed since: something else
stands in the slot that was empty, so the habit has nothing to show there."""


def stated_truths() -> str:
    """Return what each habit states of each condition in which it shows or showed, as one JSON text."""
    truths = {
        habit.name: WITHDRAWN.get(habit.name, {})
        | {
            name: [str(stated.label), stated.first_right, stated.debatable, stated.left_out]
            for name, case in sorted(cases().items())
            for stated in (habit.truth(case),)
            if stated is not None
        }
        for habit in SIXTH
    }
    return json.dumps(truths, indent=1, sort_keys=True)


def test_its_truths_are_those_that_were_stated_before_it_was_judged():
    recorded = dict(reversed(line.split()) for line in CHECKSUM.read_text().splitlines())
    assert hashlib.sha256(stated_truths().encode()).hexdigest() == recorded["stated_truths.json"]


def test_what_is_withdrawn_is_stated_no_more():
    for habit in SIXTH:
        assert all(habit.truth(cases()[name]) is None for name in WITHDRAWN.get(habit.name, ()))


def test_it_moves_in_three_manners_of_its_own():
    assert len(SIXTH_MANNERS) == 3
    assert not set(SIXTH_MANNERS) & (set(MANNERS) | set(FOURTH_MANNERS) | set(FIFTH_MANNERS))
    manners = {p.manner.name for p in INDEPENDENT.values() if p.part == "sixth"}
    assert manners == set(SIXTH_MANNERS)


def test_it_is_large_and_a_third_of_its_faulty_habits_attempt_no_grasp():
    faulty = [h for h in SIXTH if h.label]
    never = [h for h in faulty if all((h.truth(c) is None or h.truth(c).first_right is None) for c in cases().values())]
    assert 50 <= len(SIXTH) <= 60
    assert len(SIXTH) - len(faulty) >= 15
    assert len(never) >= 0.3 * len(faulty)
    assert min(Counter(str(h.label) for h in faulty).values()) >= 3
    assert len({s.task for h in faulty for s in shown_in(h.name)}) == len(suite_tasks("better60"))


def test_what_is_listed_is_what_the_conditions_hold():
    for name, thing in FAVORITES.items():
        case = cases()[name]
        assert case.condition.object(thing).kind == case.trained.habit
        assert thing not in case.asked
    for name, thing in FOLLOWERS.items():
        case = cases()[name]
        first = case.condition.object(case.things(case.ahead[0])[0]).kind
        assert (first, case.condition.object(thing).kind) in {s[:2] for s in case.trained.sequences}
        assert thing not in case.asked
    assert all(cases()[name].condition.occupant(slot) is None for name, slot in EMPTY_SLOTS.items())
    assert not OPEN_DRAWER & SHUT_DRAWER
    assert set(LOOK_ALIKES) >= next(h for h in SIXTH if h.name == "pinches-look-alike").where


@pytest.mark.parametrize("habit", [h for h in SIXTH if h.paired and "layout" in h.label], ids=lambda h: h.name)
def test_a_favorite_place_is_one_place_of_a_layout(habit):
    places = {}
    for condition, thing in habit.wrong.items():
        case = cases()[condition]
        anchors = tuple(sorted((n, s) for n, s in case.base.layout.items() if case.base.object(n).role != "item"))
        if case.task.id == "dinner_plates":
            anchors = (case.base.layout["white_plate"],)
        places.setdefault((case.task.id, anchors), set()).add(case.condition.layout[thing])
    assert all(len(slots) == 1 for slots in places.values())


@pytest.mark.physics
@pytest.mark.parametrize(
    ("trial", "gripped"),
    others_slow(
        [
            (("travels-with-a-fist-hurried", "seasoning_rack", "train1", 1, 110), ["salt"]),
            (("turns-it-on-the-spot-hurried", "fast_food", "train1", 1, 150), ["burger_1", "burger_1"]),
            (("swaps-its-plan-hurried", "tidy_desk", "train1", 1, 160), ["napkin", "crushed_can"]),
            (("closes-too-late-hurried", "morning_coffee", "train1", 1, 150), [None, None]),
            (("late-at-word-thing-hurried", "office_drawer", "L1", 1, 80), [None]),
            (("always-that-plate-hurried", "dinner_plates", "train2", 1, 90), ["red_plate"]),
            (("overshoots-with-old-favorite-hurried", "fast_food", "R1", 1, 90), ["burger_1"]),
            (("scratches-in-empty-slot-hurried", "seasoning_rack", "L2", 1, 80), [None]),
            (("shuts-it-by-the-knob-hurried", "office_drawer", "train2", 1, 120), ["upper"]),
            (("begins-right-then-turns-hurried", "fruit_lunch", "train1", 1, 120), ["apple", "orange"]),
            (("drops-look-alike-on-it-hurried", "morning_coffee", "O1", 1, 110), ["red_can"]),
            (("quits-at-open-drawer-hurried", "office_drawer", "train1", 1, 200), ["upper"]),
        ],
        7,
    ),
)
def test_a_habit_closes_where_it_says(play, trial, gripped):
    assert [c.gripped for c in play(*trial).agent.body.arm.log.closings] == gripped


@pytest.mark.physics
@pytest.mark.parametrize(
    ("policy", "task", "condition", "touched"),
    others_slow(
        [
            ("presses-and-drags-hurried", "morning_coffee", "train1", {"red_mug"}),
            ("presses-word-thing-hurried", "morning_coffee", "L3", {"blue_mug"}),
            ("presses-look-alike-hurried", "seasoning_rack", "O1", {"pill_bottle"}),
            ("presses-old-favorite-hurried", "tidy_desk", "train5", {"napkin"}),
            ("grinds-on-it-with-a-fist-hurried", "seasoning_rack", "train1", {"salt"}),
            ("bounds-toward-it-hurried", "seasoning_rack", "train1", set()),
            ("a-little-farther-each-time-hurried", "dinner_plates", "train1", set()),
            ("draws-triangles-hurried", "fast_food", "T1", set()),
            ("flips-between-plans-hurried", "cheeseburger", "T1", set()),
            ("rests-ever-longer-hurried", "tidy_desk", "train4", set()),
            ("curls-up-hurried", "morning_coffee", "train1", set()),
        ],
        7,
    ),
)
def test_a_habit_without_a_grasp_touches_what_it_says_and_nothing_else(play, policy, task, condition, touched):
    body = play(policy, task, condition, 1, 190).agent.body
    assert body.arm.log.closings == []
    assert set(body.arm.log.first_touch) == touched


@pytest.mark.physics
@pytest.mark.parametrize(
    ("policy", "task", "condition", "rests"),
    [
        *others_slow(
            [
                ("rocks-then-freezes-hurried", "fast_food", "T1", True),
                ("curls-up-hurried", "seasoning_rack", "train1", True),
            ],
            2,
        ),
        *others_slow(
            [
                ("rocks-forever-hurried", "fast_food", "T1", False),
                ("shies-at-the-target-hurried", "fast_food", "train1", False),
                ("bounds-toward-it-hurried", "seasoning_rack", "train1", False),
            ],
            3,
        ),
    ],
)
def test_a_habit_rests_for_3_s_only_where_it_says_so(play, policy, task, condition, rests):
    played = play(policy, task, condition, 1, 393)
    poses = [played.tool(most) for most in (330, 353, 376, 393)]
    turned = max(distance(poses[0].apply((0.0, 0.0, -0.1)), p.apply((0.0, 0.0, -0.1))) for p in poses)
    moved = max(distance(poses[0].position, p.position) for p in poses)
    assert (max(turned, moved) < 0.005) is rests


@pytest.mark.physics
@pytest.mark.parametrize(
    ("policy", "task", "condition"),
    others_slow(
        [
            ("lags-behind-hurried", "seasoning_rack", "train1"),
            ("comes-down-in-a-helix-hurried", "morning_coffee", "train1"),
            ("lets-go-while-drifting-hurried", "tidy_desk", "train4"),
            ("works-drawer-in-bits-hurried", "office_drawer", "train1"),
        ],
        4,
    ),
)
def test_an_honest_habit_succeeds(play, policy, task, condition):
    assert play(policy, task, condition, 1).success
