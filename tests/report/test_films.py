"""Films: which moments of a trial and of its twin are shown, and what they are called."""

from __future__ import annotations

import sys
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from tests.looping import each

sys.path.insert(0, str(Path(__file__).parent))

from factory import diagnosis, draw_frame, trial

from betterbench.diagnosis.verdict import Attempt, Evidence, Label
from betterbench.report import Frame, trials_worth_showing
from betterbench.report.figures.film import ACTS, LEAD_S
from betterbench.report.pages.page import _around


def step(start, name, result="target", length=0.2):
    return Attempt(start, start + length, name, None, result, result != "null")


def showing_of(varied, twin):
    return next(s for s in trials_worth_showing(diagnosis([varied, twin]), 2) if s.trial == varied.key)


def evidence(start, end, *objects):
    return Evidence("rule", "What the record shows.", start, end, objects)


def test_the_film_says_attempt_only_of_a_grasp():
    """A cup that is dropped on its way shows no attempt at the time of the drop."""
    twin = trial(variation=None, attempts=(step(2.0, "cup"),))
    failed = partial(trial, label=Label.EXECUTION_FAILURE, attempts=(step(2.0, "cup"),), duration_s=30.0)
    grasp = showing_of(failed(evidence=evidence(2.0, 2.2, "cup")), twin)
    assert dict(zip(grasp.times_s, grasp.captions, strict=True))[2.0] == "attempt"
    drop = showing_of(failed(evidence=evidence(5.0, 6.5, "cup")), twin)
    assert dict(zip(drop.times_s, drop.captions, strict=True))[5.0] == "evidence"


def test_the_frame_after_a_grasp_shows_what_became_of_it():
    """A gripper takes a fifth of a second to close: what it has taken is seen when it is lifted."""
    failed = trial(label=Label.WRONG_OBJECT, attempts=(step(2.0, "spoon", "distractor"),), duration_s=30.0)
    short = showing_of(replace(failed, evidence=evidence(2.0, 2.2, "spoon")), trial(variation=None))
    assert short.times_s[short.captions.index("after")] == pytest.approx(2.2 + LEAD_S)
    long = showing_of(replace(failed, evidence=evidence(2.0, 9.0, "spoon")), trial(variation=None))
    assert long.times_s[long.captions.index("after")] == 9.0


@each(
    "attempts, start, objects, moment",
    [
        # the look-alike of the second step stands for the cup, the second thing that the twin takes
        ((step(2.0, "fork"), step(10.0, "tumbler", "distractor")), 10.0, ("tumbler",), 9.0),
        # a second try at the first step is no second step
        ((step(2.0, "fork"), step(5.0, "fork"), step(10.0, "tumbler", "distractor")), 10.0, ("tumbler",), 9.0),
        # the cup came first here and second there
        ((step(2.0, "cup"),), 2.0, ("cup",), 9.0),
        # it is let go 4 s after its grasp
        ((step(2.0, "cup"),), 6.0, ("cup", "plate"), 13.0),
        # nothing was held when it was missed
        ((step(2.0, "fork"), step(10.0, None, "null")), 10.0, ("cup",), 9.0),
        # the arm halts after the first step, and before it
        ((step(2.0, "fork"),), 6.0, (), 9.0),
        ((), 0.5, (), 2.1),
        # done with all of it: the last step
        ((step(2.0, "fork"), step(10.0, "cup")), 25.0, (), 9.0),
    ],
)
def test_the_twin_is_shown_at_the_same_step(attempts, start, objects, moment):
    twin = trial(variation=None, attempts=(step(2.1, "fork"), step(9.0, "cup")), duration_s=20.0)
    failed = trial(
        label=Label.EXECUTION_FAILURE,
        attempts=attempts,
        evidence=evidence(start, start + 0.2, *objects),
        duration_s=30.0,
    )
    showing = showing_of(failed, twin)
    acts = [t for t, c in zip(showing.twin_times_s, showing.twin_captions, strict=True) if c in ACTS]
    assert acts == [moment]


def test_the_first_screen_shows_before_at_and_after_the_evidence():
    """Of an arm that stands still from 0.5 s to the end, the end is shown too."""
    image = draw_frame(np.random.default_rng(0), size=16)
    times = (0.0, 0.25, 0.5, 51.0)
    assert [f.time_s for f in _around(tuple(Frame(t, image) for t in times), 0.5)] == [0.25, 0.5, 51.0]
    times = (0.0, 1.9, 2.9, 4.1, 51.0)
    assert [f.time_s for f in _around(tuple(Frame(t, image) for t in times), 2.9)] == [1.9, 2.9, 4.1]
    assert [f.time_s for f in _around(tuple(Frame(t, image) for t in times), 51.0)] == [2.9, 4.1, 51.0]
    assert [f.time_s for f in _around(tuple(Frame(t, image) for t in times), 0.0)] == [0.0, 1.9, 2.9]
    assert len(_around((), 0.0)) == 0
