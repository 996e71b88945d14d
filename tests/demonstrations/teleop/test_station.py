"""The loop without a browser: time stands still while nothing is asked for, and what is saved stays."""

from __future__ import annotations

import errno
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))

from scripted_operator import CONDITION, ITEMS, TASK, grasp_of, pack

from betterbench.demonstrations.teleop import cameras as cameras_module
from betterbench.demonstrations.teleop import page
from betterbench.demonstrations.teleop.controls import Controls
from betterbench.demonstrations.teleop.station import WAIT_STEPS, Station
from betterbench.demonstrations.teleop.store import DemonstrationStore, TeleopPlan
from betterbench.errors import InvalidInputError, RunConflictError, StorageError, UnknownNameError
from betterbench.records import RunFolder, read_record

pytestmark = pytest.mark.physics
WANTED = TeleopPlan((TASK,), condition=CONDITION)


class FakeDisplay:
    """A page that remembers what it shows."""

    view_yaw, speed = 0.0, 1.0

    def __init__(self):
        self.panel, self.gizmo, self.scenes = None, None, 0

    def show_scene(self, files):
        self.scenes += 1
        assert all(data.startswith(b"glTF") for data in files.values())

    def show_state(self, positions, quaternions, gizmo):
        assert np.isfinite(positions).all()
        assert np.isfinite(quaternions).all()
        self.gizmo = gizmo

    def show(self, panel):
        self.panel = panel


class Desk:
    """A station with a page that drives."""

    def __init__(self, store):
        self.controls, self.display, self.now = Controls(), FakeDisplay(), 0.0
        self.controls.connected(1)
        self.station = Station(store, self.controls, self.display, name="tester")

    def tick(self, times=1):
        for _ in range(times):
            self.now += 0.05
            self.station.tick(self.now)
        return self.display.panel

    def tap(self, tap):
        self.controls.tapped(1, tap)
        return self.tick()

    def drag(self, pose, most=200):
        """Drag the gizmo somewhere and wait until time stands still again."""
        self.controls.dragged(1, pose, is_over=True)
        for _ in range(most):
            if not self.tick().status.startswith("recording"):
                return


@pytest.fixture
def store(tmp_path):
    with DemonstrationStore(tmp_path / "run", WANTED) as made:
        yield made


@pytest.fixture
def desk(store):
    return Desk(store)


class Driven:
    """What the scripted operator drives: the session, through the controls and the loop."""

    def __init__(self, desk):
        self._desk, self._session = desk, desk.station.session

    def __getattr__(self, name):
        return getattr(self._session, name)

    def step(self, command):
        if command.target is not None:
            self._desk.controls.dragged(1, command.target, is_over=True)
        if command.closed != self._desk.display.panel.closed:
            self._desk.controls.tapped(1, "gripper")
        self._desk.tick()


def test_time_stands_still_while_nothing_is_asked_for(desk):
    desk.tick(30)
    assert desk.station.session.steps == 0
    assert desk.display.panel.status.startswith("ready")
    grasp, _ = grasp_of(desk.station.session, "apple")
    desk.drag(grasp.translated(z=0.2))
    steps = desk.station.session.steps
    assert desk.display.panel.status == "waiting for you"
    desk.controls.dragged(1, grasp.translated(z=0.2), is_over=False)  # still held, and already there
    desk.tick(30)
    assert desk.station.session.steps == steps
    record = desk.station.session.record("tester")
    still = np.abs(np.diff(record.qpos, axis=0)).max(axis=1) < 1e-5
    assert still[-2 * WAIT_STEPS :].sum() <= WAIT_STEPS + 1


def test_time_stands_still_without_a_page(desk):
    desk.controls.sent(1, '{"held": ["KeyF"]}', desk.now)
    desk.tick(4)
    assert 0 < desk.station.session.steps <= 4
    desk.controls.disconnected(1)
    before = desk.station.session.steps
    assert desk.tick(5).status == "paused: no page is open"
    assert desk.station.session.steps == before


def test_keys_move_the_tool_as_the_operator_looks_and_stop_soon_after_they_are_let_go(desk):
    desk.display.view_yaw = 0.5 * np.pi  # looking along the table, so that "away" is to the robot's left
    began = np.array(desk.station.session.state.ee_pose.position)
    for _ in range(20):
        desk.controls.sent(1, '{"held": ["KeyW"]}', desk.now)
        desk.tick()
    pushed = np.array(desk.station.session.state.ee_pose.position) - began
    desk.controls.sent(1, "{}", desk.now)
    desk.tick(40)
    moved = np.array(desk.station.session.state.ee_pose.position) - began
    assert pushed[1] > 0.1
    assert abs(moved[0]) < 0.01
    assert abs(moved[2]) < 0.01
    assert 0.0 <= moved[1] - pushed[1] < 0.1


def test_the_gripper_closes_once_and_undo_opens_it_again(desk):
    desk.tap("gripper")
    desk.tick(20)
    assert desk.display.panel.closed
    assert desk.station.session.state.finger_width_m < 0.02
    steps = desk.station.session.steps
    panel = desk.tap("undo")
    assert panel.said[-1] == f"returned to the start; {steps} steps were removed"
    assert not panel.closed
    assert desk.station.session.steps == 0
    assert desk.tick(10).status.startswith("ready")


def test_a_demonstration_is_saved_and_the_same_command_goes_on(tmp_path, monkeypatch):
    wanted = replace(WANTED, condition=None)
    with DemonstrationStore(tmp_path / "run", wanted) as store:
        desk = Desk(store)
        first = desk.station.start
        assert desk.tap("save").said[-1] == "not saved: the subgoals are not done"
        desk.tap("discard")
        second = desk.station.start
        assert {first.condition, second.condition} == {"train1", "train2"}
        desk.tap("discard")
        assert desk.station.start == first  # those that were discarded come again after the others
        desk.tick()
        for number, item in enumerate(ITEMS):
            pack(Driven(desk), item, number)
        assert (desk.display.panel.status, desk.display.panel.can_save) == ("done: save it", True)
        assert [done for _, done in desk.display.panel.subgoals] == [True, True]
        full = OSError(errno.ENOSPC, "No space left on device")
        with monkeypatch.context() as broken:
            broken.setattr(RunFolder, "write_record", lambda *_: (_ for _ in ()).throw(full))
            assert desk.tap("save").said[-1].startswith("not saved yet:")
        store.run.path.rename(tmp_path / "elsewhere")
        assert "run: the folder or its .lock was removed or moved" in desk.tap("save").said[-1]
        assert not store.run.path.exists()
        (tmp_path / "elsewhere").rename(store.run.path)
        assert store.saved == 0
        assert desk.tap("save").said[-1] == f"saved records/{TASK}/train1/{first.seed}.parquet"
        assert desk.station.start == second
        _check_saved(store)
        with pytest.raises(RunConflictError):
            DemonstrationStore(tmp_path / "run", wanted)
    with DemonstrationStore(tmp_path / "run", wanted) as again:
        assert (again.saved, again.planned, again.due()) == (1, 2, second)
    with DemonstrationStore(tmp_path / "run", replace(wanted, demos=2)) as more:
        assert (more.saved, more.planned, more.due()) == (1, 4, second)


def _check_saved(store):
    entry = store.run.entries()[0]
    assert (entry.status, store.saved, store.planned) == ("done", 1, 2)
    record = read_record(store.run.record_path(TASK, CONDITION, entry.seed))
    assert (record.metadata.demonstrator.kind, record.metadata.demonstrator.name) == ("teleoperated", "tester")
    assert [s.subgoal for s in record.metadata.segments if s.subgoal] == ["pack_apple", "pack_orange"]
    assert store.run.scene_path(record.metadata.scene_hash).exists()


@pytest.mark.parametrize(
    ("wanted", "error"),
    [
        (TeleopPlan(()), InvalidInputError),
        (TeleopPlan(("fruit_lunsh",)), UnknownNameError),
        (replace(WANTED, condition="T1"), UnknownNameError),
        (replace(WANTED, demos=0), InvalidInputError),
        (replace(WANTED, first_seed=7), InvalidInputError),
    ],
)
def test_what_cannot_be_demonstrated_is_named_before_anything_is_written(tmp_path, wanted, error):
    with pytest.raises(error):
        DemonstrationStore(tmp_path / "run", wanted)
    assert not (tmp_path / "run").exists()


def test_a_run_of_something_else_is_not_written_to(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises((RunConflictError, StorageError, InvalidInputError)):
        DemonstrationStore(tmp_path / "file", WANTED)


def test_the_panel_says_how_high_the_tool_is(tmp_path):
    with DemonstrationStore(tmp_path / "run", WANTED) as store:
        desk = Desk(store)
        panel = desk.tick()
        height = desk.station.session.state.ee_pose.position[2]
        assert panel.height == f"tool {100 * height:.0f} cm above the table"


def test_late_camera_images_are_said_and_nothing_waits_for_them(tmp_path, monkeypatch):
    """A renderer that never answers: every step of the loop goes on, and the panel says why there are no images."""
    blocked = threading.Event()

    class Stuck:
        def __init__(self, *_, **__):
            blocked.wait(30.0)

        def close(self):
            pass

    monkeypatch.setattr(cameras_module, "StoredView", Stuck)
    monkeypatch.setattr(cameras_module, "LATE_S", 0.2)
    images = cameras_module.CameraThread(("front",), lambda *_: None, lambda _: None)
    try:
        with DemonstrationStore(tmp_path / "run", WANTED) as store:
            desk = Desk(store)
            desk.station._cameras = images
            began = time.monotonic()
            first = desk.tick(3)
            assert time.monotonic() - began < 5.0
            assert first.images == ""
            time.sleep(0.3)
            late = desk.tick()
            assert late.images.startswith("camera images are ")
            assert "steering does not wait" in page._foot(late)
    finally:
        blocked.set()
        images.close()
    assert images.late_s == 0.0
