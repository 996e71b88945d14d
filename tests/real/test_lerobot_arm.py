"""lerobot's class as our adapter uses it, against a stand-in with lerobot's names; the real one is not installed."""

import sys
import time
import types
from types import SimpleNamespace

import numpy as np
import pytest

from betterbench.errors import InvalidInputError, MissingDependencyError
from betterbench.real.record import MOTORS
from betterbench.real.robots.lerobot_arm import LeRobotArm
from betterbench.real.robots.robot import RobotError


class Bus:
    def __init__(self):
        self.positions = dict.fromkeys(MOTORS, 10.0)
        self.loads = dict(zip(MOTORS, (0, 500, 1024 + 300, -200, 0, 1000), strict=True))
        self.fails = self.torque_off = False

    def sync_read(self, name, *, normalize=True, num_retry=0):
        if self.fails:
            raise ConnectionError("no status packet")
        assert normalize == (name == "Present_Position")
        assert num_retry > 0
        return {"Present_Position": self.positions, "Present_Load": self.loads}[name]

    def disable_torque(self, motors=None, num_retry=0):
        self.torque_off = motors is None and num_retry > 0


class Camera:
    def __init__(self, config):
        self.config, self.works = config, True

    def async_read(self, timeout_ms=200):
        time.sleep(min(0.01, timeout_ms))
        if not self.works:
            raise TimeoutError
        return np.full((self.config.height, self.config.width, 3), 7, np.uint8)


class Arm:
    made = None
    is_calibrated = True

    def __init__(self, config):
        self.config, self.bus, self.sent, self.disconnected = config, Bus(), [], False
        self.cameras = {name: Camera(c) for name, c in config.cameras.items()}
        type(self).made = self

    def connect(self, calibrate=True):
        assert calibrate is False
        if self.config.port == "/dev/none":
            raise OSError("could not open port")

    def send_action(self, action):
        if self.bus.fails:
            raise ConnectionError("no status packet")
        self.sent.append(action)

    def disconnect(self):
        self.disconnected = True


@pytest.fixture(params=["so101_follower", "so_follower"])
def lerobot(request, monkeypatch):
    """lerobot's modules under both of its layouts."""

    def module(name, **values):
        made = types.ModuleType(name)
        made.__path__ = []
        for key, value in values.items():
            setattr(made, key, value)
        monkeypatch.setitem(sys.modules, name, made)

    for name in ("lerobot", "lerobot.robots", "lerobot.cameras", "lerobot.cameras.opencv"):
        module(name)
    choice = SimpleNamespace(get_choice_class=lambda kind: {"so101_follower": SimpleNamespace}[kind])
    module("lerobot.robots.config", RobotConfig=choice)
    module("lerobot.robots.utils", make_robot_from_config=Arm)
    module("lerobot.cameras.opencv.configuration_opencv", OpenCVCameraConfig=SimpleNamespace)
    module(f"lerobot.robots.{request.param}")


def arm_of(**options):
    given = {"arm_id": "mine", "unit": "degrees", "cameras": {"front": "0", "wrist": "/dev/video2"}} | options
    return LeRobotArm(given.pop("port", "/dev/ttyACM0"), **given)


def test_an_arm_is_read_and_commanded_by_its_motors_names(lerobot):
    arm = arm_of()
    arm.connect()
    reading = arm.read()
    np.testing.assert_array_equal(reading.state, np.full(6, 10.0))
    np.testing.assert_allclose(reading.load, [0.0, 0.5, -0.3, -0.2, 0.0, 1.0])
    assert reading.frames["front"].image.shape == (480, 640, 3)
    assert 0.0 <= reading.time_s - reading.frames["wrist"].time_s < 1.0
    arm.command(np.arange(6.0))
    assert Arm.made.sent == [{f"{m}.pos": float(i) for i, m in enumerate(MOTORS)}]
    assert Arm.made.config.use_degrees is True
    assert Arm.made.config.disable_torque_on_disconnect is False
    assert Arm.made.config.cameras["front"].index_or_path == 0
    assert Arm.made.config.cameras["wrist"].index_or_path == "/dev/video2"
    arm.release()
    assert Arm.made.bus.torque_off
    arm.disconnect()
    arm.disconnect()
    assert Arm.made.disconnected
    with pytest.raises(RobotError, match="not connected"):
        arm.read()


def test_an_unplugged_camera_keeps_its_last_frame_whose_age_grows(lerobot):
    arm = arm_of()
    arm.connect()
    Arm.made.cameras["front"].works = False
    time.sleep(0.15)
    reading = arm.read()
    assert reading.time_s - reading.frames["front"].time_s > 0.1
    assert reading.time_s - reading.frames["wrist"].time_s < 0.1
    arm.disconnect()


def test_faults_are_named_with_their_cure(lerobot, monkeypatch):
    with pytest.raises(RobotError, match=r"could not open port.*lerobot-find-port"):
        arm_of(port="/dev/none").connect()
    assert Arm.made.disconnected
    monkeypatch.setattr(Arm, "is_calibrated", False)
    with pytest.raises(RobotError, match=r"is not calibrated\. Run lerobot-calibrate --robot\.type=so101_follower"):
        arm_of().connect()
    monkeypatch.undo()


def test_motors_that_do_not_answer_are_a_robot_error(lerobot):
    arm = arm_of()
    arm.connect()
    Arm.made.bus.fails = True
    with pytest.raises(RobotError, match=r"motors do not answer .no status packet"):
        arm.read()
    with pytest.raises(RobotError, match="motors do not answer"):
        arm.command(np.zeros(6))
    arm.disconnect()


def test_without_lerobot_the_message_says_how_to_install_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "lerobot", None)
    monkeypatch.setitem(sys.modules, "lerobot.robots.config", None)
    with pytest.raises(MissingDependencyError, match=r"lerobot\[feetech\]"):
        arm_of().connect()


def test_a_port_and_a_camera_are_needed():
    with pytest.raises(InvalidInputError, match="--arm-port"):
        arm_of(port="")
    with pytest.raises(InvalidInputError, match="--camera"):
        arm_of(cameras={})
