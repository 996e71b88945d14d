"""``better teleop`` as its operator meets it: the gizmo is dragged in a browser until all is packed and saved."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parents[2] / "report"))

from browser_operator import BrowserOperator
from chromium import COMMAND, browser
from scripted_operator import CONDITION, ITEMS, TASK, above_spot, fresh_scene, grasp_of

from betterbench.demonstrations.teleop.session import TeleopSession
from betterbench.geometry import distance
from betterbench.records import RunFolder, read_record

pytest.importorskip("viser")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(COMMAND is None, reason="no Chromium is installed"),
    # viser's own code, as it shuts down.
    pytest.mark.filterwarnings("default::DeprecationWarning:websockets"),
]

SOFTWARE_GL = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader")


@pytest.fixture
def teleop(tmp_path):
    """The command, and the address of its page."""
    command = [sys.executable, "-m", "betterbench.cli", "teleop", "--tasks", TASK, "--condition", CONDITION]
    command += ["--out", str(tmp_path / "run"), "--port", "0", "--name", "tester", "--devices", "none"]
    environment = {name: value for name, value in os.environ.items() if name != "DISPLAY"}
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment)
    try:
        found = re.fullmatch(r"open (http://localhost:\d+/[\w-]{32})\n", process.stdout.readline())
        assert found is not None, process.stderr.read()
        yield process, found[1]
    finally:
        process.kill()
        process.communicate()


def test_fruit_is_packed_by_dragging_the_gizmo_and_saved(teleop, tmp_path):
    process, url = teleop
    session = TeleopSession(fresh_scene())
    grasps = [grasp_of(session, item)[0] for item in ITEMS]
    with browser(tmp_path / "profile", SOFTWARE_GL) as chromium:
        operator = BrowserOperator(chromium, url)
        began = operator.tool
        operator.drag_to((0.5, -0.1, 0.2))
        assert distance(operator.tool.position, (0.5, -0.1, 0.2)) < 0.005
        operator.press("KeyZ")
        operator.wait_for("returned to the start")
        time.sleep(1.0)
        assert distance(operator.tool.position, began.position) < 0.001
        for number, (item, grasp) in enumerate(zip(ITEMS, grasps, strict=True)):
            above = above_spot(session, number, grasp).position
            operator.pack(grasp.position, above)
            operator.wait_for(f"✔ pack {item}")
            if number == 0:
                operator.drag_to(above)
        operator.wait_for("done: save it")
        operator.click("Save")
        operator.wait_for("all saved")
        assert operator.addresses() <= {url + "/?fixedDpr=0.5"}  # nobody else is asked for anything
        assert chromium.complaints() == []
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert (process.returncode, out) == (0, "")
    assert "1 of 1 demonstrations are saved" in err
    run = RunFolder.open(tmp_path / "run")
    assert json.loads((run.path / "run.json").read_text())["plan"]["policy"] == "demonstrator:teleoperated"
    record = read_record(run.record_path(TASK, CONDITION, run.entries()[0].seed))
    assert record.outcome.success
    assert record.metadata.demonstrator.name == "tester"
    _check_replays(record)


def _check_replays(record):
    """The same actions lead through the same states, bit for bit."""
    scene = fresh_scene()
    scene.reset()
    for row in range(1, len(record)):
        scene.step(record.action[row])
        assert scene.simulator_state()["qpos"].tolist() == record.qpos[row].tolist()
