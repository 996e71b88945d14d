"""A run whose first trials all end with the same error warns once, and goes on."""

from __future__ import annotations

import logging

import pytest
from tests.evaluation.misbehaving import Misbehaving

from betterbench.evaluation import evaluate
from betterbench.evaluation.running.failing_start import FIRST_TRIALS, FailingStart
from betterbench.records import JournalEntry


def entry(seed, message):
    return JournalEntry("fast_food", "T1", "T1", seed, "done", message)


def warnings_after(caplog, messages):
    caplog.clear()
    warning = FailingStart("openpi://here:1")
    with caplog.at_level(logging.WARNING, logger="betterbench.evaluation.running.failing_start"):
        for seed, message in enumerate(messages):
            warning.add(entry(seed, message))
    return [record.getMessage() for record in caplog.records]


def test_the_same_error_from_the_beginning_is_told_once_with_what_to_try(caplog):
    (told,) = warnings_after(caplog, [f"the reply's 'actions' has shape (50, 32), step {i}" for i in range(12)])
    assert "(50, 32)" in told
    assert "better doctor --policy 'openpi://here:1'" in told
    assert "Ctrl-C" in told


@pytest.mark.parametrize(
    "messages",
    [
        ["bad"] * (FIRST_TRIALS - 1),
        [None, *["bad"] * 20],
        ["bad", "bad", None, *["bad"] * 20],
        ["bad", "worse", *["bad"] * 20],
    ],
    ids=["too few", "one that worked before", "one that worked between", "two reasons"],
)
def test_anything_else_is_left_to_the_diagnosis(caplog, messages):
    assert warnings_after(caplog, messages) == []


@pytest.mark.usefixtures("short_trials")
def test_a_run_that_breaks_from_the_beginning_is_finished_all_the_same(caplog, tiny_plan, tmp_path):
    with (
        Misbehaving(lambda *_: "wrong shape") as server,
        caplog.at_level(logging.WARNING, logger="betterbench.evaluation.running.failing_start"),
    ):
        run = evaluate(tiny_plan(server.address, trials=FIRST_TRIALS + 1), tmp_path / "run")
    assert [e.status for e in run.entries()] == ["done"] * (FIRST_TRIALS + 1)
    assert sum("all ended with the same error" in r.getMessage() for r in caplog.records) == 1
