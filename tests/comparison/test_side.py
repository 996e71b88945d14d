"""Sides: runs are read from their folders, with their conventions and with what is not finished."""

from __future__ import annotations

import pytest

from betterbench.comparison import load_sides
from betterbench.comparison.conventions import side_conventions
from betterbench.errors import InvalidInputError, RecordError
from betterbench.records import JournalEntry, RunFolder


@pytest.fixture
def broken_run(tmp_path):
    """A run of three trials: one broke down, two were not begun; no record is needed to compare it."""
    trials = [
        {"task": "fast_food", "condition": name, "variation": None if name == "train1" else name, "seed": 0}
        for name in ("train1", "L1", "R1")
    ]
    plan = {"policy": "p", "suite_version": "1.0", "engine": {"mujoco": "3.17.0"}, "trials": trials}
    run = RunFolder.start(tmp_path / "run", plan)
    with run.journal() as journal:
        journal.append(JournalEntry("fast_food", "L1", "L1", 0, "error", "out of memory"))
    return run.path


def test_a_run_is_read_with_its_conventions_and_its_unfinished_trials(broken_run, tmp_path):
    other = RunFolder.start(tmp_path / "other", {"policy": "q", "trials": []}).path
    side = load_sides([broken_run, other])[0]
    assert (side.name, side.path) == ("p", str(broken_run))
    assert side.unfinished == {"fast_food/train1/0", "fast_food/R1/0"}
    assert side.conventions == {"suite_version": "1.0", "engine:mujoco": "3.17.0"}


def test_records_outweigh_the_plan():
    plan = {"robot": "panda", "control_rate_hz": 20.0, "engine": {"mujoco": "1"}, "task_versions": {"fast_food": 1}}
    found = side_conventions(plan, {"engine:mujoco": "2", "camera_preset": "None"})
    assert found == {
        "robot": "panda",
        "control_rate_hz": "20",
        "engine:mujoco": "2",
        "task_version:fast_food": "1",
        "camera_preset": "None",
    }


def test_runs_have_to_be_several_different_ones(broken_run, tmp_path):
    with pytest.raises(InvalidInputError, match="needs at least two runs, got 1"):
        load_sides([broken_run])
    with pytest.raises(InvalidInputError, match="given twice"):
        load_sides([broken_run, broken_run / ".." / "run"])
    with pytest.raises(RecordError, match="no run"):
        load_sides([broken_run, tmp_path / "nowhere"])
