"""The rule about what may be replaced, and the folders that are guarded."""

from __future__ import annotations

import os
import subprocess
import sys
import threading

import pytest

from betterbench.errors import InvalidInputError, RunConflictError, StorageError
from betterbench.jobs import LineJournal, RunLock, write_durably
from betterbench.jobs.durable import DurableFile, remove_parts
from betterbench.jobs.lock import LOCK_NAME, FileLock
from betterbench.jobs.outputs import LIST_NAME, OutputFile, OutputFolder, bears_mark, mark_of
from betterbench.ordinary_file import NotOrdinaryError, open_ordinary, read_ordinary


def test_a_folder_lists_what_was_written_and_nothing_else_is_replaced(tmp_path):
    out = tmp_path / "out"
    with OutputFolder(out, "report"):
        write_durably(out / "a.txt", b"1")
        write_durably(out / "deep" / "b.txt", b"2")
    with OutputFolder(out, "report"):
        write_durably(out / "a.txt", b"3")
    (out / "mine.txt").write_bytes(b"mine")
    with (
        OutputFolder(out, "report"),
        pytest.raises(RunConflictError, match=r"mine\.txt: a file that .* already exists"),
    ):
        write_durably(out / "mine.txt", b"4")
    (out / "deep" / "b.txt").write_bytes(b"edited")
    with pytest.raises(RunConflictError, match=r"b\.txt: a file that .* already exists"), OutputFolder(out, "report"):
        pass
    with pytest.raises(RunConflictError, match="which better shortcuts did not write"):
        OutputFolder(out, "shortcuts").__enter__()
    with OutputFolder(out, "report", overwrite=True):
        write_durably(out / "mine.txt", b"4")
    assert (out / "mine.txt").read_bytes() == b"4"
    assert (out / "deep" / "b.txt").read_bytes() == b"edited"


def test_a_file_that_a_killed_process_did_not_list_twice_is_still_ours(tmp_path):
    """What is listed before a file is put at its place holds for the old file and the new one."""
    out = tmp_path / "out"
    with OutputFolder(out, "report"):
        write_durably(out / "a.txt", b"old")
    code = (
        "import os, sys; from pathlib import Path; from betterbench.jobs import write_durably\n"
        "from betterbench.jobs.outputs import OutputFolder\n"
        "out = Path(sys.argv[1]); folder = OutputFolder(out, 'report').__enter__()\n"
        "replace = Path.replace\n"
        "def killed(self, target):\n"
        "    if self.name.startswith('.a.txt'):\n"
        "        replace(self, target) if sys.argv[2] == 'after' else None\n"
        "        os._exit(9)\n"
        "    return replace(self, target)\n"
        "Path.replace = killed\n"
        "write_durably(out / 'a.txt', b'new')\n"
    )
    for when in ("before", "after"):
        assert subprocess.run([sys.executable, "-c", code, str(out), when], check=False).returncode == 9
        assert (out / "a.txt").read_bytes() == (b"old" if when == "before" else b"new")
        with OutputFolder(out, "report"):
            assert sorted(p.name for p in out.iterdir()) == [LOCK_NAME, LIST_NAME, "a.txt"]


@pytest.mark.parametrize("text", ["", "{", "[]", '{"by": "report"}', '{"by": 3, "files": {}}', "\xff"])
def test_a_list_that_is_none_makes_no_folder_ours(tmp_path, text):
    (tmp_path / LIST_NAME).write_text(text, encoding="latin-1")
    (tmp_path / "mine.txt").write_bytes(b"mine")
    with pytest.raises(RunConflictError, match=r"contains mine\.txt"):
        OutputFolder(tmp_path, "report").__enter__()


def test_a_list_of_a_stranger_names_nothing_outside(tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (tmp_path / "mine.txt").write_bytes(b"mine")
    (out / LIST_NAME).write_text('{"by": "report", "files": {"../mine.txt": ["0"], "/etc/passwd": ["0"]}}')
    with OutputFolder(out, "report"):
        pass
    assert (tmp_path / "mine.txt").read_bytes() == b"mine"


def test_the_journal_of_a_claimed_folder_needs_no_second_lock(tmp_path):
    with OutputFolder(tmp_path, "certify"):
        RunLock(tmp_path / LOCK_NAME).release()
        refused = []

        def other():
            try:
                RunLock(tmp_path / LOCK_NAME).release()
            except RunConflictError as error:
                refused.append(error)

        thread = threading.Thread(target=other)
        thread.start()
        thread.join()
        assert refused
        with pytest.raises(RunConflictError):
            _lock_elsewhere(tmp_path / LOCK_NAME)
    RunLock(tmp_path / LOCK_NAME).release()


def _lock_elsewhere(path):
    code = "import sys; from pathlib import Path; from betterbench.jobs import RunLock; RunLock(Path(sys.argv[1]))"
    done = subprocess.run([sys.executable, "-c", code, str(path)], capture_output=True, text=True, check=False)
    if "RunConflictError" in done.stderr:
        raise RunConflictError(done.stderr)


def test_a_file_is_locked_by_one_and_the_lock_leaves_nothing(tmp_path):
    file = tmp_path / "a.json"
    with FileLock(file), pytest.raises(RunConflictError, match="another process"):
        FileLock(file)
    assert list(tmp_path.iterdir()) == []
    seen, inside = [], threading.Event()

    def wait_for_it(number):
        with FileLock(file, waits=True):
            assert not inside.is_set()
            inside.set()
            seen.append(number)
            inside.clear()

    threads = [threading.Thread(target=wait_for_it, args=(i,)) for i in range(20)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(seen) == list(range(20))
    assert list(tmp_path.iterdir()) == []


def test_marks_are_found_at_both_ends(tmp_path):
    for text in (mark_of("show") + "x" * 200_000, "x" * 200_000 + mark_of("show")):
        (tmp_path / "a").write_text(text)
        assert bears_mark(tmp_path / "a", "show")
        assert not bears_mark(tmp_path / "a", "replay")
        with OutputFile(tmp_path / "a", "show") as path:
            write_durably(path, b"new")
        with pytest.raises(RunConflictError, match="better replay did not write"):
            OutputFile(tmp_path / "a", "replay").__enter__()


@pytest.mark.parametrize("name", ["file", "folder/file"])
def test_nothing_below_a_locked_folder_is_written_through_a_link(tmp_path, name):
    run, home = tmp_path / "run", tmp_path / "home"
    run.mkdir()
    home.mkdir()
    (home / "file").write_bytes(b"mine")
    place = run / name.partition("/")[0]
    place.symlink_to(home / "file" if name == "file" else home)
    with RunLock(run / LOCK_NAME):
        with pytest.raises(InvalidInputError, match=f"{place}: leads out of {run} through a link"):
            DurableFile(run / name)
        with pytest.raises(InvalidInputError, match="through a link"):
            RunLock(run / "folder" / LOCK_NAME if name != "file" else run / name)
    assert (home / "file").read_bytes() == b"mine"
    assert [p.name for p in home.iterdir()] == ["file"]


def test_a_link_within_a_folder_is_followed(tmp_path):
    (tmp_path / "real").mkdir()
    (tmp_path / "link").symlink_to("real")
    with RunLock(tmp_path / LOCK_NAME):
        write_durably(tmp_path / "link" / "a", b"1")
    assert (tmp_path / "real" / "a").read_bytes() == b"1"


def test_half_files_are_removed_but_not_where_somebody_writes(tmp_path):
    for folder in ("idle", "busy"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / ".a.txt.ab12_xyz.part").write_bytes(b"half")
        (tmp_path / folder / ".movie.part").write_bytes(b"of the user")
    (tmp_path / "linked").symlink_to(tmp_path / "busy")
    with RunLock(tmp_path / "busy" / LOCK_NAME):
        remove_parts(tmp_path)
    assert sorted(p.name for p in (tmp_path / "idle").iterdir()) == [".movie.part"]
    assert (tmp_path / "busy" / ".a.txt.ab12_xyz.part").exists()


class _Lines(LineJournal):
    def _take_in(self, lines):
        self.lines = lines


def test_no_tail_is_cut_off_that_is_no_beginning_of_a_line(tmp_path):
    file = tmp_path / "journal.jsonl"
    file.write_bytes(b"notes of a thesis")
    with pytest.raises(Exception, match="the end of the file is not an unfinished journal line"):
        _Lines(file)
    assert file.read_bytes() == b"notes of a thesis"
    file.write_bytes(b'{"a": 1}\n{"b"')
    with _Lines(file) as journal:
        assert journal.lines == [b'{"a": 1}']
    assert file.read_bytes() == b'{"a": 1}\n'


def test_a_folder_and_a_pipe_are_not_read(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path, said in (
        (tmp_path / "pipe", "not a regular file"),
        (tmp_path, "a folder"),
        ("/dev/null", "not a regular"),
    ):
        with pytest.raises(NotOrdinaryError, match=said):
            open_ordinary(path)
    (tmp_path / "file").write_bytes(b"1")
    assert read_ordinary(tmp_path / "file") == b"1"
    with pytest.raises(FileNotFoundError):
        open_ordinary(tmp_path / "none")
    os.truncate(tmp_path / "file", 1 << 40)  # takes no room on the disk
    with pytest.raises(NotOrdinaryError, match="is larger than"):
        read_ordinary(tmp_path / "file")


@pytest.mark.parametrize("what", ["end", "write", "error"])
def test_an_output_that_was_moved_while_it_was_written_is_not_called_whole(what, tmp_path):
    """Nothing is written to a new folder at the old place; an error of the command itself is what there is to say."""
    out, moved = tmp_path / "out", tmp_path / "moved"

    def write():
        with OutputFolder(out, "report"):
            write_durably(out / "a.txt", b"1")
            out.rename(moved)
            if what == "error":
                raise ZeroDivisionError
            if what == "write":
                write_durably(out / "b.txt", b"2")

    if what == "error":
        with pytest.raises(ZeroDivisionError):
            write()
    else:
        with pytest.raises(StorageError, match=r"out: the folder or its .* was removed or moved"):
            write()
    assert not out.exists()
    assert sorted(p.name for p in moved.iterdir()) == [LOCK_NAME, LIST_NAME, "a.txt"]


def test_a_set_of_questions_that_was_moved_while_it_was_made_is_not_called_whole(tmp_path):
    from betterbench.vqa.dataset import begun_set

    out = tmp_path / "set"

    def write():
        with begun_set(out, {}):
            out.rename(tmp_path / "moved")

    with pytest.raises(StorageError, match=r"set: the folder or its .* was removed or moved"):
        write()
    with begun_set(tmp_path / "moved", {}) as complete:
        assert not complete
