"""Laws of journals and run folders: nothing lost, nothing twice, nothing outside."""

from __future__ import annotations

import io
import json
import logging
import os
import signal
import subprocess
import sys
import time
import zipfile

import pytest

from betterbench import json_form
from betterbench.errors import InvalidInputError, RecordError, RunConflictError
from betterbench.jobs import RunLock
from betterbench.records import Journal, JournalEntry, RunFolder, read_journal, scene_archive
from betterbench.tasks import TrialId

PLAN = {"policy": "zoo:lexical", "tasks": ["fast_food", "fruit_lunch"], "trials": 20, "suite": {"version": "1.0"}}
HASH = "0123abcd" * 4


def entry(seed: int, **changes: object) -> JournalEntry:
    fields = {"task": "fast_food", "condition": "R1", "variation": "R1", "seed": seed, "wall": {"duration_s": 1.25}}
    return JournalEntry(**{**fields, **changes})


# ---------------------------------------------------------------------------------------------------------- journal


def test_what_is_appended_is_read(tmp_path) -> None:
    path = tmp_path / "journal.jsonl"
    written = [entry(0), entry(1, condition="train1", variation=None), entry(2, status="error", message="süß\nno")]
    with Journal(path) as journal:
        for e in written:
            journal.append(e)
        assert journal.entries == tuple(written) == read_journal(path)
        assert journal.is_done(TrialId("fast_food", "R1", 0))
        assert not journal.is_done(written[2].key)
    with Journal(path) as journal:
        assert journal.entries == tuple(written)
    assert len(path.read_bytes().splitlines()) == 3


def test_a_torn_last_line_is_cut_off_wherever_it_tore(tmp_path, caplog) -> None:
    path = tmp_path / "journal.jsonl"
    with Journal(path) as journal:
        for seed in range(3):
            journal.append(entry(seed))
    whole = path.read_bytes()
    second = whole.rfind(b"\n", 0, -1) + 1
    for cut in range(second, len(whole)):
        path.write_bytes(whole[:cut])
        assert [e.seed for e in read_journal(path)] == [0, 1]
        assert path.stat().st_size == cut
        with caplog.at_level(logging.WARNING), Journal(path) as journal:
            assert [e.seed for e in journal.entries] == [0, 1]
            journal.append(entry(2))
        assert path.read_bytes() == whole
    assert len(caplog.records) == len(whole) - second - 1


@pytest.mark.parametrize(
    "bad", [b'{"task":"fast_food"', b"", b"\x00\x00", b"[]", b'{"task":"x"}', b"[" * 100_000, b"\xff\xfe"]
)
def test_a_corrupt_line_in_the_middle_is_named(tmp_path, bad) -> None:
    path = tmp_path / "journal.jsonl"
    with Journal(path) as journal:
        for seed in range(3):
            journal.append(entry(seed))
    lines = path.read_bytes().splitlines()
    lines[1] = bad
    path.write_bytes(b"\n".join(lines) + b"\n")
    for attempt in (read_journal, Journal):
        with pytest.raises(RecordError, match=r"journal\.jsonl: line 2 is corrupt"):
            attempt(path)
    RunLock(tmp_path / ".lock").release()


def test_a_trial_is_finished_once_but_an_error_may_be_run_again(tmp_path) -> None:
    path = tmp_path / "journal.jsonl"
    with Journal(path) as journal:
        journal.append(entry(0, status="error", message="engine fell over"))
        journal.append(entry(0))
        with pytest.raises(RunConflictError, match="fast_food/R1/0 is already finished"):
            journal.append(entry(0))
    assert read_journal(path) == (entry(0),)
    path.write_bytes(path.read_bytes() + path.read_bytes().splitlines()[1] + b"\n")
    with pytest.raises(RecordError, match="line 3 does not match the lines before it"):
        read_journal(path)
    lines = [json.loads(line) for line in path.read_bytes().splitlines()]
    old = [{name: value for name, value in line.items() if name not in ("link", "record")} for line in lines]
    path.write_text("".join(f"{json.dumps(line)}\n" for line in old), encoding="utf-8")
    with pytest.raises(RecordError, match="line 3: fast_food/R1/0 is already finished in line 2"):
        read_journal(path)


@pytest.mark.parametrize("how", ["removed", "replaced", "cut", "grown", "changed", "linked"])
def test_a_journal_that_somebody_else_spoils_while_it_is_written_is_whole_again(tmp_path, how, caplog) -> None:
    path = tmp_path / "journal.jsonl"
    with Journal(path) as journal:
        journal.append(entry(0))
        match how:
            case "removed":
                path.unlink()
            case "replaced":
                path.rename(tmp_path / "elsewhere")
                path.write_text("{}\n")
            case "cut":
                os.truncate(path, 10)
            case "grown":
                path.write_bytes(path.read_bytes() + b"garbage\n")
            case "changed":
                path.write_bytes(path.read_bytes().replace(b"fast_food", b"slow_food"))
            case "linked":
                path.unlink()
                path.symlink_to("nowhere")
        journal.append(entry(1))
        journal.restore()
        assert [e.seed for e in read_journal(path)] == [0, 1]
        journal.append(entry(2))
    assert [e.seed for e in read_journal(path)] == [0, 1, 2]
    assert "was removed or changed by another program" in caplog.text


@pytest.mark.parametrize("content", [None, b"{", b'{"schema_version": 1, "plan": {}, "context": {}}'])
def test_the_description_of_a_run_is_written_again(tmp_path, content) -> None:
    run = RunFolder.start(tmp_path / "run", PLAN, context={"machine": "a"})
    before = (run.path / "run.json").read_bytes()
    run.restore()
    if content is None:
        (run.path / "run.json").unlink()
    else:
        (run.path / "run.json").write_bytes(content)
    run.restore()
    assert (run.path / "run.json").read_bytes() == before


def test_a_finished_trial_whose_record_is_lost_is_run_again(tmp_path) -> None:
    path = tmp_path / "journal.jsonl"
    with Journal(path) as journal:
        journal.append(entry(0, record="0f" * 32))
        journal.reopen(entry(0).key, "its record is not there")
        journal.reopen(entry(1).key, "never finished")
        assert not journal.is_done(entry(0).key)
        assert [(e.status, e.message, e.record) for e in read_journal(path)] == [
            ("error", "its record is not there", None)
        ]
        journal.append(entry(0, record="1e" * 32))
    assert [(e.status, e.record) for e in read_journal(path)] == [("done", "1e" * 32)]


def test_a_full_disk_leaves_the_journal_as_it_was(tmp_path, monkeypatch) -> None:
    path = tmp_path / "journal.jsonl"
    with Journal(path) as journal:
        journal.append(entry(0))
        before, write = path.read_bytes(), os.pwrite

        def half(handle: int, data: bytes, offset: int) -> int:
            if len(data) < 40:
                raise OSError(28, "No space left on device")
            return write(handle, data[: len(data) // 2], offset)

        with monkeypatch.context() as patch:
            patch.setattr("os.pwrite", half)
            with pytest.raises(OSError, match="No space left") as told:
                journal.append(entry(1))
        assert told.value.filename == str(path)
        assert path.read_bytes() == before
        journal.append(entry(1))
    assert [e.seed for e in read_journal(path)] == [0, 1]
    with pytest.raises(ValueError, match="closed"):
        journal.append(entry(2))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"seed": -1}, "seed"),
        ({"seed": True}, "seed"),
        ({"task": 3}, "task"),
        ({"variation": 3}, "variation"),
        ({"status": "fine"}, "status"),
        ({"wall": {"latency_s": float("nan")}}, r"wall\.latency_s"),
        ({"wall": {"latency_s": "1"}}, r"wall\.latency_s"),
        ({"ground_truth": {"fault": 3}}, r"ground_truth\.fault"),
    ],
)
def test_an_entry_that_could_not_be_read_back_is_refused(tmp_path, changes, message) -> None:
    with Journal(tmp_path / "journal.jsonl") as journal, pytest.raises(InvalidInputError, match=message):
        journal.append(entry(**{"seed": 0, **changes}))
    assert read_journal(tmp_path / "journal.jsonl") == ()


APPEND_FOREVER = """
import sys
from pathlib import Path
from betterbench.records import Journal, JournalEntry
with Journal(Path(sys.argv[1])) as journal:
    print("ready", flush=True)
    for seed in range(10**6):
        journal.append(JournalEntry("fast_food", "R1", "R1", seed, wall={"x" * 1000: 1.0}))
        print(seed, flush=True)
"""


def test_kill_9_loses_no_trial_and_frees_the_lock(tmp_path) -> None:
    path = tmp_path / "journal.jsonl"
    child = subprocess.Popen([sys.executable, "-c", APPEND_FOREVER, str(path)], stdout=subprocess.PIPE, text=True)
    assert child.stdout is not None
    try:
        for _ in range(10):
            child.stdout.readline()
        with pytest.raises(RunConflictError, match=rf"another run \(process {child.pid}\) is writing here"):
            Journal(path)
    finally:
        child.send_signal(signal.SIGKILL)
        told = child.stdout.read()
        child.stdout.close()
        child.wait(timeout=10)
    seeds = [int(line) for line in told.splitlines() if line.isdigit()]
    with Journal(path) as journal:
        kept = [e.seed for e in journal.entries]
        assert kept == list(range(len(kept)))
        assert len(kept) >= (seeds[-1] + 1 if seeds else 9)
        journal.append(entry(len(kept)))
    assert len(read_journal(path)) == len(kept) + 1


def test_the_lock_excludes_and_a_forked_child_does_not_keep_it(tmp_path) -> None:
    lock = RunLock(tmp_path / ".lock")
    with pytest.raises(RunConflictError, match=f"process {os.getpid()}"):
        RunLock(tmp_path / ".lock")
    code = (
        "import os, sys, time; from pathlib import Path; from betterbench.jobs import RunLock;"
        "lock = RunLock(Path(sys.argv[1])); pid = os.fork();\n"
        "if pid == 0: time.sleep(20)\n"
        "else: print(pid, flush=True); os._exit(0)"
    )
    lock.release()
    parent = subprocess.Popen(
        [sys.executable, "-c", code, str(tmp_path / ".lock")],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    assert parent.stdout is not None
    orphan = int(parent.stdout.readline())
    parent.wait(timeout=10)
    try:
        deadline = time.monotonic() + 5.0  # the child closes its copy right after the fork, on its own time
        while True:
            try:
                RunLock(tmp_path / ".lock").release()
                break
            except RunConflictError:
                assert time.monotonic() < deadline
                time.sleep(0.02)
    finally:
        os.kill(orphan, signal.SIGKILL)
        parent.stdout.close()


# ------------------------------------------------------------------------------------------------------- run folder


def test_the_same_plan_resumes_and_keeps_the_first_context(tmp_path) -> None:
    first = RunFolder.start(tmp_path / "run", PLAN, context={"machine": "a"})
    again = RunFolder.start(tmp_path / "run", {**PLAN, "tasks": tuple(PLAN["tasks"])}, context={"machine": "b"})
    assert again == first == RunFolder.open(tmp_path / "run")
    assert again.context == {"machine": "a"}


@pytest.mark.parametrize(
    ("plan", "message"),
    [
        ({**PLAN, "trials": 50}, r"plan\.trials is 20 in the folder but 50 in the request"),
        ({**PLAN, "trials": 20.0}, r"plan\.trials is 20 in the folder but 20\.0 in the request"),
        (
            {**PLAN, "suite": {"version": "1.1"}},
            r'plan\.suite\.version is "1\.0" in the folder but "1\.1" in the request',
        ),
        ({**PLAN, "tasks": ["fast_food", "tidy_desk"]}, r"plan\.tasks\[1\]"),
        ({**PLAN, "tasks": ["fast_food"]}, r"the length of plan\.tasks is 2 in the folder but 1 in the request"),
        (
            {k: v for k, v in PLAN.items() if k != "policy"},
            r"plan\.policy is .* in the folder but absent in the request",
        ),
        ({**PLAN, "a": None, "zzz": 1}, r"plan\.a is absent in the folder but null in the request"),
    ],
)
def test_another_plan_is_refused_with_the_first_difference(tmp_path, plan, message) -> None:
    RunFolder.start(tmp_path / "run", PLAN)
    with pytest.raises(RunConflictError, match=message):
        RunFolder.start(tmp_path / "run", plan)


def trials(*names: str) -> list[dict[str, object]]:
    return [{"task": name, "seed": 0} for name in names]


def test_a_plan_with_more_trials_takes_the_place_of_the_stored_one(tmp_path) -> None:
    few = {**PLAN, "trials": trials("a", "b"), "task_versions": {"a": 1, "b": 1}}
    more = {**few, "trials": trials("c", "b", "a"), "task_versions": {"a": 1, "b": 1, "c": 1}}
    RunFolder.start(tmp_path / "run", few, context={"machine": "a"})
    grown = RunFolder.start(tmp_path / "run", more)
    assert grown == RunFolder.open(tmp_path / "run")
    assert grown.plan["trials"] == more["trials"]
    assert grown.context["machine"] == "a"
    assert [(e["trials_before"], e["done_before"]) for e in grown.context["extended"]] == [(2, 0)]
    with pytest.raises(RunConflictError, match="has 3 trials, but this command requests only 2 of them"):
        RunFolder.start(tmp_path / "run", few)
    assert RunFolder.start(tmp_path / "run", more) == grown


@pytest.mark.parametrize(
    "change",
    [
        {"trials": trials("a", "c", "d")},  # one of the stored trials is missing
        {"trials": trials("a", "b", "c"), "policy": "noop"},
        {"trials": trials("a", "b", "c"), "task_versions": {"a": 2, "b": 1, "c": 1}},
    ],
)
def test_a_plan_that_changes_what_is_there_is_no_larger_plan(tmp_path, change) -> None:
    few = {**PLAN, "trials": trials("a", "b"), "task_versions": {"a": 1, "b": 1}}
    stored = RunFolder.start(tmp_path / "run", few)
    with pytest.raises(RunConflictError, match="contains a different run"):
        RunFolder.start(tmp_path / "run", {**few, **change})
    assert RunFolder.open(tmp_path / "run") == stored


def test_a_folder_with_other_files_is_left_alone(tmp_path) -> None:
    (tmp_path / "thesis.tex").write_text("x")
    with pytest.raises(RunConflictError, match="contains other files but no run"):
        RunFolder.start(tmp_path, PLAN)
    assert [p.name for p in tmp_path.iterdir()] == ["thesis.tex"]
    with pytest.raises(RunConflictError, match="this is a file"):
        RunFolder.start(tmp_path / "thesis.tex", PLAN)
    with pytest.raises(RecordError, match=r"File name too long. Pass the --out folder of the run"):
        RunFolder.open(tmp_path / ("x" * 300))
    with pytest.raises(RecordError, match=r"contains no run .*Pass the --out folder of a run"):
        RunFolder.open(tmp_path)


def test_a_folder_of_runs_is_no_run_and_the_error_names_them(tmp_path) -> None:
    for name in ("sources", "demonstrations"):
        RunFolder.start(tmp_path / name, PLAN)
    with pytest.raises(RecordError, match=r"Pass a run inside it: .*demonstrations, .*sources"):
        RunFolder.open(tmp_path)


def test_a_run_being_written_cannot_be_started_again(tmp_path) -> None:
    folder = RunFolder.start(tmp_path / "run", PLAN)
    with folder.journal() as journal:
        journal.append(entry(0))
        with pytest.raises(RunConflictError, match="another run"):
            RunFolder.start(tmp_path / "run", PLAN)
        assert RunFolder.open(tmp_path / "run").entries() == (entry(0),)
    RunFolder.start(tmp_path / "run", PLAN)


@pytest.mark.parametrize(
    "text", ["", "{", "[]", '{"schema_version": 2}', '{"schema_version": 3}', '{"schema_version": 1, "plan": 3}']
)
def test_a_corrupt_run_json_is_named(tmp_path, text) -> None:
    (tmp_path / "run.json").write_text(text)
    with pytest.raises(RecordError, match=r"run\.json: "):
        RunFolder.open(tmp_path)


def test_half_written_files_of_a_killed_process_are_cleared(tmp_path) -> None:
    folder = RunFolder.start(tmp_path / "run", PLAN)
    part = folder.path / "records" / "fast_food" / "R1" / ".7.parquet.abc.part"
    part.parent.mkdir(parents=True)
    part.write_bytes(b"half")
    RunFolder.start(tmp_path / "run", PLAN)
    assert not part.exists()


def test_records_have_one_place(tmp_path, make_record) -> None:
    folder = RunFolder.start(tmp_path / "run", PLAN)
    record, _ = make_record(rows=3)
    path = folder.write_record(record)
    assert path == folder.path / "records" / "fast_food" / "R1" / "7.parquet"
    assert folder.read_record("fast_food", "R1", 7).same_bits(record)
    with folder.journal() as journal:
        journal.append(entry(7))
        journal.append(entry(8, status="error", message="broke"))
    assert [r.metadata.seed for r in folder.records()] == [7]
    path.rename(path.with_name("9.parquet"))
    with pytest.raises(RecordError, match="is the record of fast_food/R1 seed 7"):
        folder.read_record("fast_food", "R1", 9)
    with pytest.raises(RecordError, match="the record does not exist"):
        list(folder.records())
    assert folder.video_path("fast_food", "R1", 7, camera="front").name == "7_front.mp4"
    assert folder.report_path.parent == folder.path


@pytest.mark.parametrize(
    "name", ["..", ".", "", "a/b", "/etc", "a\\b", "a\x00b", ".hidden", "-rf", "x" * 101, "naïve", "a\n"]
)
def test_no_name_leaves_the_folder(tmp_path, name) -> None:
    folder = RunFolder.start(tmp_path / "run", PLAN)
    for attempt in (
        lambda: folder.record_path(name, "R1", 0),
        lambda: folder.record_path("fast_food", name, 0),
        lambda: folder.video_path("fast_food", "R1", 0, camera=name),
        lambda: folder.scene_path(name),
    ):
        with pytest.raises(InvalidInputError):
            attempt()
    with pytest.raises(InvalidInputError, match="seed"):
        folder.record_path("fast_food", "R1", -1)


def test_no_link_leads_out_of_the_folder(tmp_path) -> None:
    folder = RunFolder.start(tmp_path / "run", PLAN)
    (tmp_path / "elsewhere").mkdir()
    (folder.path / "records").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(InvalidInputError, match="through a link"):
        folder.record_path("fast_food", "R1", 0)


def test_a_scene_is_stored_once_and_comes_back(tmp_path) -> None:
    folder, other = (RunFolder.start(tmp_path / name, PLAN) for name in ("run", "other"))
    files = {"model.mjb": bytes(range(256)) * 100, "assets/mug.obj": b"v 0 0 0\n", "empty": b""}
    path = folder.store_scene(HASH, files)
    time.sleep(0.01)
    assert other.store_scene(HASH, dict(reversed(files.items()))).read_bytes() == path.read_bytes()
    before = path.stat().st_mtime_ns
    assert folder.store_scene(HASH, files) == path
    assert path.stat().st_mtime_ns == before
    assert folder.load_scene(HASH) == files
    with pytest.raises(RecordError, match="is not stored"):
        folder.load_scene("ab" * 8)


@pytest.mark.parametrize(
    "name", ["../x", "/x", "a/../../x", "a//b", "a\\b", "c:x", "", "a/", "./a", "x\x00", "n" * 201]
)
def test_no_member_of_a_scene_leaves_its_folder(tmp_path, name) -> None:
    folder = RunFolder.start(tmp_path / "run", PLAN)
    with pytest.raises(InvalidInputError, match="scene file"):
        folder.store_scene(HASH, {name: b"x"})
    if not name or "\x00" in name:
        return  # the zip format itself cannot carry these
    folder.scene_path(HASH).parent.mkdir()
    with zipfile.ZipFile(folder.scene_path(HASH), "w") as archive:
        archive.writestr(name, b"x")
    with pytest.raises(RecordError, match="This is not a scene of a run"):
        folder.load_scene(HASH)


def test_a_scene_that_is_too_large_or_damaged_is_refused(tmp_path, monkeypatch) -> None:
    folder = RunFolder.start(tmp_path / "run", PLAN)
    path = folder.store_scene(HASH, {"a": bytes(600_000), "b": bytes(600_000)})
    assert path.stat().st_size < 10_000
    monkeypatch.setattr(scene_archive, "MAX_SCENE_BYTES", 1_000_000)
    with pytest.raises(RecordError, match="unpacks to more than 1000000 bytes"):
        folder.load_scene(HASH)
    with pytest.raises(InvalidInputError, match="scene: 1 files with 1000001 bytes exceed"):
        folder.store_scene("cd" * 8, {"a": bytes(1_000_001)})
    whole = path.read_bytes()
    for bad in (b"", b"junk", whole[: len(whole) // 2], whole.replace(b"\x00" * 4, b"\x01\x02\x03\x04", 1)):
        path.write_bytes(bad)
        with pytest.raises(RecordError, match=r"\.zip"):
            folder.load_scene(HASH)


def rewritten(path, **changes) -> bytes:
    """Return an archive as another program writes it, with its seal kept and some files changed."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(path) as there, zipfile.ZipFile(buffer, "w") as archive:
        for name in there.namelist():
            archive.writestr(name, changes.get(name, there.read(name)))
        archive.comment = there.comment
    return buffer.getvalue()


def test_a_changed_scene_or_that_of_another_hash_is_refused(tmp_path) -> None:
    """Pictures are drawn from it: the zip format's own sums are made anew by whatever program changes a file."""
    folder = RunFolder.start(tmp_path / "run", PLAN)
    files = {"model": b"red mug", "scene": b"{}"}
    path, other = folder.store_scene(HASH, files), folder.store_scene("cd" * 8, {**files, "model": b"blue mug"})
    whole = path.read_bytes()
    for bad in (other.read_bytes(), rewritten(path, model=b"blue mug"), rewritten(path, scene=b"")):
        path.write_bytes(bad)
        with pytest.raises(RecordError, match="changed after it was written, or belongs to another scene"):
            folder.load_scene(HASH)
    path.write_bytes(whole)
    path.write_bytes(rewritten(path))  # only packed in another way
    assert folder.load_scene(HASH) == files


def test_each_bit_of_a_scene_that_counts_is_seen(tmp_path, caplog) -> None:
    folder = RunFolder.start(tmp_path / "run", PLAN)
    files = {"model": bytes(range(40)), "scene": b"{}"}
    path = folder.store_scene(HASH, files)
    whole, silent, refused = path.read_bytes(), [], 0
    for place in range(8 * len(whole)):
        changed = bytearray(whole)
        changed[place // 8] ^= 1 << place % 8
        path.write_bytes(changed)
        caplog.clear()
        json_form._SAID.clear()
        try:
            if folder.load_scene(HASH) != files and not caplog.messages:
                silent.append(place)
        except RecordError:
            refused += 1
    assert silent == []
    assert refused > 4 * len(whole)


def test_a_scene_of_an_earlier_version_is_read_with_a_word(tmp_path, caplog) -> None:
    folder = RunFolder.start(tmp_path / "run", PLAN)
    path = folder.store_scene(HASH, {"model": b"red mug"})
    with zipfile.ZipFile(path, "a") as archive:
        archive.comment = b""
    assert folder.load_scene(HASH) == {"model": b"red mug"}
    assert "without a seal" in caplog.text


def test_run_json_is_readable_and_written_first(tmp_path) -> None:
    folder = RunFolder.start(tmp_path / "new" / "run", PLAN)
    assert json.loads((folder.path / "run.json").read_text())["plan"] == PLAN
    assert sorted(p.name for p in folder.path.iterdir()) == [".lock", "run.json"]
    with pytest.raises(InvalidInputError, match="metadata"):
        RunFolder.start(tmp_path / "x", {"bad": float("nan")})
