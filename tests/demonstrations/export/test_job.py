"""A whole export: the same bytes after interruptions and with any workers, and one line for what goes wrong."""

from __future__ import annotations

import errno
import json
import re
import resource
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from rich import filesize

from betterbench.cli.main import main
from betterbench.demonstrations.export import ExportPlan, export_dataset, job, layout_of, part, select_demonstrations
from betterbench.demonstrations.shortcuts.lerobot import facts_of_lerobot
from betterbench.errors import InvalidInputError, RecordError, RunConflictError, StorageError
from betterbench.jobs import RunLock
from betterbench.jobs.lock import LOCK_NAME
from betterbench.json_form import sealed_form
from betterbench.records import RunFolder
from betterbench.records.twins import PAIRS_FILE, pairs_bytes, read_pairs
from betterbench.vqa.dataset import write_set
from betterbench.vqa.question import Difficulty, Form, FrameSource, Question, QuestionType

sys.path.insert(0, str(Path(__file__).parent))
from demonstrating import TRIALS, PaintedPictures, add_record, start_run, twins_run
from validators import read_v30

pytestmark = [pytest.mark.physics, pytest.mark.render, pytest.mark.usefixtures("painted")]


def plan_of(run: RunFolder, out: Path, **options) -> ExportPlan:
    given = {"to": "lerobot", "layout": layout_of("lerobot"), **options}
    return ExportPlan([run], select_demonstrations([run]), out=out, **given)


def content(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


@pytest.fixture(scope="module")
def whole_folder(demonstrations, tmp_path_factory):
    """An export that nothing disturbed. Tests change copies of it."""
    out = tmp_path_factory.mktemp("undisturbed") / "whole"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(job, "Pictures", PaintedPictures)
        export_dataset(plan_of(demonstrations.run, out))
    return out


@pytest.fixture(scope="module")
def whole(whole_folder):
    return content(whole_folder)


def test_bytes_do_not_depend_on_workers_or_interruptions(demonstrations, whole, tmp_path, monkeypatch):
    export_dataset(plan_of(demonstrations.run, tmp_path / "two"), workers=2)
    assert content(tmp_path / "two") == whole
    made, real = [], part.write_part

    def interrupted(folder, *arguments):
        if made:
            raise KeyboardInterrupt
        made.append(folder)
        real(folder, *arguments)

    monkeypatch.setattr(job, "write_part", interrupted)
    with pytest.raises(KeyboardInterrupt):
        export_dataset(plan_of(demonstrations.run, tmp_path / "set"))
    assert not (tmp_path / "set").exists()
    monkeypatch.setattr(job, "write_part", real)
    assert export_dataset(plan_of(demonstrations.run, tmp_path / "set")).made == 1
    assert content(tmp_path / "set") == whole
    assert not list(tmp_path.glob(".set*"))


@pytest.fixture(scope="module")
def all_parts(demonstrations, tmp_path_factory):
    """What an export leaves that was stopped when all its parts were made. Tests change copies of it."""

    def stopped(*_):
        raise KeyboardInterrupt

    out = tmp_path_factory.mktemp("stopped") / "set"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(job, "Pictures", PaintedPictures)
        patch.setattr(job, "_assemble", stopped)
        with pytest.raises(KeyboardInterrupt):
            export_dataset(plan_of(demonstrations.run, out))
    return out.with_name(".set.parts")


def test_a_damaged_part_is_made_again(demonstrations, whole, all_parts, tmp_path):
    parts = Path(shutil.copytree(all_parts, tmp_path / ".set.parts"))
    video = min(parts.rglob("0.mp4"))
    video.write_bytes(video.read_bytes()[:-9] + b"unreadable")
    assert export_dataset(plan_of(demonstrations.run, tmp_path / "set")).made == 1
    assert content(tmp_path / "set") == whole


@pytest.mark.parametrize(
    "harm",
    [
        lambda text: text.replace(b'"seed":0', b'"seed":7'),
        lambda text: text.replace(b'"sampled":9', b'"sampled":8'),
        lambda _: b"[" * 100_000,
        lambda _: b"{}",
        lambda _: json.dumps(sealed_form({"files": {"../x": ""}})).encode(),
        lambda text: json.dumps({k: v for k, v in json.loads(text).items() if k != "seal"}).encode(),
    ],
)
def test_what_a_part_says_about_itself_is_under_its_seal(demonstrations, whole, all_parts, tmp_path, harm):
    parts = Path(shutil.copytree(all_parts, tmp_path / ".set.parts"))
    index = min(parts.rglob("part.json"), key=lambda p: b'"seed":0' not in p.read_bytes())
    before = index.read_bytes()
    index.write_bytes(harm(before))
    assert index.read_bytes() != before
    assert export_dataset(plan_of(demonstrations.run, tmp_path / "set")).made == 1
    assert content(tmp_path / "set") == whole


def test_the_same_command_again_does_nothing_and_another_one_is_refused(demonstrations, whole_folder, tmp_path):
    out = Path(shutil.copytree(whole_folder, tmp_path / "whole"))
    assert export_dataset(plan_of(demonstrations.run, out)).made == 0
    with pytest.raises(RunConflictError, match="another data set"):
        export_dataset(plan_of(demonstrations.run, out, layout=layout_of("vla_eval")))
    (tmp_path / "mine").mkdir()
    with pytest.raises(RunConflictError, match="a folder that `better export` did not write already exists here"):
        export_dataset(plan_of(demonstrations.run, tmp_path / "mine"))


def test_a_second_export_at_once_is_told_which_output_is_taken(demonstrations, tmp_path):
    out = tmp_path / "out"
    with (
        RunLock(tmp_path / ".out.parts" / LOCK_NAME),
        pytest.raises(RunConflictError, match=f"^{re.escape(str(out))}: another run"),
    ):
        export_dataset(plan_of(demonstrations.run, out))


def test_a_full_disk_is_one_line_and_leaves_nothing_at_the_place(demonstrations, tmp_path, monkeypatch):
    def full(path, data):
        raise OSError(errno.ENOSPC, "No space left on device", str(path))

    monkeypatch.setattr(part, "write_durably", full)
    with pytest.raises(StorageError, match=r"No space left on device\. Finished work is kept"):
        export_dataset(plan_of(demonstrations.run, tmp_path / "set"))
    assert not (tmp_path / "set").exists()


def test_a_corrupt_record_is_one_line_that_names_it(demonstrations, tmp_path, capsys):
    run = start_run(tmp_path / "run", TRIALS)
    for record in demonstrations.records.values():
        add_record(run, record)
    path = run.record_path(TRIALS[1].task, TRIALS[1].condition, TRIALS[1].seed)
    path.write_bytes(path.read_bytes()[:-50])
    assert main(["export", str(run.path), "--to", "lerobot", "--out", str(tmp_path / "set")]) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert str(path).split("/")[-1] in said
    assert "damaged" in said


def test_a_missing_scene_is_one_line_that_names_it(demonstrations, tmp_path, monkeypatch):
    from betterbench.demonstrations.export.pictures import Pictures

    monkeypatch.setattr(job, "Pictures", Pictures)
    run = start_run(tmp_path / "run", TRIALS)
    for record in demonstrations.records.values():
        add_record(run, record)
    with pytest.raises(RecordError, match="the scene is not stored"):
        export_dataset(plan_of(run, tmp_path / "set"))


def test_seeds_are_held_out_whole_and_come_last(demonstrations, tmp_path):
    plan = plan_of(demonstrations.run, tmp_path / "set", validation=0.5)
    export_dataset(plan)
    info = json.loads((plan.out / "meta/info.json").read_text())
    assert info["splits"] == {"train": "0:1", "validation": "1:2"}
    assert len(read_v30(plan.out)) == 2


def test_questions_and_subgoals_stand_in_the_language_columns(demonstrations, tmp_path):
    def question(text, answer, *, options=(), camera="wrist", size=256) -> Question:
        trial = TRIALS[0]
        source = FrameSource(trial.task, trial.condition, trial.seed, 3, 0.15, camera)
        form = Form.CHOICE if options else Form.YES_NO
        kind, hard = QuestionType.STATE, Difficulty.EASY
        return Question(
            text, kind, form, "f", text, options, answer, "i.jpg", size, size, hard, (), (), (), {}, 0.5, source
        )  # fmt: skip

    questions = [
        question("Is the mug held?", "No"),
        question("Which is red?", "the mug", options=("the box", "the mug")),
        question("What is in the box [1, 2, 3, 4]?", "the mug", size=128),
        question("And here?", "No", camera="left_shoulder"),
    ]
    asked = write_set(tmp_path / "asked", questions, (), "training")
    plan = plan_of(demonstrations.run, tmp_path / "set", questions=asked.path / "questions.jsonl")
    export_dataset(plan)
    first, second = read_v30(plan.out)
    events = first["language_events"]
    assert [bool(rows) for rows in events] == [row == 3 for row in range(len(events))]
    said = [(e["role"], e["content"], e["style"], e["camera"]) for e in events[3]]
    wrist = "observation.images.wrist"
    assert said == [
        ("user", "Is the mug held?", "vqa", wrist),
        ("assistant", "No", "vqa", wrist),
        ("user", "Which is red?\nA. the box\nB. the mug", "vqa", wrist),
        ("assistant", "B. the mug", "vqa", wrist),
    ]
    assert not any(second["language_events"])
    persistent = first["language_persistent"]
    assert all(rows == persistent[0] for rows in persistent)
    changes = [row for row in range(len(events)) if row == 0 or first["subgoal"][row] != first["subgoal"][row - 1]]
    assert [(e["style"], e["content"], e["camera"]) for e in persistent[0]] == [
        ("subtask", first["subgoal"][row], None) for row in changes
    ]
    entry = demonstrations.run.entry(TRIALS[0])
    for record, held in ((demonstrations.run.record_digest(entry), True), ("0" * 64, False)):
        (asked.path / "set.json").write_text(json.dumps({"records": {str(TRIALS[0]): record}}))
        again = plan_of(demonstrations.run, tmp_path / str(held), questions=asked.path)
        if held:
            export_dataset(again)
            assert read_v30(again.out)[0]["language_events"] == events
        else:  # of another run, which had the same trial
            with pytest.raises(InvalidInputError, match="contains no questions about frames of these episodes"):
                export_dataset(again)
    write_set(tmp_path / "others", questions[3:], (), "training")
    with pytest.raises(InvalidInputError, match="contains no questions about frames of these episodes"):
        export_dataset(plan_of(demonstrations.run, tmp_path / "other", questions=tmp_path / "others"))
    with pytest.raises(RecordError, match="contains no complete question set"):
        export_dataset(plan_of(demonstrations.run, tmp_path / "other", questions=tmp_path))


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"validation": 1.5}, "--validation: 1.5 is out of range"),
        ({"to": "lerobot-v2.1", "language": True}, "lerobot-v2.1 does not support language columns"),
        ({"quality": "best"}, "Unknown quality 'best'"),
    ],
)
def test_options_that_do_not_fit_are_told(demonstrations, tmp_path, options, said):
    with pytest.raises(Exception, match=said):
        export_dataset(plan_of(demonstrations.run, tmp_path / "set", **options))


def test_the_command_line_names_what_is_missing(demonstrations, tmp_path, capsys):
    def told(*words: str) -> str:
        assert main(["export", *words]) == 2
        return " ".join(capsys.readouterr().err.split())

    run = str(demonstrations.run.path)
    assert "--out: this option is required" in told(run, "--to", "lerobot")
    assert "Unknown preset" in told(run, "--to", "lerobot", "--preset", "openpi", "--out", str(tmp_path / "x"))
    assert "Unknown task of the run" in told(run, "--to", "lerobot", "--tasks", "coffee", "--out", str(tmp_path / "x"))
    assert "runs: 2 runs were given" in told(run, run)


def test_an_option_of_data_sets_without_one_is_refused(demonstrations, tmp_path, capsys):
    words = ["export", str(demonstrations.run.path), "--preset", "openpi_libero", "--out", str(tmp_path / "set")]
    assert main(words) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert "--preset: this option applies only to data sets, and submission is not a data set. Add --to lerobot" in said
    assert not (tmp_path / "set").exists()


def test_the_command_line_writes_and_says_how_to_evaluate(demonstrations, tmp_path, capsys):
    out = tmp_path / "set"
    words = ["export", str(demonstrations.run.path), "--to", "lerobot", "--out", str(out), "--images", "png", "--json"]
    assert main(words) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["episodes"] == 2
    assert document["bytes"] == sum(file.stat().st_size for file in out.rglob("*") if file.is_file())
    assert document["seconds"] > 0.0
    assert document["evaluate"].startswith("better eval --policy lerobot:CHECKPOINT --quality fast")
    assert document["evaluate"].endswith(" --tasks morning_coffee --trials 3 --out RUN")
    assert document["evaluate"] in (out / "README.md").read_text()
    assert main([*words[:-1]]) == 0  # it is there already
    assert f"{filesize.decimal(document['bytes'])} on disk, 0:00:0" in capsys.readouterr().out
    assert main(["export", str(demonstrations.run.path), "--check", str(out), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["worst_error"] == 0.0


def test_the_ids_of_twins_are_exported_and_the_audit_reads_what_is(demonstrations, tmp_path):
    run, pair = twins_run(tmp_path / "run", demonstrations)
    assert read_pairs(run) == (pair,)
    assert pair.trials == (TRIALS[0], replace(TRIALS[1], seed=TRIALS[0].seed))
    export_dataset(plan_of(run, tmp_path / "set"))
    read_v30(tmp_path / "set")
    rows = pq.read_table(tmp_path / "set/meta/episodes/chunk-000/file-000.parquet").to_pylist()
    assert [row["better/pairs"] for row in rows] == ["it", "it"]
    source = json.loads((tmp_path / "set/meta/betterbench.json").read_text())
    assert [episode["pairs"] for episode in source["episodes"]] == [["it"], ["it"]]
    export_dataset(plan_of(run, tmp_path / "old", to="lerobot-v2.1", layout=layout_of("gr00t_new_embodiment")))
    for folder in ("set", "old"):
        facts = facts_of_lerobot(tmp_path / folder)
        assert [f.instruction for f in facts] == [r.metadata.instruction for r in demonstrations.records.values()]
        assert all(f.steps for f in facts)
    (run.path / PAIRS_FILE).write_bytes(pairs_bytes([pair])[:-20])
    with pytest.raises(
        RecordError, match=r"pairs\.jsonl: its last line is not a valid seal.*Repeat the command that made"
    ):
        read_pairs(run)


def test_a_data_set_that_lost_a_file_is_not_called_finished(demonstrations, whole_folder, tmp_path):
    name = "meta/stats.json"
    shutil.copytree(whole_folder, tmp_path / "whole")
    (tmp_path / "whole" / name).unlink()
    with pytest.raises(RunConflictError, match=rf"{name}: the file is missing"):
        export_dataset(plan_of(demonstrations.run, tmp_path / "whole"))


def test_a_file_larger_than_the_disk_takes_is_one_line(demonstrations, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(sys, "dont_write_bytecode", True)  # Python stores files of bytecode cut off at the limit
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (9_000, before[1]))  # Python ignores the signal of the limit
    try:
        status = main(["export", str(demonstrations.run.path), "--to", "lerobot", "--out", str(tmp_path / "set")])
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert status == 2
    said = capsys.readouterr().err
    assert "Traceback" not in said
    assert "File too large. Finished work is kept" in " ".join(said.split())
    assert not (tmp_path / "set").exists()


def test_validation_leaves_a_seed_for_training():
    assert len(job.validation_seeds({1, 2, 3, 4}, 0.9)) == 3
    assert job.validation_seeds({1}, 0.9) == set()


def test_a_record_that_is_given_twice_is_refused(demonstrations, tmp_path):
    run = demonstrations.run
    shutil.copytree(run.path, tmp_path / "copy")
    for runs in ([run, run], [run, RunFolder.open(tmp_path / "copy")]):
        with pytest.raises(
            InvalidInputError, match=r"record of morning_coffee/\S+: the same record .*Pass each run only once"
        ):
            select_demonstrations(runs)


def test_records_of_two_versions_of_a_task_are_no_data_set(demonstrations, tmp_path):
    run = start_run(tmp_path / "run", TRIALS)
    for number, entry in enumerate(demonstrations.run.entries()):
        record = demonstrations.run.read_record(entry.task, entry.condition, entry.seed)
        newer = replace(record.metadata, task_version=record.metadata.task_version + number)
        add_record(run, replace(record, metadata=newer))
    with pytest.raises(
        InvalidInputError,
        match=r"recorded with version \d+ of the task .* with version .*Export each version separately",
    ):
        select_demonstrations([run])


def test_a_link_to_nothing_is_refused_before_anything_is_drawn(demonstrations, tmp_path):
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    with pytest.raises(RunConflictError, match="this is a broken symbolic link"):
        export_dataset(plan_of(demonstrations.run, tmp_path / "link"))
    assert [path.name for path in tmp_path.iterdir()] == ["link"]


def test_it_is_said_that_no_seed_is_held_out(demonstrations, tmp_path, capsys):
    words = ["export", str(demonstrations.run.path), "--to", "lerobot", "--validation", "0.01"]
    assert main([*words, "--out", str(tmp_path / "set")]) == 0
    assert "no seed is held out: a fraction of 0.01 of" in " ".join(capsys.readouterr().err.split())


def test_an_empty_preset_is_no_preset(demonstrations, tmp_path, capsys):
    words = ["export", str(demonstrations.run.path), "--to", "lerobot", "--preset", "", "--out", str(tmp_path / "set")]
    assert main(words) == 2
    assert "preset" in capsys.readouterr().err


def test_the_command_that_evaluates_names_the_files_of_ones_own_tasks(monkeypatch):
    """By name alone, since whoever has the data set has them in another place."""
    from betterbench.demonstrations.export import job
    from betterbench.demonstrations.export.layout import layout_of

    told = ("--task-file", "my tasks.py")
    monkeypatch.setattr(job, "options_by_name", lambda tasks: told if "my_lunch" in tasks else ())
    layout = layout_of("lerobot")
    assert "--task-file 'my tasks.py'" in job.evaluation_command(layout, "standard", ["my_lunch"])
    assert "--task-file" not in job.evaluation_command(layout, "standard", ["fruit_lunch"])
