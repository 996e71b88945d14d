"""Certifying many trials: interrupted anywhere, the same command makes the same certificate."""

from __future__ import annotations

import dataclasses
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from tests.certification.made import dies_at_seed_2

from betterbench.certification import runner
from betterbench.certification.certificate import CertificateVersions
from betterbench.certification.runner import certify
from betterbench.errors import InvalidInputError, RecordError, RunConflictError, UnknownNameError, WorkerError
from betterbench.tasks import TrialId, get_task

TRIALS = [TrialId("morning_coffee", "T1", s) for s in range(4)] + [TrialId("morning_coffee", "train1", 0)]


def timeless(certificate):
    trials = tuple(dataclasses.replace(t, expert_s=0.0, total_s=0.0) for t in certificate.trials)
    return dataclasses.replace(certificate, trials=trials, wall_s=0.0, workers=0)


@pytest.fixture
def examined(monkeypatch, trial):
    """Replaces the examination by one that takes no time; lists what was examined."""
    seen = []

    def quick(asked):
        seen.append(asked)
        return trial(asked.task, asked.condition, asked.seed)

    monkeypatch.setattr(runner, "examine", quick)
    return seen


def test_trials_are_certified_in_plan_order_once_each(tmp_path, examined):
    told = []
    certificate = certify([*TRIALS, TRIALS[0]], tmp_path, on_progress=told.append)
    assert [t.key for t in certificate.trials] == TRIALS
    assert len(examined) == len(TRIALS)
    assert [p.done for p in told] == list(range(len(TRIALS) + 1))
    assert {p.planned for p in told} == {len(TRIALS)}
    form = json.loads((tmp_path / "certificate.json").read_text())
    assert form["versions"]["tasks"] == {"morning_coffee": get_task("morning_coffee").version}


def test_an_interrupted_certification_goes_on_and_ends_the_same(tmp_path, examined):
    whole = certify(TRIALS, tmp_path / "whole")
    for stop_at in range(1, len(TRIALS)):
        out = tmp_path / str(stop_at)

        def stop(progress, stop_at=stop_at):
            if progress.done == stop_at and progress.last is not None:
                raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            certify(TRIALS, out, on_progress=stop)
        assert not (out / "certificate.json").exists()
        examined.clear()
        assert timeless(certify(TRIALS, out)) == timeless(whole)
        assert len(examined) == len(TRIALS) - stop_at


def test_a_last_line_cut_off_anywhere_is_examined_again(tmp_path, examined):
    whole = certify(TRIALS, tmp_path)
    journal = tmp_path / "journal.jsonl"
    data = journal.read_bytes()
    for cut in (1, 30, len(data.splitlines()[-1])):
        journal.write_bytes(data[:-cut])
        examined.clear()
        assert timeless(certify(TRIALS, tmp_path)) == timeless(whole)
        assert len(examined) == 1
        assert len(journal.read_bytes().splitlines()) == len(TRIALS) + 1


def test_more_trials_in_the_same_folder_add_to_what_is_there(tmp_path, examined):
    certify(TRIALS[:2], tmp_path)
    examined.clear()
    assert len(certify(TRIALS, tmp_path).trials) == len(TRIALS)
    assert sorted(s.seed for s in examined if s.condition == "T1") == [2, 3]


def test_a_folder_begun_under_other_versions_is_refused(tmp_path, examined, monkeypatch):
    certify(TRIALS[:1], tmp_path)
    monkeypatch.setattr(runner, "engine_version", lambda: "3.99.0")
    with pytest.raises(RunConflictError, match=r"mujoco 3\.\d+\.\d+, but 3\.99\.0 is in use now"):
        certify(TRIALS[:1], tmp_path)


def test_trials_of_another_task_version_are_examined_again(tmp_path, examined, monkeypatch):
    certify(TRIALS, tmp_path)
    examined.clear()
    used = runner.versions_in_use

    def moved(tasks, *, robot):
        return dataclasses.replace(used(tasks), tasks={"morning_coffee": get_task("morning_coffee").version + 1})

    monkeypatch.setattr(runner, "versions_in_use", moved)
    certify(TRIALS, tmp_path)
    assert len(examined) == len(TRIALS)


@pytest.mark.parametrize("line", [b"{}", b"[]", b"nonsense", b'{"session":"a","elapsed_s":1,"trial":{}}'])
def test_a_corrupt_line_is_named(tmp_path, examined, line):
    certify(TRIALS[:2], tmp_path)
    journal = tmp_path / "journal.jsonl"
    lines = journal.read_bytes().splitlines()
    journal.write_bytes(b"\n".join([lines[0], line, lines[2]]) + b"\n")
    with pytest.raises((RecordError, InvalidInputError), match="line 2"):
        certify(TRIALS[:2], tmp_path)


def test_bad_input_is_named_before_anything_runs(tmp_path, examined):
    with pytest.raises(UnknownNameError, match="T9"):
        certify([TrialId("morning_coffee", "T9", 0)], tmp_path)
    with pytest.raises(InvalidInputError, match="--workers"):
        certify(TRIALS, tmp_path, workers=0)
    with pytest.raises(InvalidInputError, match="no trials to certify"):
        certify([], tmp_path)
    assert not examined
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
@pytest.mark.physics
def test_killed_workers_and_a_killed_process_lose_no_more_than_what_was_in_flight(tmp_path):
    whole = certify(TRIALS, tmp_path / "whole")
    script = (
        "from pathlib import Path\nfrom betterbench.tasks import TrialId\n"
        "from betterbench.certification.runner import certify\n"
        "if __name__ == '__main__':\n"
        "    certify([TrialId('morning_coffee', 'T1', s) for s in range(4)]"
        f" + [TrialId('morning_coffee', 'train1', 0)], Path({str(tmp_path / 'killed')!r}), workers=2)\n"
    )
    file = tmp_path / "job.py"
    file.write_text(script)
    job = subprocess.Popen([sys.executable, str(file)])
    journal = tmp_path / "killed" / "journal.jsonl"
    deadline = time.monotonic() + 120.0
    while time.monotonic() < deadline and (not journal.exists() or journal.read_bytes().count(b"\n") < 2):
        time.sleep(0.05)
    os.kill(job.pid, signal.SIGKILL)
    job.wait()
    assert journal.read_bytes().count(b"\n") >= 2
    assert timeless(certify(TRIALS, tmp_path / "killed", workers=2)) == timeless(whole)


def test_a_trial_that_kills_its_worker_is_named_and_the_others_are_kept(tmp_path, monkeypatch):
    monkeypatch.setattr(runner, "examine", dies_at_seed_2)
    trials = [TrialId("morning_coffee", "T1", seed) for seed in range(6)]
    with pytest.raises(WorkerError, match=r"^morning_coffee/T1/2: 3 worker processes died while running it"):
        certify(trials, tmp_path, workers=2)
    assert len((tmp_path / "journal.jsonl").read_bytes().splitlines()) >= 2, "the header and a trial"


def test_a_journal_that_an_earlier_version_left_is_gone_on_with(tmp_path, examined, monkeypatch):
    """The file was written before certification was moved to ``run_items``; three of the five trials are in it."""
    old = Path(__file__).with_name("data") / "journal_v2.jsonl"
    shutil.copy(old, tmp_path / "journal.jsonl")
    there = CertificateVersions("0.1.0", "2.0", "3.17.0", {"morning_coffee": 5})
    monkeypatch.setattr(runner, "versions_in_use", lambda _, **_options: there)
    certificate = certify(TRIALS, tmp_path)
    assert [t.key for t in certificate.trials] == TRIALS
    assert examined == [TrialId("morning_coffee", "T1", 2), TrialId("morning_coffee", "T1", 3)]
    assert (tmp_path / "journal.jsonl").read_bytes().startswith(old.read_bytes())
