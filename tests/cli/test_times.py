"""Where the time of a run went: the four times at its end, and the sentence that names the bottleneck."""

from __future__ import annotations

import json
import time

import numpy as np
import pytest
from tests.evaluation.conftest import in_few_steps

from betterbench.cli.main import main
from betterbench.cli.tally import times_text
from betterbench.episodes.chunks import Chunks
from betterbench.evaluation.running.summary import RunTimes, run_times
from betterbench.interface import Execution
from betterbench.policies.serving.server import PolicyServer
from betterbench.records import JournalEntry, RunFolder
from betterbench.tasks.trial import Trial

LATENCY_S = 0.2


class Slow:
    """Takes its time, and answers with what is no number after some steps, which ends the trial."""

    def answer(self, request):
        time.sleep(LATENCY_S)
        first = 0.1 if float(np.asarray(request["better/step"])) < 16 else np.nan
        return {"actions": np.tile([first, 0.1, 0.0, 0.0, 0.0, 0.0, -1.0], (4, 1))}

    def close(self):
        pass


def times(**changes) -> RunTimes:
    usual = {"policy_s": 0.0, "simulation_s": 1.0, "rendering_s": 1.0, "wire_s": 0.1, "idle_s": 0.0, "envs": 8}
    return RunTimes(**{**usual, **changes})


@pytest.mark.parametrize(
    ("given", "bottleneck", "words"),
    [
        (times(policy_s=80.0, idle_s=8.0), "policy", "waited for it 80 % of their time"),
        (times(policy_s=80.0, idle_s=0.1, rendering_s=2.0), "rendering", "a graphics card, --quality fast"),
        (times(policy_s=80.0, simulation_s=3.0), "simulation", "more --workers"),
        (times(policy_s=80.0, wire_s=3.0), "wire", "size=N"),
        (times(policy_s=0.5, wire_s=3.0, idle_s=3.0), "wire", "size=N"),
        (times(policy_s=9.0, envs=None), "policy", "runs inside the workers"),
        (times(policy_s=0.5, simulation_s=2.0, envs=None), "simulation", "--engine ray"),
    ],
)
def test_the_bottleneck_is_named_with_its_cure(given, bottleneck, words):
    assert given.bottleneck == bottleneck
    text = times_text(given, drawn_here=True, chosen=True)
    assert words in text
    assert "the bottleneck" in text


def test_a_number_that_was_given_is_a_cure_and_a_world_has_no_quality():
    waiting = times(policy_s=80.0, idle_s=8.0, envs=1)
    assert "more --envs" in times_text(waiting, drawn_here=True, chosen=False)
    assert "(1 environment a worker)" in times_text(waiting, drawn_here=True, chosen=False)
    assert "more --envs" not in times_text(waiting, drawn_here=True, chosen=True)
    assert "--quality" not in times_text(times(rendering_s=9.0), drawn_here=False, chosen=True)
    assert "if the world draws at each step" in times_text(times(simulation_s=9.0), drawn_here=False, chosen=True)


def test_times_are_those_of_the_journal():
    wall = {"policy_s": 4.0, "wire_s": 1.0, "simulation_s": 2.0, "setup_s": 0.5, "write_s": 0.25, "observe_s": 3.0}
    entry = JournalEntry("morning_coffee", "T1", "T1", 0, wall={**wall, "idle_s": 0.5, "envs": 12.0})
    assert run_times([entry, entry]) == RunTimes(6.0, 5.5, 6.0, 2.0, 1.0, 12)
    assert run_times([JournalEntry("morning_coffee", "T1", "T1", 1, "error", "broken", {})]) is None
    assert run_times([]) is None


@pytest.fixture(scope="module")
def served():
    with PolicyServer(Slow, metadata={}, port=0) as server:
        yield f"{server.address}?preset=native"


def command(address, out, *more: str) -> list[str]:
    arguments = ["eval", "--policy", address, "--tasks", "morning_coffee", "--variations", "T1", "--trials", "2"]
    return [*arguments, "--observation", "state_only", "--workers", "1", "--envs", "1", "--out", str(out), *more]


def test_a_run_ends_with_its_times_and_a_resumed_one_with_those_of_all_sessions(served, tmp_path, capsys):
    out = tmp_path / "run"
    main(command(served, out))
    shown = " ".join(capsys.readouterr().err.split())
    assert "time: policy " in shown
    assert "The policy is the bottleneck: the workers waited for it" in shown
    journal = out / "journal.jsonl"
    lines = journal.read_text(encoding="utf-8").splitlines(keepends=True)
    journal.write_text("".join(lines[:2]), encoding="utf-8")
    main(command(served, out, "--json"))
    told = json.loads(capsys.readouterr().out)["times"]
    entries = RunFolder.open(out).entries()
    assert len(entries) == 4
    assert told["bottleneck"] == "policy"
    assert told["envs"] == 1
    answers = sum(e.wall["policy_answers"] for e in entries)
    assert told["policy_s"] + told["wire_s"] >= answers * LATENCY_S, "those of the first session count"
    assert told["waited_s"] >= 0.8 * answers * LATENCY_S
    assert {"policy_s", "simulation_s", "rendering_s", "wire_s"} <= told.keys()


def test_a_built_in_policy_has_times_too(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(Trial, "resolve", in_few_steps(24))
    arguments = ["eval", "--policy", "noop", "--tasks", "morning_coffee", "--variations", "T1", "--trials", "1"]
    main([*arguments, "--observation", "state_only", "--workers", "1", "--out", str(tmp_path / "run"), "--json"])
    shown = capsys.readouterr()
    told = json.loads(shown.out)["times"]
    assert told["simulation_s"] > 0.0
    assert (told["wire_s"], told["waited_s"], told["envs"]) == (0.0, 0.0, None)
    assert "is the bottleneck" in " ".join(shown.err.split())


def test_what_another_world_draws_counts_as_rendering():
    chunks = Chunks(None, None, Execution(), limit=8, began=time.perf_counter() - 4.0)
    for step in range(8):
        chunks.note_world_step(0.5 if step % 4 == 3 else 0.2, drawn=step % 4 == 3)
    assert chunks.wall_figures()["observe_s"] == pytest.approx(0.6)
    assert 3.4 <= chunks.wall_figures()["simulation_s"] < 10.0
    always = Chunks(None, None, Execution(), limit=8, began=time.perf_counter())
    always.note_world_step(0.5, drawn=True)
    assert always.wall_figures()["observe_s"] == 0.0, "nothing tells the parts of such a step apart"
