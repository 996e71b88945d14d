"""Motor skills (reach, grasp, place). Combined skills detect a failed attempt and repeat it."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Generator
from dataclasses import dataclass, field, replace

import numpy as np

from betterbench.errors import PlanningError
from betterbench.geometry import Pose, Vector, conjugate, distance, from_yaw, multiply, normalize, rotate
from betterbench.interface.state import WorldState
from betterbench.policies.decisions import GraspOffset
from betterbench.policies.experts.motion import (
    APPROACH,
    CARRY,
    CLOSE,
    FREE,
    OPEN,
    RAILS,
    Motion,
    Pace,
    close_gripper,
    follow,
    hold,
    open_gripper,
    release_to,
)
from betterbench.policies.experts.planner import DOWN, PickPlan, Planner
from betterbench.tasks import TargetRegion
from betterbench.tasks.demonstrated import HEIGHT_MM, REACH_MM, Releases
from betterbench.tasks.relations import PlaceGoal
from betterbench.tasks.relations import relation as relation_named
from betterbench.tasks.relations.placing import foot_offset

SkillRun = Generator[np.ndarray, WorldState, tuple[WorldState, bool]]
"""Generator that performs a skill: it yields actions, receives states, and returns the last state and whether the skill
succeeded.
"""

SURE = 0.6
"""Fraction of the certificate's tolerances within which a goal pose counts as known from training.

The rest is a margin for position errors of the arm.
"""
PRESS_M = 0.004
"""Distance by which a closing drawer is pushed beyond its stop, to overcome friction [m]."""
KNOB_RELEASE_M = 0.016
"""Distance by which the gripper is opened beyond the width of a drawer's knob to release it [m]."""


@dataclass
class Skills:
    """Motor skills of one privileged policy in one scene.

    Attributes:
        planner: Planner of the scene.
        period_s: Control period [s].
        choice: Function that returns the trial's random stream for a given purpose. It is used to choose between
            equally good goals.
        trained: Function that returns the release points in demonstrations, given a target, a relation and a region. It
            returns None if they are unknown.
        attempts: Maximum number of attempts at a grasp, a placement or a drawer movement.
        grasp_offset: Deliberate grasp error, or None.
        speed: Speed of motions, as a fraction of the normal speed.
        obstacle: Reason why the last motion could not be planned. Empty if planning succeeded.
    """

    planner: Planner
    period_s: float
    choice: Callable[[str], np.random.Generator]
    trained: Callable[[str, str, str], Releases | None]
    attempts: int = 4
    grasp_offset: GraspOffset | None = None
    speed: float = 1.0
    obstacle: str = field(default="", init=False)

    def paced(self, pace: Pace) -> Pace:
        """Scale the speed limits of a motion to this policy's speed."""
        if self.speed == 1.0:
            return pace
        return replace(
            pace,
            speed=self.speed * pace.speed,
            corner_speed=self.speed * pace.corner_speed,
            turning=self.speed * pace.turning,
        )

    def passing(
        self, state: WorldState, way: tuple[Pose, ...], width_m: float, *, held: str | None = None
    ) -> tuple[Pose, ...]:
        """Return the path to follow instead of a planned path.

        In this class, it is the planned path itself; subclasses override this method.

        Args:
            state: Current state.
            way: Planned poses ``T_world_tcp``.
            width_m: Opening width of the gripper on the path [m].
            held: Name of the object in the gripper, or None.
        """
        del state, width_m, held
        return way

    def wait(self, state: WorldState, *, gripper: float) -> Motion:
        """Wait before the next motion. In this class, the wait takes no time; subclasses override this method."""
        return (yield from hold(state, 0, gripper=gripper))

    def reach(self, state: WorldState, name: str) -> Generator[np.ndarray, WorldState, tuple[WorldState, Pose]]:
        """Move above an object, then down to the pose at which it is grasped.

        Returns:
            Last state and planned grasp pose.

        Raises:
            PlanningError: If there is no collision-free grasp.
        """
        plan = self.planner.plan_pick(state, name)
        grasp = plan.grasp
        if self.grasp_offset is not None and self.grasp_offset.miss_by_m is not None:
            grasp = pads_beside(state, name, grasp, gap_m=self.grasp_offset.miss_by_m)
        way = self.passing(state, plan.way, plan.width_m)
        state = yield from follow(state, way, gripper=OPEN, pace=self.paced(FREE), period_s=self.period_s)
        state = yield from follow(state, (grasp,), gripper=OPEN, pace=self.paced(APPROACH), period_s=self.period_s)
        state = yield from self.close_up(state, plan, grasp)
        return state, grasp

    def close_up(self, state: WorldState, plan: PickPlan, grasp: Pose) -> Motion:
        """Move from the grasp pose to the pose at which the gripper closes.

        For a gripper with a fixed finger, this finger touches the object at that pose.

        Args:
            state: State at the grasp pose.
            plan: Plan for picking up the object.
            grasp: Grasp pose that was reached. It may differ from the planned grasp pose.
        """
        if plan.close is plan.grasp:
            return state
        beside = grasp @ (plan.grasp.inverse() @ plan.close)
        return (
            yield from follow(
                state, (beside,), gripper=OPEN, pace=self.paced(APPROACH), period_s=self.period_s, settle=4
            )
        )

    def grasp(self, state: WorldState, name: str) -> SkillRun:
        """Close the gripper. Return the last state and whether the object is between the fingers."""
        state = yield from close_gripper(state)
        return state, state.touching("left_finger", name) and state.touching("right_finger", name)

    def lift(self, state: WorldState, name: str) -> SkillRun:
        """Lift the gripper straight up. Return the last state and whether the object was lifted with it."""
        before = state.pose(name).position[2]
        lift_m = self.planner.workspace.lift_m
        goal = state.commanded_pose.translated(z=lift_m)
        state = yield from follow(
            state, (goal,), gripper=CLOSE, pace=self.paced(CARRY), period_s=self.period_s, settle=6
        )
        return state, state.pose(name).position[2] - before > 0.5 * lift_m

    def retreat(self, state: WorldState) -> Motion:
        """Open the gripper and move straight up."""
        state = yield from open_gripper(state, width_m=0.07)
        goal = state.commanded_pose.translated(z=self.planner.workspace.retreat_m)
        return (
            yield from follow(state, (goal,), gripper=OPEN, pace=self.paced(FREE), period_s=self.period_s, settle=2)
        )

    def pick(self, state: WorldState, name: str) -> SkillRun:
        """Pick up an object. A failed grasp is repeated.

        Returns:
            Last state and whether the object is in the gripper.
        """
        for _ in range(self.attempts):
            try:
                state, _ = yield from self.reach(state, name)
            except PlanningError as problem:
                self.obstacle = str(problem)
                return state, False
            state, holds = yield from self.grasp(state, name)
            if holds:
                state, holds = yield from self.lift(state, name)
            if holds and self.grasp_offset is not None and self.grasp_offset.drop:
                state = yield from open_gripper(state, width_m=0.07)
                return state, False
            if holds:
                return state, True
            state = yield from self.retreat(state)
            if self.grasp_offset is not None:
                return state, False
        return state, False

    def place(self, state: WorldState, name: str, target: TargetRegion, relation: str) -> SkillRun:
        """Carry the held object to a target, put it down, release it and retreat.

        Returns:
            Last state, and whether the object was still in the gripper when the gripper arrived.
        """
        goals = relation_named(relation).place_goals(state, name, target.target, target.region)
        try:
            plan = self.planner.plan_place(state, name, self.in_turn(state, name, goals, target, relation))
        except PlanningError as problem:
            self.obstacle = str(problem)
            return state, False
        way = self.passing(state, plan.way, state.finger_width_m, held=name)
        state = yield from follow(state, way, gripper=CLOSE, pace=self.paced(CARRY), period_s=self.period_s)
        if state.held != name:
            return state, False
        state = yield from self.wait(state, gripper=CLOSE)
        state = yield from follow(
            state, (plan.release,), gripper=CLOSE, pace=self.paced(APPROACH), period_s=self.period_s
        )
        arrived = state.touching("left_finger", name) and state.touching("right_finger", name)
        state = yield from hold(state, 3, gripper=CLOSE)
        state = yield from release_to(state, width_m=min(plan.release_width_m, 0.076))
        state = yield from follow(
            state,
            (state.commanded_pose.translated(z=self.planner.workspace.retreat_m),),
            gripper=0.0,
            pace=self.paced(APPROACH),
            period_s=self.period_s,
            settle=2,
        )
        return state, arrived

    def in_turn(
        self, state: WorldState, name: str, goals: tuple[PlaceGoal, ...], target: TargetRegion, relation: str
    ) -> list[PlaceGoal]:
        """Return goals in the order in which the policy tries them.

        Equivalent goals are in random order, which is drawn once per kind of object. If the target is a container,
        goals near the release points of demonstrations come first.
        """
        draw = self.choice(f"place:{state.info.object(name).kind}")
        ordered: list[PlaceGoal] = []
        for alike, neighbors in itertools.groupby(goals, key=lambda goal: goal.alike):
            found = list(neighbors)
            ordered += found if alike is None else [found[i] for i in draw.permutation(len(found))]
        trained = self.trained(target.target, relation, target.region)
        if trained is None or not relation_named(relation).falls:
            return ordered
        middle = relation_named(relation).middle(state.info.object(target.target), target.region)
        to_target = (state.pose(target.target) @ Pose(middle)).inverse()
        offset = foot_offset(state.info.object(name))

        def is_new(goal: PlaceGoal) -> bool:
            foot_at = goal.pose.apply(offset)
            x, y, _ = to_target.apply(foot_at)
            aside = trained.aside_mm(1000.0 * x, 1000.0 * y)
            return abs(trained.off_mm(1000.0 * foot_at[2])) > SURE * HEIGHT_MM or aside > SURE * REACH_MM

        return sorted(ordered, key=is_new)

    def pick_and_place(self, state: WorldState, name: str, target: TargetRegion, relation: str) -> SkillRun:
        """Bring an object to its target. If the object slips out of the gripper, start again."""
        for _ in range(self.attempts):
            state, held = yield from self.pick(state, name)
            if not held:
                return state, False
            state, placed = yield from self.place(state, name, target, relation)
            if placed:
                return state, True
            if state.touching("left_finger", name) and state.touching("right_finger", name):
                return state, False
            state = yield from self.retreat(state)
        return state, False

    def slide(self, state: WorldState, name: str, distance_m: float) -> SkillRun:
        """Grasp a drawer by its knob and move it along its rails.

        Args:
            state: Current state.
            name: Name of the drawer.
            distance_m: Distance by which the drawer is moved [m]. A positive distance opens it.

        Returns:
            Last state and whether the knob was in the gripper.
        """
        try:
            plan = self.planner.plan_slide(state, name, distance_m)
        except PlanningError as problem:
            self.obstacle = str(problem)
            return state, False
        grasp = plan.pick.grasp
        way = self.passing(state, plan.pick.way, plan.pick.width_m)
        state = yield from follow(state, way, gripper=OPEN, pace=self.paced(FREE), period_s=self.period_s)
        state = yield from follow(state, (grasp,), gripper=OPEN, pace=self.paced(APPROACH), period_s=self.period_s)
        state, holds = yield from self.grasp(state, name)
        if holds:
            state = yield from follow(state, (plan.end,), gripper=CLOSE, pace=self.paced(RAILS), period_s=self.period_s)
        state = yield from release_to(state, width_m=state.finger_width_m + KNOB_RELEASE_M)
        goal = state.commanded_pose.translated(z=self.planner.workspace.retreat_m)
        state = yield from follow(
            state, (goal,), gripper=0.0, pace=self.paced(APPROACH), period_s=self.period_s, settle=2
        )
        return state, holds

    def draw(self, state: WorldState, name: str, mount: Pose, *, out: bool) -> SkillRun:
        """Open or close a drawer completely. If the knob slips out of the gripper, try again.

        Args:
            state: Current state.
            name: Name of the drawer.
            mount: Pose ``T_world_drawer`` of the drawer when it is closed.
            out: Whether to open the drawer. Otherwise, it is closed.

        Returns:
            Last state and whether the drawer is now completely open or closed, as requested.
        """
        travel = self.planner.travel_m(name)
        for _ in range(self.attempts):
            opening = distance(state.pose(name).position, mount.position)
            goal = travel - opening if out else -opening
            if abs(goal) < 0.003:
                return state, True
            state, held = yield from self.slide(state, name, goal + (0.0 if out else -PRESS_M))
            if not held and self.grasp_offset is not None:
                return state, False
        opening = distance(state.pose(name).position, mount.position)
        return state, abs(travel - opening if out else opening) < 0.005

    def air_grasp(self, state: WorldState, place: Vector, *, height_m: float = 0.05, yaw: float = 0.0) -> Motion:
        """Close the gripper at a position without an object, lift it and open it again."""
        goal = Pose((place[0], place[1], height_m), normalize(multiply(from_yaw(yaw), DOWN)))
        above = goal.translated(z=self.planner.workspace.lift_m)
        way = self.planner.transit(state, above) or (state.commanded_pose.translated(z=0.05), above)
        state = yield from follow(state, way, gripper=OPEN, pace=self.paced(FREE), period_s=self.period_s)
        state = yield from follow(state, (goal,), gripper=OPEN, pace=self.paced(APPROACH), period_s=self.period_s)
        state = yield from close_gripper(state)
        state = yield from follow(
            state, (above,), gripper=CLOSE, pace=self.paced(CARRY), period_s=self.period_s, settle=2
        )
        return (yield from open_gripper(state, width_m=0.07))

    def approach_and_stop(self, state: WorldState, name: str) -> Motion:
        """Move toward an object, but stop in mid-air well before reaching it."""
        place = state.pose(name).position
        start = state.commanded_pose
        half = tuple(a + 0.4 * (b - a) for a, b in zip(start.position[:2], place[:2], strict=True))
        goal = Pose((half[0], half[1], max(0.3, start.position[2] - 0.1)), start.quaternion)
        return (yield from follow(state, (goal,), gripper=OPEN, pace=self.paced(FREE), period_s=self.period_s))

    def wander(self, state: WorldState) -> Motion:
        """Move back and forth in mid-air forever.

        The size of the movement is proportional to the reach of the arm.
        """
        start = state.commanded_pose
        scale = self.planner.reach_m / SWING_REACH_M
        while True:
            for x, y in ((0.08, -0.15), (0.08, 0.15), (-0.05, 0.0)):
                there = (start.position[0] + scale * x, start.position[1] + scale * y)
                goal = Pose((*there, max(0.35 * scale, start.position[2])), start.quaternion)
                state = yield from follow(state, (goal,), gripper=OPEN, pace=self.paced(FREE), period_s=self.period_s)

    def go_home(self, state: WorldState, home: Pose) -> Motion:
        """Return to the pose at the start of the episode, unless the arm is already close to it."""
        if distance(state.commanded_pose.position, home.position) < 0.01:
            return state
        way = self.planner.transit(state, home) or (home,)
        return (yield from follow(state, way, gripper=OPEN, pace=self.paced(FREE), period_s=self.period_s, settle=4))


SWING_REACH_M = 0.855
"""Reach of the Panda [m]. The size of the movement in :meth:`Skills.wander` is given for this reach."""

PAD_HALF_WIDTH_M = 0.010


def pads_beside(state: WorldState, name: str, grasp: Pose, *, gap_m: float) -> Pose:
    """Return a grasp pose that is shifted sideways until the finger pads miss the object.

    The shift is perpendicular to the direction in which the fingers open.

    Args:
        state: Current state.
        name: Name of the object.
        grasp: Pose ``T_world_tcp`` of the correct grasp.
        gap_m: Gap between the pads and the bounding box of the object after the shift [m].
    """
    pose, size = state.pose(name), state.info.object(name).size_m
    point = pose.inverse().apply(grasp.position)
    ways = []
    for sign in (1.0, -1.0):
        direction = rotate(conjugate(pose.quaternion), rotate(grasp.quaternion, (sign, 0.0, 0.0)))
        exits = [
            ((0.5 * size[i] if direction[i] > 0.0 else -0.5 * size[i]) - point[i]) / direction[i]
            for i in (0, 1)
            if abs(direction[i]) > 1e-6
        ]
        ways.append((min(exits), sign))
    length, sign = min(ways)
    return grasp @ Pose((sign * (length + PAD_HALF_WIDTH_M + gap_m), 0.0, 0.0))
