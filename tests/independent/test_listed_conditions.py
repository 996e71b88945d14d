"""Habits of the fourth, the fifth and the sixth part show in conditions that they list by name."""

from __future__ import annotations

import pytest
from tests.independent.cases import CASES

from betterbench.independent import FAMILY_PARTS

HABITS = [*FAMILY_PARTS["fourth"], *FAMILY_PARTS["fifth"], *FAMILY_PARTS["sixth"]]
LISTED = [h for h in HABITS if hasattr(h, "where")]
PAIRED = [h for h in HABITS if h.paired]


@pytest.mark.parametrize("habit", LISTED, ids=lambda h: h.name)
def test_the_conditions_it_lists_exist(habit):
    assert habit.where <= set(CASES)


@pytest.mark.parametrize("habit", PAIRED, ids=lambda h: h.name)
def test_a_rule_of_several_trials_is_wrong_only_where_it_says_so(habit):
    for name, thing in habit.wrong.items():
        case = CASES[name]
        assert thing in case.condition.layout
        assert thing not in case.asked
    assert all(CASES[name].plain for name in habit.fine)
    assert not habit.fine & set(habit.wrong)
