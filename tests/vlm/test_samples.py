"""The log of samples in the form of lmms-eval, read as its readers do."""

from __future__ import annotations

import json
import re

import pytest
from tests.vlm import published
from tests.vlm.test_running import Scripted, run

from betterbench.cli.main import main
from betterbench.vlm import find_benchmark

WRITTEN = {"doc_id", "target", "filtered_resps", "token_counts", "doc_hash", "input"}
"""Fields of a line of lmms-eval (commit 75571cf) for a task with one answer per document, beside the metrics."""


@pytest.fixture
def finished(tmp_path):
    """A run of eight items whose answers are read, unreadable, and empty."""
    folder, told = published.embspatial_json(tmp_path / "data"), iter(["B", "The answer is B.", "no idea", ""] * 2)
    run("embspatial", folder, tmp_path / "run", Scripted(lambda *_: next(told), name="org/model:8b"), at_once=1)
    return tmp_path / "run"


def test_a_run_is_written_as_lmms_eval_writes_it(finished, tmp_path, capsys):
    assert main(["export", str(finished), "--to", "lmms-eval", "--out", str(tmp_path / "logs"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["samples"] == [8]
    (file,) = (tmp_path / "logs").rglob("*.jsonl")
    assert str(file) == found["files"][0]
    assert file.parent.name == "org__model__8b"
    assert re.fullmatch(r"\d{8}_\d{6}_samples_embspatial\.jsonl", file.name)
    lines = [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()]
    items = find_benchmark("embspatial").load(tmp_path / "data").items
    assert [line["doc_id"] for line in lines] == list(range(8))
    for line, item in zip(lines, items, strict=True):
        assert set(line) >= WRITTEN
        assert "resps" not in line  # left out where they equal filtered_resps
        assert "doc" not in line
        assert re.fullmatch("[0-9a-f]{64}", line["doc_hash"])
        assert line["target"] == item.gold.text
        assert item.question in line["input"]
        assert line["betterbench"]["id"] == item.id
    assert [line["filtered_resps"] for line in lines[:4]] == ["B", "The answer is B.", "no idea", ""]
    result = json.loads((finished / "result.json").read_text())
    mean = sum(line["betterbench_score"] for line in lines) / 8
    assert mean == result["headline"]["parsed"] == 0.25
    assert len({line["doc_hash"] for line in lines}) == 8


def test_an_existing_log_is_kept(finished, capsys):
    line = ["export", str(finished), "--to", "lmms-eval"]
    assert main(line) == 0
    assert (finished / "lmms_eval").is_dir()
    assert main(line) == 2
    assert "exists" in capsys.readouterr().err
    assert main([*line, "--overwrite"]) == 0


def test_other_folders_and_options_are_refused(finished, tmp_path, capsys):
    (tmp_path / "other").mkdir()
    assert main(["export", str(tmp_path / "other"), "--to", "lmms-eval"]) == 2
    assert "is not the output folder of better vlm" in " ".join(capsys.readouterr().err.split())
    assert main(["export", str(finished), "--to", "lmms-eval", "--name", "x"]) == 2
    assert "--name: this option is not used by the lmms-eval export" in " ".join(capsys.readouterr().err.split())


def test_a_run_of_an_earlier_version_says_the_cure(finished, capsys):
    from betterbench.json_form import dump_json, open_sealed_lines, sealed_lines
    from betterbench.quoting import json_line

    file = finished / "items.jsonl"
    lines = open_sealed_lines(file.read_bytes(), where="items", cure="")
    old = [{k: v for k, v in json.loads(line).items() if k not in ("prompt", "target")} for line in lines]
    file.write_bytes(sealed_lines(b"".join(json_line(dump_json(line)) for line in old)))
    assert main(["export", str(finished), "--to", "lmms-eval"]) == 2
    assert "earlier version" in " ".join(capsys.readouterr().err.split())
