"""Teleoperated episode. It turns operator commands into states, independently of clock, browser and devices.

Commands use the same action space as any policy, so the record is an ordinary one. The session stores the complete
state at the start and whenever a subgoal has been reached. Undo returns to the last of these moments and drops
everything after it, as if the undone steps had never happened.
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
"""Distance from its target within which the commanded pose counts as arrived [m, rad]."""
RESTING_M_S = 0.01
"""Speed below which an object counts as at rest while the session waits for the operator [m/s]."""
FINGERS_STILL_M = 0.0005
"""Change in opening width per control step below which the fingers count as still [m]."""
STUCK_M = 0.035
"""Distance between the tool and its goal at which the arm is considered stuck [m]; the controller allows 0.05."""
STUCK_STEPS = 10
"""Number of control steps at this distance after which the arm is considered stuck: 0.5 s."""
SAME_MOMENT_STEPS = 20
"""Number of control steps within which reaching the same subgoals again creates no new undo moment: 1 s."""

SessionPhase = Literal["going", "success", "step_limit"]


@dataclass(frozen=True, slots=True)
class Command:
    """Command of the operator at one control step.

    Attributes:
        target: Target pose of the tool center point, in the base frame; None to keep the current one.
        closed: Whether the gripper should be closed.
        speed: Fraction of the expert's full speed.
    """

    target: Pose | None
    closed: bool
    speed: float = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class _Moment:
    """Moment to which an undo can return, with the number of rows and the complete state of scene and steering."""

    rows: int
    done: tuple[bool, ...]
    name: str
    scene: SceneSnapshot
    steering: Steering
    stuck_for: int


@dataclass(frozen=True, slots=True, eq=False)
class _Row:
    """One row of the future record."""

    state: WorldState
    truth: Truth
    simulator: dict[str, np.ndarray]
    action: np.ndarray | None
    applied: np.ndarray | None


class TeleopSession:
    """One episode in one scene, driven by an operator."""

    def __init__(self, scene: Scene) -> None:
        """Set the scene to the start of its trial; raise PremiseError if it contradicts the instruction's premise.

        The scene should be new: earlier episodes in it can change the last bits of its contact forces.
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
        """The current state."""
        return self._rows[-1].state

    @property
    def truth(self) -> Truth:
        """Ground truth of the present state."""
        return self._rows[-1].truth

    @property
    def steps(self) -> int:
        """Number of control steps, without undone steps."""
        return len(self._rows) - 1

    @property
    def phase(self) -> SessionPhase:
        """Current phase of the episode, which ends on success or at the step limit."""
        if self.truth.success:
            return "success"
        return "step_limit" if self.steps >= self.limit else "going"

    @property
    def undo_to(self) -> str:
        """Name of the moment to which an undo would return ("the start", "place_mug")."""
        return self._last_moment().name

    def is_waiting(self, target: Pose | None) -> bool:
        """Whether a step would leave the state unchanged, because the arm is at its goal and the scene is at rest."""
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
        """Take one control step and return the state after it; nothing happens once the episode has ended.

        Raises InvalidInputError if a number of the command is not finite; the session is then unchanged.
        """
        if (command.target is not None and not is_finite(command.target)) or not np.isfinite(command.speed):
            raise InvalidInputError(
                "command", "its pose is not finite, so the arm does not move", "Send finite numbers"
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
        """Return to the last moment at which a subgoal was reached, or to the initial state. Return the moment's name.

        If nothing has happened since this moment, return to the moment before.
        """
        moment = self._last_moment()
        self._moments = self._moments[: self._moments.index(moment) + 1]
        self._come_back(moment)
        return moment.name

    def restart(self) -> None:
        """Return to the initial state."""
        self._moments = self._moments[:1]
        self._come_back(self._moments[0])

    def record(self, name: str) -> Record:
        """Return the episode record so far, demonstrated by ``name``; raise InvalidInputError for an invalid name.

        Its segments are not set yet.
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
        """Return the record with its segments, and whether it meets all conditions for a demonstration set.

        For this check, the scene is simulated a little further without recording, and then reset to its state. Raises
        the errors of :meth:`record`.
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
        """Return the speed of the moving tool (90th percentile) as a fraction of the expert's free speed."""
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
        """Return the last moment after which something has happened, or the moment of the initial state."""
        return next((m for m in reversed(self._moments) if m.rows < len(self._rows)), self._moments[0])

    def _come_back(self, moment: _Moment) -> None:
        self.scene.restore(moment.scene)
        self._steering, self._stuck_for, self.notice = moment.steering, moment.stuck_for, ""
        del self._rows[moment.rows :]
        self._tracker = self._new_tracker()
        for row in self._rows:
            self._tracker.update(row.state)
