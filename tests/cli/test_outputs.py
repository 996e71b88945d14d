"""What every verb that writes owes to the files of others, and what every verb that reads owes to a pipe.

One table of command lines per kind of output: a single file, a folder of files, and a folder that is resumed.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from types import SimpleNamespace

import pytest
from tests.daily import others_slow
from tests.demonstrations.shortcuts.strangers import make
from tests.evaluation.conftest import in_few_steps
from tests.generation.better_release.writing import lunch, write_task

from betterbench.cli.main import VERBS, main
from betterbench.cli.verbs.evaluate import default_folder
from betterbench.jobs.lock import LOCK_NAME, FileLock, RunLock
from betterbench.jobs.outputs import LIST_NAME, bears_mark
from betterbench.records import RunFolder, read_record
from betterbench.sim.assets.catalogue.sources import procedural
from betterbench.tasks.trial import Trial

FOREIGN = b"notes of a thesis, without an end"


class _Yes(BaseHTTPRequestHandler):
    """A model that says yes to everything."""

    def do_POST(self):
        self.rfile.read(int(self.headers["Content-Length"]))
        reply = json.dumps({"choices": [{"message": {"content": "Yes"}}]}).encode()
        self.send_response(200)
        self.send_header("Content-Length", str(len(reply)))
        self.end_headers()
        self.wfile.write(reply)

    def log_message(self, *_):
        pass


def record_of(run: Path) -> Path:
    return next((run / "records" / "fast_food" / "train1").glob("*.parquet"))


@pytest.fixture(scope="module")
def made(kept_views_of_module, tmp_path_factory):
    """A run of two brief trials, a set of questions, a mixture, a few assets, and a model that answers."""
    folder = tmp_path_factory.mktemp("outputs")
    run, questions = folder / "run", folder / "questions"
    plan = ["--policy", "zoo:lexical", "--tasks", "fast_food", "--variations", "T1", "--trials", "1"]
    seen = ["--observation", "state_only", "--quality", "fast"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Trial, "resolve", in_few_steps(24))
        assert main(["eval", *plan, *seen, "--workers", "1", "--out", str(run)]) == 0
    frames = ["--frames", "2", "--size", "96", "--questions", "40", "--cameras", "front", "--quality", "fast"]
    assert main(["vqa", str(run), "--out", str(questions), *frames]) == 0
    items = folder / "items.jsonl"
    items.write_text("".join(f'{{"id": {i}}}\n' for i in range(40)))
    mixture = folder / "mixture.yaml"
    mixture.write_text("groups:\n- {name: g, weight: 1, sets: [{path: items.jsonl, name: items}]}\n")
    (folder / "meshes").mkdir()
    (folder / "meshes" / "tin.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 1\nf 1 2 3\n")
    catalogue = folder / "catalogue"
    words = ["--license", "cc0", "--encoder", "none", "--catalogue", str(catalogue)]
    assert main(["assets", "index", str(folder / "meshes"), *words]) == 0
    server = ThreadingHTTPServer(("127.0.0.1", 0), _Yes)
    threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True).start()
    patch = pytest.MonkeyPatch()
    patch.setattr(procedural, "categories", lambda: ("apple", "lemon", "orange", "takeaway_box"))  # a few, to be quick
    yield SimpleNamespace(
        folder=folder,
        run=run,
        record=record_of(run),
        questions=questions,
        mixture=mixture,
        catalogue=catalogue,
        release=write_task(folder / "Picnic", lunch()),
        strange=make(folder / "strange", "plain", "word", count=12),
        url=f"http://127.0.0.1:{server.server_port}/v1",
        plan=plan + seen,
        frames=frames,
    )
    patch.undo()
    server.shutdown()
    server.server_close()


FILES = {
    "assets": lambda made, out: ["assets", "search", "tin", "--catalogue", str(made.catalogue), "--out", out],
    "show": lambda _, out: ["show", "fast_food/T1", "--size", "64", "--out", out],
    "doctor": lambda _, out: ["doctor", "--policy", "noop", "--no-proof", "--quality", "fast", "--out", out],
    "view": lambda made, out: ["view", str(made.record), "--camera", "front:32", "--quality", "fast", "--out", out],
    "replay": lambda made, out: ["replay", str(made.record), "--size", "32", "--out", out],
    "export": lambda made, out: ["export", str(made.run), "--out", out],
    "mixture": lambda made, out: ["mixture", str(made.mixture), "--draws", "50", "--out", out],
    "vqa --answers": lambda made, out: ["vqa", str(made.questions), "--ask", made.url, "--answers", out],
}
ENDINGS = {"assets": ".png", "show": ".png", "doctor": ".png", "view": ".html", "replay": ".mp4"}

FOLDERS = {
    "report": (lambda made, out: ["report", str(made.run), "--films", "0", "--no-latex", "--out", out], "index.html"),
    "shortcuts": (lambda made, out: ["shortcuts", str(made.strange), "--out", out], "shortcuts.md"),
    "generate": (lambda _, out: ["generate", "loose_packing", "--num", "1", "--out", out], "generate.json"),
    "recipe": (lambda _, out: ["recipe", "openpi", "--data", "sets/pi", "--out", out], "README.md"),
    "place": (
        lambda _, out: ["place", "--robot", "so101", "--tasks", "fast_food", "--no-measure", "--out", out],
        "fast_food_so101.json",
    ),
    "import-better": (lambda made, out: ["import-better", str(made.release), "--out", out], "audit.md"),
}
LONG = {
    "calibrate": lambda _, out: ["calibrate", "--tasks", "fast_food", "--out", out],
    "calibrate --power": lambda _, out: ["calibrate", "--power", "--tasks", "fast_food", "--out", out],
    "certify": lambda _, out: ["certify", "--tasks", "fast_food", "--trials", "1", "--out", out],
    "study": lambda _, out: ["study", "--preset", "small", "--out", out],
}
"""Verbs that write folders too, and would take minutes: only what they refuse is looked at here."""

RESUMED = {
    "eval": lambda made, out: ["eval", *made.plan, "--workers", "1", "--out", out],
    "collect": lambda _, out: ["collect", "--tasks", "fast_food", "--demos", "1", "--workers", "1", "--out", out],
    "dataset": lambda _, out: ["dataset", "--tasks", "fast_food", "--demos", "1", "--workers", "1", "--out", out],
    "materialize": lambda made, out: ["materialize", str(made.run), "--camera", "front:32", "--out", out],
    "vqa": lambda made, out: ["vqa", str(made.run), *made.frames, "--out", out],
}
"""Verbs whose folder is resumed, and never taken if it holds anything else."""


def said(capsys, words):
    """Runs a verb that has to refuse, and returns its one line."""
    capsys.readouterr()
    assert main(words) == 2
    text = " ".join(capsys.readouterr().err.split())
    assert "Traceback" not in text
    return text


def content(folder: Path):
    """Returns what a folder holds, as far as the user sees it."""
    hidden = (LOCK_NAME, LIST_NAME)
    return {p.relative_to(folder): p.read_bytes() for p in folder.rglob("*") if p.is_file() and p.name not in hidden}


def test_the_tables_name_every_verb_that_writes():
    named = {name.partition(" ")[0] for name in (*FILES, *FOLDERS, *LONG, *RESUMED)}
    elsewhere = {"premise", "diagnose"}  # below
    elsewhere |= {"amplify", "teleop"}  # a run as that of collect
    elsewhere |= {"compare", "demo"}  # a folder as that of report
    elsewhere |= {"train", "worlds", "review", "build", "vlm"}  # with locks that have tests of their own
    elsewhere |= {"real"}  # a plan that is never replaced, and journals
    reads = {"list", "serve", "audit-paper"}
    assert named | elsewhere | reads == set(VERBS)


@pytest.mark.parametrize("name", FILES)
def test_a_file_of_somebody_else_stays_as_it_is(made, tmp_path, capsys, name):
    out = tmp_path / f"thesis{ENDINGS.get(name, '.txt')}"
    words = FILES[name](made, str(out))
    out.write_bytes(FOREIGN)
    text = said(capsys, words)
    assert f"{out}: a file that better {words[0]} did not write already exists here and is not replaced." in text
    assert text.endswith("Choose a different file name, or pass --overwrite.")
    assert out.read_bytes() == FOREIGN
    assert [p.name for p in tmp_path.iterdir()] == [out.name]
    assert main([*words, "--overwrite"]) == 0
    first = out.read_bytes()
    assert first != FOREIGN
    assert main(words) == 0  # what it wrote itself it replaces, or goes on with
    # x264 does not give the same bytes for the same frames each time; what is in the video has tests of its own.
    assert out.read_bytes() == first or (out.suffix == ".mp4" and FOREIGN not in out.read_bytes())
    assert [p.name for p in tmp_path.iterdir()] == [out.name]


@pytest.mark.parametrize("name", FILES)
def test_an_empty_file_is_nobodys(made, tmp_path, name):
    if name in ("doctor", "replay", "view"):
        pytest.skip("as the other files, and slow")
    out = tmp_path / f"new{ENDINGS.get(name, '.txt')}"
    out.touch()
    assert main(FILES[name](made, str(out))) == 0
    assert out.stat().st_size


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("what", ["link", "folder", "pipe", "locked"])
def test_what_is_no_file_of_ours_is_not_written_to(made, tmp_path, capsys, name, what):
    out, victim = tmp_path / f"out{ENDINGS.get(name, '.txt')}", tmp_path / "victim"
    victim.write_bytes(FOREIGN)
    words = FILES[name](made, str(out))
    if what == "link":
        out.symlink_to(victim)
        assert f"{out}: a link that better {words[0]} did not write already exists here" in said(capsys, words)
        assert out.is_symlink()
    elif what == "folder":
        out.mkdir()
        assert "is a folder, which is never replaced" in said(capsys, words)
        assert "is a folder, which is never replaced" in said(capsys, [*words, "--overwrite"])
    elif what == "pipe":
        os.mkfifo(out)
        assert "is a pipe, socket or device, which is never replaced" in said(capsys, [*words, "--overwrite"])
        assert out.is_fifo()
    else:
        with FileLock(out):
            assert "another process" in said(capsys, words)
        assert not out.exists()
    assert victim.read_bytes() == FOREIGN


def test_a_link_that_may_be_overwritten_is_replaced_and_not_followed(made, tmp_path):
    out, victim = tmp_path / "out.png", tmp_path / "victim"
    victim.write_bytes(FOREIGN)
    out.symlink_to(victim)
    assert main([*FILES["show"](made, str(out)), "--overwrite"]) == 0
    assert not out.is_symlink()
    assert bears_mark(out, "show")
    assert victim.read_bytes() == FOREIGN


@pytest.mark.parametrize("name", FOLDERS)
def test_files_of_somebody_else_stay_in_a_folder_and_half_files_do_not(made, tmp_path, capsys, name):
    command, page = FOLDERS[name]
    out = tmp_path / "thesis"
    words = command(made, str(out))
    out.mkdir()
    (out / page).write_bytes(FOREIGN)
    (out / "mine.txt").write_bytes(FOREIGN)
    text = said(capsys, words)
    assert f"{out}: the folder contains " in text
    assert "--overwrite" in text
    assert content(out) == {Path(page): FOREIGN, Path("mine.txt"): FOREIGN}
    assert main([*words, "--overwrite"]) == 0
    assert (out / page).read_bytes() != FOREIGN
    assert (out / "mine.txt").read_bytes() == FOREIGN
    first = content(out)
    (out / ".page.html.ab12_xyz.part").write_bytes(b"half")  # of a killed command
    assert main(words) == 0
    assert content(out) == first
    edited = (out / page).read_bytes() + b"<!-- my own remark -->\n"
    (out / page).write_bytes(edited)
    assert f"{out / page}: a file that better {words[0]} did not write already exists here" in said(capsys, words)
    assert (out / page).read_bytes() == edited
    assert main([*words, "--overwrite"]) == 0
    assert content(out) == first


@pytest.mark.parametrize("name", FOLDERS)
def test_one_process_writes_to_a_folder(made, tmp_path, capsys, name):
    out = tmp_path / "out"
    with RunLock(out / LOCK_NAME):
        assert "is writing here" in said(capsys, FOLDERS[name][0](made, str(out)))
    assert content(out) == {}


def test_a_command_that_fails_leaves_no_folder(made, tmp_path, capsys):
    assert "8 are needed" in said(capsys, ["shortcuts", str(made.run), "--out", str(tmp_path / "out")])
    assert not (tmp_path / "out").exists()


def test_half_files_beside_a_file_are_removed_and_no_others(made, tmp_path):
    out = tmp_path / "out.json"
    others = [tmp_path / ".out.json.bak.ab12_xyz.part", tmp_path / ".mine.part"]
    for other in others:
        other.write_bytes(FOREIGN)
    (tmp_path / ".out.json.ab12_xyz.part").write_bytes(b"half")
    assert main(FILES["export"](made, str(out))) == 0
    assert sorted(tmp_path.iterdir()) == sorted([out, *others])


@pytest.mark.parametrize("name", [*LONG, *RESUMED])
def test_a_verb_that_goes_on_takes_no_folder_of_somebody_else(made, tmp_path, capsys, name):
    out = tmp_path / "thesis"
    out.mkdir()
    (out / "thesis.txt").write_bytes(FOREIGN)
    said(capsys, (LONG | RESUMED)[name](made, str(out)))
    assert [p.name for p in out.iterdir()] == ["thesis.txt"]
    assert (out / "thesis.txt").read_bytes() == FOREIGN


@pytest.mark.parametrize("name", [*LONG, *RESUMED])
def test_a_verb_that_goes_on_is_alone_in_its_folder(made, tmp_path, capsys, name):
    with RunLock(tmp_path / "out" / LOCK_NAME):
        assert "writing here" in said(capsys, (LONG | RESUMED)[name](made, str(tmp_path / "out")))


def test_premises_are_kept_in_no_file_of_somebody_else(tmp_path, capsys):
    out = tmp_path / "notes.txt"
    out.write_bytes(FOREIGN)
    assert "did not write" in said(capsys, ["premise", "libero", "--out", str(out)])
    with FileLock(tmp_path / "new.jsonl"):
        assert "another process" in said(capsys, ["premise", "libero", "--out", str(tmp_path / "new.jsonl")])
    assert out.read_bytes() == FOREIGN


def test_two_mixtures_at_once_write_one_file(made, tmp_path):
    out = tmp_path / "draws.jsonl"
    words = ["mixture", str(made.mixture), "--draws", "5000", "--out"]
    assert main([*words, str(tmp_path / "whole.jsonl")]) == 0
    command = [sys.executable, "-m", "betterbench.cli", *words, str(out)]
    both = [subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) for _ in range(2)]
    told = [process.communicate(timeout=60) for process in both]
    assert sorted(p.returncode for p in both) in ([0, 0], [0, 2]), told
    assert out.read_bytes() == (tmp_path / "whole.jsonl").read_bytes()


EXPORT = [sys.executable, "-m", "betterbench.cli", "export"]


@pytest.fixture(scope="module")
def exported(made):
    """A whole export, and the time that it took [s]."""
    whole, began = made.folder / "whole.json", time.monotonic()
    subprocess.run([*EXPORT, str(made.run), "--out", str(whole)], check=True, capture_output=True)
    return whole, time.monotonic() - began


@pytest.mark.parametrize("at", others_slow([0.2, 0.5, 0.9], 3))
def test_a_killed_export_is_written_whole_by_the_next(made, exported, tmp_path, at):
    (whole, took_s), out = exported, tmp_path / "out" / "out.json"
    command = [*EXPORT, str(made.run), "--out", str(out)]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(at * took_s)
    process.kill()
    process.wait()
    assert main(["export", str(made.run), "--out", str(out)]) == 0
    assert out.read_bytes() == whole.read_bytes()
    assert [p.name for p in out.parent.iterdir()] == ["out.json"]


# --- links inside a run of a stranger


@pytest.fixture
def stranger(made, tmp_path):
    """A copy of the run, as somebody may have sent it, and a folder and a file of the user."""
    run, home, victim = tmp_path / "run", tmp_path / "home", tmp_path / "victim"
    shutil.copytree(made.run, run)
    home.mkdir()
    (home / "index.html").write_bytes(FOREIGN)
    victim.write_bytes(FOREIGN)

    def replace(name, target):
        place = run / name
        if place.is_dir() and not place.is_symlink():
            shutil.rmtree(place)
        place.unlink(missing_ok=True)
        place.parent.mkdir(parents=True, exist_ok=True)
        place.symlink_to(target)
        return place

    yield SimpleNamespace(run=run, home=home, victim=victim, replace=replace, plan=made.plan)
    assert victim.read_bytes() == FOREIGN
    assert content(home) == {Path("index.html"): FOREIGN}


LINKED_FOLDERS = {
    "report": lambda s: ["report", str(s.run), "--films", "0"],
    "modalities": lambda s: ["materialize", str(s.run), "--camera", "front:32"],
    "videos": lambda s: ["replay", str(record_of(s.run)), "--size", "64"],
    "tensorboard": lambda s: ["export", str(s.run), "--to", "tensorboard"],
    "records": lambda s: ["eval", *s.plan, "--workers", "1", "--out", str(s.run)],
}


@pytest.mark.parametrize("name", LINKED_FOLDERS)
def test_no_folder_of_a_run_leads_out_of_it(stranger, capsys, name):
    words = LINKED_FOLDERS[name](stranger)
    stranger.replace(name, stranger.home)
    text = said(capsys, words)
    assert f"{name}: leads out of" in text or f"{stranger.run / name}" in text
    assert "link" in text


LINKED_FILES = {
    LOCK_NAME: lambda s: ["eval", *s.plan, "--workers", "1", "--out", str(s.run)],
    "diagnosis.json": lambda s: ["diagnose", str(s.run)],
}


@pytest.mark.parametrize("name", LINKED_FILES)
def test_no_file_of_a_run_leads_out_of_it(stranger, capsys, name):
    stranger.replace(name, stranger.victim)
    text = said(capsys, LINKED_FILES[name](stranger))
    assert name in text
    assert (stranger.run / name).is_symlink()


@pytest.mark.parametrize("kind", ["link", "second name"])
@pytest.mark.parametrize("name", ["journal.jsonl", LOCK_NAME])
def test_what_is_written_in_place_has_no_second_name(stranger, capsys, name, kind):
    place, elsewhere = stranger.run / name, stranger.home.parent / "elsewhere"
    shutil.copy(place, elsewhere)
    before = elsewhere.read_bytes()
    place.unlink()
    if kind == "link":
        place.symlink_to(elsewhere)
    else:
        os.link(elsewhere, place)
    longer = [*stranger.plan[:-5], "2", *stranger.plan[-4:]]
    assert stranger.plan[-5] == "1"
    text = said(capsys, ["eval", *longer, "--workers", "1", "--out", str(stranger.run)])
    assert str(place) in text
    assert "link" in text
    assert elsewhere.read_bytes() == before


def test_a_folder_that_the_user_names_may_be_a_link(made, tmp_path):
    (tmp_path / "disk").mkdir()
    (tmp_path / "out").symlink_to(tmp_path / "disk")
    assert main(FOLDERS["report"][0](made, str(tmp_path / "out"))) == 0
    assert main(FILES["export"](made, str(tmp_path / "out" / "x.json"))) == 0
    assert {"index.html", "x.json"} <= {p.name for p in (tmp_path / "disk").iterdir()}


@pytest.mark.parametrize("name", ["figures", "index.html"])
def test_no_link_in_an_output_of_ours_is_followed(made, tmp_path, capsys, name):
    out, home = tmp_path / "out", tmp_path / "home"
    home.mkdir()
    words = FOLDERS["report"][0](made, str(out))
    assert main(words) == 0
    place = out / name
    shutil.rmtree(place) if place.is_dir() else place.unlink()
    place.symlink_to(home if name == "figures" else home / "page.html")
    said(capsys, words)
    assert list(home.iterdir()) == []


# --- pipes where files are read


class _HungError(BaseException):
    """A command waits for a pipe."""


@contextlib.contextmanager
def within(seconds):
    def ring(*_):
        raise _HungError

    before = signal.signal(signal.SIGALRM, ring)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


IN_RUN = ["run.json", "journal.jsonl", "diagnosis.json", "knowledge.json", "record", "scene"]


@pytest.mark.parametrize("name", IN_RUN)
def test_a_pipe_in_a_run_is_not_waited_for(stranger, capsys, name):
    record = record_of(stranger.run)
    scene = RunFolder.open(stranger.run).scene_path(read_record(record).metadata.scene_hash)
    place = {"record": record, "scene": scene}.get(name, stranger.run / name)
    place.unlink(missing_ok=True)
    os.mkfifo(place)
    commands = [["diagnose", str(stranger.run)], ["report", str(stranger.run), "--films", "0"]]
    commands += [["eval", *stranger.plan, "--workers", "1", "--out", str(stranger.run)]] if name == "run.json" else []
    commands += [["export", str(stranger.run), "--out", str(stranger.run.parent / "x.json")]]
    if name == "scene":
        commands = [["replay", str(record), "--check"]]
    for words in commands:
        with within(20.0), contextlib.suppress(SystemExit):
            main(words)
        assert "Traceback" not in capsys.readouterr().err


PIPES = {
    "submission": lambda made, pipe: ["compare", str(made.run), pipe],
    "exported": lambda made, pipe: ["export", str(made.run), "--check", pipe],
    "hdf5": lambda made, pipe: ["export", str(made.run), "--check", pipe],
    "yaml": lambda _, pipe: ["mixture", pipe],
    "draws": lambda made, pipe: ["mixture", str(made.mixture), "--draws", "5", "--out", pipe],
    "plan": lambda _, pipe: ["study", pipe, "--out", "study"],
    "recipe": lambda _, pipe: ["recipe", "openpi", "--recipe", pipe, "--data", "sets/pi"],
    "answers": lambda made, pipe: ["vqa", str(made.questions), "--answers", pipe],
    "asked": lambda made, pipe: ["vqa", str(made.questions), "--ask", made.url, "--answers", pipe],
    "known": lambda made, pipe: ["diagnose", str(made.run), "--answers", pipe, "--questions", str(made.questions)],
    "key": lambda made, pipe: ["shortcuts", str(made.run), "--out", "audit", "--sign", pipe],
    "tables": lambda _, pipe: ["audit-paper", "--tables", pipe],
    "tasks": lambda _, pipe: ["list", "tasks", "--task-file", pipe],
    "options": lambda _, pipe: ["eval", "--run-file", pipe],
    "certificate": lambda made, pipe: ["eval", *made.plan, "--certificate", pipe, "--out", "run"],
    "policy": lambda made, pipe: ["eval", *made.plan[2:], "--policy", f"python:{pipe}:Mine", "--out", "run"],
    "learner": lambda made, pipe: ["eval", *made.plan[2:], "--policy", f"learned:{pipe}", "--out", "run"],
    "record": lambda _, pipe: ["replay", pipe, "--check"],
    "viewed": lambda _, pipe: ["view", pipe],
    "premises": lambda _, pipe: ["premise", "libero", "--out", pipe],
}
SUFFIXES = {"hdf5": ".hdf5", "yaml": ".yaml", "plan": ".yaml", "recipe": ".yaml", "tasks": ".py", "policy": ".py"}


@pytest.mark.parametrize(
    ("kind", "name"),
    [
        pytest.param(kind, name, marks=pytest.mark.slow if (kind, name) == ("socket", "policy") else ())
        for kind in ("pipe", "socket")
        for name in PIPES  # the file of a policy is read in a process of its own
    ],
)
def test_a_pipe_in_place_of_a_file_is_not_waited_for(made, tmp_path, capsys, name, kind):
    place = tmp_path / f"p{SUFFIXES.get(name, '.json')}"
    if kind == "pipe":
        os.mkfifo(place)
    else:
        import socket

        opened = socket.socket(socket.AF_UNIX)
        opened.bind(str(place))
        opened.close()
    with contextlib.chdir(tmp_path), within(20.0):
        assert main(PIPES[name](made, str(place))) == 2
    text = capsys.readouterr().err
    assert "Traceback" not in text
    assert len(text.strip().splitlines()) < 8


@pytest.mark.parametrize("name", ["summary.json", "set.json", "questions.jsonl", "images"])
def test_a_pipe_in_a_set_of_questions_is_not_waited_for(made, tmp_path, capsys, name):
    copy = tmp_path / "questions"
    shutil.copytree(made.questions, copy)
    for place in list((copy / "images").rglob("*.jpg")) if name == "images" else [copy / name]:
        place.unlink()
        os.mkfifo(place)
    with within(20.0):
        assert main(["vqa", str(copy), "--ask", made.url]) == 2
    assert "Traceback" not in capsys.readouterr().err


def test_a_pipe_among_modalities_is_not_waited_for(made, tmp_path, capsys):
    words = ["materialize", str(made.run), "--camera", "front:32", "--modality", "rgb", "--out", str(tmp_path / "m")]
    assert main(words) == 0
    file = next((tmp_path / "m").rglob("*.parquet"))
    whole = file.read_bytes()
    file.unlink()
    os.mkfifo(file)
    with within(20.0):
        assert main(["materialize", str(made.run), "--out", str(tmp_path / "m"), "--check"]) == 2
        assert main(words) == 0  # it is drawn again
    assert file.read_bytes() == whole
    (tmp_path / "m" / "materialize.json").unlink()
    os.mkfifo(tmp_path / "m" / "materialize.json")
    with within(20.0):
        assert main(words) == 2
    assert "Traceback" not in capsys.readouterr().err


def test_a_pipe_in_a_data_set_of_lerobot_is_not_waited_for(made, tmp_path, capsys):
    names = sorted(str(p.relative_to(made.strange)) for p in made.strange.rglob("*") if p.is_file())
    (tmp_path / "mixture.yaml").write_text("groups:\n- {name: g, weight: 1, sets: [{path: set, name: s}]}\n")
    for name in dict.fromkeys((names[0], names[-1], *(n for n in names if n.startswith("meta")))):
        shutil.rmtree(tmp_path / "set", ignore_errors=True)
        shutil.copytree(made.strange, tmp_path / "set")
        (tmp_path / "set" / name).unlink()
        os.mkfifo(tmp_path / "set" / name)
        with within(20.0):
            main(["shortcuts", str(tmp_path / "set")])
            main(["mixture", str(tmp_path / "mixture.yaml"), "--draws", "5"])
        assert "Traceback" not in capsys.readouterr().err


# --- a disk that is full or not ours


@pytest.mark.parametrize("name", ["export", "mixture", "vqa --answers", "report", "shortcuts", "recipe"])
def test_a_full_disk_is_one_line(made, tmp_path, capsys, monkeypatch, name):
    out = tmp_path / "out"
    words = (
        FILES[name](made, f"{out}{ENDINGS.get(name, '.txt')}") if name in FILES else FOLDERS[name][0](made, str(out))
    )

    def full(_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    text = said(capsys, words)
    assert "No space left on device" in text
    monkeypatch.undo()
    assert not [p for p in tmp_path.rglob("*") if p.name.endswith(".part")]
    assert main(words) == 0


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
@pytest.mark.parametrize("name", [*FILES, *FOLDERS])
def test_a_folder_that_may_not_be_written_is_one_line(made, tmp_path, capsys, name):
    tmp_path.chmod(0o500)
    try:
        out = tmp_path / f"out{ENDINGS.get(name, '')}"
        said(capsys, FILES[name](made, str(out)) if name in FILES else FOLDERS[name][0](made, str(out)))
    finally:
        tmp_path.chmod(0o700)


def test_vqa_names_a_folder_that_is_not_there(tmp_path, capsys):
    words = ["vqa", str(tmp_path / "gone"), "--ask", "http://127.0.0.1:9/v1"]
    assert f"{tmp_path / 'gone'} is not a folder" in said(capsys, words)


def test_a_default_name_fits_a_folder_whatever_the_policy_is_called():
    """No system takes a name of 256 bytes, and the path of a policy's file is often longer."""
    deep = ["python:/" + "/".join(["deep" * 20] * n) + "/policy.py:Policy" for n in (4, 9)]
    names = [
        default_folder(p) for p in (*deep, deep[0] + "2", "x" * 5000, "\x1b[2J", "../../x", "..", "", "\ud800" * 300)
    ]
    assert all(re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9.-]{0,99}", name) for name in names), names
    assert len(set(names[:4])) == 4
    assert default_folder("openpi://127.0.0.1:8000?preset=native") == "openpi-127.0.0.1-8000-preset-native"
