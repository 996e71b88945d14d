"""Replay proof: a policy gets the observations of a demonstration, and its actions are compared with the demonstration.

For each axis, the path that the policy's actions command is compared with the path of the demonstration. If the actions
are interpreted with wrong units, in a wrong frame or with a wrong sign, the commanded path is scaled, rotated or
mirrored. This shows in the ratio of the two paths along each axis. The actions are also executed in a separate scene,
to measure the distance between the final positions of the end effector in this scene and in the demonstration.

The paths consist of commanded poses, which the arm follows with a delay of a few control steps.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from betterbench.episodes import POLICY_BOUNDARY, Observer
from betterbench.episodes.chunks import checked_chunk
from betterbench.geometry import Quaternion, normalize, to_axis_angle, turn_between
from betterbench.interface import EpisodeStart, Observation, ObservationSpec, Policy, PolicyInfo, episode_number
from betterbench.interface.actions import EE_DELTA_MEASURED, OPENING_SPACES, USUAL_ROBOT, ActionSpace, action_space
from betterbench.interface.state import WorldState
from betterbench.policies.experts import make_expert
from betterbench.sim.robots import robot_space
from betterbench.sim.robots.control import ControllerState
from betterbench.sim.scenes import Scene
from betterbench.sim.scenes.stage import Quality
from betterbench.tasks import TrialId
from betterbench.tasks.interventions import resolve_condition

MAX_REQUESTS = 100
"""Maximum number of requests in a replay proof.

With five actions per reply, it covers a whole demonstration. With one action per reply, it covers the path to the first
object.
"""

LEAST_RANGE = {"m": 0.02, "rad": 0.05}
"""Minimum extent of a demonstration along an axis for the ratio of the two paths to be computed [m, rad]."""

FOLLOWS = 0.7
"""Minimum agreement (:attr:`AxisProof.agreement`) on each axis for a policy to count as following the demonstration."""

PROVEN = 0.02
"""Maximum deviation of the ratio of the paths from 1 for the conventions of an axis to count as proven."""

WRONG = 1.5
"""Ratio of the two paths above which the conventions of an axis count as wrong.

The conventions also count as wrong if the ratio is below the inverse of this value.
"""

_IDLE_STEPS = 40


@dataclass(frozen=True, slots=True)
class AxisProof:
    """Comparison of a policy with the demonstration along one axis.

    Attributes:
        name: Position axis "x", "y" or "z" or rotation axis "rx", "ry" or "rz" in the base frame, or name of a joint.
        unit: Unit of the axis, "m" or "rad".
        range: Extent of the demonstration's path along the axis [unit].
        factor: Slope of a line fitted to the policy's path as a function of the demonstration's path. It is 1 if the
            paths are equal, and None if the demonstration hardly moves.
        agreement: Cosine similarity between the steps of the two paths, from -1 to 1. None if one of the paths does not
            move.
        apart: Largest distance between the two paths along the axis [unit].
    """

    name: str
    unit: str
    range: float
    factor: float | None
    agreement: float | None
    apart: float


@dataclass(frozen=True, slots=True)
class ReplayProof:
    """Result of a replay proof, in which a policy gets the observations of a demonstration.

    Attributes:
        steps: Number of control steps of the demonstration that were replayed.
        requests: Number of requests sent to the policy.
        axes: Comparison of the policy with the demonstration along each axis.
        gripper: Fraction of the steps in which the policy and the demonstration gave the same gripper command.
        executed_off_m: Distance between the end effector's final positions after the policy's actions and in the
            demonstration [m].
    """

    steps: int
    requests: int
    axes: tuple[AxisProof, ...]
    gripper: float
    executed_off_m: float

    @property
    def moved(self) -> tuple[AxisProof, ...]:
        """Axes along which the demonstration moves."""
        return tuple(axis for axis in self.axes if axis.factor is not None)

    @property
    def follows(self) -> bool:
        """Whether the policy follows the demonstration along each axis, apart from the sign and the scale."""
        return bool(self.moved) and all(abs(axis.agreement or 0.0) >= FOLLOWS for axis in self.moved)

    @property
    def is_proven(self) -> bool:
        """Whether the policy agrees with the demonstration on every axis and in the gripper commands."""
        factors = [axis.factor for axis in self.moved if axis.factor is not None]
        return self.follows and all(abs(f - 1.0) <= PROVEN for f in factors) and self.gripper >= 1.0 - PROVEN

    @property
    def wrong(self) -> tuple[str, ...]:
        """Names of the axes (and "gripper") on which the policy's conventions differ from the demonstration's."""
        if not self.follows:
            return ()
        names = [axis.name for axis in self.moved if not 1.0 / WRONG < (axis.factor or 0.0) < WRONG]
        return (*names, *(["gripper"] if self.gripper < 1.0 - FOLLOWS else []))

    @property
    def verdict(self) -> str:
        """Sentence that states the result, with a suggestion if conventions are wrong."""
        if not self.follows:
            return "inconclusive: the policy does not follow the demonstration"
        if self.is_proven:
            return "the conventions are proven: the policy's actions follow the demonstration"
        if not self.wrong:
            return "the policy's actions roughly follow the demonstration"
        return f"the conventions of {', '.join(self.wrong)} are wrong. {self._cure()}"

    def _cure(self) -> str:
        told = {axis.name: axis.factor for axis in self.moved if axis.factor is not None}
        lengths = [f for name, f in told.items() if name in ("x", "y", "z")]
        if len(lengths) > 1 and max(lengths) - min(lengths) < 0.2 * abs(float(np.mean(lengths))):
            mean = float(np.mean(lengths))
            for factor, cure in _KNOWN:
                if abs(mean / factor - 1.0) < 0.15:
                    return cure
        if self.wrong == ("gripper",):
            return "Its polarity is reversed: set gripper=open_positive, or the convention of the policy."
        return "Choose another preset, or correct action_space, units, frame, rotation or gripper."

    def to_json(self) -> dict[str, Any]:
        """Return the result as a JSON-serializable dict."""
        return {
            **asdict(self),
            "follows": self.follows,
            "proven": self.is_proven,
            "wrong": list(self.wrong),
            "verdict": self.verdict,
        }


_KNOWN = (
    (4.0, "A checkpoint trained on LIBERO moves 0.0125 m per unit: set units=libero_measured, or its suite's preset."),
    (0.25, "The policy moves 0.05 m per unit, as betterbench's demonstrations do: set units=libero."),
    (20.0, "The policy's unit is 0.05 m instead of 1 m: set units=libero."),
    (80.0, "The policy's unit is 0.0125 m instead of 1 m: set units=libero_measured."),
    (0.05, "The policy answers in meters: set units=physical."),
    (0.0125, "The policy answers in meters: set units=physical."),
)
"""Ratios of the two paths' translations that have a known cause, each with a remedy."""


def prove_by_replay(
    client: Policy,
    info: PolicyInfo,
    trial: TrialId,
    *,
    space: ActionSpace,
    spec: ObservationSpec,
    quality: Quality,
    robot: str = USUAL_ROBOT,
) -> ReplayProof:
    """Send a policy the observations of an expert's demonstration, and compare the policy's path with the expert's.

    Args:
        client: Policy for which an episode has just begun.
        info: Description of the policy.
        trial: Trial that the expert demonstrates.
        space: Action space of the policy.
        spec: Specification of the images that the policy gets.
        quality: Rendering quality of the images.
        robot: Name of the robot.

    Raises:
        BetterError: If the policy fails or gives an invalid answer.
    """
    found = resolve_condition(trial.task, trial.condition)
    scenes = [
        Scene(found.task, found.condition, seed=trial.seed, action_space=driven, quality=quality, robot_name=robot)
        for driven in (action_space(robot_space(robot)), space)
    ]
    demonstration, executed = _Demonstration(scenes[0]), scenes[1]
    paths, observer = _PATHS.get(space.name, _JointPaths)(space), Observer(spec)
    same: list[bool] = []
    requests = 0
    try:
        with POLICY_BOUNDARY:
            instruction = found.condition.instruction.text
            client.reset(EpisodeStart(instruction, episode_number(trial.seed), space.name))
        while requests < MAX_REQUESTS and not demonstration.is_over():
            seen = observer.observe(demonstration.scene, demonstration.state)
            answer = _ask(client, seen, space)[: info.execution.horizon]
            requests += 1
            for action in answer:
                if demonstration.is_over():
                    break
                before = demonstration.moment()
                told = demonstration.step()
                paths.add(action, before, demonstration.moment())
                executed.step(action)
                if told != 0.0:
                    opens = space.name in OPENING_SPACES
                    answered = executed.state().gripper_command if opens else np.sign(action[-1])
                    same.append(bool(answered == np.sign(told)))
            paths.mark()
    finally:
        observer.close()
    ends = [np.array(s.ee_pose.position) for s in (executed.state(), demonstration.state)]
    return ReplayProof(
        steps=demonstration.state.step,
        requests=requests,
        axes=paths.compare(),
        gripper=float(np.mean(same)) if same else 1.0,
        executed_off_m=float(np.linalg.norm(ends[0] - ends[1])),
    )


def _ask(client: Policy, seen: Observation, space: ActionSpace) -> np.ndarray:
    """Return a policy's answer (horizon, dim). Raises InvalidActionError or PolicyError if it is invalid."""
    with POLICY_BOUNDARY:
        answer = np.asarray(client.act(seen))
    chunk = checked_chunk(answer, space)
    for action in chunk:
        space.clip(action)
    return chunk


@dataclass(frozen=True, slots=True)
class _Moment:
    """Commanded state and measured state of the robot at a control step."""

    commanded: ControllerState
    state: WorldState


class _Demonstration:
    """Demonstration by the expert, which is executed step by step until the arm is at rest."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.state = scene.reset()
        self._expert = make_expert("expert", scene)
        self._limit = scene.task.step_limit(scene.condition)
        self._idle = 0
        self._last = np.zeros(scene.action_space.dim)  # at first, absolute actions differ from these zeros

    def is_over(self) -> bool:
        """Return whether the expert has come to rest or the trial has ended."""
        return self._idle >= _IDLE_STEPS or self.state.step >= self._limit

    def moment(self) -> _Moment:
        """Return the commanded and the measured state at the current step."""
        return _Moment(self.scene.controller.state(), self.state)

    def step(self) -> float:
        """Execute the expert's next action. Return the gripper command."""
        space = self.scene.action_space
        action = self.scene.step(np.asarray(self._expert.act_on_state(self.state)))
        self.state = self.scene.state()
        self._idle = 0 if np.abs(action[:-1] - self._last[:-1]).max() > 1e-3 else self._idle + 1
        if not space.is_delta:
            self._last = action
        return self.state.gripper_command if space.name in OPENING_SPACES else float(action[-1])


class _Paths:
    """Paths of the demonstration and of the policy. A point of each path is stored at the end of each action chunk."""

    units: tuple[str, ...] = ("m", "m", "m", "rad", "rad", "rad")
    names: tuple[str, ...] = ("x", "y", "z", "rx", "ry", "rz")

    def __init__(self, space: ActionSpace) -> None:
        self._space = space
        self._scale = np.array(space.scale[:-1])
        self._now = np.zeros((2, len(self.names)))
        self._marked = [self._now.copy()]

    def add(self, action: np.ndarray, before: _Moment, after: _Moment) -> None:
        """Add a control step to both paths.

        The step consists of the policy's action and the demonstration's states before and after it.
        """
        raise NotImplementedError

    def mark(self) -> None:
        """Store the current points of the two paths."""
        self._marked.append(self._now.copy())

    def compare(self) -> tuple[AxisProof, ...]:
        """Compare the two paths along each axis."""
        demonstrated, answered = np.array(self._marked).transpose(1, 2, 0)
        return tuple(
            _compare(name, unit, d, a)
            for name, unit, d, a in zip(self.names, self.units, demonstrated, answered, strict=True)
        )


class _DeltaPaths(_Paths):
    """Paths for delta actions, as the sum of the end effector's steps."""

    def add(self, action: np.ndarray, before: _Moment, after: _Moment) -> None:
        measured = self._space.name == EE_DELTA_MEASURED.name
        start = before.state.ee_pose if measured else before.commanded.pose
        end = after.commanded.pose
        moved = np.array(end.position) - np.array(start.position)
        self._now[0] += [*moved, *_turn(start.quaternion, end.quaternion)]
        self._now[1] += action[:-1] * self._scale


class _PosePaths(_Paths):
    """Paths for absolute poses of the end effector, relative to the first pose of the demonstration."""

    def add(self, action: np.ndarray, before: _Moment, after: _Moment) -> None:
        start, end = before.commanded.pose, after.commanded.pose
        moved = np.array(end.position) - np.array(start.position)
        self._now[0] += [*moved, *_turn(start.quaternion, end.quaternion)]
        beyond = action[:3] - np.array(end.position)
        turned = _turn(end.quaternion, normalize(action[3:7].tolist()))
        self._now[1] = self._now[0] + [*beyond, *turned]


class _JointPaths(_Paths):
    """Paths for joint actions, as joint angles relative to the first angles of the demonstration."""

    def __init__(self, space: ActionSpace) -> None:
        self.names, self.units = space.components[:-1], space.units[:-1]
        super().__init__(space)

    def add(self, action: np.ndarray, before: _Moment, after: _Moment) -> None:
        end = np.array(after.commanded.joints)
        self._now[0] += end - np.array(before.commanded.joints)
        if self._space.is_delta:
            self._now[1] += action[:-1] * self._scale
        else:
            self._now[1] = self._now[0] + (action[:-1] * self._scale - end)


_PATHS: dict[str, type[_Paths]] = {"ee_delta": _DeltaPaths, "ee_delta_measured": _DeltaPaths, "ee_pose": _PosePaths}


def _turn(start: Quaternion, end: Quaternion) -> np.ndarray:
    """Return the rotation vector (3,) [rad], in the base frame, of the rotation from ``start`` to ``end``."""
    return np.array(to_axis_angle(turn_between(start, end)))


def _compare(name: str, unit: str, demonstrated: np.ndarray, answered: np.ndarray) -> AxisProof:
    """Compare two paths along one axis. Each path is an (n,) array."""
    spread = float(np.ptp(demonstrated))
    steps, answers = np.diff(demonstrated), np.diff(answered)
    lengths = float(np.linalg.norm(steps) * np.linalg.norm(answers))
    centered = demonstrated - demonstrated.mean()
    moves = spread >= LEAST_RANGE[unit]
    return AxisProof(
        name=name,
        unit=unit,
        range=spread,
        factor=float(centered @ (answered - answered.mean()) / (centered @ centered)) if moves else None,
        agreement=float(steps @ answers / lengths) if lengths > 0.0 else None,
        apart=float(np.abs(answered - demonstrated).max()),
    )
