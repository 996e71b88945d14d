"""Execution of one trial: move the arm to the initial pose, run the policy, record the motion, and stop the arm.

The loop never waits for the policy. If no action arrives, the arm first completes the last command and then, after the
watchdog time, holds its measured position. The software switch is turned off at the end of every trial: the arm holds
its measured position with torque on and gets no further commands.
"""

from __future__ import annotations

import logging
import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from betterbench.errors import BetterError, InvalidInputError, one_line
from betterbench.interface import EpisodeStart, Observation, Policy
from betterbench.interface.policy import episode_number
from betterbench.jobs.decisions import now
from betterbench.real.arm import NotArmedError, SafeArm
from betterbench.real.asking import ANSWER_S, Asker
from betterbench.real.films import FilmThread
from betterbench.real.limits import ROBOT
from betterbench.real.plan import PlannedTrial, RealPlan
from betterbench.real.record import TRIAL_VERSION, Ending, Film, Samples, TrialHeader, write_attempt
from betterbench.real.robots.robot import Reading, RobotError
from betterbench.sim.robots import ArmIK, robot
from betterbench.sim.scenes.appearance import start_joints_of

NO_FRAME_S = 1.0
"""Maximum age of a camera's newest frame [s]. If the frame is older, the trial is aborted."""
HOME_S = 15.0
"""Maximum duration of the motion to the initial pose [s]."""
HOME_SHARE = 0.5
"""Speed of the motion to the initial pose, as a fraction of the maximum speed."""
AT_HOME_RAD, AT_HOME_GRIPPER = 0.08, 10.0
"""Maximum distance from the initial pose at which a trial may begin: for each arm joint [rad], and for the gripper
[percent]."""

logger = logging.getLogger(__name__)


class TrialAbortedError(BetterError):
    """Error for an aborted attempt at a trial. The attempt is discarded and repeated. The message states the reason."""


@dataclass(slots=True)
class Controls:
    """Signals from the operator to a running trial.

    Attributes:
        end: Set to end the trial and keep its result.
        stop: Set to stop the arm immediately and discard the attempt.
        show: Called with the newest reading of the robot, to display it on a page.
        why: Reason for a stop.
    """

    end: threading.Event = field(default_factory=threading.Event)
    stop: threading.Event = field(default_factory=threading.Event)
    show: Callable[[Reading], None] = lambda _: None
    why: str = "the operator stopped it"


class Pace:
    """Timer for control steps.

    If a step is late, all following steps are delayed as well, so that the arm never moves faster to catch up.
    """

    def __init__(self, rate_hz: float) -> None:
        self._period_s, self._due, self.late_steps = 1.0 / rate_hz, time.monotonic(), 0

    def wait(self) -> None:
        """Wait until the next control step is due."""
        self._due += self._period_s
        left = self._due - time.monotonic()
        if left > 0.0:
            time.sleep(left)
        elif -left > 0.5 * self._period_s:
            self.late_steps += 1
            self._due = time.monotonic()


@dataclass(slots=True)
class _Rows:
    time_s: list[float] = field(default_factory=list)
    state: list[np.ndarray] = field(default_factory=list)
    command: list[np.ndarray] = field(default_factory=list)
    asked: list[np.ndarray] = field(default_factory=list)
    load: list[np.ndarray] = field(default_factory=list)
    late: list[bool] = field(default_factory=list)
    limited: list[bool] = field(default_factory=list)

    def samples(self) -> Samples:
        wide = {name: np.array(getattr(self, name), dtype=float).reshape(-1, 6) for name in _WIDE}
        flags = {name: np.array(getattr(self, name), dtype=bool) for name in ("late", "limited")}
        return Samples(np.array(self.time_s, dtype=float), **wide, **flags)


_WIDE = ("state", "command", "asked", "load")


class TrialRun:
    """Execution and recording of one attempt at a trial.

    Attributes:
        left_busy: Whether the policy was still computing an answer when the trial ended.
    """

    def __init__(
        self,
        arm: SafeArm,
        policy: Policy,
        plan: RealPlan,
        planned: PlannedTrial,
        *,
        attempt: int,
        controls: Controls,
        agreement: float | None = None,
        overridden: bool = False,
    ) -> None:
        """Prepare the attempt without moving the arm."""
        self._arm, self._policy, self._plan, self._planned = arm, policy, plan, planned
        self._attempt, self._controls = attempt, controls
        self._agreement, self._overridden = agreement, overridden
        self._space, self._spec = plan.action_space, robot(ROBOT)
        self._ik = ArmIK(self._spec)
        self._rows, self._pace = _Rows(), Pace(plan.rate_hz)
        self._films = {camera: FilmThread(camera, rate_hz=plan.rate_hz) for camera in arm.robot.cameras}
        self._held = 0
        self.left_busy = False
        self._film_problem = ""
        self._begun = now()
        self._instruction = plan.instruction(planned.condition)
        self._before: Reading | None = None

    def run(self, folder: Path) -> TrialHeader:
        """Run the trial and write its files into a folder, even if the trial is aborted.

        Raises:
            TrialAbortedError: If the trial was aborted.
            StorageError: If the disk is full.
        """
        ending: Ending | None = None
        why = ""
        try:
            self._go_to_start()
            ending = self._follow_policy()
        except TrialAbortedError as problem:
            why = str(problem)
        except NotArmedError:
            why = self._arm.why_off or "the switch was turned off"
        except BetterError as problem:
            why = one_line(str(problem), most=400)
        except KeyboardInterrupt:
            why = "the program was interrupted"
        finally:
            self._arm.stop(why or "the trial is over")
        header = self._write(folder, ending)
        if header.ending is None:
            raise TrialAbortedError(why or self._film_problem)
        return header

    def _read(self) -> Reading:
        """Abort if a stop was requested, read the state of the arm, and check the age of each camera's newest frame."""
        self._look_for_stop()
        reading = self._arm.read()
        for camera in self._arm.robot.cameras:
            frame = reading.frames.get(camera)
            age = math.inf if frame is None else reading.time_s - frame.time_s
            if age > NO_FRAME_S:
                told = "has sent no frame" if frame is None else f"has sent no frame for {age:.1f} s"
                raise RobotError(f"Camera {camera} {told}. Check its plug, and close other programs that use it.")
        self._controls.show(reading)
        return reading

    def _look_for_stop(self) -> None:
        if self._controls.stop.is_set():
            raise TrialAbortedError(self._controls.why)

    def start_position(self) -> np.ndarray:
        """Return the initial motor positions (6,): the positions of the simulated twin, with the gripper open."""
        joints = start_joints_of(self._plan.task, self._planned.scene_seed, self._spec)
        return np.array(self._spec.positions_in(self._space, joints, self._spec.gripper_opening_m))

    def _go_to_start(self) -> None:
        """Move to the initial motor positions at reduced speed."""
        wanted = np.clip(self.start_position(), self._arm.limiter.low, self._arm.limiter.high)
        near = np.array([*(AT_HOME_RAD / np.array(self._space.scale[:5])), AT_HOME_GRIPPER])
        reading = self._read()
        self._arm.begin(reading)
        most = HOME_SHARE * self._arm.limiter.most_step
        limit = math.ceil(HOME_S * self._plan.rate_hz)
        for _ in range(limit):
            if (np.abs(wanted - reading.state) < near).all():
                self._before = reading
                return
            step = wanted - self._arm.limiter.last
            ratio = max(1.0, float(np.max(np.abs(step) / most)))
            self._arm.move(self._arm.limiter.last + step / ratio, reading)
            self._pace.wait()
            reading = self._read()
        raise RobotError(
            f"The arm did not reach its initial pose within {HOME_S:.0f} s. Clear its path, or move it by hand."
        )

    def _follow_policy(self) -> Ending:
        asker = Asker(self._policy, self._space)
        try:
            with asker:
                try:
                    return self._steps(asker)
                finally:
                    if self._arm.is_armed:  # set the result now, because a pending answer may take half a minute
                        self._arm.stop("the trial is over")
        finally:
            self.left_busy = asker.is_busy

    def _steps(self, asker: Asker) -> Ending:
        seed = episode_number(self._planned.scene_seed)
        asker.start(EpisodeStart(self._instruction, seed, self._space.name), check=self._look_for_stop)
        self._begun, self._pace = now(), Pace(self._plan.rate_hz)
        began_s, period_s = self._arm.robot.now(), 1.0 / self._plan.rate_hz
        waited_s, at = 0.0, self._arm.limiter.last
        for step in range(round(self._plan.time_limit_s * self._plan.rate_hz)):
            reading = self._read()
            if self._controls.end.is_set():
                return "operator"
            if asker.wants():
                asker.ask(step, self._observation(reading, step))
            action = asker.next(step, wait_s=0.5 * period_s)
            if action is None:
                waited_s += period_s
                if waited_s > ANSWER_S:
                    raise TrialAbortedError(f"the policy did not answer within {ANSWER_S:.0f} s")
                if waited_s < self._arm.limiter.limits.watchdog_s:
                    at = self._arm.limiter.last
                elif waited_s - period_s < self._arm.limiter.limits.watchdog_s:
                    at = reading.state.copy()
                sent = self._arm.move(at, reading)
                self._held += 1
            else:
                waited_s = 0.0
                sent = self._arm.move(action, reading)
            self._append(reading, sent.command, action, bool(sent.by), began_s)
            self._pace.wait()
        return "time_limit"

    def _append(
        self, reading: Reading, command: np.ndarray, action: np.ndarray | None, limited: bool, began_s: float
    ) -> None:
        rows = self._rows
        late = [film.add(reading.frames[camera], reading.time_s) for camera, film in self._films.items()]
        rows.time_s.append(reading.time_s - began_s)
        rows.state.append(reading.state)
        rows.command.append(command)
        rows.asked.append(np.full(6, np.nan) if action is None else action)
        rows.load.append(reading.load)
        rows.late.append(any(late))
        rows.limited.append(limited and action is not None)

    def _observation(self, reading: Reading, step: int) -> Observation:
        """Return the observation that is sent to the policy."""
        units = np.array(self._space.scale)
        joints = reading.state[:5] * units[:5]
        speeds = np.zeros(5)
        if self._before is not None and reading.time_s > self._before.time_s:
            speeds = (joints - self._before.state[:5] * units[:5]) / (reading.time_s - self._before.time_s)
        self._before = reading
        tool = self._ik.forward(joints)
        return Observation(
            instruction=self._instruction,
            step=step,
            images={camera: frame.image for camera, frame in reading.frames.items()},
            joint_positions=joints,
            joint_velocities=speeds,
            ee_position=np.array(tool.position),
            ee_quaternion=np.array(tool.quaternion),
            gripper_width=self._spec.jaw.width_at_share(float(np.clip(reading.state[5] * units[5], 0.0, 1.0))),
            depth={},
            masks={},
        )

    def _write(self, folder: Path, ending: Ending | None) -> TrialHeader:
        films: dict[str, tuple[Film, bytes]] = {}
        for camera, thread in self._films.items():
            try:
                made = thread.finish()
            except InvalidInputError as problem:  # a trial without a video cannot be judged
                self._film_problem, ending = str(problem), None
                continue
            if made is not None:
                films[camera] = made
        samples = self._rows.samples()
        header = TrialHeader(
            TRIAL_VERSION,
            self._planned.code,
            self._attempt,
            self._arm.robot.name,
            self._instruction,
            self._plan.unit,
            self._plan.rate_hz,
            self._begun,
            ending,
            len(samples),
            self._pace.late_steps,
            self._held,
            int(samples.limited.sum()),
            {camera: film for camera, (film, _) in films.items()},
            {},
            self._agreement,
            self._overridden,
        )
        return write_attempt(folder, header, samples, {camera: data for camera, (_, data) in films.items()})
