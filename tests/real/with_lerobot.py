"""lerobot's own classes of the SO-101 through our modules, on emulated servos behind a serial port.

Run by ``test_real_lerobot.py`` in an environment with lerobot; pytest does not collect this file by itself. Real are
lerobot's robot, teleoperator, bus and camera classes, the SDK of the motors and pyserial; the servos, and the cameras
at the port of OpenCV, are not.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import termios
import threading
import time
from pathlib import Path

import cv2
import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
import feetech
import lerobot_driving
from feetech import CALIBRATION, MOTORS, so101_chain, write_calibration

from betterbench.demonstrations.teleop import lerobot_arms
from betterbench.demonstrations.teleop.controls import Controls
from betterbench.demonstrations.teleop.leader import Follower, LeaderThread, connect_leader
from betterbench.errors import InvalidInputError
from betterbench.geometry import Pose
from betterbench.real.arm import SafeArm
from betterbench.real.limits import Limiter, LimitError, SafetyLimits
from betterbench.real.plan import ACTION_SPACES, RealPolicy, make_plan, write_plan
from betterbench.real.record import read_run
from betterbench.real.robots.lerobot_arm import LeRobotArm
from betterbench.real.robots.robot import RobotError
from betterbench.sim.robots import robot

pytestmark = pytest.mark.filterwarnings("ignore")

DEGREES = (10.0, -20.0, 30.0, -40.0, 50.0)
STEP = 360.0 / 4095
SCRIPTED = Path(__file__).with_name("scripted.py")
RATE_HZ = 20.0


@pytest.fixture(autouse=True)
def home(tmp_path, monkeypatch):
    """lerobot's folder of calibrations, with the one of ``mine``; fake cameras; threads that take short turns."""
    from lerobot.robots import robot as robots
    from lerobot.teleoperators import teleoperator
    from lerobot.utils import constants

    calibrations = tmp_path / "calibration"
    for module in (constants, robots, teleoperator):
        monkeypatch.setattr(module, "HF_LEROBOT_CALIBRATION", calibrations)
    for kind in ("robots/so_follower", "teleoperators/so_leader"):
        write_calibration(calibrations / kind / "mine.json")
    monkeypatch.setattr(cv2, "VideoCapture", lerobot_driving.Capture)
    monkeypatch.setattr(lerobot_driving.Capture, "unplugged", ())
    monkeypatch.setattr(lerobot_arms, "QUIET_S", lerobot_driving.PATIENCE * lerobot_arms.QUIET_S)
    interval = sys.getswitchinterval()
    sys.setswitchinterval(0.0005)
    yield calibrations
    sys.setswitchinterval(interval)


@pytest.fixture
def chain():
    with so101_chain(degrees=DEGREES, gripper=25.0) as made:
        yield made


def arm_of(chain, **options):
    given = {"arm_id": "mine", "unit": "degrees", "cameras": {"front": "0"}} | options
    return LeRobotArm(given.pop("port", chain.port), **given)


@pytest.fixture
def arm(chain):
    made = arm_of(chain)
    made.connect()
    yield made
    made.disconnect()


def torque(chain):
    return [servo.byte(feetech.TORQUE) for servo in chain.servos]


def is_open(path):
    """Whether this process has the port open, beside the end that the emulator keeps."""
    links = list(Path("/proc/self/fd").iterdir())
    return sum(link.is_symlink() and str(link.readlink()) == path for link in links) > 1


def until(condition, limit_s=20.0):
    end = time.monotonic() + limit_s
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)


def test_positions_are_read_in_degrees(chain, arm):
    reading = arm.read()
    np.testing.assert_allclose(reading.state[:5], DEGREES, atol=STEP)
    assert reading.state[5] == pytest.approx(25.0, abs=0.1)
    assert reading.frames["front"].image.shape == (480, 640, 3)
    assert tuple(reading.frames["front"].image[0, 0]) == lerobot_driving.COLOR_BGR[::-1]
    assert torque(chain) == [1] * 6
    chain.servos[0].encoder += 100
    until(lambda: abs(arm.read().state[0] - 10.0) < 2 * STEP)  # it holds its position


def test_positions_are_read_and_sent_as_parts_of_the_range(chain):
    arm = arm_of(chain, unit="normalized")
    arm.connect()
    state = arm.read().state
    for value, angle, motor in zip(state[:5], DEGREES, MOTORS, strict=False):
        _, low, high = CALIBRATION[motor]
        assert value == pytest.approx(200.0 * angle / STEP / (high - low), abs=0.2)
    arm.command(np.array([100.0, 0.0, -100.0, 0.0, 0.0, 100.0]))
    until(lambda: [chain.servos[k].position for k in (0, 2, 5)] == [3440, 900, 3480])
    arm.disconnect()


def test_lerobot_configures_the_motors(chain, arm):
    for servo in chain.servos:
        assert (servo.byte(feetech.MODE), servo.byte(feetech.P_GAIN), servo.byte(feetech.LOCK)) == (0, 16, 1)
    assert [servo.word(feetech.MOST_TORQUE) for servo in chain.servos] == [1000] * 5 + [500]
    assert [servo.goals for servo in chain.servos] == [[]] * 6


def test_actions_move_the_motors(chain, arm):
    wanted = np.array([15.0, -25.0, 35.0, -45.0, 45.0, 60.0])
    arm.command(wanted)
    until(lambda: np.abs(arm.read().state - wanted).max() < 0.2)
    until(lambda: [len(servo.goals) for servo in chain.servos] == [1] * 6)


def test_the_load_has_its_sign(chain, arm):
    chain.servos[1].push, chain.servos[4].push = 400, -900
    np.testing.assert_allclose(arm.read().load, [0, 0.4, 0, 0, -0.9, 0], atol=0.01)
    chain.servos[2].blocked = True
    arm.command(np.array([*DEGREES[:2], 50.0, *DEGREES[3:], 25.0]))
    until(lambda: arm.read().load[2] == pytest.approx(2 * 20 / STEP / 1000, abs=0.01))


def test_a_disconnected_arm_keeps_its_position_and_a_released_one_is_off(chain):
    arm = arm_of(chain)
    arm.connect()
    arm.disconnect()
    arm.disconnect()
    assert torque(chain) == [1] * 6
    assert not is_open(chain.port)
    arm.connect()
    arm.release()
    assert torque(chain) == [0] * 6
    chain.servos[0].encoder += 200
    assert arm.read().state[0] == pytest.approx(10.0 + 200 * STEP, abs=STEP)
    arm.disconnect()


def test_every_motor_is_switched_off_although_one_reports_an_overload(chain, arm):
    chain.servos[2].error = feetech.OVERLOAD
    with pytest.raises(RobotError, match="Overload error"):
        arm.release()
    assert torque(chain) == [0] * 6


def test_the_limits_hold_on_the_wire(chain, arm):
    limiter = Limiter(SafetyLimits(), ACTION_SPACES["degrees"], rate_hz=RATE_HZ)
    safe = SafeArm(arm, limiter)
    safe.arm()
    reading = safe.read()
    safe.begin(reading)
    began = [servo.position for servo in chain.servos]
    for _ in range(12):
        safe.move(np.array([500.0, -500.0, 500.0, 500.0, -500.0, 300.0]), reading)
        time.sleep(1.0 / RATE_HZ)
        reading = safe.read()
    most = limiter.most_step[:5] / STEP
    for servo, start, step in zip(chain.servos[:5], began, most, strict=False):
        assert len(servo.goals) == 12
        assert np.abs(np.diff([start, *servo.goals])).max() <= step + 2
    assert max(abs(servo.goals[-1] - start) for servo, start in zip(chain.servos, began, strict=True)) > 100
    low, high = limiter.low[:5] / STEP, limiter.high[:5] / STEP
    for motor, servo, least, largest in zip(MOTORS, chain.servos[:5], low, high, strict=False):
        middle = sum(CALIBRATION[motor][1:]) / 2
        assert middle + least - 1 <= min(servo.goals)
        assert max(servo.goals) <= middle + largest + 1
    safe.stop("enough")
    until(lambda: np.abs(arm.read().state - reading.state).max() < 0.5)


def test_a_blocked_joint_stops_the_arm(chain, arm):
    safe = SafeArm(arm, Limiter(SafetyLimits(), ACTION_SPACES["degrees"], rate_hz=RATE_HZ))
    safe.arm()
    reading = safe.read()
    safe.begin(reading)
    chain.servos[0].blocked = True

    def push():
        nonlocal reading
        for _ in range(60):
            safe.move(np.array([60.0, *DEGREES[1:], 25.0]), reading)
            time.sleep(1.0 / RATE_HZ)
            reading = safe.read()

    with pytest.raises(LimitError, match="shoulder_pan"):
        push()
    assert not safe.is_armed


def test_lost_and_late_answers_are_asked_for_again(chain, arm):
    wanted = arm.read().state
    late_s = 0.1 * lerobot_driving.PATIENCE
    for joint, name, value in ((3, "corrupt", 1), (0, "corrupt", 2), (3, "late_s", late_s), (0, "late_s", late_s)):
        setattr(chain.servos[joint], name, value)
        for _ in range(3):
            reading = arm.read()
            np.testing.assert_allclose(reading.state, wanted, atol=0.2)
            np.testing.assert_allclose(reading.load, 0.0, atol=0.01)


def test_a_servo_that_stops_answering_is_one_clear_error(chain, arm):
    chain.servos[3].silent = True
    with pytest.raises(RobotError, match=r"motors do not answer \(.*no status packet!\)\. Check the USB cable") as told:
        arm.read()
    assert "\n" not in str(told.value)
    chain.servos[3].silent = False
    np.testing.assert_allclose(arm.read().state[:5], DEGREES, atol=0.2)


def test_answers_with_wrong_checksums_are_one_clear_error(chain, arm):
    chain.servos[3].corrupt = 100
    with pytest.raises(RobotError, match=r"motors do not answer \(.*Incorrect status packet!\)\. Check the USB"):
        arm.read()


def test_an_unplugged_cable_is_one_clear_error(chain, arm):
    chain.unplug()
    for _ in range(2):
        with pytest.raises(
            RobotError, match=rf"motors do not answer \(there is no {chain.port}\)\. Check the USB cable"
        ):
            arm.read()
        with pytest.raises(RobotError, match="motors do not answer"):
            arm.command(np.zeros(6))
    with pytest.raises(RobotError, match="motors do not answer"):
        arm.release()


def test_an_unplugged_camera_stops_only_its_own_frames(chain, arm):
    lerobot_driving.Capture.unplugged = ("0",)
    time.sleep(1.0)
    reading = arm.read()
    assert reading.time_s - reading.frames["front"].time_s > 0.5
    arm.command(reading.state)


@pytest.mark.parametrize(
    ("fault", "says"),
    [
        (lambda servos: setattr(servos[3], "silent", True), r"Missing motor IDs: - 4 \(expected model: 777\)\. Check"),
        (lambda servos: setattr(servos[5], "error", feetech.OVERLOAD), r"Missing motor IDs: - 6 .*overload"),
        (lambda servos: servos[1].store(model_number=2825), r"2 \(shoulder_lift\): expected 777, found 2825\. Check"),
        (lambda servos: [s.write(feetech.BAUD_RATE, b"\4") for s in servos], r"Missing motor IDs: - 1 .*- 6 \("),
        (lambda servos: servos[0].store(low=700),
         r"not calibrated: the motors shoulder_pan have other values than .*mine.json"),
        (lambda servos: servos[5].store(offset=7),
         r"not calibrated: the motors gripper have other values than .*mine.json"),
    ],
)  # fmt: skip
def test_an_arm_that_cannot_be_used_is_left_as_it_was(chain, fault, says):
    fault(chain.servos)
    arm = arm_of(chain)
    with pytest.raises(RobotError, match=says) as told:
        arm.connect()
    assert "\n" not in str(told.value)
    assert torque(chain) == [0] * 6
    assert not is_open(chain.port)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (None, r"other.json\. Run lerobot-calibrate --robot.type=so101_follower --robot.port=\S+ --robot.id=other\."),
        ("{oops", r"other.json: not a calibration of lerobot .*Rename or delete the file, then run lerobot-calibrate"),
        ('{"gripper": {"id": 6}}', r"other.json: not a calibration of lerobot .*homing_offset"),
        ("{}", r"not calibrated: there is no"),
        ("flat", r"other.json: the range of shoulder_pan is empty \(7 to 7\)"),
        ("five", r"not calibrated: the motors gripper have other values than .*other.json"),
    ],
)
def test_a_bad_calibration_file_is_named(home, chain, text, says):
    file = home / "robots/so_follower/other.json"
    if text == "flat":
        write_calibration(file, shoulder_pan={"range_min": 7, "range_max": 7})
    elif text == "five":
        form = json.loads((home / "robots/so_follower/mine.json").read_text())
        file.write_text(json.dumps({motor: form[motor] for motor in MOTORS[:5]}))
    elif text is not None:
        file.write_text(text)
    with pytest.raises(RobotError, match=says):
        arm_of(chain, arm_id="other").connect()
    assert torque(chain) == [0] * 6
    assert not is_open(chain.port)


def test_without_the_camera_the_port_is_closed_again(chain):
    with pytest.raises(RobotError, match=r"Failed to open OpenCVCamera\(9\).*--cameras"):
        arm_of(chain, cameras={"front": "9"}).connect()
    assert not is_open(chain.port)
    with pytest.raises(RobotError, match=r"at /dev/none: there is no /dev/none\. Check"):
        arm_of(chain, port="/dev/none").connect()


def test_a_request_lost_while_connecting_is_repeated(chain):
    chain.servos[4].corrupt = 1
    arm = arm_of(chain)
    arm.connect()
    np.testing.assert_allclose(arm.read().state[:5], DEGREES, atol=0.2)
    arm.disconnect()


def test_the_leader_is_read_and_disconnected(chain):
    leader = connect_leader("so101_leader", chain.port, "mine")
    assert torque(chain) == [0] * 6  # a person moves it
    controls = Controls()
    controls.hold_from(Pose((0.3, 0.0, 0.2)))
    thread = LeaderThread(leader, controls, Follower())
    found = []
    until(lambda: found.append(controls.take(time.monotonic())) or found[-1].drag is not None)
    before = found[-1].drag
    assert found[-1].closed  # the gripper is at 25 of 100
    chain.servos[0].encoder += 300
    chain.servos[5].encoder += 1000
    until(lambda: found.append(controls.take(time.monotonic())) or not found[-1].closed)
    assert abs(found[-1].drag.position[1] - before.position[1]) > 0.02
    thread.close()
    assert not is_open(chain.port)
    assert controls.take_problems() == []


def test_a_leader_that_is_unplugged_is_no_longer_followed(chain):
    controls = Controls()
    thread = LeaderThread(connect_leader("so101_leader", chain.port, "mine"), controls, Follower())
    chain.unplug()
    problems = []
    until(lambda: problems.extend(controls.take_problems()) or problems)
    assert problems[0].startswith("leader arm: ")
    assert problems[0].endswith("It is no longer followed.")
    thread.close()


@pytest.mark.parametrize(
    ("fault", "name", "says"),
    [
        (lambda servos: setattr(servos[3], "silent", True), "mine", r"--leader-port: \S+: .*Missing motor IDs: - 4"),
        (
            lambda servos: servos[0].store(high=3000),
            "mine",
            r"'mine': not calibrated: the motors shoulder_pan have other values than",
        ),
        (lambda _: None, "other", r"there is no .*other.json\. Run lerobot-calibrate --teleop.type=so101_leader"),
    ],
)
def test_a_leader_that_cannot_be_used_is_named(chain, fault, name, says):
    fault(chain.servos)
    with pytest.raises(InvalidInputError, match=says) as told:
        connect_leader("so101_leader", chain.port, name)
    assert "\n" not in str(told.value)
    assert not is_open(chain.port)


def test_the_port_has_the_baud_rate_of_the_motors(chain, arm):
    assert termios.tcgetattr(chain._ends[1])[4:6] == [termios.B1000000] * 2


HOME = np.degrees(robot("so101").home_joints)


class RealRun:
    """A process of ``better real run`` with the arm behind lerobot, obeying lines."""

    def __init__(self, folder, port, calibrations, *options):
        script = [sys.executable, str(Path(__file__).with_name("lerobot_driving.py")), "real", "run", str(folder)]
        command = [*script, "--arm-port", port, "--arm-id", "mine", "--no-page", "--camera-size", "160", "120"]
        self.process = subprocess.Popen(
            [*command, "--author", "ada", *options],
            stdin=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            env={**os.environ, "HF_LEROBOT_CALIBRATION": str(calibrations)},
        )  # fmt: skip
        self.lines = []
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self):
        for line in self.process.stderr:
            self.lines.append(line)

    def until(self, words):
        def seen():
            assert self.process.poll() is None or any(words in line for line in self.lines), "".join(self.lines)
            return any(words in line for line in self.lines)

        try:
            until(seen, 180.0)
        except AssertionError:
            raise AssertionError("".join(self.lines)) from None

    def type(self, *lines):
        self.process.stdin.write("".join(f"{line}\n" for line in lines))
        self.process.stdin.flush()

    def end(self):
        return self.process.wait(60)

    def close(self):
        self.process.kill()
        self.process.wait(60)
        self._reader.join(5.0)
        self.process.stdin.close()
        self.process.stderr.close()


@pytest.mark.parametrize("unit", ["degrees", "normalized"])
def test_a_whole_trial_of_better_real_run(tmp_path, home, unit):
    policy = f"python:{SCRIPTED}:Reach?space=so101_{unit}&amount=6"
    plan = make_plan((RealPolicy("reach", policy),), conditions=["O1"], time_limit_s=2.0, unit=unit)
    write_plan(tmp_path / "bench", plan)
    rest = (*(HOME - np.array([15.0, -5.0, 5.0, 5.0, 10.0])),)
    with so101_chain(degrees=rest, gripper=10.0) as chain:
        run = RealRun(tmp_path / "bench", chain.port, home, "--cameras", "front=0", "wrist=2")
        try:
            run.until("set up the scene")
            assert [servo.goals for servo in chain.servos] == [[]] * 6
            run.type("a", "f")
            run.until("has ended. Enter the outcome")
            run.type("9 it waved")
            run.until("every trial is done")
            assert run.end() == 0
        finally:
            run.close()
        assert torque(chain) == [1] * 6
        goals = [list(servo.goals) for servo in chain.servos]
    (trial,) = read_run(tmp_path / "bench").trials
    assert (trial.header.robot, trial.header.ending, trial.header.unit) == ("so101_follower", "time_limit", unit)
    assert sorted(trial.header.films) == ["front", "wrist"]
    samples = trial.samples()
    assert len(samples) == trial.header.steps > 20
    assert np.isfinite(samples.load).all()
    assert samples.state[-1, 0] - samples.state[0, 0] > 3.0
    # What the record says was sent is what the servos got.
    motors = [(low, high) for _, low, high in CALIBRATION.values()]
    for joint, (low, high) in enumerate(motors):
        sent = samples.command[:, joint]
        if joint == 5:
            raw = low + sent / 100.0 * (high - low)
        elif unit == "degrees":
            raw = (low + high) / 2 + sent / STEP
        else:
            raw = low + (sent + 100.0) / 200.0 * (high - low)
        got = np.array(goals[joint][-len(sent) - 1 :])
        assert min(np.abs(got[:-1] - raw).max(), np.abs(got[1:] - raw).max()) <= 1.001


def test_a_trial_in_which_the_cable_is_pulled_comes_again(tmp_path, home):
    plan = make_plan((RealPolicy("reach", f"python:{SCRIPTED}:Reach"),), conditions=["O1"], time_limit_s=60.0)
    write_plan(tmp_path / "bench", plan)
    with so101_chain(degrees=HOME, gripper=50.0) as chain:
        run = RealRun(tmp_path / "bench", chain.port, home)
        try:
            run.until("set up the scene")
            run.type("a", "f")
            until(lambda: len(chain.servos[0].goals) > 30, 120.0)
            chain.unplug()
            run.until("does not count and will be repeated: The motors do not answer (there is no ")
            run.type("q")
            assert run.end() == 0
        finally:
            run.close()
    assert read_run(tmp_path / "bench").trials == ()
