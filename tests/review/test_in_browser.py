"""``better review`` as its user meets it: a mug is righted, a grasp moved, a block rejected, and all is replayed."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parents[1] / "report"))

from browser_reviewer import BrowserReviewer, write_leaning_mug
from chromium import COMMAND, browser

from betterbench.errors import InvalidInputError
from betterbench.review.agreement import agreement
from betterbench.sim.assets import build
from betterbench.sim.assets.authoring.registry import unregister
from betterbench.sim.assets.importing import child, imported
from betterbench.sim.assets.importing.review import GraspChange, PoseChange, Undo, Verdict, read_reviews

pytest.importorskip("viser")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(COMMAND is None, reason="no Chromium is installed"),
    # viser's own code, as it shuts down.
    pytest.mark.filterwarnings("default::DeprecationWarning:websockets"),
]

SOFTWARE_GL = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader")


@pytest.fixture
def meshes(tmp_path):
    """A mug that leans by 30 degrees, and a block."""
    folder = tmp_path / "meshes"
    folder.mkdir()
    write_leaning_mug(folder / "a_mug.glb")
    trimesh.creation.box((0.05, 0.04, 0.06)).export(folder / "block.glb")
    return folder


@pytest.fixture
def review(meshes, tmp_path):
    """The command, and the address of its page."""
    command = [sys.executable, "-m", "betterbench.cli", "review", str(meshes), "--author", "ada"]
    command += ["--out", str(tmp_path / "reviews.jsonl"), "--port", "0"]
    environment = {name: value for name, value in os.environ.items() if name != "DISPLAY"}
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment)
    try:
        found = re.fullmatch(r"open (http://localhost:\d+/[\w-]{32})\n", process.stdout.readline())
        assert found is not None, process.stderr.read()
        yield process, found[1]
    finally:
        process.kill()
        process.communicate()


def test_a_mug_is_righted_a_grasp_moved_and_a_block_rejected(review, meshes, tmp_path, monkeypatch):
    process, url = review
    with browser(tmp_path / "profile", SOFTWARE_GL) as chromium:
        reviewer = BrowserReviewer(chromium, url)
        reviewer.right_the_mug()
        assert "× 7.6 × 9.0 cm" in reviewer.text()
        approach = reviewer.raise_grasp(0.015)
        reviewer.press("Enter")
        reviewer.wait_for("Kept: grasp")
        reviewer.press("KeyN")  # a new grasp is added, and taken back
        reviewer.wait_for("added — Enter keeps it")
        reviewer.press("Enter")
        reviewer.wait_for("Kept: grasp grasp added")
        reviewer.press("Backspace")
        reviewer.wait_for("Undone: grasp grasp added")
        reviewer.press("KeyD")
        reviewer.wait_for("Comes to rest after")
        reviewer.press("KeyG")
        reviewer.wait_for("Lifted", "The gripper closes", "The open gripper")
        reviewer.press("KeyA")
        reviewer.wait_for("a_mug.glb: fix")
        reviewer.press("KeyR")
        reviewer.wait_for("Write the reason for the rejection first")
        reviewer.write("reason", "a block is not a toy")
        reviewer.click("Reject")
        reviewer.wait_for("block.glb: reject, a block is not a toy")
        assert chromium.complaints() == []
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert (process.returncode, out) == (0, "")
    assert "2 of 2 objects have a verdict" in err
    journal = tmp_path / "reviews.jsonl"
    pose, grasp, added, undo, fix, reject = (r.decision for r in read_reviews(journal))
    assert (type(pose), type(grasp), type(added), undo) == (PoseChange, GraspChange, GraspChange, Undo(3))
    assert (fix, reject) == (Verdict("fix"), Verdict("reject", "a block is not a toy"))
    moved = np.subtract(grasp.after.pose.position, grasp.before.pose.position)
    assert moved @ approach == pytest.approx(-0.015, abs=0.004)
    assert agreement(journal, journal).all.kappa == 1.0
    _replays(meshes, journal, tmp_path, monkeypatch, grasp.after)


def _replays(meshes, journal, tmp_path, monkeypatch, grasp):
    """Two fresh caches get the same bytes, and tasks get the righted mug and no block."""
    made = []
    for cache in ("one", "two"):
        monkeypatch.setattr(child, "cache_folder", lambda cache=cache: tmp_path / cache)
        imported("reviewed_mug", meshes / "a_mug.glb", color="gray", name="a_mug", any_license=True, review=journal)
        imported("reviewed_block", meshes / "block.glb", color="gray", name="block", any_license=True, review=journal)
        try:
            made.append(build("reviewed_mug"))
            with pytest.raises(InvalidInputError, match=r"ada rejected it on .*: a block is not a toy"):
                build("reviewed_block")
        finally:
            unregister("reviewed_mug")
            unregister("reviewed_block")
    files = [{p.name: p.read_bytes() for p in (tmp_path / cache).rglob("*.npz")} for cache in ("one", "two")]
    assert files[0] == files[1]
    assert made[0].size_m[1:] == pytest.approx((0.076, 0.09), abs=2e-3)
    assert made[0].grasp(grasp.name) == grasp
    assert "opening" in {region.name for region in made[0].regions}
