"""What a record is viewed with: lanes that follow from it, a page, and a file of Rerun where that is installed."""

from __future__ import annotations

import importlib
import json

import numpy as np
import pytest

from betterbench.cli.main import EXIT_BAD_INPUT, main
from betterbench.materialization.rerun_file import write_rerun
from betterbench.materialization.viewing import lanes_of
from betterbench.recording.modalities.spec import ViewSpec

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
    assert main(["materialize", *words, "--check"]) == 0
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
    assert main(["view", str(record), "--out", str(tmp_path / "x.txt")]) == EXIT_BAD_INPUT
    assert "'.txt'" in capsys.readouterr().err


def test_without_rerun_the_extra_is_named(recorded, tmp_path, monkeypatch):
    def missing(name):
        raise ModuleNotFoundError(name)

    monkeypatch.setattr(importlib, "import_module", missing)
    record = recorded.run.record_path("fast_food", "train1", 0)
    from betterbench.cli.view import view_command
    from betterbench.errors import MissingDependencyError

    with pytest.raises(MissingDependencyError, match=r"betterbench\[view\]"):
        view_command(record, out=tmp_path / "x.rrd")


def test_a_file_of_rerun_is_written_whole_or_not_at_all(recorded, tmp_path, one_process):
    pytest.importorskip("rerun")
    path, record, view = tmp_path / "x.rrd", recorded.records[0], (ViewSpec("front", 48, 48),)
    told = []
    write_rerun(recorded.run, record, view, path, quality="standard", on_progress=lambda *n: told.append(n))
    assert told[-1] == (len(record), len(record))
    assert path.read_bytes()[:4] == b"RRF2"
    assert path.stat().st_size > 10_000
    assert [p.name for p in tmp_path.iterdir()] == ["x.rrd"]
