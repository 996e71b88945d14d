"""``better diagnose`` keeps its result in the run and says what it judges otherwise."""

from __future__ import annotations

import json

import pytest
from tests.resealing import rewrite

from betterbench.cli.main import main
from betterbench.errors import InvalidInputError, RunConflictError, StorageError
from betterbench.json_form import sealed_form
from betterbench.records import JournalEntry, RunFolder
from betterbench.vqa.knowing import Knowledge


def run_verb(capsys, *arguments):
    status = main(arguments)
    captured = capsys.readouterr()
    return status, captured.out, captured.err


@pytest.fixture
def folder(tmp_path):
    """A run without records: what it planned broke down."""
    trials = [
        {"task": "fast_food", "condition": "train1", "variation": name, "seed": seed}
        for name in (None, "L1")
        for seed in range(2)
    ]
    run = RunFolder.start(tmp_path / "run", {"policy": "scripted", "trials": trials})
    with run.journal() as journal:
        journal.append(JournalEntry("fast_food", "L1", "L1", 0, "error", "the server went away"))
    return run.path


@pytest.fixture
def older(folder, capsys):
    """The same run with a diagnosis of another version, in which a trial has another label."""
    assert run_verb(capsys, "diagnose", str(folder))[0] == 0
    path = folder / "diagnosis.json"
    form = json.loads(path.read_text())
    form["package_version"] = "0.0.1"
    form["thresholds"]["halt_time"] = 2.0
    trial = next(t for t in form["trials"] if t["key"] == "fast_food/L1/0")
    trial["label"] = "timeout"
    trial["evidence"] |= {"rule": "old_rule", "text": "It was late."}
    metric = next(m for m in form["metrics"] if (m["name"], m["scope"]) == ("system_failure_rate", "overall"))
    metric |= {"k": 1, "value": 0.5}
    path.write_text(json.dumps(sealed_form(form)))
    return path


def test_the_first_diagnosis_is_stored_and_repeated_without_a_word(folder, capsys):
    status, first, _ = run_verb(capsys, "diagnose", str(folder))
    assert status == 0
    stored = (folder / "diagnosis.json").read_bytes()
    _, again, _ = run_verb(capsys, "diagnose", str(folder))
    assert again == first
    assert "stored diagnosis" not in again
    assert (folder / "diagnosis.json").read_bytes() == stored
    _, out, _ = run_verb(capsys, "diagnose", str(folder), "--json")
    changes = json.loads(out)["changes"]
    assert changes["trials"] == changes["thresholds"] == changes["metrics"] == []


def test_json_has_no_changes_without_a_stored_diagnosis(folder, capsys):
    _, out, _ = run_verb(capsys, "diagnose", str(folder), "--json", "--keep")
    assert json.loads(out)["changes"] is None
    assert not (folder / "diagnosis.json").exists()


def test_changes_are_shown_and_the_new_diagnosis_replaces_the_old_one(older, capsys):
    status, out, _ = run_verb(capsys, "diagnose", str(older.parent))
    text = " ".join(out.split())
    assert status == 0
    assert "Changes since the stored diagnosis of version 0.0.1 (now" in text
    assert "1 trial with a different label" in text
    assert "threshold halt_time: 2 before, 3 now" in text
    assert "1 × timeout → policy_error" in text
    assert "before 0.00 s old_rule: It was late." in text
    assert "now 0.00 s no_record: The trial has no record: the server went away." in text
    assert "because threshold halt_time changed; at 0.00 s rule no_record decides instead of old_rule" in text
    assert "system failure rate overall 50.0 %" not in text, "the trial that was not finished is no failure"
    assert json.loads(older.read_text())["package_version"] != "0.0.1"


def test_keep_leaves_the_stored_diagnosis(older, capsys):
    before = older.read_bytes()
    _, out, _ = run_verb(capsys, "diagnose", str(older.parent), "--keep", "--json")
    changes = json.loads(out)["changes"]
    assert changes["version_before"] == "0.0.1"
    assert [t["key"] for t in changes["trials"]] == ["fast_food/L1/0"]
    assert older.read_bytes() == before


def test_another_version_that_judges_alike_says_so(folder, capsys):
    run_verb(capsys, "diagnose", str(folder))
    path = folder / "diagnosis.json"
    rewrite(path, lambda form: form.update(package_version="0.0.1"))
    _, out, _ = run_verb(capsys, "diagnose", str(folder))
    assert "gives every trial the same label and evidence" in " ".join(out.split())


def test_a_malformed_stored_diagnosis_is_one_error_and_is_left_alone(folder, capsys):
    (folder / "diagnosis.json").write_text("{")
    status, out, err = run_verb(capsys, "diagnose", str(folder))
    assert status == 2
    assert not out
    assert "diagnosis.json: is not JSON" in err.replace("\n", "")
    assert (folder / "diagnosis.json").read_text() == "{"


def test_a_folder_that_cannot_be_written_is_diagnosed_all_the_same(folder, capsys, monkeypatch):
    def refuse(*_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("betterbench.diagnosis.stored.store_diagnosis", refuse)
    status, out, err = run_verb(capsys, "diagnose", str(folder), "--json")
    assert status == 0
    assert json.loads(out)["policy"] == "scripted"
    assert "not stored" in err


@pytest.mark.parametrize(
    "problem",
    [
        PermissionError(13, "Permission denied"),
        StorageError("RUN: No space left on device."),
        RunConflictError("RUN: another process is writing to it."),
        InvalidInputError("RUN", "a link leads out of the folder", "Remove the link"),
    ],
    ids=lambda problem: type(problem).__name__,
)
def test_what_a_model_knows_is_shown_though_it_cannot_be_kept(folder, tmp_path, capsys, monkeypatch, problem):
    """Where the two results of the verb cannot be stored, both are printed, with one line each about the reason."""

    def refuse(*_):
        raise problem

    class Asked:
        def require_about(self, run):
            assert run.path == folder

    known = Knowledge("a model", "scripted", (), (), {})
    monkeypatch.setattr("betterbench.diagnosis.stored.store_diagnosis", refuse)
    monkeypatch.setattr("betterbench.vqa.knowing.store_knowledge", refuse)
    monkeypatch.setattr("betterbench.vqa.dataset.read_set", lambda _: Asked())
    monkeypatch.setattr("betterbench.vqa.asking.read_answers", lambda *_: ())
    monkeypatch.setattr("betterbench.vqa.knowing.knowledge_of", lambda *_: known)
    words = ("--answers", str(tmp_path / "answers.jsonl"), "--questions", str(tmp_path), "--json")
    status, out, err = run_verb(capsys, "diagnose", str(folder), *words)
    assert status == 0, err
    assert json.loads(out)["policy"] == "scripted"
    assert "not stored: " in err
    assert "the report will not show it: " in err
