"""Part of a large enumeration that the default tests check today; a slow test checks the whole."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from datetime import UTC, datetime
from typing import Any, TypeVar

import pytest

ItemT = TypeVar("ItemT")
TestT = TypeVar("TestT", bound=Callable[..., None])

VARIABLE = "BETTERBENCH_TEST_DAY"
"""Environment variable with the number of the day; the first process of a run sets it for all others."""

TODAY = int(os.environ.setdefault(VARIABLE, str(datetime.now(UTC).toordinal())))
"""Number of the day (UTC) on which this run of the tests began."""


def part_of_today(cases: Sequence[ItemT], parts: int, *, day: int = TODAY) -> list[ItemT]:
    """Return every ``parts``-th case, beginning with another one each day; ``parts`` days cover all cases."""
    return [*cases[day % parts :: parts]]


def others_slow(cases: Iterable[Any], parts: int, *, day: int = TODAY) -> list[Any]:
    """Return the cases as parameters of a test; those that are not the part of today are slow tests."""
    listed = [case if isinstance(case, tuple) else (case,) for case in cases]
    return [pytest.param(*c, marks=() if i % parts == day % parts else pytest.mark.slow) for i, c in enumerate(listed)]


def in_turn(number: int, parts: int, *, day: int = TODAY) -> Callable[[TestT], TestT]:
    """Return the decorator of one of several similar tests: each is a slow test except every ``parts``-th day."""
    if number % parts == day % parts:
        return lambda test: test
    return pytest.mark.slow
