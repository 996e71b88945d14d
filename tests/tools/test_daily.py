"""Tests that check a part of their cases each day."""

from __future__ import annotations

import pytest
from tests.daily import in_turn, others_slow, part_of_today


@pytest.mark.parametrize("parts", [1, 2, 3, 7])
def test_every_case_has_its_day_and_none_has_two(parts):
    cases = ["a", "b", "c", "d", "e"]
    for first in (0, 739_000):
        days = [part_of_today(cases, parts, day=first + i) for i in range(parts)]
        assert sorted(case for day in days for case in day) == cases


@pytest.mark.parametrize("day", range(6))
def test_the_default_and_the_slow_tests_of_a_day_have_all_cases(day):
    cases = [("a", 1), ("b", 2), ("c", 3), ("d", 4), ("e", 5)]
    parameters = others_slow(cases, 3, day=day)
    assert [p.values for p in parameters] == cases
    assert [p.values for p in parameters if not p.marks] == part_of_today(cases, 3, day=day)
    assert [p.values for p in others_slow("ab", 1)] == [("a",), ("b",)]


def test_similar_tests_take_turns():
    for number in range(5):
        marks = [[mark.name for mark in marks_of(in_turn(number, 3, day=day))] for day in range(739_000, 739_003)]
        assert sorted(marks) == [[], ["slow"], ["slow"]]


def marks_of(decorate):
    def test():
        pass

    return getattr(decorate(test), "pytestmark", [])
