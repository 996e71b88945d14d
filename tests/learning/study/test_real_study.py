"""A study in miniature with real demonstrations, real training and real trials, killed on its way."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from betterbench.learning.study.page import FILES
from betterbench.records import RunFolder
from betterbench.vqa import read_set

pytest.importorskip("torch")
pytest.importorskip("safetensors")

pytestmark = [pytest.mark.slow, pytest.mark.physics]

PLAN = """
tasks: [fruit_lunch]
arms: {confounded: {training: 1.0}, balanced: {balanced: 1.0}}
seeds: [0]
demos: 4
sources: 1
trials: 1
recipe:
  capacity: {width: 16, layers: 1, heads: 2}
  steps: 20
  batch: 8
  save_every: 5
  rollouts: 0
  warmup: 5
"""
ARMS = ("confounded", "balanced")
PAUSE_S = 0.05
PATIENCE_S = 600.0


@pytest.fixture
def plan(tmp_path):
    path = tmp_path / "plan.yaml"
    path.write_text(PLAN)
    return path


def begin(plan: Path, out: Path, workers: int = 1) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "betterbench.cli", "study", plan, "--out", out, "--workers", str(workers)]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)


def kill_once_there(plan: Path, out: Path, sign: str) -> None:
    """Begin or resume a study, and kill it as soon as some file is there."""
    process, began = begin(plan, out), time.monotonic()
    while not any(out.glob(sign)):
        assert process.poll() is None, process.stderr and process.stderr.read().decode()
        assert time.monotonic() - began < PATIENCE_S
        time.sleep(PAUSE_S)
    os.kill(process.pid, signal.SIGKILL)
    process.communicate()


def finish(plan: Path, out: Path, workers: int = 1) -> None:
    process = begin(plan, out, workers)
    _, said = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0, said.decode()


def test_a_learner_whose_process_is_killed_stops_the_study_and_nothing_is_lost(plan, tmp_path):
    out = tmp_path / "study"
    process, began = begin(plan, out, workers=2), time.monotonic()
    while not all((out / "learners" / f"fruit_lunch-{arm}-seed0" / "loss.csv").exists() for arm in ARMS):
        assert process.poll() is None, process.stderr and process.stderr.read().decode()
        assert time.monotonic() - began < PATIENCE_S
        time.sleep(PAUSE_S)
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    named = [pid for pid in children if b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes()]
    os.kill(int(named[-1]), signal.SIGKILL)
    said = process.communicate(timeout=PATIENCE_S)[1].decode()
    if process.returncode == 0:
        pytest.skip("the learners were ready before one could be killed")
    assert "has ended (SIGKILL" in said
    assert "run the same command again" in said
    assert said.count("Traceback") == 0
    finish(plan, out, workers=2)
    assert (out / "study.html").exists()


def test_a_real_study_that_is_killed_at_each_kind_of_stage_and_moved_ends_the_same(plan, tmp_path):
    out = tmp_path / "study"
    for sign in (
        "sets/*-balanced/sources/records/**/*.parquet",
        "learners/*-confounded-seed0/state.safetensors",
        "runs/*-confounded-seed0/records/**/*.parquet",
        "stages/learners-*-balanced-seed0.json",
    ):
        kill_once_there(plan, out, sign)
        assert not (out / "study.html").exists()
        if not (out / "runs").exists():
            out = out.rename(tmp_path / f"moved-{out.name}")  # sets and learners are at home wherever they lie
    finish(plan, out)
    killed = {name: (out / name).read_bytes() for name in FILES if name != "study.html"}
    out = tmp_path / "study"
    finish(plan, out, workers=2)  # and both learners are trained side by side
    assert killed == {name: (out / name).read_bytes() for name in FILES if name != "study.html"}
    found = json.loads((out / "study.json").read_text())
    assert found["learners"] == 2
    assert found["trials"] == 2 * 12
    assert found["prediction"]["area"]["n"] == 6
    run = RunFolder.open(out / "runs" / "fruit_lunch-balanced-seed0")
    assert {entry.status for entry in run.entries()} == {"done"}
    assert (run.path / "diagnosis.json").is_file()


LEVERS = """
levers:
  - {name: frozen, start: balanced, changes: {frozen: [words, objects]}}
  - {name: asked, changes: {co_training: {weight: 0.5}}, questions: 60}
  - {name: seeing, changes: {family: pixels, every: 8, eyes: {views: [front], size: 32, quality: fast}}}
"""


def weights_of(out: Path, learner: str) -> dict[str, object]:
    from safetensors.torch import load_file

    return load_file(out / "learners" / f"fruit_lunch-{learner}" / "checkpoint.safetensors")


@pytest.mark.render
def test_levers_that_begin_with_a_learner_see_pictures_or_are_asked_are_trained_and_evaluated(plan, tmp_path):
    plan.write_text(PLAN + LEVERS)
    out = tmp_path / "study"
    finish(plan, out, workers=2)
    assert json.loads((out / "study.json").read_text())["learners"] == 5
    begun, start = weights_of(out, "confounded-frozen-seed0"), weights_of(out, "balanced-seed0")
    for part, stays in (("words.", True), ("objects.", True), ("head.", False)):
        same = [bool((weight == start[name]).all()) for name, weight in begun.items() if name.startswith(part)]
        assert same, part
        assert all(same) == stays, part
    assert list(out.glob("sets/fruit_lunch-training.frames/*.bin"))
    answers = (out / "learners" / "fruit_lunch-confounded-asked-seed0" / "answers.csv").read_text()
    assert len(answers.splitlines()) > 1
    (questions,) = (out / "questions").iterdir()
    assert read_set(questions).purpose == "training"
    evaluated = RunFolder.open(out / "runs" / "fruit_lunch-confounded-seeing-seed0").plan
    assert (evaluated["observation"]["name"], evaluated["quality"]["name"]) == ("default", "fast")
