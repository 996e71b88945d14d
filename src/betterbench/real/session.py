"""Session of an operator: set up the scene, switch the arm on, run the trial, enter the outcome, and continue.

All work is done in the thread of :meth:`RealSession.run`, which owns the renderers. Pages and keys put commands into
the queue of this thread. Only :meth:`RealSession.halt` and commands that end a trial act immediately, from any thread.

A session may end at any time. The next session marks an interrupted attempt as aborted and repeats its trial. If no
outcome has been entered for a finished trial, the next session first asks for it.
"""

from __future__ import annotations

import logging
import queue
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Self

from betterbench.errors import BetterError, InvalidInputError, StorageError
from betterbench.real.arm import SafeArm
from betterbench.real.asking import RealPolicies
from betterbench.real.limits import Limiter, SafetyLimits
from betterbench.real.loop import Controls, TrialRun
from betterbench.real.outcomes import outcome_named
from betterbench.real.overlap import Agreement, measure_agreement
from betterbench.real.plan import PlannedTrial
from betterbench.real.record import RealJournal, enter, read_run
from betterbench.real.robots.robot import Reading, Robot, RobotError
from betterbench.real.twin import FRONT, SetupStep, Twin, TwinView

MOST_WAITING = 50
LOOK_S = 0.1
"""Interval between readings of the robot while no trial is running [s]."""
MEASURE_S = 1.0
"""Interval between measurements of the agreement between the scene and its simulated twin [s]."""

_NOT_VALID = "the operator marked it as invalid"

logger = logging.getLogger(__name__)


class Stage(StrEnum):
    """Stage of a session."""

    SETUP = "setup"
    RUNNING = "running"
    ENTER = "enter"
    DONE = "done"


@dataclass(frozen=True, slots=True)
class Command:
    """Command from the operator.

    Attributes:
        name: Name of the command, one of :data:`COMMANDS`.
        value: Name of the outcome, for "enter".
        note: The operator's note.
    """

    name: str
    value: str = ""
    note: str = ""


COMMANDS = ("arm", "disarm", "start", "force", "end", "enter", "undo", "again", "release")
"""Names of the commands that pages and keys can send.

They switch the arm on (arm) and off (disarm), start the trial if the scene matches the twin (start) or in any case
(force), end the trial (end), enter the outcome (enter), undo the last entry (undo), discard and repeat the last trial
(again), and switch the motor torque off (release).
"""


@dataclass(frozen=True, slots=True)
class SessionView:
    """Content of the operator page. Policy and condition are hidden.

    Attributes:
        stage: Stage of the session.
        code: Code of the current trial; empty after the last trial.
        number: Number of the current trial in the plan, counted from 1.
        done: Number of finished trials.
        planned: Number of planned trials.
        instruction: Instruction of the current trial.
        cloth: Color of the tablecloth; empty if there is none.
        steps: Instructions for setting up the objects, one per object.
        armed: Whether the switch of the arm is on.
        why_off: Reason why the switch is off.
        message: Latest message to the operator.
        agreement: Last measured agreement between the scene and its twin, or None if it was not measured.
        elapsed_s: Duration of the running trial so far [s].
        time_limit_s: Maximum duration of a trial [s].
        can_undo: Whether there is an entry that can be undone.
    """

    stage: Stage
    code: str
    number: int
    done: int
    planned: int
    instruction: str
    cloth: str
    steps: tuple[SetupStep, ...]
    armed: bool
    why_off: str
    message: str
    agreement: Agreement | None
    elapsed_s: float
    time_limit_s: float
    can_undo: bool


@dataclass(frozen=True, slots=True)
class _Shown:
    """Current trial and stage, together with the setup steps and the image of the twin.

    The object is replaced as a whole, so that a page never shows a mixture of two trials.
    """

    trial: PlannedTrial | None = None
    stage: Stage = Stage.SETUP
    steps: tuple[SetupStep, ...] = ()
    view: TwinView | None = None


class RealSession:
    """Session in which an operator runs the trials of a protocol.

    A session can be used as a context manager, which closes it at the end.

    Raises:
        RunConflictError: If another process is running the protocol.
        RecordError: If the folder is damaged.
        InvalidInputError: If a policy cannot run on a real arm.
        RobotError: If the robot cannot be reached.
    """

    def __init__(
        self,
        folder: Path,
        robot: Robot,
        *,
        person: str,
        limits: SafetyLimits | None = None,
        apart: bool = True,
        size: tuple[int, int] = (320, 240),
        say: Callable[[str], None] = logger.info,
    ) -> None:
        """Open the protocol folder and connect the robot.

        Args:
            folder: Folder of a protocol with a plan.
            robot: Robot, which is not connected yet.
            person: Name of the operator, stored with the entries.
            limits: Safety limits; by default the limits of the SO-101.
            apart: Whether a user's policy runs in a separate process.
            size: Width and height of the images of the simulated twin [pixels].
            say: Called with each message to the operator.
        """
        self.folder, self.person, self.controls = folder, person, Controls()
        self._say, self._robot = say, robot
        self._journal = RealJournal(folder)
        try:
            self.plan = self._journal.plan
            cut = self._journal.settle()
            self._policies = RealPolicies(self.plan, robot.cameras, apart=apart)
            robot.connect()
        except BaseException:
            self._journal.close()
            raise
        self._arm = SafeArm(robot, Limiter(limits or SafetyLimits(), self.plan.action_space, rate_hz=self.plan.rate_hz))
        self._twin = Twin(self.plan, size=size)
        self._commands: queue.Queue[tuple[int, Command]] = queue.Queue(MOST_WAITING)
        self._halts = 0
        self._shown = _Shown()
        self._entered: list[str] = []
        self._message = ""
        self._agreement: Agreement | None = None
        self._begun_s = self._measured_s = 0.0
        self.reading: Reading | None = None
        """Newest reading, for display on pages."""
        self.counted = 0
        """Number of trials finished in this session."""
        if cut:
            self._tell(f"The program ended during {', '.join(cut)}: it will be repeated.")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Stop the arm, close all resources and unlock the folder."""
        self._arm.stop("the session ended")
        self._policies.close()
        self._robot.disconnect()
        self._twin.close()
        self._journal.close()

    # ------------------------------------------------------------------------------------------- from any thread

    def put(self, command: Command) -> None:
        """Queue a command. Raise InvalidInputError if the command is unknown.

        Switching the arm off acts immediately. While a trial is running, all commands except switching off and "end"
        are ignored.
        """
        if command.name not in COMMANDS:
            raise InvalidInputError("command", f"{command.name!r} is unknown", f"Use one of {', '.join(COMMANDS)}")
        if command.name == "disarm":
            self.halt("the operator switched it off")
            return
        if self._shown.stage is Stage.RUNNING:
            if command.name == "end":
                self.controls.end.set()
            return  # a queued command to switch on would take effect after the trial
        try:
            self._commands.put_nowait((self._halts, command))
        except queue.Full:
            logger.warning("too many commands are waiting, so %s is ignored", command.name)

    def halt(self, why: str = "the operator stopped it") -> None:
        """Stop the arm immediately, abort a running attempt, and drop the queued commands."""
        self._halts += 1
        self.controls.why = why
        self.controls.stop.set()
        self._arm.stop(why)

    @property
    def cameras(self) -> tuple[str, ...]:
        """Names of the robot's cameras."""
        return self._robot.cameras

    @property
    def twin_view(self) -> TwinView | None:
        """Image of the simulated twin for the current trial, or None."""
        return self._shown.view

    @property
    def view(self) -> SessionView:
        """Current content of the operator page."""
        trial, stage = self._shown.trial, self._shown.stage
        states = [self._journal.state(t.code).state for t in self.plan.trials]
        return SessionView(
            stage=stage,
            code="" if trial is None else trial.code,
            number=0 if trial is None else self.plan.trials.index(trial) + 1,
            done=states.count("done"),
            planned=len(states),
            instruction="" if trial is None else self.plan.instruction(trial.condition),
            cloth="" if trial is None else self._twin.cloth(trial),
            steps=self._shown.steps,
            armed=self._arm.is_armed,
            why_off=self._arm.why_off,
            message=self._message,
            agreement=self._agreement,
            elapsed_s=time.monotonic() - self._begun_s if stage is Stage.RUNNING else 0.0,
            time_limit_s=self.plan.time_limit_s,
            can_undo=stage is Stage.SETUP and bool(self._entered),
        )

    # ----------------------------------------------------------------------------------------- the session's thread

    def run(self, stopped: threading.Event) -> None:
        """Execute commands until the event is set, or until every trial is finished and has an entry.

        Raises:
            StorageError: If the disk is full.
        """
        watcher = threading.Thread(target=self._halt_with, args=(stopped,), daemon=True)
        watcher.start()
        self.begin()
        while not stopped.is_set() and self._shown.stage is not Stage.DONE:
            try:
                halts, command = self._commands.get(timeout=LOOK_S)
            except queue.Empty:
                self._look()
                continue
            if halts == self._halts:
                self.obey(command)
        self._arm.stop("the session ended")

    def _halt_with(self, stopped: threading.Event) -> None:
        stopped.wait()
        self.halt("the program was stopped")

    def _tell(self, message: str) -> None:
        self._message = message
        self._say(message)

    def begin(self) -> None:
        """Go to a finished trial for which no outcome has been entered yet, or else to the next trial in the plan."""
        # The program was killed after writing the entry, but before writing the journal line that repeats the trial.
        for trial in read_run(self.folder).trials:
            for entry in trial.seen_by("operator"):
                seen = entry.decision
                if seen.kind == "seen" and not outcome_named(seen.outcome).scored:
                    self._journal.repeat(trial.code, seen.note.strip() or _NOT_VALID, entry.author)
                    break
        run = read_run(self.folder)
        for damaged in run.damaged:
            logger.warning("%s", damaged.problem)
        waiting = next((t for t in run.trials if not t.seen_by("operator")), None)
        if waiting is not None:
            self._show(waiting.planned, Stage.ENTER)
            return
        following = self._journal.next_trial
        if following is None:
            self._shown = _Shown(stage=Stage.DONE)
            self._tell("Every trial is done.")
            return
        self._show(following, Stage.SETUP)

    def _show(self, trial: PlannedTrial, stage: Stage) -> None:
        steps, view = self._twin.steps(trial), self._twin.view(trial)
        if stage is Stage.SETUP:
            self._robot.set_up(trial)
        # The measurements belong to the previous scene.
        self._agreement = self.reading = None
        self._shown = _Shown(trial, stage, steps, view)
        if stage is Stage.SETUP:
            number = self.plan.trials.index(trial) + 1
            told = "; ".join(step.text for step in steps)
            where, cloth = f"{trial.code}, trial {number} of {len(self.plan.trials)}", self._twin.cloth(trial)
            self._say(f"{where}: set up the scene. {f'Tablecloth: {cloth}. ' if cloth else ''}{told}.")

    def _look(self) -> None:
        """Read the robot. At regular intervals, also measure the agreement between the scene and its twin."""
        if self._shown.stage is Stage.DONE:
            return
        try:
            self.reading = self._arm.read()
        except RobotError as problem:
            if self._message != str(problem):
                self._tell(str(problem))
            return
        if self._shown.stage is Stage.SETUP and time.monotonic() - self._measured_s > MEASURE_S:
            self._agreement = self._measured(self.reading)
            self._measured_s = time.monotonic()

    def _measured(self, reading: Reading) -> Agreement | None:
        """Return the agreement between the front camera's and the twin's image, or None if one of them is missing."""
        frame = reading.frames.get(FRONT)
        if frame is None or self._shown.view is None:
            return None
        return measure_agreement(frame.image, self._shown.view)

    def obey(self, command: Command) -> None:
        """Execute a command in this thread. Errors become messages to the operator.

        Raises:
            StorageError: If the disk is full.
        """
        try:
            self._obey(command)
        except StorageError:
            raise
        except BetterError as problem:
            self._tell(str(problem))

    def _obey(self, command: Command) -> None:
        match command.name, self._shown.stage:
            case "arm", _:
                self.controls.stop.clear()
                self._arm.arm()
            case "disarm", _:
                self._arm.stop("the operator switched it off")
            case "release", Stage.SETUP | Stage.ENTER:
                self._arm.release()
            case (("start" | "force"), Stage.SETUP):
                self._start(forced=command.name == "force")
            case "enter", Stage.ENTER:
                self._enter(command.value, command.note)
            case "undo", Stage.SETUP:
                self._undo()
            case "again", Stage.ENTER:
                self._again(command.note)
            case _:
                self._tell(f"{command.name!r} has no effect in this stage.")

    def _start(self, *, forced: bool) -> None:
        trial = self._shown.trial
        if trial is None:
            return
        if not self._arm.is_armed:
            self._tell(f"The arm does not move: {self._arm.why_off}. Turn its switch on.")
            return
        self._agreement = self._measured(self._arm.read())
        if not forced and (self._agreement is None or not self._agreement.accepted):
            told = "It was not measured." if self._agreement is None else " ".join(self._agreement.sentences)
            self._tell(f"The scene does not match the twin. {told} Correct it, or start anyway.")
            return
        policy = self._policies.get(trial.policy)
        self.controls.end.clear()
        self.controls.show = self._keep
        folder = self._journal.begin(trial.code, self.person)
        self._begun_s = time.monotonic()
        self._shown = replace(self._shown, stage=Stage.RUNNING)
        self._message = ""
        made = None
        try:
            made = TrialRun(
                self._arm,
                policy,
                self.plan,
                trial,
                attempt=self._journal.state(trial.code).attempt,
                controls=self.controls,
                agreement=None if self._agreement is None else self._agreement.score,
                overridden=forced and not (self._agreement is not None and self._agreement.accepted),
            )
            header = made.run(folder)
        except StorageError:
            raise
        except BetterError as problem:
            self._journal.abort(trial.code, str(problem))
            self._show(trial, Stage.SETUP)
            self._tell(f"{trial.code} does not count and will be repeated: {problem}")
            return
        finally:
            if made is not None and made.left_busy:
                self._policies.discard(trial.policy)
        self._journal.end(trial.code, header.ending or "time_limit")
        self.counted += 1
        self._shown = replace(self._shown, stage=Stage.ENTER)
        self._tell(f"{trial.code} has ended. Enter the outcome.")

    def _keep(self, reading: Reading) -> None:
        self.reading = reading

    def _enter(self, outcome: str, note: str) -> None:
        trial = self._shown.trial
        if trial is None:
            return
        attempt = self._journal.state(trial.code).attempt
        enter(self.folder, trial.code, attempt, author=self.person, role="operator", outcome=outcome, note=note)
        if not outcome_named(outcome).scored:
            self._journal.repeat(trial.code, note.strip() or _NOT_VALID, self.person)
            self._tell(f"{trial.code} is not valid and will be repeated.")
        else:
            self._entered.append(trial.code)
            self._tell(f"{trial.code}: {outcome_named(outcome).title}.")
        self.begin()

    def _undo(self) -> None:
        """Undo the last entry of this session, and go back to the trial so that the outcome can be entered again."""
        if not self._entered:
            self._tell("This session has no entry to undo.")
            return
        code = self._entered.pop()
        attempt = self._journal.state(code).attempt
        enter(self.folder, code, attempt, author=self.person, role="operator", outcome=None)
        self._tell(f"The entry on {code} was undone.")
        self.begin()

    def _again(self, note: str) -> None:
        """Discard the last trial, so that it will be repeated."""
        if self._shown.trial is not None:
            code = self._shown.trial.code
            self._journal.repeat(code, note, self.person)
            self._tell(f"{code} will be repeated.")
            self.begin()
