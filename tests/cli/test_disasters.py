"""What a verb that writes says on a full or protected disk, in a folder that vanishes, and when it is interrupted."""

from __future__ import annotations

import errno
import io
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time

import pytest
from tests.daily import others_slow
from tests.evaluation.conftest import in_few_steps

from betterbench.cli.main import main
from betterbench.errors import RunConflictError, StorageError, system_error_text
from betterbench.evaluation import evaluate, make_plan
from betterbench.jobs.durable import DurableFile, write_durably
from betterbench.jobs.lock import LOCK_NAME, FileLock, RunLock
from betterbench.records import JournalEntry, RunFolder
from betterbench.tasks.trial import Trial

FULL = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))  # as write() raises it: without a name


class Full(io.BytesIO):
    """A file on a full disk."""

    def write(self, _):
        raise FULL


def fill(monkeypatch):
    def full(*_):
        raise FULL

    monkeypatch.setattr(os, "fsync", full)


def test_a_full_disk_names_the_file_and_the_cure(tmp_path, monkeypatch):
    fill(monkeypatch)
    with pytest.raises(StorageError, match=r"x\.json: No space left on device.*free disk space") as told:
        write_durably(tmp_path / "x.json", b"{}")
    assert str(tmp_path / "x.json") in str(told.value)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "words", [["recipe", "openpi", "--data", "sets/pi"], ["shortcuts", "SET"]], ids=lambda words: words[0]
)
def test_a_verb_names_the_folder_that_is_on_a_full_disk(tmp_path, monkeypatch, capsys, words):
    from tests.demonstrations.shortcuts.strangers import make

    strange = str(make(tmp_path / "set", "plain", "word", count=12)) if "SET" in words else ""
    fill(monkeypatch)
    out = tmp_path / "out"
    assert main([*(strange if word == "SET" else word for word in words), "--out", str(out)]) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert str(out) in said
    assert "free disk space, then run the same command again" in said


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EROFS])
def test_the_cure_of_a_disk_is_no_better_path(number):
    text = system_error_text(OSError(number, os.strerror(number), "/x"))
    assert "Check that the path is right" not in text
    assert text.endswith(".")


def test_a_folder_that_vanishes_while_a_file_is_written_is_named(tmp_path):
    with DurableFile(tmp_path / "out" / "x.json") as file:
        shutil.rmtree(tmp_path / "out")
        with pytest.raises(StorageError, match=r"x\.json: its folder was removed or moved while the file was written"):
            file.finish()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("how", ["removed", "moved", "moved and made anew", "lock removed"])
def test_nothing_is_written_beside_what_vanished_with_a_locked_folder(tmp_path, how):
    """A training whose folder was moved put its checkpoint into a new one without recipe, which no command resumed."""
    out = tmp_path / "out"
    with RunLock(out / LOCK_NAME):
        write_durably(out / "recipe.json", b"{}\n")
        if how == "removed":
            shutil.rmtree(out)
        elif how == "lock removed":
            (out / LOCK_NAME).unlink()
        else:
            out.rename(tmp_path / "elsewhere")
            if how == "moved and made anew":
                out.mkdir()
        with pytest.raises(
            StorageError, match=r"out: the folder or its .* was removed or moved.* run the same command again"
        ):
            write_durably(out / "checkpoints" / "last", b"weights")
    assert not (out / "checkpoints").exists()
    with RunLock(out / LOCK_NAME):
        write_durably(out / "recipe.json", b"{}\n")


def test_a_journal_that_vanishes_with_its_folder_takes_the_lock_anew(tmp_path):
    """It is written again, and the lock keeps others out as before; a folder that others have taken stays theirs."""
    run = RunFolder.start(tmp_path / "run", {"trials": [], "policy": "expert"})
    with run.journal(renews=True) as journal:
        shutil.rmtree(run.path)
        journal.restore()
        run.restore()
        assert sorted(p.name for p in run.path.iterdir()) == [LOCK_NAME, "journal.jsonl", "run.json"]
        with pytest.raises(RunConflictError, match="is writing here"):
            RunLock(run.path / LOCK_NAME)
        shutil.rmtree(run.path)
        with RunLock(run.path / LOCK_NAME), pytest.raises(RunConflictError, match="is writing here"):
            run.restore()
    assert not (run.path / "run.json").exists()


def test_a_run_within_a_folder_that_vanished_makes_nothing_anew(tmp_path):
    """The set that it belongs to would be without its recipe."""
    out = tmp_path / "set"
    entry = JournalEntry("fast_food", "R1", "R1", 0, "error", "broke down")
    with RunLock(out / LOCK_NAME):
        run = RunFolder.start(out / "sources", {"policy": "expert"})
        with run.journal(renews=True) as journal:
            out.rename(tmp_path / "elsewhere")
            with pytest.raises(StorageError, match=r"set: the folder or its .* was removed or moved"):
                journal.append(entry)
    assert not out.exists()


@pytest.mark.parametrize("begin", ["start", "journal"])
def test_no_lock_is_made_within_a_folder_that_vanished(tmp_path, begin):
    """The next stage of a study that was removed left ``sets/SET/demonstrations/.lock`` behind."""
    out = tmp_path / "study"
    with RunLock(out / LOCK_NAME):
        run = RunFolder.start(out / "sets" / "one", {"policy": "expert"})
        shutil.rmtree(out)
        with pytest.raises(StorageError, match=r"study: the folder or its .* was removed or moved"):
            run.journal(renews=True) if begin == "journal" else RunFolder.start(run.path, run.plan)
    assert not out.exists()


def test_workers_make_nothing_anew_within_a_folder_that_vanished(tmp_path):
    """A worker wrote the record that it was at, and the same calibration then found a folder that it had not made."""
    out = tmp_path / "calibration"
    plan = make_plan("expert", tasks=["fast_food"], variations=["T1"], trials=1, observation="state_only")
    with (
        RunLock(out / LOCK_NAME),
        pytest.raises(StorageError, match=r"calibration: the folder or its .* was removed or moved"),
    ):
        evaluate(plan, out / "expert", workers=2, on_progress=lambda _: shutil.rmtree(out, ignore_errors=True))
    assert not out.exists()


@pytest.mark.parametrize("kind", ["file", "folder"])
def test_a_refusal_names_the_output_and_no_lock_beside_it(tmp_path, monkeypatch, kind):
    def refuse(path, *_, **__):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))

    monkeypatch.setattr(os, "open", refuse)
    with pytest.raises(PermissionError) as told:
        FileLock(tmp_path / "x.json") if kind == "file" else RunLock(tmp_path / "out" / LOCK_NAME)
    assert told.value.filename == str(tmp_path / ("x.json" if kind == "file" else "out"))


def test_a_lock_on_a_folder_that_was_removed_keeps_nobody_out_and_is_taken_again(tmp_path, monkeypatch):
    """Who waits for a lock may get one on a file that its holder has removed, as a command that fails does."""
    from betterbench.jobs import lock

    file, usual = tmp_path / "out" / LOCK_NAME, lock._lock_exclusively
    removals = []

    def removed_meanwhile(handle):
        usual(handle)
        if not removals:
            removals.append(file)
            shutil.rmtree(file.parent)

    monkeypatch.setattr(lock, "_lock_exclusively", removed_meanwhile)
    with RunLock(file):
        assert file.exists()
        with pytest.raises(RunConflictError, match="is writing here"):
            RunLock(file)
    assert removals


# --- experiment trackers


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tracked") / "run"
    words = ["--policy", "noop", "--tasks", "morning_coffee", "--variations", "T1", "--trials", "1", "--workers", "1"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Trial, "resolve", in_few_steps(24))
        assert main(["eval", *words, "--observation", "state_only", "--quality", "fast", "--out", str(folder)]) == 0
    return folder


def test_events_of_an_earlier_export_are_replaced(run, tmp_path):
    pytest.importorskip("tensorboardX")
    words = ["export", str(run), "--to", "tensorboard", "--out", str(tmp_path / "tb")]
    assert main(words) == 0
    assert main(words) == 0
    (events,) = (p for p in (tmp_path / "tb").iterdir() if "tfevents" in p.name)
    events.write_bytes(b"of somebody else")
    assert main(words) == 2
    assert events.read_bytes() == b"of somebody else"
    assert main([*words, "--overwrite"]) == 0


def test_events_on_a_full_disk_are_one_line_and_no_hang(run, tmp_path, capsys, monkeypatch):
    """TensorBoard's SummaryWriter has a thread; on a busy machine it met the full disk first, and all waited for it."""
    pytest.importorskip("tensorboardX")

    def late(*_):
        raise AssertionError("a thread that dies on a full disk is waited for without an end")

    monkeypatch.setattr("tensorboardX.event_file_writer.EventFileWriter.__init__", late)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    fill(monkeypatch)
    assert main(["export", str(run), "--to", "tensorboard", "--out", str(tmp_path / "tb")]) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert "No space left on device" in said
    assert "Traceback" not in said
    assert [p for p in tmp_path.rglob("*") if p.is_file()] == []


@pytest.mark.usefixtures("kept_views")
def test_a_file_of_rerun_is_never_cut_short(run, tmp_path, capsys, monkeypatch):
    """Rerun's own writer noticed a full disk in its log alone, and half a file was said to be written."""
    pytest.importorskip("rerun")
    usual = DurableFile.__init__

    def on_full_disk(self, path):
        usual(self, path)
        self.file.close()
        self.file = Full()

    monkeypatch.setattr(DurableFile, "__init__", on_full_disk)
    record = str(run / "records" / "morning_coffee" / "T1" / "0.parquet")
    out = tmp_path / "x.rrd"
    assert main(["view", record, "--camera", "front:32", "--quality", "fast", "--out", str(out)]) == 2
    assert f"{out}: No space left on device" in " ".join(capsys.readouterr().err.split())
    assert list(tmp_path.iterdir()) == []


# --- Ctrl-C


@pytest.mark.parametrize("at_s", others_slow([0.15, 0.4, 0.8], 3))
def test_ctrl_c_at_the_beginning_is_one_line(tmp_path, at_s):
    """While modules are imported, that is; Python itself takes some 0.05 s to begin."""
    code = (
        "import betterbench.cli, signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler); "
        "print('begun', file=sys.stderr); sys.stderr.flush(); betterbench.cli.main()"
    )
    words = ["recipe", "openpi", "--data", "sets/pi", "--out", str(tmp_path / "out")]
    process = subprocess.Popen(
        [sys.executable, "-c", code, *words],
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        text=True,
    )
    assert process.stderr.readline() == "begun\n"
    time.sleep(at_s)
    process.send_signal(signal.SIGINT)
    said = process.communicate(timeout=60.0)[1]
    assert "Traceback" not in said
    assert process.returncode == 0 or (process.returncode, said.splitlines()[-1]) == (130, "interrupted")


def test_ctrl_c_while_a_class_is_made_leaves_the_exit_status(tmp_path):
    """Dataclasses run code by exec(), which Python remembers until the end of `python -m`."""
    (tmp_path / "interrupted.py").write_text(
        "import sys\nfrom betterbench.cli import main as entry\nimport betterbench.cli.main\n"
        "def run():\n"
        "    try:\n"
        "        exec('raise KeyboardInterrupt')\n"
        "    except KeyboardInterrupt:\n"
        "        return 130\n"
        "sys.modules['betterbench.cli.main'].main = run\n"
        "entry()\n"
    )
    assert subprocess.run([sys.executable, "-m", "interrupted"], cwd=tmp_path, check=False).returncode == 130


_ENTRY = """
import sys
from betterbench.cli import main as entry
import betterbench.cli.main
import os, signal

def press():
    os.kill(os.getpid(), signal.SIGINT)

class Late:
    def __del__(self, kill=os.kill, me=os.getpid(), number=signal.SIGINT):  # the names are gone by then
        kill(me, number)

{run}
sys.modules["betterbench.cli.main"].main = run
entry()
"""


def _ended(tmp_path, run):
    (tmp_path / "ended.py").write_text(_ENTRY.format(run=run))
    words = [sys.executable, "-m", "ended"]
    return subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=False)


@pytest.mark.parametrize(
    "run",
    [
        "import atexit\ndef run():\n    atexit.register(press)\n    return 0",
        "kept = Late()\ndef run():\n    return 0",
    ],
    ids=["at exit", "while modules are taken down"],
)
def test_ctrl_c_after_the_work_is_done_changes_nothing(tmp_path, run):
    """The output is whole by then; torch and MuJoCo take up to a second to be taken down."""
    ended = _ended(tmp_path, run)
    assert (ended.returncode, ended.stderr) == (0, "")


def test_a_second_ctrl_c_ends_a_process_that_hangs_after_its_work(tmp_path):
    """A thread of a policy may keep the process alive."""
    run = (
        "import threading, time\n"
        "def run():\n"
        "    threading.Thread(target=time.sleep, args=(60,)).start()\n"
        "    threading.Timer(0.2, press).start()\n"
        "    threading.Timer(0.6, press).start()\n"
        "    return 0"
    )
    began = time.monotonic()
    assert _ended(tmp_path, run).returncode == -signal.SIGINT
    assert time.monotonic() - began < 30.0


def test_an_error_that_ctrl_c_became_during_imports_is_one_line(tmp_path):
    """Python makes a RuntimeError of what __set_name__ raises, as of a cached property of a class."""
    run = (
        "def run():\n"
        "    class Name:\n"
        "        def __set_name__(self, owner, name):\n"
        "            press()\n"
        "    class Owner:\n"
        "        name = Name()\n"
        "    return 0"
    )
    ended = _ended(tmp_path, run)
    assert (ended.returncode, ended.stderr) == (130, "interrupted\n")


def test_an_error_that_ctrl_c_became_in_native_code_is_one_line(monkeypatch, capsys):
    """PyOpenGL makes an ArgumentError of it, and a child that Ctrl-C ended too lets its parent fail."""
    from betterbench import cli
    from betterbench.demonstrations.recipes import write

    def interrupted(*_, **__):
        cli._interrupts.append(signal.SIGINT)
        raise TypeError("argument 1: KeyboardInterrupt")

    monkeypatch.setattr(write, "OutputFolder", interrupted)
    monkeypatch.setattr(cli, "_interrupts", [])
    assert main(["recipe", "openpi", "--data", "sets/pi", "--out", "out"]) == cli.EXIT_INTERRUPTED
    assert capsys.readouterr().err.strip().splitlines()[-1] == "interrupted"


# --- an export that another one is working at


def test_a_finished_export_does_not_remove_what_another_process_is_making(tmp_path):
    from betterbench.demonstrations.export.job import _remove_leftover

    staging = tmp_path / ".set.parts"
    staging.mkdir()
    (staging / "part.json").write_bytes(b"{}")
    with RunLock(staging / LOCK_NAME):
        _remove_leftover(staging)
        assert (staging / "part.json").exists()
    _remove_leftover(staging)
    assert not staging.exists()
