"""What people type and read: verbs, their help, their JSON, and errors that say what to do."""

from __future__ import annotations

import json

import pytest

from betterbench.cli.main import VERBS, main
from betterbench.tasks import all_tasks


def run(capsys, *arguments):
    try:
        status = main(arguments)
    except SystemExit as stop:
        status = stop.code or 0
    captured = capsys.readouterr()
    return status, captured.out, captured.err


@pytest.fixture(scope="module")
def small_run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cli") / "run"
    arguments = ["--policy", "zoo:lexical", "--tasks", "morning_coffee", "--variations", "L1", "T1", "--trials", "1"]
    assert main(["eval", *arguments, "--workers", "1", "--out", str(folder)]) == 0
    return folder


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_has_help_with_an_example(capsys, verb):
    status, out, _ = run(capsys, verb, "--help")
    assert status == 0
    assert f"better {verb}" in out
    assert "Example" in out


@pytest.mark.parametrize("what", ["tasks", "variations", "policies", "assets", "templates"])
def test_lists_are_json_on_request(capsys, what):
    status, out, _ = run(capsys, "list", what, "--json")
    listed = json.loads(out)
    assert status == 0
    assert listed


def test_variations_are_counted_by_axis(capsys):
    _, out, _ = run(capsys, "list", "variations")
    total = sum(len(t.variations) for t in all_tasks())
    letters = [v.name[0] for t in all_tasks() for v in t.variations]
    counts = ", ".join(f"{letters.count(letter)} {letter}" for letter in "LROT")
    assert f"{total} variations: {counts}" in out


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("eval", "--policy", "zoo:lexica"), "zoo:lexical"),
        (("eval", "--policy", "expert", "--tasks", "fast_fod"), "fast_food"),
        (("eval", "--policy", "expert", "--suite", "better06"), "better60"),
        (("eval", "--policy", "expert", "--suite", "better06", "--tasks", "fast_food"), "Did you mean 'better60'"),
        (("certify", "--suite", "better06", "--tasks", "fast_food"), "Did you mean 'better60'"),
        (("eval", "--policy", "expert", "--replicas", "1"), "--replicas: it is for a Ray cluster"),
        (("eval", "--policy", "expert", "--replica-gpus", "0.5"), "--replica-gpus: it is for a Ray cluster"),
        (("eval", "--policy", "expert", "--ray-address", "auto"), "or leave out --ray-address"),
        (("eval", "--policy", "expert", "--allow-other-versions"), "Give --from too"),
        (("eval", "--policy", "expert", "--variations", "X9"), "X9"),
        (("eval", "--policy", "replay:nowhere"), "no run"),
        (("serve", "replay:x:runs"), "replay:x:runs"),
        (("eval", "--policy", "openpi://127.0.0.1:1?patience=0.1&preset=native"), "127.0.0.1:1"),
        (("eval", "--policy", "openpi://127.0.0.1:1?patiense=1"), "patience"),
        (("eval", "--policy", "opnpi://127.0.0.1:1"), "openpi://"),
        (("eval", "--policy", "expert", "--trials", "0"), "--trials"),
        (("eval", "--policy", "expert", "--quality", "fastest"), "fast"),
        (("show", "fast_food/T9"), "T1"),
        (("diagnose", "no/such/run"), "no run"),
        (("report", "no/such/run"), "no run"),
        (("replay", "no/such/record.parquet", "--check"), "record.parquet"),
    ],
)
def test_bad_input_is_one_clear_error_with_status_2(capsys, monkeypatch, tmp_path, arguments, text):
    monkeypatch.chdir(tmp_path)
    status, out, err = run(capsys, *arguments)
    assert status == 2
    assert not out
    assert "error:" in err
    assert text in err.replace("\n", " ")
    assert "Traceback" not in err
    assert not list(tmp_path.iterdir())


def test_diagnose_json_has_the_promised_fields(capsys, small_run):
    status, out, _ = run(capsys, "diagnose", str(small_run), "--json")
    document = json.loads(out)
    assert status == 0
    fields = {"task", "variation", "condition", "axis", "seed", "policy", "success", "expected", "label", "kind"}
    fields |= {"first_attempt", "intended", "progress", "evidence"}
    planned = json.loads((small_run / "run.json").read_text())["plan"]["trials"]
    assert len(document["trials"]) == len(planned)
    for trial in document["trials"]:
        assert fields <= set(trial)
        assert trial["policy"] == "zoo:lexical"
        assert trial["kind"] in {"none", "reasoning", "execution", "system"}
    assert {"k", "n", "value", "low", "high"} <= set(document["metrics"][0])
    by_name = {t["variation"]: t for t in document["trials"] if t["variation"]}
    assert by_name["L1"]["label"] == "success"
    assert by_name["T1"]["label"] == "behavioral_inertia"
    assert by_name["T1"]["expected"] == "stay_still"


def test_the_same_command_again_runs_nothing(capsys, small_run):
    journal = (small_run / "journal.jsonl").read_bytes()
    arguments = ["--policy", "zoo:lexical", "--tasks", "morning_coffee", "--variations", "L1", "T1", "--trials", "1"]
    status, out, _ = run(capsys, "eval", *arguments, "--workers", "1", "--out", str(small_run), "--json")
    assert status == 0
    assert json.loads(out)["variations"] == {"k": 1, "n": 2}
    assert (small_run / "journal.jsonl").read_bytes() == journal


def test_another_plan_in_the_same_folder_is_refused(capsys, small_run):
    status, _, err = run(capsys, "eval", "--policy", "noop", "--trials", "1", "--out", str(small_run))
    assert status == 2
    assert "plan" in err


@pytest.mark.parametrize("options", [(), ("--check",), ("--twin",)])
def test_nothing_that_is_no_record_is_called_damaged_or_to_be_deleted(capsys, small_run, tmp_path, options):
    (tmp_path / "thesis.parquet").write_bytes(b"years of work")
    for path in (small_run, small_run / "records", tmp_path / "thesis.parquet", tmp_path):
        status, out, err = run(capsys, "replay", str(path), *options)
        said = err.replace("\n", " ")
        assert status == 2
        assert not out
        assert "delete" not in said.lower()
        assert "RUN/records/TASK/CONDITION/SEED.parquet" in said or "morning_coffee" in said
        if path.is_dir():
            assert "is a folder" in said
            assert "damaged" not in said


def test_replay_checks_bit_for_bit(capsys, small_run):
    record = small_run / "records" / "morning_coffee" / "L1" / "0.parquet"
    status, out, _ = run(capsys, "replay", str(record), "--check", "--json")
    assert status == 0
    assert json.loads(out)["identical"] is True


@pytest.mark.render
def test_a_record_becomes_a_video(capsys, small_run, tmp_path):
    record = small_run / "records" / "morning_coffee" / "T1" / "0.parquet"
    out = tmp_path / "t1.mp4"
    status, _, _ = run(capsys, "replay", str(record), "--out", str(out), "--size", "64")
    assert status == 0
    assert out.read_bytes()[4:8] == b"ftyp"


@pytest.mark.render
def test_show_writes_a_image(capsys, tmp_path):
    out = tmp_path / "images" / "t1.png"
    status, _, _ = run(capsys, "show", "fast_food/T1", "--out", str(out), "--size", "96")
    assert status == 0
    assert out.read_bytes().startswith(b"\x89PNG")


@pytest.mark.render
def test_report_is_one_page(capsys, small_run, tmp_path):
    status, out, _ = run(capsys, "report", str(small_run), "--out", str(tmp_path), "--films", "1")
    assert status == 0
    page = (tmp_path / "index.html").read_text()
    assert out.strip().endswith("index.html")
    assert "zoo:lexical" in page
    assert "data:image/jpeg" in page


@pytest.mark.render
def test_doctor_finds_nothing_wrong_here(capsys):
    status, out, _ = run(capsys, "doctor", "--json")
    findings = json.loads(out)
    assert status == 0
    assert {f["name"] for f in findings} >= {"versions", "physics", "rendering", "video"}
    assert all(f["works"] for f in findings)
