"""Joint signals against the simulator: a clumsy policy's trials, read as if a real arm had recorded them."""

import importlib
from collections import Counter
from pathlib import Path

import pytest

from betterbench.cli.main import main
from betterbench.real.signals import JointTrack, signals_of
from betterbench.records import RunFolder, read_record

pytestmark = [pytest.mark.slow, pytest.mark.physics]
TOOLS = Path(__file__).resolve().parents[2] / "tools"


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    out = tmp_path_factory.mktemp("clumsy") / "run"
    options = ["--policy", "zoo:clumsy", "--robot", "so101", "--suite", "real_world", "--tasks", "fruit_basket"]
    options += ["--variations", "T1", "T4", "T7", "--trials", "1", "--workers", "1", "--uncertified", "--out", str(out)]
    assert main(["eval", *options]) == 0
    return out


@pytest.mark.parametrize(("rate_hz", "unit"), [(20.0, "degrees"), (15.0, "normalized"), (30.0, "degrees")])
def test_signals_are_what_the_simulator_knows(run, monkeypatch, rate_hz, unit):
    monkeypatch.syspath_prepend(TOOLS)
    tool = importlib.import_module("joint_signals")
    found = Counter()
    for number, path in enumerate(sorted((run / "records").rglob("*.parquet"))):
        record = read_record(path)
        samples = tool.samples_of(record, unit=unit, rate_hz=rate_hz, noise=number)
        signals = signals_of(JointTrack.of(samples, unit=unit, rate_hz=rate_hz))
        found.update(tool.compare(signals, tool.truth_of(record)))
    asked = {what for what, _ in found}
    assert {"object held: a closing on an object is found", "freeze: true, found", "freeze: false, not found"} <= asked
    missed = {what: count for (what, agrees), count in found.items() if not agrees}
    assert sum(missed.values()) <= 1, missed  # a closing may be under way when a trial ends
    assert found.total() >= 20


def test_labels_with_a_perfect_judge_are_those_of_the_simulated_diagnosis(run, monkeypatch):
    monkeypatch.syspath_prepend(TOOLS)
    tool = importlib.import_module("joint_signals")
    rows = list(tool.labels_of(run, noise=1))
    assert len(rows) == len(list(RunFolder.open(run).path.glob("records/*/*/*.parquet"))) > 3
    apart = [row for row in rows if row[2] != row[3]]
    assert not apart
