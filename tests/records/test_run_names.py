"""Runs side by side have names that tell them apart."""

from __future__ import annotations

from pathlib import Path

import pytest

from betterbench.errors import InvalidInputError
from betterbench.records import RunFolder, run_names


def run(folder: str, address: str, declared: object = None) -> RunFolder:
    context = {} if declared is None else {"policy": {"address": address, "name": declared}}
    return RunFolder(Path(folder), {"policy": address}, context)


def test_a_run_is_called_by_the_name_that_its_policy_declared():
    runs = [run("a", "python:my.py:Mine", "step 5000"), run("b", "expert", "expert"), run("c", "noop")]
    assert run_names(runs) == ("step 5000", "expert", "noop")


def test_two_checkpoints_of_one_server_are_told_apart_by_their_folders():
    runs = [run("runs/step1", "openpi://h:8000", "openpi://h:8000"), run("runs/step2", "openpi://h:8000")]
    assert run_names(runs) == ("openpi://h:8000 (step1)", "openpi://h:8000 (step2)")
    assert len(set(run_names([run("x/same", "noop"), run("y/same", "noop")]))) == 2


def test_a_declared_name_does_not_hide_whose_run_it_is():
    assert run_names([run("a", "expert"), run("b", "python:my.py:Mine", "expert")]) == ("expert", "python:my.py:Mine")
    assert run_names([run("a", "python:my.py:Mine", "mine"), run("b", "openpi://h", "mine")]) == (
        "python:my.py:Mine",
        "openpi://h",
    )


@pytest.mark.parametrize("built_in", ["noop", "Expert", "random", "zoo:lexical", "probe:replay"])
def test_a_policy_derived_from_a_built_in_one_is_not_called_by_its_name(built_in):
    assert run_names([run("a", "python:my.py:Mine", built_in)]) == ("python:my.py:Mine",)
    assert run_names([run("a", built_in, built_in)]) == (built_in,)


def test_names_of_strangers_are_one_line_of_bounded_length():
    name = run_names([run("a", "noop", "\x1b[31mred\n" + "x" * 10**6)])[0]
    assert name.isprintable()
    assert len(name) <= 80
    assert run_names([run("a", "noop", ["no text"])]) == ("noop",)


def test_given_names_stand_for_the_runs_in_their_order():
    runs = [run("a", "noop"), run("b", "noop")]
    assert run_names(runs, ["before", "after"]) == ("before", "after")
    for wrong in (["one"], ["one", "one"], ["one", " "], ["one", "a\nb"], ["one", "x" * 81], ["a", "b", "c"]):
        with pytest.raises(InvalidInputError, match=r"^--name: "):
            run_names(runs, wrong)
