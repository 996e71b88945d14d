"""What a record is viewed with: lanes that follow from it, a page, and a file of Rerun where that is installed."""

from __future__ import annotations

import importlib
import io
import json
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from PIL import Image
from tests.daily import others_slow

from betterbench.cli.main import EXIT_BAD_INPUT, main
from betterbench.records.modalities.spec import ViewSpec
from betterbench.sim.modalities.rerun_file import _depth_png, is_rerun_file, write_rerun
from betterbench.sim.modalities.viewing import lanes_of

pytestmark = [pytest.mark.physics, pytest.mark.render]


def test_lanes_say_what_the_record_says(recorded):
    record = recorded.records[0]
    lanes = lanes_of(record)
    for i, name in enumerate(record.metadata.subgoal_names):
        (lane,) = [lane for lane in lanes if (lane.kind, lane.name) == ("subgoal", name)]
        there = np.zeros(len(record), bool)
        for first, last, _ in lane.spans:
            there[first : last + 1] = True
        np.testing.assert_array_equal(there, record.subgoals[:, i])
    for lane in lanes:
        if lane.kind == "contact":
            pair = lane.name.split(" – ")
            for row, state in enumerate(record.states()):
                assert state.touching(*pair) == any(first <= row <= last for first, last, _ in lane.spans)


def test_the_command_writes_files_that_it_finds_intact(recorded, tmp_path, one_process, capsys):
    out = tmp_path / "modalities"
    words = [str(recorded.run.path), "--out", str(out), "--json"]
    wanted = ["--camera", "wrist:48x32", "--modality", "boxes", "--trial", "fast_food/train1/1"]
    assert main(["materialize", *words, *wanted]) == 0
    assert json.loads(capsys.readouterr().out)["files"] == 1
    assert main(["materialize", *words, "--check", "--trial", "fast_food/train1/1"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["files"], found["rows"], found["problems"]) == (1, len(recorded.records[1]), [])
    assert main(["materialize", *words, "--trial", "fast_food/train1"]) == EXIT_BAD_INPUT
    assert main(["materialize", *words, "--modality", "normals"]) == EXIT_BAD_INPUT
    assert main(["materialize", *words, "--camera", "ceiling"]) == EXIT_BAD_INPUT
    assert main(["materialize", *words, "--trial", "fast_food/train1/77"]) == EXIT_BAD_INPUT


def test_a_page_of_a_record(recorded, tmp_path, one_process, capsys):
    record = recorded.run.record_path("fast_food", "train1", 0)
    page = tmp_path / "x.html"
    assert main(["view", str(record), "--camera", "front:64", "--out", str(page)]) == 0
    text = page.read_text()
    assert "fast_food/train1/0" in text
    assert text.count('"pictures":[') == 1
    assert main(["view", str(record), "--camera", "front:48", "--out", str(page)]) == 0  # its own page, once more
    assert page.read_text() != text
    assert main(["view", str(record), "--out", str(tmp_path / "x.txt")]) == EXIT_BAD_INPUT
    assert "'.txt'" in capsys.readouterr().err


def refused(capsys, *words):
    """Return the line of a command that is refused."""
    capsys.readouterr()
    assert main(["view", *map(str, words)]) == EXIT_BAD_INPUT
    return " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize("suffix", [".html", ".rrd"])
def test_what_somebody_else_wrote_is_left_alone(recorded, tmp_path, capsys, suffix):
    record, mine = recorded.run.record_path("fast_food", "train1", 0), tmp_path / f"mine{suffix}"
    for content in ("<!doctype html><p>betterbench, by hand", "RRF", "x"):
        mine.write_text(content)
        assert "a file that better view did not write already exists here" in refused(capsys, record, "--out", mine)
        assert mine.read_text() == content
    mine.unlink()
    mine.mkdir()
    assert refused(capsys, record, "--out", mine)


def test_an_unknown_camera_or_preset_is_named_before_anything_is_read(tmp_path, capsys):
    words = (tmp_path / "none.parquet", "--out", tmp_path / "x.html")
    assert "'fron'. Did you mean 'front'" in refused(capsys, *words, "--camera", "fron")
    assert "'fst'. Did you mean 'fast'" in refused(capsys, *words, "--quality", "fst")


def test_a_record_away_from_its_run_is_named_with_the_cure(recorded, tmp_path, capsys):
    alone = tmp_path / "alone.parquet"
    shutil.copy(recorded.run.record_path("fast_food", "train1", 0), alone)
    told = refused(capsys, alone, "--out", tmp_path / "x.html")
    assert f"{alone}: the record is not in its run folder, which contains the scene." in told
    assert "move the record back to RUN/records/fast_food/train1/0.parquet" in told


def test_without_rerun_the_extra_is_named(recorded, tmp_path, monkeypatch):
    ordinary = importlib.import_module

    def missing(name):
        if name.startswith("rerun"):
            raise ModuleNotFoundError(name)
        return ordinary(name)

    monkeypatch.setattr(importlib, "import_module", missing)
    record = recorded.run.record_path("fast_food", "train1", 0)
    from betterbench.cli.verbs.view import view_command
    from betterbench.errors import MissingDependencyError

    with pytest.raises(MissingDependencyError, match=r"setup EXTRAS=view"):
        view_command(record, out=tmp_path / "x.rrd")


def test_a_file_of_rerun_is_written_whole_or_not_at_all(recorded, tmp_path, one_process):
    pytest.importorskip("rerun")
    path, record, view = tmp_path / "x.rrd", recorded.records[0], (ViewSpec("front", 48, 48),)
    told = []
    write_rerun(recorded.run, record, view, path, quality="standard", on_progress=lambda *n: told.append(n))
    assert told[-1] == (len(record), len(record))
    assert path.read_bytes()[:4] == b"RRF2"
    assert is_rerun_file(path)
    assert path.stat().st_size > 10_000
    assert [p.name for p in tmp_path.iterdir()] == ["x.rrd"]


def test_a_file_of_rerun_holds_compressed_images(recorded, tmp_path, one_process):
    """Depth as 32-bit numbers took nine tenths of a file: 273 MB for one trial of 540 steps."""
    pytest.importorskip("rerun")
    path, record, view = tmp_path / "x.rrd", recorded.records[0], (ViewSpec("front", 256, 256),)
    write_rerun(recorded.run, record, view, path, quality="standard")
    assert path.stat().st_size < 60_000 * len(record)


def test_compressed_depth_is_that_of_the_modality_to_half_a_millimeter():
    depth = np.array([[0.1234, 1.0, 65.0], [np.nan, np.inf, 70.0]], np.float32)
    stored = np.asarray(Image.open(io.BytesIO(_depth_png(depth))))
    assert stored.dtype == np.uint16
    np.testing.assert_allclose(stored[0] / 1000.0, depth[0], atol=5.1e-4)
    assert not stored[1].any()


@pytest.mark.parametrize("number", others_slow([signal.SIGINT, signal.SIGTERM], 2))
def test_an_interrupted_file_of_rerun_leaves_nothing(recorded, tmp_path, number):
    pytest.importorskip("rerun")
    record = recorded.run.record_path("fast_food", "train1", 0)
    code = "import sys; from betterbench.cli.main import main; sys.exit(main(sys.argv[1:]))"
    words = [sys.executable, "-c", code, "view", str(record), "--out", str(tmp_path / "x.rrd")]
    process = subprocess.Popen(words, stderr=subprocess.PIPE, text=True)
    until = time.monotonic() + 120.0
    while not list(tmp_path.iterdir()) and time.monotonic() < until and process.poll() is None:
        time.sleep(0.05)
    time.sleep(0.1)
    process.send_signal(number)
    _, said = process.communicate(timeout=60.0)
    assert process.returncode == 130, said
    assert list(tmp_path.iterdir()) == []
