"""Our adapter of lerobot's class against a stand-in with lerobot's names; with_lerobot.py has the real class."""

import sys
import time
import types
from types import SimpleNamespace

import numpy as np
import pytest

from betterbench.errors import InvalidInputError, MissingDependencyError
from betterbench.interface.actions import SO101_MOTORS as MOTORS
from betterbench.real.robots.lerobot_arm import LeRobotArm
from betterbench.real.robots.robot import RobotError

MOTOR = SimpleNamespace(homing_offset=5, range_min=100, range_max=3000)
OTHER, EMPTY = (SimpleNamespace(homing_offset=5, range_min=7, range_max=high) for high in (9, 7))


class Port:
    def __init__(self):
        self.is_using, self.dropped = False, 0
        self.ser = SimpleNamespace(reset_input_buffer=self.drop)

    def drop(self):
        self.dropped += 1


class Bus:
    def __init__(self):
        self.positions = dict.fromkeys(MOTORS, 10.0)
        self.loads = dict(zip(MOTORS, (0, 500, 1024 + 300, -200, 0, 1000), strict=True))
        self.fails, self.off, self.overloaded, self.sent = 0, [], "", []
        self.port_handler, self.held = Port(), dict.fromkeys(MOTORS, MOTOR)
        self.is_connected = False

    def connect(self):
        self.is_connected = True

    def read_calibration(self):
        return self.held

    def disconnect(self, disable_torque=True):
        assert disable_torque is False
        self.is_connected = False

    def sync_read(self, name, *, normalize=True):
        dropped, self.port_handler.dropped = self.port_handler.dropped, 0
        assert dropped == 1
        if self.fails:
            self.fails -= 1
            raise ConnectionError("no status packet")
        assert normalize == (name == "Present_Position")
        return {"Present_Position": self.positions, "Present_Load": self.loads}[name]

    def sync_write(self, name, values):
        assert name == "Goal_Position"
        if self.fails:
            raise ConnectionError("no status packet")
        self.sent.append(values)

    def disable_torque(self, motor, num_retry=0):
        assert num_retry > 0
        if motor == self.overloaded:
            raise RuntimeError("Overload error!")
        self.off.append(motor)


class Camera:
    def __init__(self, config):
        self.config, self.works, self.is_open = config, True, True

    def disconnect(self):
        self.is_open = False

    def async_read(self, timeout_ms=200):
        time.sleep(min(0.01, timeout_ms))
        if not self.works:
            raise TimeoutError
        return np.full((self.config.height, self.config.width, 3), 7, np.uint8)


class Arm:
    made = None
    problem, most_failures = None, 99

    def __init__(self, config):
        self.config, self.bus, self.id = config, Bus(), config.id
        self.failures, self.calibration = 0, dict.fromkeys(MOTORS, MOTOR)
        self.calibration_fpath = f"/calibrations/{config.id}.json"
        self.cameras = {name: Camera(c) for name, c in config.cameras.items()}
        type(self).made = self

    def connect(self, calibrate=True):
        assert calibrate is False
        assert not self.bus.is_connected  # the calibration was compared before
        self.bus.is_connected = True
        self.failures += 1
        if self.problem is not None and self.failures <= self.most_failures:
            raise self.problem

    @property
    def is_closed(self):
        return not self.bus.is_connected and not any(camera.is_open for camera in self.cameras.values())


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
    assert Arm.made.bus.sent == [{m: float(i) for i, m in enumerate(MOTORS)}]
    assert Arm.made.config.use_degrees is True
    assert Arm.made.config.disable_torque_on_disconnect is False
    assert Arm.made.config.cameras["front"].index_or_path == 0
    assert Arm.made.config.cameras["wrist"].index_or_path == "/dev/video2"
    arm.release()
    assert Arm.made.bus.off == list(MOTORS)
    arm.disconnect()
    arm.disconnect()
    assert Arm.made.is_closed
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
    monkeypatch.setattr(Arm, "problem", OSError("could not open port"))
    with pytest.raises(RobotError, match=r"there is no /dev/none\..*lerobot-find-port"):
        arm_of(port="/dev/none").connect()
    assert Arm.made.is_closed
    monkeypatch.setattr(Arm, "problem", RuntimeError("motor check:\n - 4 missing\n\nFull expected motor list\n1, 2"))
    with pytest.raises(RobotError, match=r"so101_follower at /dev/null: motor check: - 4 missing\. Check power"):
        arm_of(port="/dev/null").connect()
    assert Arm.made.is_closed


def test_a_request_that_is_lost_while_connecting_is_repeated(lerobot, monkeypatch):
    monkeypatch.setattr(Arm, "problem", ConnectionError("no status packet"))
    monkeypatch.setattr(Arm, "most_failures", 2)
    arm = arm_of(port="/dev/null")
    arm.connect()
    assert arm.read().state[0] == 10.0
    arm.disconnect()
    monkeypatch.setattr(Arm, "most_failures", 3)
    with pytest.raises(RobotError, match="no status packet"):
        arm_of(port="/dev/null").connect()


def test_an_arm_that_is_not_calibrated_is_not_switched_on(lerobot, monkeypatch):
    monkeypatch.setattr(Bus, "read_calibration", lambda _: dict.fromkeys(MOTORS, MOTOR) | {"gripper": OTHER})
    with pytest.raises(
        RobotError, match=r"the motors gripper have other values than /calibrations/mine.json.*lerobot-calibrate"
    ):
        arm_of().connect()
    assert Arm.made.is_closed
    monkeypatch.setattr(Arm, "calibration", property(lambda _: {}, lambda *_: None), raising=False)
    with pytest.raises(
        RobotError, match=r"there is no /calibrations/mine.json\. Run lerobot-calibrate --robot\.type=so"
    ):
        arm_of().connect()
    monkeypatch.setattr(Arm, "calibration", property(lambda _: {"gripper": EMPTY}, lambda *_: None), raising=False)
    with pytest.raises(RobotError, match=r"the range of gripper is empty \(7 to 7\)"):
        arm_of().connect()


def test_motors_that_do_not_answer_are_a_robot_error(lerobot):
    arm = arm_of(port="/dev/null")
    arm.connect()
    Arm.made.bus.fails = 2
    assert arm.read().state[0] == 10.0
    Arm.made.bus.fails = 100
    with pytest.raises(RobotError, match=r"motors do not answer .no status packet"):
        arm.read()
    with pytest.raises(RobotError, match="motors do not answer"):
        arm.command(np.zeros(6))
    arm.disconnect()


def test_every_motor_is_switched_off_although_one_reports_an_error(lerobot):
    arm = arm_of(port="/dev/null")
    arm.connect()
    Arm.made.bus.overloaded = "elbow_flex"
    with pytest.raises(RobotError, match="Overload error"):
        arm.release()
    assert Arm.made.bus.off == [motor for motor in MOTORS if motor != "elbow_flex"]
    arm.disconnect()


def test_a_damaged_calibration_file_is_not_a_missing_lerobot(lerobot, monkeypatch, tmp_path):
    def broken(config):
        raise ValueError("Expecting property name: line 1")

    module = next(
        sys.modules[n] for n in ("lerobot.robots.so_follower", "lerobot.robots.so101_follower") if n in sys.modules
    )
    monkeypatch.setattr(module, "SO101Follower", SimpleNamespace(name="so_follower"), raising=False)
    monkeypatch.setattr(sys.modules["lerobot.robots.utils"], "make_robot_from_config", broken)
    monkeypatch.setitem(sys.modules, "lerobot.utils", types.ModuleType("lerobot.utils"))
    constants = types.ModuleType("lerobot.utils.constants")
    constants.HF_LEROBOT_CALIBRATION = tmp_path
    monkeypatch.setitem(sys.modules, "lerobot.utils.constants", constants)
    with pytest.raises(MissingDependencyError, match="Expecting property name"):
        arm_of().connect()
    file = tmp_path / "robots" / "so_follower" / "mine.json"
    file.parent.mkdir(parents=True)
    file.write_text("{")
    with pytest.raises(
        RobotError, match=r"mine.json: not a calibration of lerobot .*Rename or delete the file, then run lerobot"
    ):
        arm_of().connect()


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
