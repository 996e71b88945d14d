"""Motions of the independent family, such as picking, carrying, placing, pushing and sliding drawers."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Self

from betterbench.geometry import Pose, Vector, angle_between, from_axis_angle, rotate
from betterbench.interface.state import WorldState
from betterbench.sim.assets import Asset, Grasp
from betterbench.tasks.relations import PlaceGoal
from betterbench_calibration.independent.controller import RATE_HZ, Actions, Arm, tool_down, tool_yaw
from betterbench_calibration.independent.events import in_gripper
from betterbench_calibration.independent.room import crowding, height_of, highest_between, lowest_of

FULL_OPENING_M = 0.08
NARROW_MARGIN_M = 0.026
WRIST_RANGE_RAD = 1.75
"""Rotation of the wrist from its home position beyond which a grasp gets a penalty [rad]."""
LIFT_M = 0.09
SAFE_M = 0.05
HIGHEST_TOOL_M = 0.52
NO_SHIFT: Vector = (0.0, 0.0, 0.0)
SLOW, CAREFUL = 0.3, 0.55


@dataclass(frozen=True, slots=True)
class Hold:
    """Chosen grasp of an object.

    Attributes:
        tool: Pose of the tool in the world frame.
        opening_m: Opening width of the gripper before it closes [m].
        width_m: Width of the object between the fingers [m].
    """

    tool: Pose
    opening_m: float
    width_m: float


class Routines:
    """Motions for one episode. Most methods are generators that yield actions and receive states."""

    def __init__(self, arm: Arm, assets: Mapping[str, Asset]) -> None:
        """Prepare an episode. ``assets`` contains the assets of the scene by object name."""
        self.arm, self.assets = arm, assets

    @classmethod
    def like(cls, other: Routines) -> Self:
        """Create an instance of this class with the arm and the assets of other routines."""
        return cls(other.arm, other.assets)

    @property
    def state(self) -> WorldState:
        """Latest state."""
        return self.arm.state

    def wrist_turn(self, tool: Pose) -> float:
        """Return the absolute wrist rotation at a tool pose, relative to the home pose [rad]."""
        x, y, _ = tool.position
        hx, hy, _ = self.arm.home.position
        base = math.atan2(y, x) - math.atan2(hy, hx)
        turn = tool_yaw(tool.quaternion) - tool_yaw(self.arm.home.quaternion)
        return abs(math.remainder(turn, 2.0 * math.pi) - base)

    # --- paths

    def over(self, tool: Pose, *, hang_m: float = 0.0, ignore: Iterable[str] = (), pace: float = 1.0) -> Actions[None]:
        """Move up, horizontally above all obstacles, and down to a pose of the tool."""
        skip = frozenset(ignore)
        top = highest_between(self.state, self.arm.here.position, tool.position, ignore=skip)
        height = top + hang_m + self.arm.manner.carry_m
        height = min(max(height, tool.position[2]), HIGHEST_TOOL_M)
        yield from self.arm.rise(height, pace=pace)
        x, y, z = tool.position
        across = max(height, min(self.arm.here.position[2], height + 0.08))
        yield from self.arm.go(Pose((x, y, across), tool.quaternion), pace=pace, bow=True)
        if across - z > 0.005:
            yield from self.arm.go(tool, pace=CAREFUL * pace)

    def above(self, point: Vector, height_m: float) -> Actions[None]:
        """Move over a point of the table, with the tool ``height_m`` above the table."""
        yield from self.over(Pose((point[0], point[1], height_m), self.arm.home.quaternion))

    def hover(self, name: str, gap_m: float) -> Actions[None]:
        """Move over an object with an open gripper, the tool ``gap_m`` above its top, oriented for a grasp."""
        hold = self.choose_hold(name)
        x, y, _ = hold.tool.position
        height = height_of(self.state, name) + gap_m
        yield from self.over(Pose((x, y, height), hold.tool.quaternion))

    # --- picking

    def choose_hold(self, name: str, *, avoid: int = 0) -> Hold:
        """Return the grasp with the most space and the least wrist rotation, skipping the ``avoid`` best grasps."""
        pose = self.state.pose(name)
        ranked: list[tuple[float, int, Hold]] = []
        for grasp in self.assets[name].grasps or (_makeshift(self.assets[name]),):
            for turn in _turns(grasp):
                tool = pose @ grasp.pose @ Pose(NO_SHIFT, from_axis_angle((0.0, 0.0, turn)))
                opening, cost = self._best_opening(tool, grasp.width_m, name)
                ranked.append((cost + 0.05 * grasp.preference, len(ranked), Hold(tool, opening, grasp.width_m)))
        ranked.sort()
        return ranked[min(avoid, len(ranked) - 1)][2]

    def _best_opening(self, tool: Pose, width_m: float, name: str) -> tuple[float, float]:
        """Return the gripper opening for a grasp [m] and the cost of the grasp."""
        narrow = min(FULL_OPENING_M, width_m + NARROW_MARGIN_M)
        full_cost = self._cost(tool, FULL_OPENING_M, frozenset({name}))
        narrow_cost = self._cost(tool, narrow, frozenset({name})) + 0.01
        return (narrow, narrow_cost) if narrow_cost < full_cost else (FULL_OPENING_M, full_cost)

    def _cost(self, tool: Pose, opening_m: float, ignore: frozenset[str]) -> float:
        turn = self.wrist_turn(tool)
        return (
            3.0 * crowding(self.state, tool, opening_m, ignore=ignore)
            + 0.02 * turn
            + 2.0 * max(0.0, turn - WRIST_RANGE_RAD)
        )

    def pick(self, name: str, *, shift: Vector = NO_SHIFT, avoid: int = 0) -> Actions[bool]:
        """Pick an object from above and lift it, and return whether it is in the gripper.

        Args:
            name: Name of the object.
            shift: Offset of the tool from the grasp pose when the gripper closes, in the world frame [m].
            avoid: Number of grasps that are skipped, starting with the best one.
        """
        hold = self.choose_hold(name, avoid=avoid)
        x, y, z = hold.tool.position
        tool = Pose((x + shift[0], y + shift[1], z + shift[2]), hold.tool.quaternion)
        return (yield from self.take_at(tool, hold.opening_m, name=name))

    def take_at(self, tool: Pose, opening_m: float, *, name: str | None = None) -> Actions[bool]:
        """Approach a pose from above, close the gripper, lift, and return whether ``name`` is in the gripper."""
        manner = self.arm.manner
        before = tool.translated(z=manner.approach_m)
        if self.state.finger_width_m < opening_m - 0.01:
            yield from self.arm.rise(self.arm.here.position[2] + SAFE_M)
            yield from self.arm.open()
        yield from self.over(before)
        if manner.glance_s:
            yield from self.arm.wait(manner.glance_s)
        if opening_m < self.state.finger_width_m - 0.006:
            yield from self.arm.narrow(opening_m)
        yield from self.arm.go(tool, pace=CAREFUL)
        yield from self.arm.wait(manner.pause_s)
        yield from self.arm.close()
        yield from self.arm.go(tool.translated(z=LIFT_M), pace=CAREFUL)
        return name is not None and in_gripper(self.state) == name

    # --- placing

    def choose_goal(self, name: str, goals: tuple[PlaceGoal, ...], *, ignore: Iterable[str] = ()) -> PlaceGoal:
        """Return the goal with the most space and the least wrist rotation. Earlier goals are preferred."""
        grip = self.state.ee_pose.inverse() @ self.state.pose(name)
        skip = frozenset({name, *ignore})

        def cost(indexed: tuple[int, PlaceGoal]) -> float:
            index, goal = indexed
            tool = goal.pose @ grip.inverse()
            opening = FULL_OPENING_M if goal.release_width_m is None else goal.release_width_m
            return self._cost(tool, opening, skip) + 0.004 * index

        return min(enumerate(goals[:60]), key=cost)[1]

    def put(self, name: str, goal: PlaceGoal, *, ignore: Iterable[str] = ()) -> Actions[None]:
        """Carry the held object to a goal, release it and move away."""
        arm = self.arm
        grip = self.state.ee_pose.inverse() @ self.state.pose(name)
        tool = goal.pose @ grip.inverse()
        ax, ay, az = goal.approach
        sideways = math.hypot(ax, ay) > 0.02
        before = tool.translated(ax, ay, az if sideways else max(az, arm.manner.approach_m))
        yield from self.carry(name, before, ignore=ignore if sideways else ())
        yield from arm.go(self._corrected(name, goal.pose, tool), pace=SLOW if sideways else CAREFUL)
        yield from arm.wait(max(arm.manner.pause_s, 0.1))
        yield from arm.open(goal.release_width_m)
        if sideways:
            yield from arm.go(arm.here.translated(ax, ay, az), pace=CAREFUL)
        else:
            yield from arm.go(arm.here.translated(z=0.06), pace=CAREFUL)
        yield from arm.rise(before.position[2] + 0.04)

    def _corrected(self, name: str, goal: Pose, tool: Pose) -> Pose:
        """Return the tool pose that brings the object to the goal, given its current pose in the gripper."""
        if in_gripper(self.state) != name:
            return tool
        grip = self.state.ee_pose.inverse() @ self.state.pose(name)
        now = goal @ grip.inverse()
        return now if angle_between(now.quaternion, tool.quaternion) < 0.4 else tool

    def carry(self, name: str, tool: Pose, *, ignore: Iterable[str] = ()) -> Actions[None]:
        """Carry the held object above all obstacles to a pose of the tool."""
        held = in_gripper(self.state) == name
        hang = max(0.0, self.state.ee_pose.position[2] - lowest_of(self.state, name)) if held else 0.05
        yield from self.over(tool, hang_m=hang, ignore=(name, *ignore), pace=0.9)

    # --- other motions

    def sway(self, a: Vector, b: Vector) -> Actions[None]:
        """Move back and forth between two positions of the tool [m] until the episode ends."""
        turn = self.arm.home.quaternion
        yield from self.over(Pose(a, turn))
        while True:
            yield from self.arm.go(Pose(b, turn))
            yield from self.arm.go(Pose(a, turn))

    def circle(self, center: Vector, radius_m: float, *, period_s: float = 2.5) -> Actions[None]:
        """Move the tool in horizontal circles around a point until the episode ends."""
        rotation = self.arm.here.quaternion
        n = 0
        while True:
            angle = 2.0 * math.pi * n / (RATE_HZ * period_s)
            x, y, z = center
            at = (x + radius_m * math.cos(angle), y + radius_m * math.sin(angle), z)
            yield from self.arm.step(_limited(self.arm.here, Pose(at, rotation), 0.012))
            n += 1

    def push(self, name: str, direction: Vector, length_m: float) -> Actions[None]:
        """Push an object along the table by ``length_m`` in a direction, with closed fingers."""
        info, at = self.state.info.object(name), self.state.pose(name).position
        ux, uy, _ = direction
        reach = 0.5 * max(info.size_m[0], info.size_m[1]) + 0.04
        height = max(0.016, min(0.5 * info.size_m[2], 0.05))
        yaw = _near_home(math.atan2(uy, ux), tool_yaw(self.arm.home.quaternion))
        begin = Pose((at[0] - ux * reach, at[1] - uy * reach, height), tool_down(yaw))
        yield from self.over(begin.translated(z=self.arm.manner.approach_m + 0.04))
        yield from self.arm.narrow(0.0)
        yield from self.arm.go(begin, pace=CAREFUL)
        way = reach + length_m
        yield from self.arm.go(begin.translated(ux * way, uy * way), pace=CAREFUL)
        yield from self.arm.go(self.arm.here.translated(-0.03 * ux, -0.03 * uy), pace=CAREFUL)
        yield from self.arm.rise(self.arm.home.position[2])

    def slide_drawer(self, name: str, opening_m: float, *, travel_m: float) -> Actions[None]:
        """Pull a drawer by its knob, or push its front, until it is open by ``opening_m``.

        ``travel_m`` is the current opening of the drawer [m].
        """
        frame = self.state.pose(name)
        out = rotate(frame.quaternion, (1.0, 0.0, 0.0))
        way = opening_m - travel_m
        if way > 0.0:
            hold = self.choose_hold(name)
            before = hold.tool.translated(z=0.12)
            yield from self.over(before)
            yield from self.arm.narrow(0.05)
            yield from self.arm.go(hold.tool, pace=CAREFUL)
            yield from self.arm.close()
            yield from self.arm.go(hold.tool.translated(out[0] * way, out[1] * way), pace=CAREFUL)
            yield from self.arm.open(0.05)
            yield from self.arm.go(self.arm.here.translated(z=0.12), pace=CAREFUL)
            return
        x, y, z = self._knob(name)
        yaw = _near_home(tool_yaw(frame.quaternion) + math.pi / 2, tool_yaw(self.arm.home.quaternion))
        begin = Pose((x + 0.05 * out[0], y + 0.05 * out[1], z), tool_down(yaw))
        yield from self.over(begin.translated(z=0.12))
        yield from self.arm.narrow(0.0)
        yield from self.arm.go(begin, pace=CAREFUL)
        way = way - 0.045
        yield from self.arm.go(begin.translated(out[0] * way, out[1] * way), pace=SLOW)
        yield from self.arm.wait(0.2)
        yield from self.arm.go(self.arm.here.translated(0.06 * out[0], 0.06 * out[1]), pace=CAREFUL)
        yield from self.arm.rise(0.3)

    def _knob(self, name: str) -> Vector:
        grasp = self.assets[name].grasps[0]
        return self.state.pose(name).apply(grasp.pose.position)


def _turns(grasp: Grasp) -> tuple[float, ...]:
    """Return the rotations about the approach axis that result in an equivalent grasp [rad]."""
    return tuple(math.pi * i / 8 for i in range(16)) if grasp.symmetric_yaw else (0.0, math.pi)


def _makeshift(asset: Asset) -> Grasp:
    """Return a grasp across the narrow side of an object, for assets without annotated grasps."""
    sx, sy, sz = asset.size_m
    rotation = tool_down(0.0) if sy <= sx else tool_down(0.5 * math.pi)
    return Grasp("makeshift", Pose((0.0, 0.0, max(0.011, sz - 0.02)), rotation), min(sx, sy))


def _near_home(yaw: float, home_yaw: float) -> float:
    """Return ``yaw`` or the opposite heading, whichever is closer to the heading in the home pose [rad]."""
    return home_yaw + math.remainder(yaw - home_yaw, math.pi)


def _limited(start: Pose, target: Pose, most_m: float) -> Pose:
    """Return the target, or the pose on the straight path to it at a distance of ``most_m`` if it is farther away."""
    d = math.dist(start.position, target.position)
    if d <= most_m:
        return target
    f = most_m / d
    x, y, z = (a + f * (b - a) for a, b in zip(start.position, target.position, strict=True))
    return Pose((x, y, z), target.quaternion)
