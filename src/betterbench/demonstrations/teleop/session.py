"""Session in which an operator teleoperates one episode.

A session turns the operator's commands into states of the scene. A session does not depend on the clock, the browser or
the input devices.

Commands are in the same action space as the actions of policies, so the record has the same format as the record of any
other episode. The session stores the complete state at the start and whenever a subgoal has been reached. Undo returns
to the last of these moments and removes all later steps from the record.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from betterbench.demonstrations.making.attempt import TELEOPERATED, AttemptNote, DemonstrationAttempt, judge_attempt
from betterbench.demonstrations.teleop.steering import Reach, Steering, is_finite, unit
from betterbench.episodes import TrialContext, describe
from betterbench.errors import InvalidInputError
from betterbench.geometry import Pose, angle_between, distance
from betterbench.interface.state import WorldState
from betterbench.policies.experts.motion import CLOSE, FREE, OPEN
from betterbench.records import Demonstrator, Record, RecordBuilder, Termination
from betterbench.sim.scenes import Scene, SceneSnapshot
from betterbench.tasks import GoalTracker, Truth
from betterbench.tasks.relations import arm_still

ARRIVED_M, ARRIVED_RAD = 0.002, 0.02
"""Maximum distance [m] and angle [rad] between the commanded pose and a target that counts as reached."""
RESTING_M_S = 0.01
"""Maximum speed at which an object counts as at rest while the session waits for the operator [m/s]."""
FINGERS_STILL_M = 0.0005
"""Maximum change of the opening width per control step at which the fingers count as still [m]."""
STUCK_M = 0.035
"""Minimum distance between the tool and its goal at which the arm may be stuck [m].

The controller allows a distance of up to 0.05.
"""
STUCK_STEPS = 10
"""Number of control steps at this distance or more after which the arm counts as stuck (0.5 s)."""
SAME_MOMENT_STEPS = 20
"""Number of control steps within which no new undo moment is stored if the same subgoals are reached again (1 s)."""

SessionPhase = Literal["going", "success", "step_limit"]


@dataclass(frozen=True, slots=True)
class Command:
    """Command of the operator in one control step.

    Attributes:
        target: Target pose of the tool center point in the base frame; None to keep the current target.
        closed: Whether the gripper should be closed.
        speed: Fraction of the expert's full speed.
    """

    target: Pose | None
    closed: bool
    speed: float = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class _Moment:
    """Moment to which an undo can return: number of rows in the record, and complete state of scene and steering."""

    rows: int
    done: tuple[bool, ...]
    name: str
    scene: SceneSnapshot
    steering: Steering
    stuck_for: int


@dataclass(frozen=True, slots=True, eq=False)
class _Row:
    """Row of the record."""

    state: WorldState
    truth: Truth
    simulator: dict[str, np.ndarray]
    action: np.ndarray | None
    applied: np.ndarray | None


class TeleopSession:
    """One episode in one scene, controlled by an operator."""

    def __init__(self, scene: Scene) -> None:
        """Reset the scene to the initial state of its trial.

        The scene should be new, because earlier episodes in the scene can change the last bits of its contact forces.
        Raises PremiseError if the initial state contradicts the premise of the instruction.
        """
        self.scene = scene
        self.reach = Reach.of(scene.compiled.robot)
        self.limit = scene.task.step_limit(scene.condition)
        self.subgoals = tuple(g.name for g in scene.condition.instruction.subgoals)
        self._period_s = 1.0 / scene.control_rate_hz
        self._rows: list[_Row] = []
        self._steering = Steering()
        self._stuck_for = 0
        self.notice = ""
        """Reason why the tool cannot follow the operator, in one line; "" if there is none."""
        state = scene.reset()
        self._tracker = self._new_tracker()
        self._take(state, None, None)
        self._moments = [self._moment("the start")]

    @property
    def state(self) -> WorldState:
        """The current state of the scene."""
        return self._rows[-1].state

    @property
    def truth(self) -> Truth:
        """Ground truth about the goal in the current state."""
        return self._rows[-1].truth

    @property
    def steps(self) -> int:
        """Number of control steps so far, without undone steps."""
        return len(self._rows) - 1

    @property
    def phase(self) -> SessionPhase:
        """Phase of the episode, which ends on success or at the step limit."""
        if self.truth.success:
            return "success"
        return "step_limit" if self.steps >= self.limit else "going"

    @property
    def undo_to(self) -> str:
        """Name of the moment to which an undo would return, such as "the start" or "place_mug"."""
        return self._last_moment().name

    def is_waiting(self, target: Pose | None) -> bool:
        """Whether a step would leave the state unchanged. The arm is then at its goal, and all objects are at rest."""
        state, truth = self.state, self.truth
        fingers = [row.state.finger_width_m for row in self._rows[-2:]]
        if max(fingers) - min(fingers) > FINGERS_STILL_M or truth.goal or not arm_still(state):
            return False
        if max(state.linear_speeds, default=0.0) > RESTING_M_S:
            return False
        there = state.commanded_pose
        wanted = there if target is None else self.reach.within(target)[0]
        return (
            distance(there.position, wanted.position) < ARRIVED_M
            and angle_between(there.quaternion, wanted.quaternion) < ARRIVED_RAD
        )

    def step(self, command: Command) -> WorldState:
        """Take one control step, and return the state after it.

        If the episode has already ended, the state does not change.

        Raises InvalidInputError if a number in the command is not finite. The session is then unchanged.
        """
        if (command.target is not None and not is_finite(command.target)) or not np.isfinite(command.speed):
            raise InvalidInputError(
                "command", "it contains a number that is not finite, so the arm does not move", "Send finite numbers"
            )
        if self.phase != "going":
            return self.state
        now = self.state.commanded_pose
        wanted, self.notice = (now, "") if command.target is None else self.reach.within(unit(command.target))
        gripper = CLOSE if command.closed else OPEN
        self._steering, action = self._steering.toward(
            now, wanted, gripper, share=command.speed, period_s=self._period_s
        )
        applied = self.scene.step(action)
        state = self.scene.state()
        self._take(state, action, applied)
        self._see_if_stuck(state)
        before = self._rows[-2].truth.subgoals
        gained = [i for i, (a, b) in enumerate(zip(before, self.truth.subgoals, strict=True)) if b and not a]
        if gained and not self._is_known_moment():
            self._moments.append(self._moment(self.subgoals[gained[-1]]))
        return state

    def undo(self) -> str:
        """Return to the last moment at which a subgoal was reached, or to the initial state.

        If no step was taken since this moment, return to the moment before it. The returned value is the name of the
        moment.
        """
        moment = self._last_moment()
        self._moments = self._moments[: self._moments.index(moment) + 1]
        self._come_back(moment)
        return moment.name

    def restart(self) -> None:
        """Return to the initial state of the episode."""
        self._moments = self._moments[:1]
        self._come_back(self._moments[0])

    def record(self, name: str) -> Record:
        """Return the record of the episode so far. Its subgoal segments are not set yet.

        Args:
            name: Name of the demonstrator.

        Raises:
            InvalidInputError: If the name is invalid.
        """
        demonstrator = Demonstrator("teleoperated", name, {"speed": self._speed()})
        context = TrialContext(TELEOPERATED, demonstrator=demonstrator)
        builder = RecordBuilder(describe(self.scene, self._new_tracker(), context))
        for row in self._rows:
            builder.append(
                row.state,
                **row.simulator,
                action=row.action,
                applied=row.applied,
                predicates=row.truth.relations,
                subgoals=row.truth.subgoals,
                goal=row.truth.goal,
                forbidden=row.truth.forbidden,
            )
        ends: dict[SessionPhase, tuple[Termination, str | None]] = {
            "success": ("success", None),
            "step_limit": ("step_limit", None),
            "going": ("interrupted", "the operator stopped"),
        }
        termination, error = ends[self.phase]
        clipped = self.scene.action_space.count_clipped(builder.actions)
        success = termination == "success"
        return builder.finish(termination=termination, success=success, error=error, clipped_actions=clipped)

    def finished(self, name: str) -> DemonstrationAttempt:
        """Return the record with its subgoal segments, and decide whether it can be used as a demonstration.

        For this check, the simulation continues for a few steps that are not recorded, and the scene is then restored.
        Raises the same errors as :meth:`record`.
        """
        record = self.record(name)
        if self.phase != "success":
            note = AttemptNote(0, "time", "the subgoals are not done", record.n_steps)
            return DemonstrationAttempt(note, record)
        here = self.scene.snapshot()
        try:
            return judge_attempt(self.scene, record, record.states(), 0, None)
        finally:
            self.scene.restore(here)

    def _speed(self) -> float:
        """Return the 90th percentile of the moving tool's speed, as a fraction of the expert's speed in free motion."""
        at = np.array([row.state.ee_pose.position for row in self._rows])
        speeds = np.linalg.norm(np.diff(at, axis=0), axis=1) / self._period_s
        moving = speeds[speeds > RESTING_M_S]
        return round(float(np.quantile(moving, 0.9)) / FREE.speed, 3) if len(moving) else 0.0

    def _new_tracker(self) -> GoalTracker:
        scene = self.scene
        return GoalTracker(
            scene.condition, scene.info, template=scene.task.template, control_rate_hz=scene.control_rate_hz
        )

    def _take(self, state: WorldState, action: np.ndarray | None, applied: np.ndarray | None) -> None:
        simulator = {name: values.copy() for name, values in self.scene.simulator_state().items()}
        self._rows.append(_Row(state, self._tracker.update(state), simulator, action, applied))

    def _see_if_stuck(self, state: WorldState) -> None:
        off = distance(state.commanded_pose.position, state.ee_pose.position)
        self._stuck_for = self._stuck_for + 1 if off > STUCK_M else 0
        if self._stuck_for >= STUCK_STEPS and not self.notice:
            self.notice = f"stuck: the arm is blocked, {100.0 * off:.0f} cm from its goal"

    def _is_known_moment(self) -> bool:
        last = self._moments[-1]
        return last.done == self.truth.subgoals and self.steps - (last.rows - 1) < SAME_MOMENT_STEPS

    def _moment(self, name: str) -> _Moment:
        done = self.truth.subgoals
        return _Moment(len(self._rows), done, name, self.scene.snapshot(), self._steering, self._stuck_for)

    def _last_moment(self) -> _Moment:
        """Return the last stored moment after which at least one step was taken, or the moment of the initial state."""
        return next((m for m in reversed(self._moments) if m.rows < len(self._rows)), self._moments[0])

    def _come_back(self, moment: _Moment) -> None:
        self.scene.restore(moment.scene)
        self._steering, self._stuck_for, self.notice = moment.steering, moment.stuck_for, ""
        del self._rows[moment.rows :]
        self._tracker = self._new_tracker()
        for row in self._rows:
            self._tracker.update(row.state)
