"""``better review scenes`` as its user meets it: a slot is moved, certified again and accepted, a scene rejected."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parents[1] / "report"))

from browser_reviewer import BrowserReviewer
from chromium import COMMAND, browser

from betterbench.cli.main import main
from betterbench.jobs.decisions import Undo, Verdict
from betterbench.review.scenes.changes import SceneJournal, SlotChange, read_scene_reviews
from betterbench.review.scenes.desk import SceneDesk
from betterbench.review.scenes.queue import scene_queue
from betterbench.sim.scenes import engine_version
from betterbench.tasks import get_task, task_from_json
from betterbench.tasks.authoring.task_form import task_forms
from betterbench.tasks.demonstrated import DemonstrationsFile, demonstrated

pytest.importorskip("viser")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(COMMAND is None, reason="no Chromium is installed"),
    # viser's own code, as it shuts down.
    pytest.mark.filterwarnings("default::DeprecationWarning:websockets"),
]

SOFTWARE_GL = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader")
ARROW_M = 0.955 * 0.09
"""Distance of the tip of an arrow of the gizmo from its origin [m]."""


@pytest.fixture
def task_file(tmp_path):
    """A task of a user, with measured demonstrations: morning_coffee with two of its variations."""
    form = task_forms(["morning_coffee"])["morning_coffee"]
    form["id"] = "my_coffee"
    form["variations"] = [v for v in form["variations"] if v["name"] in ("L1", "O1")]
    path = tmp_path / "my_coffee.json"
    path.write_text(json.dumps(form))
    found = replace(demonstrated(get_task("morning_coffee"), engine=engine_version()), version=form["version"])
    path.with_suffix(".demonstrations.json").write_text(DemonstrationsFile({"my_coffee": found}).to_text())
    return path


@pytest.fixture
def review(task_file, tmp_path):
    """The command, and the address of its page."""
    command = [sys.executable, "-m", "betterbench.cli", "review", "scenes", "--task-file", str(task_file)]
    command += ["--tasks", "my_coffee/L1", "my_coffee/O1", "--author", "ada"]
    command += ["--out", str(tmp_path / "scenes.jsonl"), "--port", "0"]
    environment = {name: value for name, value in os.environ.items() if name != "DISPLAY"}
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment)
    try:
        found = re.fullmatch(r"open (http://localhost:\d+/[\w-]{32})\n", process.stdout.readline())
        assert found is not None, process.stderr.read()
        yield process, found[1]
    finally:
        process.kill()
        process.communicate()


def test_a_slot_is_moved_and_its_scene_certified_again(review, task_file, tmp_path, monkeypatch):
    process, url = review
    with browser(tmp_path / "profile", SOFTWARE_GL) as chromium:
        reviewer = BrowserReviewer(chromium, url, root="/scene", gizmo="/scene/gizmo")
        reviewer.wait_for("Gizmo: slot")
        while "Gizmo: slot near" not in reviewer.text():
            reviewer.press("KeyT")
        at, _ = reviewer.gizmo("/scene/gizmo")
        assert at[:2] == pytest.approx((0.60, -0.13), abs=1e-4)
        reviewer.drag(at + ARROW_M * np.array([1.0, 0.0, 0.0]), np.array([0.015, 0.0, 0.0]))
        reviewer.wait_for("moved by")
        reviewer.press("KeyL")  # 5 mm to the right
        reviewer.press("Enter")
        reviewer.wait_for("Kept: slot near moved")
        reviewer.press("KeyC")
        reviewer.wait_for("Certified with seed 0", timeout_s=400.0)
        picture = os.environ.get("BETTERBENCH_REVIEW_PICTURE")
        if picture:
            reviewer.press("KeyV")
            reviewer.press("KeyV")
            reviewer.wait_for("Shown: both")
            Path(picture).write_bytes(chromium.screenshot())
        reviewer.press("KeyA")
        reviewer.wait_for("my_coffee/L1: fix")
        reviewer.press("KeyA")
        reviewer.wait_for("my_coffee/O1: fix")
        reviewer.press("Backspace")
        reviewer.wait_for("Undone: fix of my_coffee/O1")
        reviewer.press("KeyR")
        reviewer.wait_for("Write the reason for the rejection first")
        reviewer.write("reason", "the can is hidden")
        reviewer.click("Reject")
        reviewer.wait_for("my_coffee/O1: reject, the can is hidden")
        assert chromium.complaints() == []
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=120)
    assert (process.returncode, out) == (0, "")
    assert "2 of 2 scenes have a verdict" in err
    journal = tmp_path / "scenes.jsonl"
    moved, fix, other, undo, reject = (review.decision for review in read_scene_reviews(journal))
    assert isinstance(moved, SlotChange)
    assert moved.after.x - moved.before.x == pytest.approx(0.015, abs=0.006)
    assert moved.after.y - moved.before.y == pytest.approx(-0.005, abs=0.003)
    assert (fix, other, undo) == (Verdict("fix"), Verdict("fix"), Undo(3))
    assert reject == Verdict("reject", "the can is hidden")
    _writes(journal, task_file, tmp_path, moved, monkeypatch)


def _writes(journal, task_file, tmp_path, moved, monkeypatch):
    """After the other scenes were accepted, the reviewed task is written, twice with the same bytes."""
    options = ["--task-file", str(task_file)]
    assert main(["review", "apply", str(journal), *options, "--out", str(tmp_path / "early")]) == 2
    monkeypatch.setattr(SceneDesk, "_open", lambda _: None)
    with SceneJournal(journal) as opened:
        desk = SceneDesk(scene_queue(["my_coffee"]), opened, "bob")
        for k in range(4):
            desk._go(k)
            desk.accept()
    written = []
    for name in ("one", "two"):
        assert main(["review", "apply", str(journal), *options, "--out", str(tmp_path / name)]) == 0
        written.append((tmp_path / name / "my_coffee.json").read_bytes())
    assert written[0] == written[1]
    task = task_from_json(written[0])
    assert (task.slot("near").x, task.slot("near").y) == (moved.after.x, moved.after.y)
    assert [variation.name for variation in task.variations] == ["L1"]
    assert task.version == json.loads(task_file.read_text())["version"] + 1
