"""Planner of collision-free grasps, paths and placements for the privileged policies."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from betterbench.errors import PlanningError
from betterbench.geometry import (
    Pose,
    Quaternion,
    angle_between,
    distance,
    from_axis_angle,
    from_yaw,
    multiply,
    normalize,
    rotate,
    straight_way,
)
from betterbench.interface.state import WorldState
from betterbench.sim.assets import Asset, Grasp
from betterbench.sim.robots.ik import IKResult, largest_step
from betterbench.sim.robots.spec import Workspace
from betterbench.sim.scenes import Clearance, Scene
from betterbench.tasks.relations import PlaceGoal
from betterbench.tasks.relations.inside import inside

DOWN: Quaternion = (0.0, 1.0, 0.0, 0.0)
"""Tool rotation in which the tool points straight down and the fingers open along -y."""
CHECK_POSITION_M, CHECK_ROTATION_RAD = 1e-3, 1e-2
"""Position error [m] and rotation error [rad] of the inverse kinematics that are tolerated in collision checks.

The clearances used in the checks are larger.
"""
MAX_JOINT_STEP_RAD = 0.6
"""Largest joint motion between two checked configurations [rad].

A larger motion means that the arm would have to change its posture, for example flip its elbow.
"""
COMFORT_RAD = 0.3
"""Preferred distance between a joint and its limits [rad]. A wrist at its limit cannot rotate further."""
RISES_M = (0.0, 0.002, 0.004)
"""Heights above the goal pose at which an object may be released [m], tried from the lowest.

Heights above zero are needed for an arm that tilts its tool, because an edge of a tilted object extends below the goal.
"""
SLIDE_WIDTH_M = 0.05
"""Gripper opening around the knob of a drawer, used in the collision check of the motion along the rails [m]."""
OUT_OF_REACH = "out of reach"
"""Reason for rejecting a pose that the arm cannot reach, or a path on which the arm would have to change its posture.
"""


@dataclass(frozen=True, slots=True)
class PickPlan:
    """Collision-free path to pick up an object.

    Attributes:
        object: Name of the object.
        way: Poses of the tool center point on the path. The last pose is above the grasp.
        grasp: Pose ``T_world_tcp`` at the end of the straight approach.
        close: Pose at which the gripper closes. For a gripper with a fixed finger, it is the pose beside ``grasp`` at
            which this finger touches the object. For all other grippers, it is equal to ``grasp``.
        width_m: Opening width during the approach [m].
    """

    object: str
    way: tuple[Pose, ...]
    grasp: Pose
    close: Pose
    width_m: float


@dataclass(frozen=True, slots=True)
class PlacePlan:
    """Collision-free path to put down the held object.

    Attributes:
        way: Poses of the tool center point on the path.
        release: Pose ``T_world_tcp`` at which the gripper opens.
        retreat: Pose to which the gripper moves after the release.
        release_width_m: Opening width at the release [m].
    """

    way: tuple[Pose, ...]
    release: Pose
    retreat: Pose
    release_width_m: float


@dataclass(frozen=True, slots=True)
class SlidePlan:
    """Collision-free path to grasp a drawer by its knob and move it along its rails.

    Attributes:
        pick: Path to the knob.
        end: Pose ``T_world_tcp`` at the end of the motion, with the knob in the gripper.
    """

    pick: PickPlan
    end: Pose


_Plan = TypeVar("_Plan", PickPlan, PlacePlan)


class Planner:
    """Planner of grasps and collision-free paths for one scene."""

    def __init__(self, scene: Scene) -> None:
        """Store the scene. Collisions are checked in a private copy of it."""
        self._scene = scene
        self._clearance = Clearance(scene)
        self._ik = scene.controller.ik
        self._reached: dict[tuple[bytes, Pose], IKResult] = {}
        self._robot = scene.compiled.robot
        self._opening = self._robot.gripper_opening_m
        self._assets: dict[str, Asset] = {p.spec.name: p.asset for p in scene.placements}

    def _apart_first(self, plan: Callable[[], _Plan]) -> _Plan:
        """Make a plan in which certain parts of the folded arm do not touch each other.

        If there is no such plan, allow these parts to touch. Their contact can stop the arm while it lifts an object,
        but often does not.
        """
        self._reached.clear()
        if self._robot.kept_apart:
            self._clearance.keeps_apart = True
            try:
                return plan()
            except PlanningError:
                pass
            finally:
                self._clearance.keeps_apart = False
        return plan()

    @property
    def reach_m(self) -> float:
        """Reach of the robot [m]."""
        return self._robot.reach_m

    @property
    def workspace(self) -> Workspace:
        """Characteristic distances of the robot's motions, such as the height to which objects are lifted."""
        return self._robot.workspace

    def plan_pick(self, state: WorldState, name: str, *, cost: Callable[[Pose], float] | None = None) -> PickPlan:
        """Return the best collision-free path to pick up an object.

        Args:
            state: Current state.
            name: Name of the object.
            cost: Function that returns an additional cost of a grasp pose [rad]. Grasps of equal preference are ordered
                by the rotation of the gripper [rad] plus this cost.

        Raises:
            PlanningError: If no grasp can be reached without a collision.
        """
        return self._apart_first(lambda: self._plan_pick(state, name, cost))

    def _plan_pick(self, state: WorldState, name: str, cost: Callable[[Pose], float] | None) -> PickPlan:
        self._clearance.load(state)
        reasons: list[str] = []
        grasps = list(self._grasps(state, name, cost))
        for (grasp_pose, width), margin in ((g, m) for m in (COMFORT_RAD, 0.0) for g in grasps):
            opening = min(self._opening, width + 0.035)
            above = grasp_pose.translated(z=self._robot.workspace.lift_m)
            joints = self._reach(state.joint_positions, above, margin=margin)
            if joints is None:
                reasons.append(OUT_OF_REACH)
                continue
            down = self.check_way(joints, (above, grasp_pose), opening, ignore=frozenset({name}))[0]
            if down is not None:
                reasons.append(down)
                continue
            found = self._transit(state, above, opening)
            if found is None:
                reasons.append("no free way there")
                continue
            way, there = found
            down = self.check_way(there, (above, grasp_pose), opening, ignore=frozenset({name}))[0]
            if down is not None:
                reasons.append(down)
                continue
            shift = self._robot.jaw.closing_shift_m
            close = grasp_pose @ Pose((0.0, shift, 0.0)) if shift else grasp_pose
            return PickPlan(name, way, grasp_pose, close, opening)
        if set(reasons) == {OUT_OF_REACH}:
            x, y, z = (round(v, 2) + 0.0 for v in state.position(name))  # not -0.00
            problem = f"{name} at ({x:.2f}, {y:.2f}, {z:.2f}) m is {OUT_OF_REACH} of the {self._robot.title}"
            raise PlanningError(f"no free grasp of {name}: {problem}")
        raise PlanningError(
            f"no free grasp of {name}: {', '.join(sorted(set(reasons))) or 'it has no annotated grasp'}"
        )

    def plan_slide(self, state: WorldState, name: str, travel_m: float) -> SlidePlan:
        """Return the best collision-free path to grasp a drawer and move it along its own x axis.

        Args:
            state: Current state.
            name: Name of the drawer.
            travel_m: Distance by which the drawer is moved [m]. A positive distance opens it.

        Raises:
            PlanningError: If the knob cannot be grasped, or the path along the rails is not free.
        """
        pick = self.plan_pick(state, name)
        dx, dy, dz = rotate(state.pose(name).quaternion, (travel_m, 0.0, 0.0))
        end = pick.grasp.translated(dx, dy, dz)
        joints = self._reach(state.joint_positions, pick.grasp)
        if joints is None:
            raise PlanningError(f"the knob of {name} is out of reach")
        # Objects in the drawer move with it, so they are not obstacles.
        along = frozenset({name}) | {o.name for o in state.info.objects if not o.fixed and inside(state, o.name, name)}
        blocked, _ = self.check_way(joints, (pick.grasp, end), SLIDE_WIDTH_M, ignore=along)
        if blocked is not None:
            raise PlanningError(f"no free path along the rails of {name}: {blocked}")
        return SlidePlan(pick, end)

    def travel_m(self, name: str) -> float:
        """Return the distance between the open and the closed position of a drawer [m]."""
        return float(self._assets[name].parameters["travel_m"])

    def plan_place(self, state: WorldState, name: str, goals: Sequence[PlaceGoal]) -> PlacePlan:
        """Return the best collision-free path to put the held object at one of several poses.

        Args:
            state: Current state, with the object in the gripper.
            name: Name of the object.
            goals: Possible final poses with their approaches, in order of preference.

        Raises:
            PlanningError: If none of the poses can be reached without a collision.
        """
        return self._apart_first(lambda: self._plan_place(state, name, goals))

    def _plan_place(self, state: WorldState, name: str, goals: Sequence[PlaceGoal]) -> PlacePlan:
        self._clearance.load(state)
        T_object_tcp = state.pose(name).inverse() @ state.ee_pose
        T_tcp_object = T_object_tcp.inverse()
        reasons: list[str] = []
        guess = np.asarray(state.joint_positions)
        rises = RISES_M if self._robot.ik.rotation_slack_rad else (0.0,)
        for rise, margin, goal in itertools.product(rises, (COMFORT_RAD, 0.0), goals):
            resting = goal.pose.translated(z=rise) if rise else goal.pose
            release = resting @ T_object_tcp
            above = release.translated(*goal.approach)
            opened = self._opening if goal.release_width_m is None else goal.release_width_m
            down = self._reach(guess, release, margin=margin)
            if down is None:
                reasons.append(OUT_OF_REACH)
                continue
            guess = down
            hits = self._clearance.touches(
                down, finger_width_m=state.finger_width_m, held=name, held_pose=resting
            ) or self._clearance.touches(
                down, finger_width_m=opened, held=name, held_pose=resting, ignore=frozenset({name})
            )
            if hits:
                reasons.append(", ".join(hits))
                continue
            joints = self._reach(down, above, margin=margin)
            if joints is None:
                reasons.append(OUT_OF_REACH)
                continue
            blocked, _ = self.check_way(
                joints, (above, release), state.finger_width_m, held=name, T_tcp_object=T_tcp_object
            )
            if blocked is not None:
                reasons.append(blocked)
                continue
            found = self._transit(state, above, state.finger_width_m, held=name, T_tcp_object=T_tcp_object)
            if found is None:
                reasons.append("no free way there")
                continue
            way, there = found
            blocked, _ = self.check_way(
                there, (above, release), state.finger_width_m, held=name, T_tcp_object=T_tcp_object
            )
            if blocked is not None:
                reasons.append(blocked)
                continue
            return PlacePlan(way, release, release.translated(z=self._robot.workspace.retreat_m), opened)
        raise PlanningError(f"no free placement for {name}: {', '.join(sorted(set(reasons))) or 'no goal given'}")

    def transit(self, state: WorldState, goal: Pose) -> tuple[Pose, ...] | None:
        """Return a collision-free path to a pose for the empty, open gripper. Return None if no path is found."""
        self._clearance.load(state)
        found = self._transit(state, goal, self._opening)
        return None if found is None else found[0]

    def way_to(
        self,
        state: WorldState,
        goal: Pose,
        width_m: float,
        *,
        held: str | None = None,
        T_tcp_object: Pose | None = None,
    ) -> tuple[tuple[Pose, ...], list[float]] | None:
        """Return a collision-free path to a pose, and the joint angles at its end [rad]. Return None if none is found.

        The path leads up, then across, then down to the pose.

        Args:
            state: Current state.
            goal: Pose ``T_world_tcp`` to reach.
            width_m: Opening width of the gripper on the path [m].
            held: Name of the object in the gripper, or None.
            T_tcp_object: Pose of the held object relative to the tool center point.
        """
        self._clearance.load(state)
        return self._transit(state, goal, width_m, held=held, T_tcp_object=T_tcp_object)

    def free_way(
        self,
        state: WorldState,
        way: Sequence[Pose],
        width_m: float,
        *,
        held: str | None = None,
        T_tcp_object: Pose | None = None,
    ) -> list[float] | None:
        """Check whether a path is free.

        Return the joint angles at its end [rad], or None if it collides or is out of reach.

        Args:
            state: Current state.
            way: Poses ``T_world_tcp`` on the path. The first one must be the pose that the arm is currently commanded
                to hold.
            width_m: Opening width of the gripper on the path [m].
            held: Name of the object in the gripper, or None.
            T_tcp_object: Pose of the held object relative to the tool center point.
        """
        self._clearance.load(state)
        blocked, joints = self.check_way(
            state.joint_positions, way, width_m, held=held, T_tcp_object=T_tcp_object, lenient_start=True
        )
        return joints if blocked is None else None

    def asset(self, name: str) -> Asset:
        """Return the asset of an object in the scene."""
        return self._assets[name]

    def _grasps(
        self, state: WorldState, name: str, cost: Callable[[Pose], float] | None
    ) -> Iterator[tuple[Pose, float]]:
        """Yield grasp poses in the world frame and their opening widths.

        They are ordered by preference and then by the rotation that they require.
        """
        pose = state.pose(name)
        found: list[tuple[float, Pose, float]] = []
        for grasp in self._assets[name].grasps:
            for T_world_tcp in turned_grasps(pose, grasp):
                approach = _approach(T_world_tcp)
                if approach > -0.9:
                    continue
                turn = angle_between(T_world_tcp.quaternion, state.ee_pose.quaternion)
                turn += 0.0 if cost is None else cost(T_world_tcp)
                at = self._before_closing(T_world_tcp, grasp.width_m)
                found.append((10.0 * grasp.preference + turn, at, grasp.width_m))
        if not found:
            found = [(0.0, p, w) for p, w in self._lying_grasps(state, name)]
        for _, T_world_tcp, width in sorted(found, key=lambda item: item[0]):
            yield T_world_tcp, width

    def _lying_grasps(self, state: WorldState, name: str) -> Iterator[tuple[Pose, float]]:
        """Yield grasps from above, across the narrow horizontal directions of an object that has fallen over."""
        info = state.info.object(name)
        pose = state.pose(name)
        center = pose.apply((0.0, 0.0, 0.5 * info.size_m[2]))
        for axis in range(3):
            if info.size_m[axis] > self._opening - 0.008:
                continue
            direction = tuple(1.0 if i == axis else 0.0 for i in range(3))
            x, y, z = Pose((0.0, 0.0, 0.0), pose.quaternion).apply(direction)
            if abs(z) > 0.3:
                continue
            yaw = math.atan2(y, x) - 0.5 * math.pi
            height = max(0.012, center[2] - 0.005)
            for flip in (0.0, math.pi):
                down = normalize(multiply(from_yaw(yaw + flip), DOWN))
                width = info.size_m[axis]
                yield self._before_closing(Pose((center[0], center[1], height), down), width), width

    def _before_closing(self, T_world_object: Pose, width_m: float) -> Pose:
        """Return the tool pose just before the gripper closes.

        At this pose, the center of the object is midway between the jaws.
        """
        offset = self._robot.jaw.object_offset_m(width_m)
        return T_world_object if offset == 0.0 else T_world_object @ Pose((0.0, -offset, 0.0))

    def _reach(self, start: Sequence[float] | np.ndarray, pose: Pose, *, margin: float = 0.0) -> np.ndarray | None:
        """Return joint angles with which the tool reaches a pose, or None if there are none.

        The joints keep at least ``margin`` [rad] from their limits.
        """
        joints = np.asarray(start, dtype=float)
        # Both margins and both attempts of a plan ask for the same poses. This saves 60 % of the searches of an object
        # that is out of reach.
        result = self._reached.get((joints.tobytes(), pose))
        if result is None:
            result = self._reached[joints.tobytes(), pose] = self._ik.reach(joints, pose)
        if not result.converged:
            return None
        free = min(float((result.q - self._ik.low).min()), float((self._ik.high - result.q).min()))
        return result.q if free >= margin else None

    def _tool_at(self, joints: Sequence[float], wanted: Pose) -> Pose:
        """Return the tool pose at joint angles that were computed for a desired pose.

        For an arm that cannot reach every rotation exactly, this pose differs from the desired one.
        """
        return self._ik.forward(joints) if self._robot.ik.rotation_slack_rad else wanted

    def _transit(
        self,
        state: WorldState,
        goal: Pose,
        width: float,
        *,
        held: str | None = None,
        T_tcp_object: Pose | None = None,
    ) -> tuple[tuple[Pose, ...], list[float]] | None:
        """Return a collision-free path to ``goal``, and the joint angles at its end. Return None if no path is found.

        The path leads up, then across, then down to ``goal``.
        """
        start = state.commanded_pose
        joints = state.joint_positions
        workspace = self._robot.workspace
        for detour, height in itertools.product(((), *((d,) for d in workspace.detours_m)), workspace.carry_heights_m):
            top = max(height, goal.position[2])
            if held is not None:
                top = max(top, min(start.position[2], 0.45))
            up = Pose((start.position[0], start.position[1], max(top, start.position[2])), start.quaternion)
            over = Pose((goal.position[0], goal.position[1], max(top, goal.position[2])), goal.quaternion)
            aside = [Pose((x, y, over.position[2]), goal.quaternion) for x, y in detour]
            way = (up, *aside, over, goal)
            blocked, end = self.check_way(
                joints, (start, *way), width, held=held, T_tcp_object=T_tcp_object, lenient_start=True
            )
            if blocked is None:
                return way, end
        return None

    def check_way(
        self,
        joints: Sequence[float] | np.ndarray,
        way: Sequence[Pose],
        width: float,
        *,
        held: str | None = None,
        T_tcp_object: Pose | None = None,
        ignore: frozenset[str] = frozenset(),
        lenient_start: bool = False,
    ) -> tuple[str | None, list[float]]:
        """Check a path for collisions by solving the joint angles along it.

        The objects have the poses of the state that was last loaded into the collision checker. As in the controller,
        the joint angles for each pose are solved starting from those of the previous pose. A path therefore counts as
        blocked if it reaches a joint limit or if the arm would have to change its posture.

        Args:
            joints: Joint angles (n,) at the beginning of the path [rad].
            way: Poses of the tool center point.
            width: Opening width of the gripper [m].
            held: Name of the object in the gripper, or None.
            T_tcp_object: Pose of the held object relative to the tool center point.
            ignore: Names of objects that the robot may touch.
            lenient_start: Whether contacts at the beginning of the path, i.e. at the current pose, are ignored.

        Returns:
            Reason why the path is blocked, or None if it is free, and the joint angles at which the check ended.
        """
        # Plain Python loops take half the time that NumPy needs for arrays of seven elements.
        traveled, now = 0.0, [float(angle) for angle in joints]
        before = now
        for start, end in itertools.pairwise(way):
            length = distance(start.position, end.position)
            turn = angle_between(start.quaternion, end.quaternion)
            steps = max(1, math.ceil(max(length / self._robot.workspace.check_step_m, turn / 0.25)))
            between = straight_way(start, end)
            for i in range(1, steps + 1):
                pose = between(i / steps)
                # Start the solution from joint angles that extrapolate the last joint motion.
                ahead = now if i == 1 else [2.0 * here - was for here, was in zip(now, before, strict=True)]
                found = self._ik.follow(
                    ahead, pose, position_tolerance_m=CHECK_POSITION_M, rotation_tolerance_rad=CHECK_ROTATION_RAD
                )
                if found is None or largest_step(found, now) > MAX_JOINT_STEP_RAD:
                    return OUT_OF_REACH, now
                before, now = now, found
                held_pose = None if T_tcp_object is None else self._tool_at(found, pose) @ T_tcp_object
                hits = self._clearance.touches(now, finger_width_m=width, held=held, held_pose=held_pose, ignore=ignore)
                if hits and not (lenient_start and traveled + i / steps * length < self._robot.workspace.leave_m):
                    return ", ".join(hits), now
            traveled += length
        return None, now


def turned_grasps(pose: Pose, grasp: Grasp) -> Iterator[Pose]:
    """Yield the poses that are equivalent to an annotated grasp.

    They are rotated about the object's axis of symmetry or have the two fingers swapped.
    """
    turns = [i * math.pi / 8.0 for i in range(16)] if grasp.symmetric_yaw else [0.0]
    half_turn = Pose((0.0, 0.0, 0.0), from_axis_angle((0.0, 0.0, math.pi)))
    for turn in turns:
        turned = pose @ Pose((0.0, 0.0, 0.0), from_yaw(turn)) @ grasp.pose
        yield turned
        if not grasp.symmetric_yaw:
            yield turned @ half_turn


def _approach(T_world_tcp: Pose) -> float:
    """Return the vertical component of the direction in which the tool points.

    It is -1 if the tool points straight down.
    """
    _, x, y, _ = T_world_tcp.quaternion
    return 1.0 - 2.0 * (x * x + y * y)
