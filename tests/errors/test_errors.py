"""What people read when something is wrong: the closest names, what exists, and the cure."""

from __future__ import annotations

import inspect
import multiprocessing

import pytest
from tests.looping import each

from betterbench import errors
from betterbench.errors import BetterError, InvalidInputError, UnknownNameError

KINDS = [e for _, e in inspect.getmembers(errors, inspect.isclass) if issubclass(e, BetterError)]


def example(kind: type[BetterError]) -> BetterError:
    if kind is UnknownNameError:
        return UnknownNameError("task", "fast_fod", ["morning_coffee", "fast_food"])
    if kind is InvalidInputError:
        return InvalidInputError("--trials", "0 is not positive", "Give at least 1")
    return kind("one clear line")


def test_unknown_name_lists_the_closest_first_then_everything():
    error = UnknownNameError("task", "fast_fod", ["tidy_desk", "fast_food", "morning_coffee"])
    assert str(error) == (
        "Unknown task 'fast_fod'. Did you mean 'fast_food'? Known: fast_food, morning_coffee, tidy_desk."
    )
    assert error.closest == ("fast_food",)
    assert error.known == ("fast_food", "morning_coffee", "tidy_desk")


def test_unknown_name_offers_several_close_names_best_first():
    error = UnknownNameError("slot", "neer", ["near", "beer", "far"])
    assert set(error.closest) == {"near", "beer"}
    assert "Did you mean" in str(error)
    assert " or " in str(error)


@pytest.mark.parametrize("name", ["t1", "T1 ", "\tT1\n"])
def test_unknown_name_that_differs_in_case_or_white_space_is_shown_as_given(name):
    error = UnknownNameError("variation", name, ["O1", "R1", "T1"])
    assert error.closest[0] == "T1"
    assert str(error).startswith(f"Unknown variation {name!r}. Did you mean 'T1'")


def test_unknown_name_that_resembles_nothing_gets_no_guess():
    error = UnknownNameError("policy", "zzzzzz", ["expert", "noop"])
    assert str(error) == "Unknown policy 'zzzzzz'. Known: expert, noop."
    assert error.closest == ()


def test_unknown_name_among_none_says_so():
    assert str(UnknownNameError("task", "x", [])) == "Unknown task 'x'. Known: none."


@pytest.mark.parametrize("cure", ["Give at least 1", "Give at least 1."])
def test_invalid_input_names_field_problem_and_cure_in_one_line(cure):
    error = InvalidInputError("--trials", "0 is not positive", cure)
    assert str(error) == "--trials: 0 is not positive. Give at least 1."
    assert (error.where, error.problem) == ("--trials", "0 is not positive")


@each("kind", KINDS, name=lambda k: k.__name__)
def test_every_error_is_one_line_and_a_better_error(kind):
    error = example(kind)
    assert isinstance(error, BetterError)
    assert "\n" not in str(error)
    assert kind.__doc__


@each("kind", KINDS, name=lambda k: k.__name__)
def test_every_error_travels_between_processes_unchanged(kind):
    here, there = multiprocessing.Pipe()
    with here, there:
        here.send(example(kind))
        got = there.recv()
    assert type(got) is kind
    assert str(got) == str(example(kind))
    assert vars(got) == vars(example(kind))


@each("kind", KINDS)
def test_an_error_survives_what_gymnasium_does_with_it(kind):
    """Its vector environments raise ``type(error)(error)`` in the process that waits."""
    copy = kind(example(kind))
    assert str(copy) == str(example(kind))
