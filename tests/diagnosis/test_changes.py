"""Re-diagnosis: what a run keeps is read back, and what is judged otherwise is named with its reason."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest
from tests.looping import each

from betterbench.diagnosis import Label, diagnose_run
from betterbench.diagnosis.changes import find_changes
from betterbench.diagnosis.modes import MODES
from betterbench.diagnosis.stored import (
    StoredAttempt,
    StoredDiagnosis,
    StoredTrial,
    read_stored,
    store_diagnosis,
    stored_path,
)
from betterbench.errors import RecordError
from betterbench.json_form import sealed_form
from betterbench.records import JournalEntry, RunFolder

TRIAL = StoredTrial(
    key="fast_food/R1/0",
    label="wrong_object",
    success=False,
    rule="object_of_another_instruction",
    text="It goes for the fries.",
    start_s=4.0,
    end_s=5.0,
    candidates=(),
    attempts=(StoredAttempt(4.0, "fries", "distractor"),),
    steps=300,
    has_record=True,
)


def stored(trial: StoredTrial | None = TRIAL, *, version: str = "1.0", **thresholds: float) -> StoredDiagnosis:
    return StoredDiagnosis(version, thresholds, {} if trial is None else {"fast_food/R1/0": trial}, {})


def change(now: StoredTrial | None, *, before: StoredTrial | None = TRIAL, **thresholds: float):
    found = find_changes(stored(before, halt_time=3.0), stored(now, **{"halt_time": 3.0, **thresholds}))
    assert len(found.trials) == 1
    return found.trials[0]


@pytest.fixture
def run(tmp_path, policies):
    names = ("train1", "R1", "L1")
    trials = [
        {"task": "fast_food", "condition": "train1", "variation": None if n == "train1" else n, "seed": 0}
        for n in names
    ]
    folder = RunFolder.start(tmp_path / "run", {"policy": "scripted", "trials": trials})
    with folder.journal() as journal:
        for name in ("train1", "R1"):
            folder.write_record(policies["inertia"]("fast_food", name, 0))
            journal.append(JournalEntry("fast_food", name, None if name == "train1" else name, 0))
    return folder


def test_what_is_stored_is_read_back(run):
    assert read_stored(run) is None
    found = diagnose_run(run)
    path = store_diagnosis(run, found)
    assert path == run.path / "diagnosis.json"
    assert read_stored(run) == StoredDiagnosis.of(found)
    form = json.loads(path.read_text())
    assert form["package_version"]
    assert form["thresholds"]["halt_time"] == found.thresholds["halt_time"]
    assert form["trials"][1]["evidence"]["text"] == found.trials[1].evidence.text
    assert [p.name for p in run.path.iterdir() if p.name.endswith(".part")] == []


def test_the_same_diagnosis_again_changes_nothing(run):
    store_diagnosis(run, diagnose_run(run))
    found = find_changes(read_stored(run), StoredDiagnosis.of(diagnose_run(run)))
    assert not found.any
    assert found.to_json() == {
        "version_before": found.version_now,
        "version_now": found.version_now,
        "thresholds": [],
        "counts": [],
        "trials": [],
        "metrics": [],
    }


def test_a_run_that_went_on_has_other_records_and_no_other_judgment(run, policies):
    before = StoredDiagnosis.of(diagnose_run(run))
    with run.journal() as journal:
        run.write_record(policies["inertia"]("fast_food", "L1", 0))
        journal.append(JournalEntry("fast_food", "L1", "L1", 0))
    found = find_changes(before, StoredDiagnosis.of(diagnose_run(run)))
    assert [(t.key, t.sort, t.reasons) for t in found.trials] == [
        ("fast_food/L1/0", "record", ("the trial has a record now",))
    ]
    assert found.counts == {}
    assert not found.other_rules
    changed = {(m.name, m.scope): (m.before.k, m.now.k) for m in found.metrics if m.name == "success_rate"}
    assert changed["success_rate", "fast_food/L1"] == (0, 1)


def test_labels_rules_and_evidence_are_told_apart():
    assert change(replace(TRIAL, label="early_halt")).sort == "label"
    assert change(replace(TRIAL, rule="another")).sort == "rule"
    assert change(replace(TRIAL, text="In other words.")).sort == "evidence"
    assert change(None).sort == "gone"
    assert change(TRIAL, before=None).sort == "new"
    assert change(None).labels == ("wrong_object", "none")
    assert change(replace(TRIAL, label="early_halt", steps=299)).sort == "record"
    assert change(replace(TRIAL, has_record=False)).reasons == ("its record is missing",)


@each(
    "changes, reasons",
    [
        (
            {"label": "early_halt", "rule": "stands", "start_s": 2.0},
            ("rule stands fires earlier, at 2.00 s before object_of_another_instruction at 4.00 s",),
        ),
        (
            {"label": "early_halt", "rule": "stands", "start_s": 9.0},
            ("rule object_of_another_instruction no longer decides at 4.00 s; rule stands does at 9.00 s",),
        ),
        ({"rule": "stands"}, ("at 4.00 s rule stands decides instead of object_of_another_instruction",)),
        ({"label": "timeout"}, ("rule object_of_another_instruction gives another label",)),
        ({"start_s": 3.0}, ("rule object_of_another_instruction fires earlier, at 3.00 s before at 4.00 s",)),
        ({"end_s": 6.0}, ("the evidence of rule object_of_another_instruction ends at 6.00 s instead of 5.00 s",)),
        ({"text": "!"}, ("rule object_of_another_instruction gives the same evidence with another text",)),
        (
            {"label": "lexical_kinematic_shortcut", "rule": "word"},
            ("the second pass rules differently on the attempt at 4.00 s",),
        ),
        (
            {"rule": "undecided", "candidates": ("visual_layout_bias",)},
            ("the second pass rules differently on the attempt at 4.00 s",),
        ),
        (
            {"label": "lexical_kinematic_shortcut", "rule": "word", "start_s": 2.0, "attempts": ()},
            (
                "0 grasp attempts are seen instead of 1",
                "rule word fires earlier, at 2.00 s before object_of_another_instruction at 4.00 s",
            ),
        ),
        (
            {"attempts": (StoredAttempt(4.0, "burger", "target"),)},
            (
                "the grasp attempts are read differently",
                f"rule {TRIAL.rule} decides as before; only the listed attempts or candidates differ",
            ),
        ),
    ],
)
def test_the_reason_is_what_the_two_judgments_show(changes, reasons):
    assert change(replace(TRIAL, **changes)).reasons == reasons


def test_changed_thresholds_are_named_with_the_trials_they_may_have_moved():
    now = replace(TRIAL, label="early_halt", rule="stands", start_s=2.0)
    found = find_changes(stored(halt_time=3.0, gone=1.0), stored(now, version="1.1", halt_time=2.0, new=5.0))
    assert [(t.name, t.before, t.now) for t in found.thresholds] == [
        ("halt_time", 3.0, 2.0),
        ("new", None, 5.0),
        ("gone", 1.0, None),
    ]
    assert found.other_rules
    assert found.trials[0].reasons[0] == "thresholds halt_time, new, gone changed"
    assert change(now, halt_time=2.0).reasons[0] == "threshold halt_time changed"


def test_changes_of_labels_are_counted_the_most_frequent_first():
    keys = [f"fast_food/R1/{i}" for i in range(5)]
    now = dict.fromkeys(keys, replace(TRIAL, label="early_halt"))
    now[keys[0]] = replace(TRIAL, label="timeout")
    now[keys[1]] = replace(TRIAL, text="!")
    found = find_changes(StoredDiagnosis("1", {}, dict.fromkeys(keys, TRIAL), {}), StoredDiagnosis("1", {}, now, {}))
    assert list(found.counts.items()) == [(("wrong_object", "early_halt"), 3), (("wrong_object", "timeout"), 1)]
    assert len(found.of_sort("label")) == 4
    form = json.loads(json.dumps(found.to_json(), allow_nan=False))
    assert form["counts"][0] == {"before": "wrong_object", "now": "early_halt", "trials": 3}
    assert form["trials"][0]["before"]["text"] == "It goes for the fries."


def test_a_new_ruling_of_the_diagnosis_itself_is_recognized(run, monkeypatch):
    """The inertia of this run is taken away from the diagnosis: the reason names the rule that no longer decides."""
    before = StoredDiagnosis.of(diagnose_run(run))
    silent = {**MODES, Label.BEHAVIORAL_INERTIA: replace(MODES[Label.BEHAVIORAL_INERTIA], find=lambda _: None)}
    monkeypatch.setattr("betterbench.diagnosis.labels.MODES", silent)
    found = find_changes(before, StoredDiagnosis.of(diagnose_run(run)))
    assert [t.key for t in found.trials] == ["fast_food/R1/0"]
    assert found.trials[0].labels[0] == "behavioral_inertia"
    assert found.trials[0].labels[1] != "behavioral_inertia"
    assert found.trials[0].before.rule in found.trials[0].reasons[0]


@pytest.mark.parametrize(
    ("spoil", "text"),
    [
        (lambda form: {**form, "schema_version": 99}, "schema_version: expected 2, got 99"),
        (lambda form: {**form, "schema_version": True}, "schema_version: Input should be a valid integer"),
        (lambda form: {**form, "package_version": 3}, "package_version: Input should be a valid string"),
        (
            lambda form: {**form, "thresholds": {"halt_time": "long"}},
            "thresholds.halt_time: Input should be a val",
        ),
        (lambda form: {**form, "trials": {}}, "trials: Input should be a valid array"),
        (lambda form: {**form, "trials": [3]}, r"trials\[0\]: "),
        (
            lambda form: {**form, "trials": [{**form["trials"][0], "evidence": 3}]},
            r"trials\[0\]\.evidence\.rule: is miss",
        ),
        (lambda form: {**form, "trials": [{**form["trials"][0], "label": None}]}, r"\[0\]\.label: .*valid string"),
        (lambda form: {**form, "metrics": [{"name": "x", "scope": "y", "k": 1}]}, r"metrics\[0\]\.n: is missing"),
    ],
)
def test_a_malformed_file_is_one_clear_error(run, spoil, text):
    path = store_diagnosis(run, diagnose_run(run))
    path.write_text(json.dumps(sealed_form(spoil(json.loads(path.read_text())))))
    with pytest.raises(RecordError, match=text) as caught:
        read_stored(run)
    assert "diagnosis.json" in str(caught.value)
    assert "move it elsewhere" in str(caught.value)


@pytest.mark.parametrize(
    "data", [b"", b"{", b"[]", b"\xff\xfe", b"[" * 100_000, b'{"seal": "", "thresholds": {"halt_time": Infinity}}']
)
def test_a_file_that_is_no_json_is_one_clear_error(run, data):
    stored_path(run).write_bytes(data)
    with pytest.raises(RecordError, match=r"diagnosis\.json: is not (a )?JSON"):
        read_stored(run)
