"""Driver of the SO-101 based on LeRobot's ``so101_follower`` class, with its motors, calibration and cameras.

LeRobot is an optional package, which is imported when an arm is connected. Each camera is read by its own thread, so
that the control loop never waits for a camera and knows when the newest frame arrived.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from betterbench.demonstrations.teleop.lerobot_arms import (
    RETRIES,
    ArmKind,
    CalibrationError,
    clear_port,
    close_arm,
    connect_arm,
    failure,
    make_arm,
    read_motors,
)
from betterbench.errors import InvalidInputError
from betterbench.interface.actions import SO101_MOTORS
from betterbench.real.plan import PlannedTrial, Unit
from betterbench.real.robots.robot import Frame, Reading, RobotError

KIND = "so101_follower"
FIRST_FRAME_S = 5.0
"""Maximum time to wait for the first frame of each camera [s]."""
_ARM = ArmKind("robots", KIND, "so_follower")
_CURE = (
    "Check power and plugs, and --arm-port (lerobot-find-port) and --cameras (lerobot-find-cameras). A motor that "
    "reports an overload is treated as missing: switch its power off and on"
)
_LOAD_SIGN, _LOAD_MOST = 1024, 1000
"""Sign bit and maximum value of the register ``Present_Load``. Its unit is 0.1 % of the servo's stall torque."""


class LeRobotArm:
    """SO-101 arm on a serial port. It implements :class:`~betterbench.real.robots.robot.Robot`."""

    name = KIND

    def __init__(
        self,
        port: str,
        *,
        arm_id: str,
        unit: Unit,
        cameras: Mapping[str, str],
        size: tuple[int, int] = (640, 480),
        rate_hz: int = 30,
    ) -> None:
        """Store the settings without opening a device.

        Args:
            port: Serial port ("/dev/ttyACM0").
            arm_id: Id under which LeRobot stores the calibration.
            unit: Unit of joint positions in states and commands.
            cameras: Index or path of each camera by name, starting with the front camera.
            size: Width and height of the images [pixels].
            rate_hz: Frame rate of the cameras [Hz].

        Raises:
            InvalidInputError: If no port or no camera is given.
        """
        if not port:
            raise InvalidInputError(
                "--arm-port", "the serial port of the arm is missing", "Pass a port, such as /dev/ttyACM0"
            )
        if not cameras:
            raise InvalidInputError("--cameras", "no camera is given", "Pass at least a front camera, such as front=0")
        self.cameras = tuple(cameras)
        self._port, self._id, self._unit = port, arm_id, unit
        self._sources, self._size, self._rate_hz = dict(cameras), size, rate_hz
        self._arm: Any = None
        self._frames: dict[str, Frame] = {}
        self._is_over = threading.Event()
        self._threads: list[threading.Thread] = []

    def connect(self) -> None:
        """Open the motors and cameras, and wait for the first frames.

        Raises:
            MissingDependencyError: If lerobot, or a package that it needs for these motors, is not installed.
            RobotError: If the arm or a camera cannot be reached, or the arm is not calibrated.
        """
        arm = self._made()
        try:
            connect_arm(arm, _ARM, self._port)
        except CalibrationError as problem:
            raise RobotError(str(problem)) from problem
        except Exception as problem:
            raise RobotError(f"{KIND} at {self._port}: {failure(problem, self._port)}. {_CURE}.") from problem
        self._arm = arm
        self._frames.clear()
        self._is_over.clear()
        for name, camera in arm.cameras.items():
            thread = threading.Thread(target=self._watch, args=(name, camera), name=f"camera {name}", daemon=True)
            thread.start()
            self._threads.append(thread)
        until = time.monotonic() + FIRST_FRAME_S
        while len(self._frames) < len(self.cameras):
            if time.monotonic() > until:
                missing = ", ".join(name for name in self.cameras if name not in self._frames)
                self.disconnect()
                raise RobotError(f"Camera {missing} sends no frames. Check its plug and the option --cameras.")
            time.sleep(0.02)

    def _made(self) -> Any:  # noqa: ANN401 - lerobot's Robot
        width, height = self._size
        size = {"fps": self._rate_hz, "width": width, "height": height}
        cameras = {
            name: {"index_or_path": int(source) if source.isdigit() else source, **size}
            for name, source in self._sources.items()
        }
        options = {
            "port": self._port,
            "id": self._id,
            "use_degrees": self._unit == "degrees",
            "disable_torque_on_disconnect": False,
        }
        try:
            return make_arm(_ARM, options, what="The arm needs lerobot with its Feetech motors", cameras=cameras)
        except CalibrationError as problem:
            raise RobotError(str(problem)) from problem

    def now(self) -> float:
        """Return the time of the monotonic clock [s]."""
        return time.monotonic()

    def set_up(self, trial: PlannedTrial) -> None:
        """Do nothing, because a person sets up the real scene."""

    def read(self) -> Reading:
        """Read positions, loads and the newest frames. Raise RobotError if the motors do not answer."""
        bus = self._connected.bus
        try:
            positions = read_motors(bus, "Present_Position")
            loads = read_motors(bus, "Present_Load", normalize=False)
        except Exception as problem:
            raise self._silent(problem) from problem
        state = np.array([float(positions[motor]) for motor in SO101_MOTORS])
        load = np.array([_signed(int(loads[motor])) / _LOAD_MOST for motor in SO101_MOTORS])
        return Reading(self.now(), state, load, dict(self._frames))

    def command(self, positions: np.ndarray) -> None:
        """Send target positions to the motors. Raise RobotError if the motors do not answer."""
        bus = self._connected.bus
        goals = {motor: float(value) for motor, value in zip(SO101_MOTORS, positions, strict=True)}
        try:
            clear_port(bus)
            # LeRobot's send_action does the same, but raises an error if a camera fails, so the arm could not be
            # stopped
            bus.sync_write("Goal_Position", goals)
        except Exception as problem:
            raise self._silent(problem) from problem

    def release(self) -> None:
        """Switch off the torque of all motors, so that the arm sinks.

        All motors are tried before RobotError is raised for a motor that did not answer.
        """
        bus = self._connected.bus
        problems: list[Exception] = []
        for motor in SO101_MOTORS:
            try:
                clear_port(bus)
                bus.disable_torque(motor, num_retry=RETRIES)
            except Exception as problem:  # noqa: BLE001 - such as an overloaded motor, which answers with an error
                problems.append(problem)
        if problems:
            raise self._silent(problems[0]) from problems[0]

    def disconnect(self) -> None:
        """Close the connection. The motors keep holding their position."""
        self._is_over.set()
        for thread in self._threads:
            thread.join(timeout=1.0)
        self._threads.clear()
        arm, self._arm = self._arm, None
        if arm is not None:
            close_arm(arm)

    @property
    def _connected(self) -> Any:  # noqa: ANN401 - lerobot's Robot
        if self._arm is None:
            raise RobotError("The arm is not connected. Call connect first.")
        return self._arm

    def _silent(self, problem: Exception) -> RobotError:
        told = failure(problem, self._port)
        return RobotError(f"The motors do not answer ({told}). Check the USB cable, the power and the wires.")

    def _watch(self, name: str, camera: Any) -> None:  # noqa: ANN401 - lerobot's Camera
        """Store the newest frame of a camera.

        If the camera fails, its last frame is kept. The control loop then finds that this frame is too old.
        """
        while not self._is_over.is_set():
            try:
                image = np.asarray(camera.async_read(timeout_ms=500))
            except Exception:  # noqa: BLE001 - what a camera raises; the loop sees the age of its last frame
                self._is_over.wait(0.05)
                continue
            self._frames[name] = Frame(image, self.now())


def _signed(load: int) -> int:
    """Return a signed load.

    Newer versions of LeRobot decode the sign of a load, whereas older versions return a raw value with a sign bit.
    """
    return load if abs(load) < _LOAD_SIGN else _LOAD_SIGN - load
