"""A submission says what its run says: compared like it, checked against it, and refused once it is changed."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from betterbench.cli.main import main
from betterbench.comparison import Submission, compare, load_sides, read_submission, require_same, submission_of
from betterbench.comparison.submission import SubmittedTrial
from betterbench.errors import UNPRINTABLE, BetterError, InvalidInputError, RunConflictError
from betterbench.records import JournalEntry, RunFolder

HASH = "0" * 64


def submitted(side):
    """Returns the submission that a side would have, whose trials all have a record or broke down."""
    trials = tuple(
        SubmittedTrial(
            t.task, t.variation or t.condition, t.seed, "broken" if t.record is None else "done", t.success,
            t.label.value, t.progress, t.steps, t.duration_s, None if t.record is None else HASH,
        )
        for t in side.diagnosis.trials
    )  # fmt: skip
    empty = Submission(
        "betterbench-submission", 1, side.name, side.diagnosis.policy, {}, "1", side.conventions, {}, HASH, 0, ()
    )
    return replace(empty, trials=trials).sealed()


@pytest.fixture
def files(two, tmp_path):
    paths = []
    for side in two:
        path = tmp_path / f"{side.name}.json"
        path.write_bytes(submitted(side).file_bytes())
        paths.append(path)
    return paths


@pytest.fixture
def run(tmp_path):
    """A run of three trials: one broke down, two were not begun."""
    trials = [
        {"task": "fast_food", "condition": name, "variation": None if name == "train1" else name, "seed": 0}
        for name in ("train1", "L1", "R1")
    ]
    plan = {"policy": "p://host", "suite_version": "1.0", "trials": trials}
    folder = RunFolder.start(tmp_path / "run", plan, context={"policy": {"name": "my policy", "metadata": {"a": 1}}})
    with folder.journal() as journal:
        journal.append(JournalEntry("fast_food", "L1", "L1", 0, "error", "out of memory"))
    return folder


def test_submissions_are_compared_as_the_runs_are(two, files):
    runs = compare(two).to_json()
    read = compare(load_sides(files)).to_json()
    for name in ("verdict", "groups", "paired"):
        assert read[name] == runs[name], name


def test_what_is_written_is_what_is_read(files):
    for path in files:
        found = read_submission(path)
        assert found.file_bytes() == path.read_bytes()
        assert json.loads(path.read_text())["sha256"] == found.sha256
        assert path.read_text().count("\n") > len(found.trials)


def test_what_a_server_declared_steers_nobody_who_opens_the_file(tmp_path):
    hostile = "\x1b]0;x\x07\x9b2J\u202egnp.exe\u2066\u200f\u061c\x85\U000e0041"
    declared = {"name": f"p {hostile}", "metadata": {hostile: [hostile, {"a": hostile}]}}
    plan = {
        "policy": "p://host",
        "trials": [{"task": "fast_food", "condition": "train1", "variation": None, "seed": 0}],
    }
    run = RunFolder.start(tmp_path / "run", plan, context={"policy": declared})
    path = tmp_path / "s.json"
    path.write_bytes(submission_of(run, name="p").file_bytes())
    assert not UNPRINTABLE.search(path.read_text(encoding="utf-8"))
    assert read_submission(path).declared == declared


def test_a_run_is_submitted_with_every_planned_trial(run, tmp_path):
    found = submission_of(run)
    assert [(t.condition, t.status) for t in found.trials] == [
        ("train1", "unfinished"), ("L1", "broken"), ("R1", "unfinished"),
    ]  # fmt: skip
    assert (found.name, found.policy, found.declared["metadata"]) == ("my policy", "p://host", {"a": 1})
    path = tmp_path / "s.json"
    path.write_bytes(found.file_bytes())
    (side,) = (s for s in load_sides([path, run.path]) if s.path == str(path))
    assert side.name == "my policy (s.json)"
    assert side.unfinished == {"fast_food/train1/0", "fast_food/R1/0"}
    assert side.conventions == {"suite_version": "1.0"}


def test_a_submission_is_checked_against_its_run(run, tmp_path, capsys):
    path = tmp_path / "s.json"
    assert main(["export", str(run.path), "--out", str(path), "--name", "mine"]) == 0
    assert main(["export", str(run.path), "--check", str(path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out.partition("\n")[2])["identical"] is True
    forged = read_submission(path)
    better = replace(forged.trials[1], status="done", success=True, label="success", record_sha256=HASH)
    forged = replace(forged, trials=(forged.trials[0], better, forged.trials[2])).sealed()
    with pytest.raises(RunConflictError, match=r"submission\.sha256|trials\[1\]"):
        require_same(run, forged)


def change(form, **values):
    return {**form, **values}


def first_trial(form, **values):
    return {**form, "trials": [{**form["trials"][0], **values}, *form["trials"][1:]]}


@pytest.mark.parametrize(
    ("edit", "text"),
    [
        (lambda f: change(f, name="better"), "it was changed"),
        (lambda f: first_trial(f, steps=7), "it was changed"),
        (lambda f: change(f, trials=f["trials"][1:]), "it was changed"),
        (lambda f: first_trial(f, success=False), "success is False, which contradicts the label success"),
        (lambda f: first_trial(f, label="luck"), "'luck' is not a label"),
        (lambda f: first_trial(f, status="broken"), "record_sha256 must be set if"),
        (lambda f: first_trial(f, seed=True), "seed"),
        (lambda f: first_trial(f, progress=1.5), "progress"),
        (lambda f: change(f, trials=[*f["trials"], f["trials"][0]]), "occurs twice"),
        (lambda f: change(f, name="\x1b[31mred"), "name"),
        (lambda f: change(f, name="x" * 500), "name"),
        (lambda f: change(f, schema_version=2), "schema_version"),
        (lambda f: change(f, score=1.0), "score: is unknown"),
        (lambda f: [f], "is not a JSON object"),
    ],
)
def test_a_changed_submission_is_refused_with_its_field(files, edit, text):
    path = files[0]
    path.write_text(json.dumps(edit(json.loads(path.read_text()))))
    with pytest.raises(InvalidInputError) as caught:
        load_sides(files)
    assert text in str(caught.value)
    assert str(path) in str(caught.value)
    assert "\x1b" not in str(caught.value)


def test_a_task_that_does_not_exist_here_is_named(files):
    found = read_submission(files[0])
    trial = replace(found.trials[0], task="tea_tray")
    files[0].write_bytes(replace(found, trials=(trial, *found.trials[1:])).sealed().file_bytes())
    with pytest.raises(BetterError, match="tea_tray"):
        load_sides(files)


def test_damaged_files_are_one_error_each(files):
    original = files[0].read_bytes()
    generator = np.random.default_rng(0)
    for _ in range(60):
        data = bytearray(original)
        for at in generator.integers(0, len(data), 3):
            data[at] = generator.integers(0, 256)
        files[0].write_bytes(bytes(data))
        if json_of(bytes(data)) == json_of(original):
            continue
        with pytest.raises(InvalidInputError) as caught:
            read_submission(files[0])
        assert len(str(caught.value)) < 1000


@pytest.mark.parametrize("data", [b"", b"[" * 100_000, b'{"declared": ' + b'{"a":' * 5_000, b"9" * 5_000, b"\xff\xfe"])
def test_what_is_no_submission_is_one_error(files, data):
    files[0].write_bytes(data)
    with pytest.raises(InvalidInputError):
        read_submission(files[0])


def json_of(data):
    try:
        return json.loads(data)
    except ValueError:
        return None


def test_a_place_that_cannot_be_written_is_one_error(run, tmp_path, capsys):
    (tmp_path / "file").write_text("")
    assert main(["export", str(run.path), "--out", str(tmp_path / "file" / "s.json")]) == 2
    assert "--out" in capsys.readouterr().err


@pytest.mark.parametrize(("order", "status"), [((0, 1), 0), ((1, 0), 1)])
def test_a_job_fails_if_the_first_policy_is_shown_to_be_worse(files, order, status, capsys):
    arguments = ["compare", *(str(files[i]) for i in order)]
    assert main(arguments) == 0
    try:
        left = main([*arguments, "--fail-if-worse"])
    except SystemExit as stop:
        left = stop.code
    assert left == status
    assert "good" in capsys.readouterr().out
