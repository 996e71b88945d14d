"""The comparison of joint signals with the simulator: what counts as a hold, and what joint states cannot show."""

import importlib
from collections import Counter
from pathlib import Path

import pytest
from tests.real.joint_script import Script

TOOLS = Path(__file__).resolve().parents[2] / "tools"
FOUND = "object held: a closing on an object is found"
NOTHING = "closing on nothing found: no object held"
SHUT = "object held in a fully shut jaw: a closing on nothing is found"


@pytest.fixture
def tool(monkeypatch):
    monkeypatch.syspath_prepend(str(TOOLS))
    return importlib.import_module("joint_signals")


def _compared(tool, *, opening, command, held=(), shut=()):
    """Compare one closing, from 1 s until 1.4 s, with the simulator's holds."""
    signals = Script().wait(1.0).grasp(opening=opening, command=command).signals()
    touched = (*held, *shut)
    truth = tool.Truth(held=held, shut=shut, touched=touched, empty=(), rests=False, to_and_fro=False)
    return Counter(row for row in tool.compare(signals, truth) if row[0] in (FOUND, NOTHING, SHUT))


def test_a_hold_that_need_not_be_found_does_not_contradict_a_closing_on_nothing(tool):
    """The jaw squeezes an object for one control step and slides off it."""
    assert _compared(tool, opening=0.5, command=0.0, held=((1.3, 1.3),)) == {(NOTHING, True): 1}


def test_a_hold_that_is_not_found_contradicts_a_closing_on_nothing(tool):
    rows = _compared(tool, opening=10.0, command=9.5, held=((1.4, 2.4),))
    assert rows == {(FOUND, False): 1, (NOTHING, False): 1}


def test_a_hold_in_a_fully_shut_jaw_has_its_own_row(tool):
    """Joint states of a jaw that holds an object by its tip are those of an empty one."""
    rows = _compared(tool, opening=1.7, command=0.6, shut=((1.4, 2.4),))
    assert rows == {(SHUT, True): 1, (NOTHING, True): 1}


def test_a_hold_in_a_fully_shut_jaw_without_a_closing_on_nothing_is_reported(tool):
    assert _compared(tool, opening=36.0, command=27.0, shut=((1.4, 2.4),)) == {(SHUT, False): 1}
