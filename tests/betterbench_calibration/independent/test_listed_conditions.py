"""Habits of the fourth, the fifth and the sixth part show in conditions that they list by name."""

from __future__ import annotations

import pytest
from tests.betterbench_calibration.independent.cases import cases
from tests.looping import each

from betterbench_calibration.independent import FAMILY_PARTS

HABITS = [*FAMILY_PARTS["fourth"], *FAMILY_PARTS["fifth"], *FAMILY_PARTS["sixth"]]
LISTED = [h for h in HABITS if hasattr(h, "where")]
PAIRED = [h for h in HABITS if h.paired]
OF_EMPTY_SLOTS = [h for h in HABITS if hasattr(h, "slots")]
OF_FINISHED_STEPS = [h for h in HABITS if hasattr(h, "finished")]
OF_THINGS_NOT_ASKED_FOR = [h for h in HABITS if hasattr(h, "favorite") or hasattr(h, "follower")]


@each("habit", LISTED, name=lambda h: h.name)
def test_the_conditions_it_lists_exist(habit):
    assert habit.where <= set(cases())


@each("habit", PAIRED, name=lambda h: h.name)
def test_a_rule_of_several_trials_is_wrong_only_where_it_says_so(habit):
    for name, thing in habit.wrong.items():
        case = cases()[name]
        assert thing in case.condition.layout
        assert thing not in case.asked
    assert all(cases()[name].plain for name in habit.fine)
    assert not habit.fine & set(habit.wrong)


@pytest.mark.parametrize("habit", OF_EMPTY_SLOTS, ids=lambda h: h.name)
def test_a_slot_that_it_gropes_in_is_empty(habit):
    for name, slot in habit.slots.items():
        trained = cases()[name].task.training
        assert cases()[name].condition.occupant(slot) is None
        assert any(slot in c.layout.values() for c in trained)


@pytest.mark.parametrize("habit", OF_FINISHED_STEPS, ids=lambda h: h.name)
def test_what_it_does_again_is_done_at_the_start(habit):
    assert all(thing in cases()[name].condition.preplaced for name, thing in habit.finished.items())


@pytest.mark.parametrize("habit", OF_THINGS_NOT_ASKED_FOR, ids=lambda h: h.name)
def test_what_it_takes_out_of_habit_stands_there_and_is_not_asked_for(habit):
    for name, thing in (getattr(habit, "favorite", {}) | getattr(habit, "follower", {})).items():
        assert thing in cases()[name].condition.layout
        assert thing not in cases()[name].asked
