"""Access to SO-100 and SO-101 arms through LeRobot's classes: connection, calibration check, and reading.

lerobot is optional and is only imported when an arm is created. Tested with lerobot 0.4.4 and 0.6.1 on emulated servos
(``tests/real/with_lerobot.py``).
"""

from __future__ import annotations

import contextlib
import importlib
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from betterbench.errors import InvalidInputError, one_line
from betterbench.installation import missing_packages

RETRIES = 2
"""Number of retries after a failed request to the motors, because a Feetech bus occasionally loses a packet."""
QUIET_S = 0.06
"""Time to wait after a failed request, so that a late answer can arrive [s]."""


class CalibrationError(InvalidInputError):
    """Raised if a calibration file is missing, unreadable, or does not match the motors of the arm."""


@dataclass(frozen=True, slots=True)
class ArmKind:
    """Kind of arm, with the names that lerobot uses for it.

    Attributes:
        group: Subpackage of lerobot that contains the class of the arm.
        name: Name of the kind ("so101_follower").
        module: Module of the class within this subpackage.
    """

    group: Literal["robots", "teleoperators"]
    name: str
    module: str

    @property
    def config_class(self) -> str:
        """Name of lerobot's base class for configurations, in which all kinds of arms are registered."""
        return {"robots": "RobotConfig", "teleoperators": "TeleoperatorConfig"}[self.group]

    @property
    def maker(self) -> str:
        """Name of lerobot's function that creates an arm from a configuration."""
        return f"make_{self.group.removesuffix('s')}_from_config"

    def calibrate_call(self, port: str, name: str) -> str:
        """Return the shell command that calibrates an arm of this kind.

        Args:
            port: Serial port of the arm.
            name: Id under which lerobot stores the calibration of the arm.
        """
        option = {"robots": "robot", "teleoperators": "teleop"}[self.group]
        return f"lerobot-calibrate --{option}.type={self.name} --{option}.port={port} --{option}.id={name}"


def make_arm(kind: ArmKind, options: Mapping[str, Any], *, what: str, cameras: Mapping[str, Any] | None = None) -> Any:  # noqa: ANN401 - lerobot's class
    """Create lerobot's object for an arm, without opening a connection.

    Args:
        kind: Kind of the arm.
        options: Options of the configuration, including ``id``.
        what: Text at the beginning of the error message if lerobot is not installed.
        cameras: Options of lerobot's OpenCV cameras by camera name, for a robot.

    Raises:
        MissingDependencyError: If lerobot, or a package that it needs for these motors, is not installed.
        CalibrationError: If the calibration file cannot be read.
    """
    try:
        configs = importlib.import_module(f"lerobot.{kind.group}.config")
        makers = importlib.import_module(f"lerobot.{kind.group}.utils")
        module = None
        # Older versions of lerobot have a module for each kind of arm.
        for name in (kind.module, kind.name):
            try:
                module = importlib.import_module(f"lerobot.{kind.group}.{name}")
                break
            except ModuleNotFoundError as problem:
                if problem.name != f"lerobot.{kind.group}.{name}":
                    raise
        given = dict(options)
        if cameras is not None:
            opencv = importlib.import_module("lerobot.cameras.opencv.configuration_opencv")
            given["cameras"] = {name: opencv.OpenCVCameraConfig(**chosen) for name, chosen in cameras.items()}
        config = getattr(configs, kind.config_class).get_choice_class(kind.name)(**given)
    except Exception as problem:  # inconsistent installations raise many different errors
        raise missing_packages(f"{what} ({one_line(problem)})", "lerobot[feetech]") from problem
    try:
        return getattr(makers, kind.maker)(config)
    except ImportError as problem:
        raise missing_packages(f"{what} ({one_line(problem)})", "lerobot[feetech]") from problem
    except Exception as problem:  # lerobot reads the calibration file in this call
        file = _calibration_file(kind, module, str(options["id"]))
        if file is None or not file.is_file():
            raise missing_packages(f"{what} ({one_line(problem)})", "lerobot[feetech]") from problem
        call = kind.calibrate_call(str(options["port"]), str(options["id"]))
        told = f"not a calibration of lerobot ({one_line(problem)})"
        raise CalibrationError(str(file), told, f"Rename or delete the file, then run {call}") from problem


def _calibration_file(kind: ArmKind, module: Any, name: str) -> Path | None:  # noqa: ANN401 - a module of lerobot
    """Return the path of lerobot's calibration file for an arm. Return None if lerobot has no class for the arm."""
    words = kind.name.split("_")  # so101_follower: SO101Follower
    made = getattr(module, f"{words[0].upper()}{words[1].title()}", None)
    if made is None:
        return None
    constants = importlib.import_module("lerobot.utils.constants")
    return Path(constants.HF_LEROBOT_CALIBRATION) / kind.group / str(made.name) / f"{name}.json"


def check_calibration(arm: Any, kind: ArmKind, port: str) -> None:  # noqa: ANN401 - lerobot's class
    """Check that the calibration file of an arm matches its motors, using a temporary connection.

    lerobot's ``connect`` is not used here, because it enables the torque even if the robot is not calibrated.

    Raises:
        CalibrationError: If there is no calibration file, or its values differ from those in the motors.
        OSError, RuntimeError: If the motors do not answer.
    """
    call = kind.calibrate_call(port, str(arm.id))
    file = Path(arm.calibration_fpath)
    if not arm.calibration:
        raise CalibrationError(f"{kind.name} {arm.id!r}", f"not calibrated: there is no {file}", f"Run {call}")
    for motor, kept in arm.calibration.items():
        if kept.range_min >= kept.range_max:
            told = f"the range of {motor} is empty ({kept.range_min} to {kept.range_max})"
            raise CalibrationError(str(file), told, f"Run {call}")
    try:
        arm.bus.connect()
        held = arm.bus.read_calibration()
    finally:
        close_arm(arm)
    values = ("homing_offset", "range_min", "range_max")
    differing = [
        motor
        for motor in {**held, **arm.calibration}
        if motor not in held
        or motor not in arm.calibration
        or any(getattr(held[motor], name) != getattr(arm.calibration[motor], name) for name in values)
    ]
    if differing:
        raise CalibrationError(
            f"{kind.name} {arm.id!r}",
            f"not calibrated: the motors {', '.join(differing)} have other values than {file}",
            f"Use the id of this arm, or run {call} and press Enter, which writes the values in the file to the motors",
        )


def connect_arm(arm: Any, kind: ArmKind, port: str) -> None:  # noqa: ANN401 - lerobot's class
    """Check the calibration of an arm, and connect to the arm.

    Failed requests to the motors are repeated, because lerobot does not repeat them.

    Raises:
        CalibrationError: If the calibration is missing or does not match the motors.
        Exception: Any error that lerobot raises. All connections are then closed.
    """
    for left in reversed(range(RETRIES + 1)):
        try:
            check_calibration(arm, kind, port)
            arm.connect(calibrate=False)
        except CalibrationError:
            raise
        except Exception:
            close_arm(arm)
            if not left or not Path(port).exists():
                raise
            time.sleep(QUIET_S)
        else:
            return


def close_arm(arm: Any) -> None:  # noqa: ANN401 - lerobot's class
    """Close all open connections of an arm without changing its torque.

    lerobot's own method ``disconnect`` is not used, because it does nothing if the bus or one of the cameras is not
    connected.
    """
    with contextlib.suppress(Exception):  # the arm may have been unplugged, or was never connected
        arm.bus.disconnect(disable_torque=False)
    for camera in getattr(arm, "cameras", {}).values():
        with contextlib.suppress(Exception):
            camera.disconnect()


def clear_port(bus: Any) -> None:  # noqa: ANN401 - lerobot's FeetechMotorsBus
    """Discard unread data in the serial port. Call this before each request.

    A motor's reply does not say which request it answers. A late reply would be taken for the reply to the next
    request, and all later replies would be off by one. Motor loads could then be mistaken for positions, for example.
    """
    port = bus.port_handler
    port.is_using = False  # stays True after a request that raised an error, which would block all later requests
    port.ser.reset_input_buffer()


def read_motors(bus: Any, register: str, *, normalize: bool = True) -> dict[str, float]:  # noqa: ANN401 - FeetechMotorsBus
    """Read a register of all motors, with retries. Return its value for each motor, by motor name.

    Raises the errors of lerobot and pyserial.
    """
    failures = 0
    while True:
        clear_port(bus)
        try:
            found = dict(bus.sync_read(register, normalize=normalize))
        except ConnectionError:
            failures += 1
            time.sleep(QUIET_S)
            if failures > RETRIES:
                raise
        else:
            if failures:  # this may be the late answer to the first request, so another answer may still arrive
                time.sleep(QUIET_S)
            return found


def failure(problem: Exception, port: str) -> str:
    """Return lerobot's error message about motors in one line, leaving out its long lists of all motors."""
    if not Path(port).exists():
        return f"there is no {port}"
    return one_line(str(problem).partition("\nFull expected motor list")[0]).rstrip(" .")
