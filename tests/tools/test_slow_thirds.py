"""Each slow test is in one of three thirds, and the thirds are about equal."""

from __future__ import annotations

import argparse
import contextlib
import time
from collections import Counter
from pathlib import Path
from types import SimpleNamespace

import pytest
from tests import conftest
from tests.conftest import THIRDS, pytest_collection_modifyitems, pytest_runtest_setup, third, thirds_of

TESTS = [f"tests/{file}.py::test_it[{i}]" for file, count in (("a", 7), ("b", 1), ("c", 30)) for i in range(count)]


def test_the_tests_of_a_file_are_dealt_out_evenly():
    found = dict(zip(TESTS, thirds_of(TESTS), strict=True))
    for file in ("a", "b", "c"):
        sizes = Counter(third for test, third in found.items() if test.startswith(f"tests/{file}.py"))
        assert set(sizes) <= set(THIRDS)
        assert max(sizes.values()) - min(sizes[third] for third in THIRDS) <= 1


def test_a_test_of_another_file_moves_none():
    more = ["tests/0.py::test_new", *TESTS]
    assert thirds_of(more)[1:] == thirds_of(TESTS)


def test_single_tests_of_many_files_are_spread():
    sizes = Counter(thirds_of([f"tests/test_{i}.py::test_it" for i in range(300)]))
    assert all(80 <= sizes[third] <= 120 for third in THIRDS)


class Item(SimpleNamespace):
    __hash__ = object.__hash__

    def get_closest_marker(self, name):
        return name if name == "slow" and self.slow else None


def config_with(hook, slow_third, lf=False):
    options = {"--slow-third": slow_third, "lf": lf}
    return SimpleNamespace(getoption=lambda name, **_: options[name], hook=hook)


def test_all_failed_tests_run_a_second_time():
    items = [Item(nodeid=test, slow=True) for test in TESTS]
    kept = list(items)
    pytest_collection_modifyitems(config_with(hook=None, slow_third=1, lf=True), kept)
    assert kept == items


def test_three_days_run_all_thirds(monkeypatch):
    found = []
    for day in range(739950, 739953):
        monkeypatch.setattr(conftest, "TODAY", day)
        found.append(third("today"))
    assert sorted(found) == list(THIRDS)
    assert third("2") == 2
    with pytest.raises(argparse.ArgumentTypeError, match="'4' is not 1, 2, 3 or today"):
        third("4")


@pytest.mark.parametrize("number", [None, *THIRDS])
def test_the_option_keeps_a_third_of_the_slow_tests_and_all_others(number):
    items = [Item(nodeid=test, slow=i % 2 == 0) for i, test in enumerate(TESTS)]
    slow = [item for item in items if item.slow]
    dropped, kept = [], list(items)

    def deselected(items):
        dropped.extend(items)

    hook = SimpleNamespace(pytest_deselected=deselected)
    pytest_collection_modifyitems(config_with(hook=hook, slow_third=number), kept)
    wanted = [
        item for item, found in zip(slow, thirds_of([i.nodeid for i in slow]), strict=True) if number in (None, found)
    ]
    assert [item for item in kept if item.slow] == wanted
    assert [item for item in kept if not item.slow] == [item for item in items if not item.slow]
    assert sorted(item.nodeid for item in (*kept, *dropped)) == sorted(TESTS)


@pytest.mark.parametrize(("slow", "minutes", "skipped"), [(True, 0.0, True), (False, 0.0, False), (True, None, False)])
def test_slow_tests_that_begin_too_late_are_skipped(monkeypatch, slow, minutes, skipped):
    monkeypatch.setattr(conftest, "BEGAN", time.monotonic() - 1.0)
    item = Item(nodeid="x", slow=slow, config=SimpleNamespace(getoption=lambda _: minutes))
    with pytest.raises(pytest.skip.Exception, match="not begun") if skipped else contextlib.nullcontext():
        pytest_runtest_setup(item)


def test_continuous_integration_runs_all_default_tests_and_a_third_of_the_slow_tests():
    root = Path(__file__).parents[2]
    lines = (root / ".ci" / "run").read_text(encoding="utf-8").splitlines()
    assert 'make test ARGS="--again"' in lines
    assert [line for line in lines if "make test-slow" in line] == [
        'make test-slow ARGS="tests/sim/worlds/test_calvin.py -k thousand_chains --again"',
        'make test-slow ARGS="--slow-third today --slow-minutes 30 --again"',
    ]
    assert "thousand_chains" in (root / "tests/sim/worlds/test_calvin.py").read_text(encoding="utf-8")
