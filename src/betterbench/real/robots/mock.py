"""Mock SO-101 that runs in this process: a simulated arm with camera images in real time and optional faults.

A trial uses the simulated scene: the images show its objects, the arm can grasp and lift them, and the servos have the
gains and torque limits of the simulated arm. Possible faults are a slow camera, dropped frames, an unplugged camera, a
servo that stalls, and a calibration that drifts.
"""

from __future__ import annotations

import dataclasses
import time
from collections import deque
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from betterbench.errors import InvalidInputError
from betterbench.interface.actions import SO101_MOTORS
from betterbench.interface.observation import CameraSpec, ObservationSpec
from betterbench.json_form import strict_form
from betterbench.real.plan import PlannedTrial, RealPlan
from betterbench.real.robots.robot import Frame, Reading, RobotError
from betterbench.sim.robots import robot
from betterbench.sim.scenes import Scene
from betterbench.sim.scenes.rendering import Renderers
from betterbench.sim.scenes.stage import quality_preset
from betterbench.tasks import Task
from betterbench.tasks.interventions.resolve import resolve_condition

MOST_STEPS = 5
"""Maximum number of control steps simulated per reading.

On a slow machine, this limit makes the arm slower than real time.
"""


@strict_form
@dataclasses.dataclass(frozen=True, slots=True)
class MockFaults:
    """Simulated hardware faults of the mock arm.

    Attributes:
        latency_s: Age of every frame when it arrives [s].
        drop_every: If n > 0, every n-th frame is dropped and replaced by the previous frame. 0 drops no frames.
        unplugged: Name of the camera that is unplugged after ``after_s``; empty for no camera.
        stalled: Name of the motor that stalls after ``after_s``; empty for no motor.
        after_s: Time after the first command at which the faults unplugged, stalled and broken begin [s].
        drift: Rate at which the error of all reported arm positions grows [rad/s], as if the calibration drifted.
        moved: Offset (x, y) of objects from their planned positions [m], by object name, as if the operator had
            misplaced them.
        light: Factor for the brightness of the images.
        tint: Factors for the red, green and blue channels of the images.
        broken: Whether the motor bus stops answering after ``after_s``.
    """

    latency_s: float = 0.0
    drop_every: int = 0
    unplugged: str = ""
    stalled: str = ""
    after_s: float = 0.0
    drift: float = 0.0
    moved: Mapping[str, tuple[float, float]] = dataclasses.field(default_factory=dict)
    light: float = 1.0
    tint: tuple[float, float, float] = (1.0, 1.0, 1.0)
    broken: bool = False

    def __post_init__(self) -> None:
        """Raise InvalidInputError if the stalled motor does not exist."""
        if self.stalled and self.stalled not in SO101_MOTORS:
            raise InvalidInputError(
                "mock: stalled", f"{self.stalled!r} is not a motor", f"Use one of {', '.join(SO101_MOTORS)}"
            )


class MockRobot:
    """Simulated SO-101 that is used in place of the real arm.

    It implements :class:`~betterbench.real.robots.robot.Robot`.
    """

    name = "mock"

    def __init__(
        self,
        plan: RealPlan,
        *,
        faults: MockFaults | None = None,
        cameras: tuple[str, ...] = ("front", "wrist"),
        size: tuple[int, int] = (256, 256),
        quality: str = "fast",
        log: Path | None = None,
    ) -> None:
        """Store the settings; :meth:`set_up` builds the scene.

        Args:
            plan: Plan with the unit of joint positions and the control rate.
            faults: Simulated faults; by default none.
            cameras: Camera names, starting with the front camera.
            size: Width and height of the images [pixels].
            quality: Render preset of the images.
            log: File to which each command is appended immediately, for tests. If it is None, no file is written.
        """
        self.cameras = cameras
        self.faults = faults or MockFaults()
        self.commands: list[np.ndarray] = []
        """All received commands."""
        self._plan, self._size, self._quality, self._log = plan, size, quality_preset(quality), log
        self._spec = robot("so101")
        self._renderers = Renderers(1)
        self._looks = ObservationSpec("mock", tuple(CameraSpec(name, *size) for name in cameras))
        self._scene: Scene | None = None
        self._target: np.ndarray | None = None
        self._stuck: np.ndarray | None = None
        self._stepped_s = self._first_s = 0.0
        self._is_moving = False
        self._reads = 0
        self._shown: dict[str, Frame] = {}
        self._waiting: deque[tuple[float, dict[str, np.ndarray]]] = deque()

    def connect(self) -> None:
        """Do nothing, because there is no device to connect."""

    def now(self) -> float:
        """Return the time of the monotonic clock [s]."""
        return time.monotonic()

    def set_up(self, trial: PlannedTrial) -> None:
        """Build the scene of a trial, with the arm in its initial pose."""
        setting = resolve_condition(self._plan.task, trial.condition)
        self._scene = Scene(
            moved_slots(setting.task, setting.condition.layout, self.faults.moved),
            setting.condition,
            seed=trial.scene_seed,
            action_space=self._plan.action_space,
            quality=self._quality,
            control_rate_hz=self._plan.rate_hz,
            steady_views=True,
        )
        self._target = self._stuck = None
        self._is_moving = False
        self._stepped_s = self.now()
        self._shown.clear()
        self._waiting.clear()

    @property
    def scene(self) -> Scene:
        """Scene of the current trial. Raise RobotError if :meth:`set_up` has not been called."""
        if self._scene is None:
            raise RobotError("The mock has no scene. Call set_up with a trial.")
        return self._scene

    def read(self) -> Reading:
        """Advance the simulation to the current time, and return the state of the arm."""
        now, scene = self.now(), self.scene
        faulty = self._is_moving and now - self._first_s >= self.faults.after_s
        if self.faults.broken and faulty:
            raise RobotError("The bus of the arm does not answer. Check its USB cable and its power.")
        period_s = 1.0 / self._plan.rate_hz
        for _ in range(MOST_STEPS):
            if now - self._stepped_s < period_s:
                break
            self._stepped_s += period_s
            scene.step(self._servo_targets(faulty=faulty))
        else:
            self._stepped_s = now
        state = self._positions()
        load = self._load(state)
        if self._is_moving:
            state[:5] += self.faults.drift * (now - self._first_s) / np.array(self._plan.action_space.scale[:5])
        self._look(now, faulty=faulty)
        return Reading(now, state, load, dict(self._shown))

    def command(self, positions: np.ndarray) -> None:
        """Set the target positions of the servos."""
        if not self._is_moving:
            self._is_moving, self._first_s = True, self.now()
        self._target = np.array(positions, dtype=float)
        self.commands.append(self._target.copy())
        if self._log is not None:
            with self._log.open("a") as file:
                file.write(" ".join(f"{v:.6f}" for v in self._target) + "\n")

    def release(self) -> None:
        """Hold the current position. The simulated servos cannot be switched off."""
        self._target = self._positions()

    def disconnect(self) -> None:
        """Free the renderer."""
        self._renderers.close()

    def _positions(self) -> np.ndarray:
        state = self.scene.state()
        return np.array(self._spec.positions_in(self._plan.action_space, state.joint_positions, state.finger_width_m))

    def _servo_targets(self, *, faulty: bool) -> np.ndarray:
        if self._target is None:
            self._target = self._positions()
        targets = self._target.copy()
        if self.faults.stalled and faulty:
            motor = SO101_MOTORS.index(self.faults.stalled)
            if self._stuck is None:
                self._stuck = self._positions()
            targets[motor] = self._stuck[motor]
        return targets

    def _load(self, state: np.ndarray) -> np.ndarray:
        """Return the load of each servo.

        The load is computed from the distance between the servo and its target, because the torque is this distance
        times the gain.
        """
        if self._target is None:
            return np.zeros(6)
        lag = (self._target - state) * np.array([*self._plan.action_space.scale[:5], 0.02])
        return np.asarray(np.clip(2.0 * lag, -1.0, 1.0))

    def _look(self, now: float, *, faulty: bool) -> None:
        """Render a frame, unless the frame is to be dropped.

        When the latency of a frame has passed, the frame becomes the newest one of its camera.
        """
        self._reads += 1
        if not (self.faults.drop_every and self._reads % self.faults.drop_every == 0 and self._shown):
            views = self.scene.views(self._looks, self._renderers)
            self._waiting.append((now, {name: self._lit(v.rgb) for name, v in views.items() if v.rgb is not None}))
        while self._waiting and (now - self._waiting[0][0] >= self.faults.latency_s or not self._shown):
            taken, images = self._waiting.popleft()
            for name, image in images.items():
                if not (name == self.faults.unplugged and faulty):
                    self._shown[name] = Frame(image, taken)

    def _lit(self, image: np.ndarray) -> np.ndarray:
        if self.faults.light == 1.0 and self.faults.tint == (1.0, 1.0, 1.0):
            return image
        return np.clip(image * (self.faults.light * np.array(self.faults.tint)), 0.0, 255.0).astype(np.uint8)


def moved_slots(task: Task, layout: Mapping[str, str], moved: Mapping[str, tuple[float, float]]) -> Task:
    """Return a copy of a task in which the slots of some objects are shifted by (x, y) [m].

    Raises:
        InvalidInputError: If an object is not in a slot.
    """
    shifts = {}
    for name, shift in moved.items():
        if name not in layout:
            raise InvalidInputError("moved", f"{name!r} is not in a slot", f"Use one of {', '.join(sorted(layout))}")
        shifts[layout[name]] = shift
    slots = tuple(
        dataclasses.replace(slot, x=slot.x + shifts[slot.name][0], y=slot.y + shifts[slot.name][1])
        if slot.name in shifts
        else slot
        for slot in task.slots
    )
    return dataclasses.replace(task, slots=slots)
