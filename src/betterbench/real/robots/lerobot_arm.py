"""An SO-101 behind lerobot's own ``so101_follower`` class, with its motors, calibration and cameras.

lerobot is optional and imported when an arm is connected. Each camera is read by a thread, so that the control loop
never waits for one and knows when its newest frame arrived.
"""

from __future__ import annotations

import contextlib
import importlib
import threading
import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from betterbench.errors import InvalidInputError, one_line
from betterbench.installation import missing_packages
from betterbench.real.plan import PlannedTrial, Unit
from betterbench.real.record import MOTORS
from betterbench.real.robots.robot import Frame, Reading, RobotError

KIND = "so101_follower"
RETRIES = 2
"""Repetitions of a failed request to the motors; a Feetech bus loses a packet now and then."""
FIRST_FRAME_S = 5.0
"""Longest time until each camera has sent a frame [s]."""
_LOAD_SIGN, _LOAD_MOST = 1024, 1000
"""Sign bit and maximum of ``Present_Load`` (STS3215: tenths of a percent of the stall torque)."""


class LeRobotArm:
    """A connected SO-101; implements :class:`~betterbench.real.robots.robot.Robot`."""

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
        """Prepare; nothing is opened.

        Args:
            port: Serial port ("/dev/ttyACM0").
            arm_id: Id under which lerobot keeps the calibration.
            unit: Unit of states and commands.
            cameras: Index or path of each camera by name, front first.
            size: Width and height of the images [pixel].
            rate_hz: Rate of the cameras [Hz].

        Raises:
            InvalidInputError: If there is no port or camera.
        """
        if not port:
            raise InvalidInputError(
                "--arm-port", "the serial port of the arm is missing", "Give one such as /dev/ttyACM0"
            )
        if not cameras:
            raise InvalidInputError("--camera", "no camera is given", "Give at least front=0")
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
            arm.connect(calibrate=False)
            is_calibrated = bool(arm.is_calibrated)
        except Exception as problem:
            with contextlib.suppress(Exception):
                arm.disconnect()
            cure = "Check power and plugs, and --arm-port (lerobot-find-port) and --camera (lerobot-find-cameras)"
            raise RobotError(f"{KIND} at {self._port}: {one_line(problem)}. {cure}.") from problem
        if not is_calibrated:
            with contextlib.suppress(Exception):
                arm.disconnect()
            call = f"lerobot-calibrate --robot.type={KIND} --robot.port={self._port} --robot.id={self._id}"
            raise RobotError(f"{KIND} {self._id!r} is not calibrated. Run {call}.")
        self._arm = arm
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
                raise RobotError(f"Camera {missing} sends no frames. Check its plug, and --camera.")
            time.sleep(0.02)

    def _made(self) -> Any:  # noqa: ANN401 - lerobot's Robot
        try:
            configs = importlib.import_module("lerobot.robots.config")
            makers = importlib.import_module("lerobot.robots.utils")
            opencv = importlib.import_module("lerobot.cameras.opencv.configuration_opencv")
            for module in (KIND, "so_follower"):  # lerobot 0.4 has a module per kind, 0.6 has so_follower
                try:
                    importlib.import_module(f"lerobot.robots.{module}")
                    break
                except ModuleNotFoundError as problem:
                    if problem.name != f"lerobot.robots.{module}":
                        raise
            width, height = self._size
            cameras = {
                name: opencv.OpenCVCameraConfig(
                    index_or_path=int(source) if source.isdigit() else source,
                    fps=self._rate_hz,
                    width=width,
                    height=height,
                )
                for name, source in self._sources.items()
            }
            config = configs.RobotConfig.get_choice_class(KIND)(
                port=self._port,
                id=self._id,
                use_degrees=self._unit == "degrees",
                cameras=cameras,
                disable_torque_on_disconnect=False,
            )
            return makers.make_robot_from_config(config)
        except Exception as problem:  # inconsistent installations fail in many ways
            raise missing_packages(
                f"The arm needs lerobot with its Feetech motors ({one_line(problem)})", "lerobot[feetech]"
            ) from problem

    def now(self) -> float:
        """Return the time [s]."""
        return time.monotonic()

    def set_up(self, trial: PlannedTrial) -> None:
        """Do nothing: a person sets up the scene."""

    def read(self) -> Reading:
        """Return positions, loads and the newest frames. Raises RobotError."""
        bus = self._connected.bus
        try:
            positions = bus.sync_read("Present_Position", num_retry=RETRIES)
            loads = bus.sync_read("Present_Load", normalize=False, num_retry=RETRIES)
        except Exception as problem:
            raise _silent(problem) from problem
        state = np.array([float(positions[motor]) for motor in MOTORS])
        load = np.array([_signed(int(loads[motor])) / _LOAD_MOST for motor in MOTORS])
        return Reading(self.now(), state, load, dict(self._frames))

    def command(self, positions: np.ndarray) -> None:
        """Send targets to the motors. Raises RobotError."""
        action = {f"{motor}.pos": float(value) for motor, value in zip(MOTORS, positions, strict=True)}
        try:
            self._connected.send_action(action)
        except Exception as problem:
            raise _silent(problem) from problem

    def release(self) -> None:
        """Switch the torque off; the arm sinks. Raises RobotError."""
        try:
            self._connected.bus.disable_torque(num_retry=RETRIES)
        except Exception as problem:
            raise _silent(problem) from problem

    def disconnect(self) -> None:
        """Close the connection; the motors keep their position."""
        self._is_over.set()
        for thread in self._threads:
            thread.join(timeout=1.0)
        self._threads.clear()
        arm, self._arm = self._arm, None
        if arm is not None:
            with contextlib.suppress(Exception):  # an arm that was unplugged
                arm.disconnect()

    @property
    def _connected(self) -> Any:  # noqa: ANN401 - lerobot's Robot
        if self._arm is None:
            raise RobotError("The arm is not connected. Call connect first.")
        return self._arm

    def _watch(self, name: str, camera: Any) -> None:  # noqa: ANN401 - lerobot's Camera
        """Keep the newest frame of a camera; a camera that fails keeps its last one, whose age then grows."""
        while not self._is_over.is_set():
            try:
                image = np.asarray(camera.async_read(timeout_ms=500))
            except Exception:  # noqa: BLE001 - what a camera raises; the loop sees the age of its last frame
                self._is_over.wait(0.05)
                continue
            self._frames[name] = Frame(image, self.now())


def _signed(load: int) -> int:
    """Return a load with its sign: newer versions of lerobot decode it, older ones give the sign bit."""
    return load if abs(load) < _LOAD_SIGN else _LOAD_SIGN - load


def _silent(problem: Exception) -> RobotError:
    return RobotError(f"The motors do not answer ({one_line(problem)}). Check the USB cable, the power and the wires.")
