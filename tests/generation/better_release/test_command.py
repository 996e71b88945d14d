"""The verb ``better import-better``: its files, its tables and its errors."""

from __future__ import annotations

import json

import pytest
from tests.generation.better_release.test_audit import ev, left
from tests.generation.better_release.writing import APPLE, clone, lunch, write_task

from betterbench.cli.main import main
from betterbench.tasks import read_suite_folder, task_from_json


def run(*words):
    return main(["import-better", *map(str, words)])


def test_the_audit_and_the_suite_are_written(tmp_path, capsys):
    files = lunch()
    left(files)
    root, out = clone(tmp_path / "clone", files), tmp_path / "out"
    assert run(root, "--out", out) == 0
    shown = capsys.readouterr().out
    assert "replaced_but_left" in shown
    assert "1.4 cm from the block (block_1)" in " ".join(shown.split())
    form = json.loads((out / "audit.json").read_text())
    (task,) = form["tasks"]
    assert task["release_task"] == "Picnic"
    assert [v["condition"] for v in task["variations"]] == ["train1", "train2", "O1"]
    assert {f["code"] for f in task["findings"]} >= {"replaced_but_left", "overlap"}
    assert all(v["certificate"] is None for v in task["variations"])
    suite = read_suite_folder(out / form["suite"])
    assert suite.tasks == ("better_picnic",)
    assert task_from_json(suite.files[0].read_text()).id == "better_picnic"
    page = (out / "audit.md").read_text()
    assert "- **fault** `replaced_but_left`: The apple (apple_1) is in no group" in page


def test_the_same_release_gives_the_same_bytes(tmp_path, capsys):
    root = clone(tmp_path / "clone", lunch())
    for name in ("one", "other"):
        assert run(root, "--out", tmp_path / name, "--json") == 0
    assert (tmp_path / "one" / "audit.json").read_bytes() == (tmp_path / "other" / "audit.json").read_bytes()
    out = capsys.readouterr().out
    decoder = json.JSONDecoder()
    assert decoder.raw_decode(out)[0] == json.loads((tmp_path / "one" / "audit.json").read_text())
    assert run(root, "--out", tmp_path / "one") == 0  # its own folder is written again
    (tmp_path / "one" / "audit.md").write_text("edited")
    assert run(root, "--out", tmp_path / "one") == 2


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--asset", "apple_1"], "expected NAME=CATEGORY"),
        (["--asset", "aple_1=apple"], "Unknown object of the release 'aple_1'. Did you mean 'apple_1'"),
        (["--asset", f"{APPLE}=appel"], "Did you mean 'apple'"),
        (["--asset", f"{APPLE}=apple", f"{APPLE}=lemon"], "the object was given twice"),
        (["--catalogue", "nowhere"], "nowhere"),
    ],
)
def test_a_wrong_option_is_one_line(tmp_path, capsys, words, said):
    root = clone(tmp_path / "clone", lunch())
    assert run(root, "--out", tmp_path / "out", *words) == 2
    error = capsys.readouterr().err
    assert said in " ".join(error.split())
    assert "Traceback" not in error
    assert not (tmp_path / "out").exists()


def test_markup_of_a_release_stays_text(tmp_path):
    files = lunch()
    ev(files)["instruction"] = "Put the apple <script>alert(1)</script> | [x](http://x) into the box."
    assert run(write_task(tmp_path / "Picnic", files), "--out", tmp_path / "out") == 0
    page = (tmp_path / "out" / "audit.md").read_text()
    assert "<script>" not in page.replace("\\<script>", "")
    assert "[x](http" not in page


def test_a_folder_without_a_release_is_named(tmp_path, capsys):
    assert run(tmp_path, "--out", tmp_path / "out") == 2
    assert "Pass a clone of" in " ".join(capsys.readouterr().err.split())


@pytest.mark.slow
@pytest.mark.physics
def test_the_certificate_stands_beside_the_audit(tmp_path):
    import subprocess
    import sys

    root, out = clone(tmp_path / "clone", lunch()), tmp_path / "out"
    words = ["--certify", "--trials", "1", "--demonstrations", "24", "--workers", "1", "--json"]
    command = [sys.executable, "-m", "betterbench.cli", "import-better", str(root), "--out", str(out), *words]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    variations = json.loads(done.stdout)["tasks"][0]["variations"]
    assert [v["certificate"]["passed"] for v in variations] == [1, 1, 1], done.stdout
    assert [v["certificate"]["failures"] for v in variations] == [[], [], []]
