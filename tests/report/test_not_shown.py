"""The sentence of a card that says what a pass does not show, from the measured trials."""

from __future__ import annotations

import pytest

from betterbench.diagnosis.measures.power_matrix import PowerCell, PowerMatrix
from betterbench.report.pages.not_shown import not_shown, passing_pretenders


def measured(key, **cells):
    names = {"word": "zoo:lexical", "color": "zoo:color", "deaf": "probe:no-language", "replay": "probe:replay"}
    names |= {"blind": "probe:no-images"}
    return PowerMatrix({names[n]: {key: PowerCell(k, total, k)} for n, (k, total) in cells.items()}, {}, {})


@pytest.mark.parametrize(
    ("key", "cells", "sentence"),
    [
        (
            ("fruit_lunch", "R1"),
            {"word": (6, 6), "deaf": (3, 8), "replay": (0, 7)},
            "without finding the named object outside its training slot (`zoo:lexical` passes 6 of 6 trials).",
        ),
        (
            ("fruit_lunch", "O2"),
            {"word": (0, 6), "deaf": (7, 7), "color": (0, 6)},
            "without following the instruction (`probe:no-language` passes 7 of 7 trials).",
        ),
        (
            ("fruit_lunch", "T1"),
            {"deaf": (4, 8), "replay": (3, 7), "blind": (2, 7)},
            (
                "without looking at the scene (`probe:no-images` passes 2 of 7 trials, "
                "`probe:replay` passes 3 of 7 trials)."
            ),
        ),
    ],
)
def test_the_sentence_names_what_passes_and_how_often(key, cells, sentence):
    assert not_shown(measured(key, **cells), key) == f"A policy can pass {sentence}"


def test_several_abilities_are_joined_in_one_sentence():
    key = ("fruit_lunch", "O2")
    text = not_shown(measured(key, word=(6, 6), deaf=(7, 7), color=(6, 6)), key)
    assert text == (
        "A policy can pass without following the instruction (`probe:no-language` passes 7 of 7 trials), "
        "without finding the named object outside its training slot (`zoo:lexical` passes 6 of 6 trials) or "
        "without distinguishing the requested object from objects of the same color "
        "(`zoo:color` passes 6 of 6 trials)."
    )


def test_a_rule_for_look_alikes_counts_only_where_something_looks_alike():
    for name, expected in (("O2", ("zoo:color",)), ("L1", ())):
        key = ("seasoning_rack", name)
        assert passing_pretenders(measured(key, color=(6, 6)), key) == expected


def test_half_is_no_pass_and_nothing_measured_is_nothing_shown():
    key = ("fruit_lunch", "T1")
    assert passing_pretenders(measured(key, word=(3, 6), deaf=(7, 14)), key) == ()
    assert not_shown(measured(key), key).startswith("The power of this variation was not measured")
    assert not_shown(measured(key, word=(3, 6)), key).startswith("No measured policy")
