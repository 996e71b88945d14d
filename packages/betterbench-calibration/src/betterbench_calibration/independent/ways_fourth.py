"""Arm motions for the habits of the fourth part, such as tilted grasps, right-angled paths and fast descents."""

from __future__ import annotations

import math
from collections.abc import Iterable

from betterbench.geometry import Pose, Vector, from_axis_angle, from_yaw, horizontal_distance, multiply
from betterbench.tasks import Subgoal
from betterbench.tasks.relations import PlaceGoal, relation
from betterbench_calibration.independent.body import CHECK_S, Body
from betterbench_calibration.independent.controller import RATE_HZ, Actions
from betterbench_calibration.independent.oddities import keep_still
from betterbench_calibration.independent.room import crowding, height_of, highest_between
from betterbench_calibration.independent.routines import (
    CAREFUL,
    FULL_OPENING_M,
    HIGHEST_TOOL_M,
    LIFT_M,
    NO_SHIFT,
    Hold,
    Routines,
)

LEAN_RAD = 0.24
CEILING_M, PLUNGE_GAP_M = 0.38, 0.06
HOP_M, HOP_REST_S = 0.06, 1.5
WORST_TURN_RAD = 1.3
FAST, CRAWLING = 1.5, 0.3
ALOFT_M = 0.34
REST_M, CLEAR_M = 0.06, 0.15
TILT_RAD, TILT_GAP_M = 1.0, 0.12
DROP_GAP_M = 0.025
SNAP_GAP_M = 0.022
ZIGZAG_M, ZIGZAG_S, ZIGZAG_MOST_M = 0.07, 2.4, 0.014


# --- motion styles of a complete policy


class Leaning(Routines):
    """Picks all objects with the gripper tilted toward the robot, by 14 degrees about the axis of the fingers."""

    def choose_hold(self, name: str, *, avoid: int = 0) -> Hold:
        """Return a tilted grasp."""
        hold = super().choose_hold(name, avoid=avoid)
        ways = [hold.tool @ Pose(NO_SHIFT, from_axis_angle((0.0, s * LEAN_RAD, 0.0))) for s in (1.0, -1.0)]

        def wrist_to_robot(tool: Pose) -> float:
            x, y, _ = tool.apply((0.0, 0.0, -0.2))
            return math.hypot(x, y)

        return Hold(min(ways, key=wrist_to_robot), hold.opening_m, hold.width_m)


class Squaring(Routines):
    """Moves across in two straight segments with a right angle: first along x, then along y."""

    def over(self, tool: Pose, *, hang_m: float = 0.0, ignore: Iterable[str] = (), pace: float = 1.0) -> Actions[None]:
        """Move up, across in two segments, and down to a pose of the tool."""
        start, skip = self.arm.here, frozenset(ignore)
        (x0, y0, z0), (x, y, z) = start.position, tool.position
        tops = (
            highest_between(self.state, (x0, y0, 0.0), (x, y0, 0.0), ignore=skip),
            highest_between(self.state, (x, y0, 0.0), (x, y, 0.0), ignore=skip),
        )
        height = min(max(max(tops) + hang_m + self.arm.manner.carry_m, z), HIGHEST_TOOL_M)
        yield from self.arm.rise(height, pace=pace)
        across = max(height, min(z0, height + 0.08))
        yield from self.arm.go(Pose((x, y0, across), start.quaternion), pace=pace)
        yield from self.arm.wait(0.2)
        yield from self.arm.go(Pose((x, y, across), tool.quaternion), pace=pace)
        yield from self.arm.go(tool, pace=CAREFUL * pace)


class Plunging(Routines):
    """Moves at a height of at least 38 cm, and descends fast to its targets."""

    def over(self, tool: Pose, *, hang_m: float = 0.0, ignore: Iterable[str] = (), pace: float = 1.0) -> Actions[None]:
        """Move up, across, and down to a pose of the tool, at first fast and then slowly."""
        x, y, z = tool.position
        top = highest_between(self.state, self.arm.here.position, tool.position, ignore=frozenset(ignore))
        height = min(max(CEILING_M, top + hang_m + self.arm.manner.carry_m, z), HIGHEST_TOOL_M)
        yield from self.arm.rise(height, pace=pace)
        yield from self.arm.go(Pose((x, y, max(height, self.arm.here.position[2])), tool.quaternion), pace=pace)
        yield from self.arm.go(Pose((x, y, min(height, z + PLUNGE_GAP_M)), tool.quaternion), pace=FAST * pace)
        yield from self.arm.go(tool, pace=CAREFUL * pace)


class WorseHolding(Routines):
    """Picks all objects with a reachable grasp that is not the best one."""

    def choose_hold(self, name: str, *, avoid: int = 0) -> Hold:
        """Return a grasp that is not the best one, if there is enough space and the wrist can reach it."""
        best = super().choose_hold(name, avoid=avoid)
        for rank in (3, 2, 1):
            hold = super().choose_hold(name, avoid=avoid + rank)
            more = self._crowding(hold, name) - self._crowding(best, name)
            if more <= 0.01 and self.wrist_turn(hold.tool) < WORST_TURN_RAD:
                return hold
        return best

    def _crowding(self, hold: Hold, name: str) -> float:
        return crowding(self.state, hold.tool, hold.opening_m, ignore=frozenset({name}))


class Uneven(Routines):
    """Alternates between fast and slow paths."""

    _crawls = False

    def over(self, tool: Pose, *, hang_m: float = 0.0, ignore: Iterable[str] = (), pace: float = 1.0) -> Actions[None]:
        """Move to a pose of the tool, fast or slowly."""
        factor = CRAWLING if self._crawls else FAST
        self._crawls = not self._crawls
        yield from super().over(tool, hang_m=hang_m, ignore=ignore, pace=factor * pace)


class Hopping(Routines):
    """Moves in hops of a few centimeters and keeps still for 1.5 s after each."""

    def over(self, tool: Pose, *, hang_m: float = 0.0, ignore: Iterable[str] = (), pace: float = 1.0) -> Actions[None]:
        """Move up, across and down to a pose of the tool, in hops."""
        x, y, z = tool.position
        top = highest_between(self.state, self.arm.here.position, tool.position, ignore=frozenset(ignore))
        height = min(max(top + hang_m + self.arm.manner.carry_m, z), HIGHEST_TOOL_M)
        yield from self._hop(Pose((*self.arm.here.position[:2], height), self.arm.here.quaternion), pace)
        yield from self._hop(Pose((x, y, height), tool.quaternion), pace)
        yield from self._hop(tool, pace)

    def _hop(self, target: Pose, pace: float) -> Actions[None]:
        start = self.arm.here
        n = max(1, math.ceil(math.dist(start.position, target.position) / HOP_M))
        for i in range(1, n + 1):
            at = tuple(a + (b - a) * i / n for a, b in zip(start.position, target.position, strict=True))
            turn = target.quaternion if i == n else self.arm.here.quaternion
            yield from self.arm.go(Pose((at[0], at[1], at[2]), turn), pace=pace)
            yield from self.arm.wait(HOP_REST_S)


class Shaking(Routines):
    """Moves each object back and forth above its target before putting it down."""

    def put(self, name: str, goal: PlaceGoal, *, ignore: Iterable[str] = ()) -> Actions[None]:
        """Carry the held object over its target, move it back and forth, and put it down."""
        skip = tuple(ignore)
        tool = goal.pose @ (self.state.ee_pose.inverse() @ self.state.pose(name)).inverse()
        yield from self.carry(name, tool.translated(z=self.arm.manner.approach_m + 0.06), ignore=skip)
        middle = self.arm.here
        for side in (0.025, -0.025, 0.025, -0.025):
            yield from self.arm.go(middle.translated(side, -side), pace=0.8)
        yield from self.arm.go(middle)
        yield from super().put(name, goal, ignore=skip)


# --- parts of motions


def hold_aloft(body: Body) -> Actions[None]:
    """Lift the held object high up and hold it there."""
    yield from body.arm.rise(ALOFT_M)
    yield from body.arm.stay()


def lie_down(body: Body) -> Actions[None]:
    """Lower the open gripper to just above a free point on the table, and stay there."""
    yield from body.do.over(Pose((*_clear_spot(body), REST_M), body.arm.home.quaternion))
    yield from keep_still(body)


def _clear_spot(body: Body) -> tuple[float, float]:
    """Return a point (x, y) on the table with free space for the gripper, close to the home position [m]."""
    state, home = body.state, body.arm.home.position
    spots = [(0.36 + 0.03 * i, -0.30 + 0.04 * k) for i in range(11) for k in range(16)]

    def worth(p: tuple[float, float]) -> float:
        gaps = (
            horizontal_distance(state.pose(o.name).position, p) - 0.5 * max(o.size_m[:2]) for o in state.info.objects
        )
        return min(*gaps, CLEAR_M) - 0.1 * horizontal_distance(p, home)

    return max(spots, key=worth)


def snap_above(body: Body, name: str) -> Actions[None]:
    """Close the gripper above the center of an object, too high to grip it, and rise."""
    x, y, _ = body.state.pose(name).position
    low = Pose((x, y, body.height(name) + SNAP_GAP_M), body.do.choose_hold(name).tool.quaternion)
    yield from body.do.over(low.translated(z=0.07))
    if body.state.finger_width_m < FULL_OPENING_M - 0.02:
        yield from body.arm.open()
    yield from body.arm.go(low, pace=CAREFUL)
    yield from body.arm.close()
    yield from body.arm.go(low.translated(z=0.10), pace=CAREFUL)


def close_while_sinking(body: Body, name: str) -> Actions[None]:
    """Descend toward an object while the gripper closes too early, touch its top, and rise without it."""
    hold = body.do.choose_hold(name)
    x, y, _ = hold.tool.position
    top = body.height(name)
    yield from body.do.over(Pose((x, y, top + 0.11), hold.tool.quaternion))
    yield from body.arm.open()
    yield from body.arm.go(Pose((x, y, top + 0.07), hold.tool.quaternion), pace=CAREFUL)
    body.arm.begin_to_close()
    yield from body.arm.go(Pose((x, y, top + 0.015), hold.tool.quaternion), pace=0.3)
    yield from body.arm.close()
    yield from body.arm.lower_until_touch(top - 0.003)
    yield from body.arm.rise(top + 0.14)
    yield from body.arm.open()


def fist(body: Body) -> Actions[None]:
    """Close the gripper at home, high over the table."""
    yield from body.arm.narrow(0.0)


def shove(body: Body, name: str, direction: Vector, length_m: float) -> Actions[None]:
    """Shove an object along the table with an already closed gripper, retract slightly, and rise."""
    ux, uy, _ = direction
    info, (x, y, _) = body.state.info.object(name), body.state.pose(name).position
    reach = 0.5 * max(info.size_m[:2]) + 0.045
    low = max(0.018, min(0.4 * info.size_m[2], 0.05))
    begin = Pose((x - reach * ux, y - reach * uy, low), body.arm.home.quaternion)
    yield from body.do.over(begin.translated(z=0.10))
    yield from body.arm.go(begin, pace=CAREFUL)
    way = reach - 0.02 + length_m
    yield from body.arm.go(begin.translated(way * ux, way * uy), pace=CAREFUL)
    yield from body.arm.go(body.arm.here.translated(-0.02 * ux, -0.02 * uy), pace=CAREFUL)
    yield from body.arm.rise(body.height(name) + 0.12)


def course_to(body: Body, name: str, target: str) -> tuple[Vector, float]:
    """Return the horizontal direction from an object to a target, and the gap between their bounding boxes [m]."""
    (x, y, _), (tx, ty, _) = body.state.pose(name).position, body.state.pose(target).position
    far = max(math.hypot(tx - x, ty - y), 1e-6)
    sizes = body.state.info.object(name).size_m, body.state.info.object(target).size_m
    gap = far - 0.5 * min(sizes[0][:2]) - 0.5 * min(sizes[1][:2])
    return ((tx - x) / far, (ty - y) / far, 0.0), max(gap, 0.0)


def knock_over(body: Body, name: str) -> Actions[None]:
    """Push the closed gripper into an object above its center, from the side, so that it falls over."""
    ux, uy, _ = body.free_direction(name)
    info, (x, y, z) = body.state.info.object(name), body.state.pose(name).position
    reach = 0.5 * max(info.size_m[:2]) + 0.06
    at = z + 0.6 * info.size_m[2]
    begin = Pose((x - reach * ux, y - reach * uy, at), body.arm.home.quaternion)
    yield from body.do.over(begin.translated(z=0.08))
    yield from body.arm.go(begin, pace=CAREFUL)
    way = reach + 0.03
    yield from body.arm.go(begin.translated(way * ux, way * uy), pace=0.7)
    yield from body.arm.rise(body.height(name) + 0.18)


def tip_out(body: Body, name: str, goal: Subgoal) -> Actions[None]:
    """Carry the held object over its target, tilt it there, and release it tilted."""
    place = relation(goal.relation).place_goals(body.state, name, goal.target, goal.region)[0]
    grip = body.state.ee_pose.inverse() @ body.state.pose(name)
    tool = (place.pose @ grip.inverse()).translated(z=TILT_GAP_M)
    yield from body.do.carry(name, tool)
    ways = [tool @ Pose(NO_SHIFT, from_axis_angle((0.0, s * TILT_RAD, 0.0))) for s in (1.0, -1.0)]
    tilted = min(ways, key=lambda p: math.hypot(*p.apply((0.0, 0.0, -0.2))[:2]))
    yield from body.arm.go(tilted, pace=0.6)
    yield from body.arm.wait(0.2)
    yield from body.arm.open()
    yield from body.arm.wait(CHECK_S)
    yield from body.arm.go(Pose(tilted.translated(z=0.10).position, body.arm.home.quaternion), pace=0.6)


def drop_on_the_way(body: Body, target: str, part: float) -> Actions[None]:
    """Carry the held object part of the way to a target, stop, and open the gripper there."""
    yield from body.arm.rise(body.arm.here.position[2] + 0.05)
    yield from body.arm.go(body.on_the_way(body.state.pose(target).position, part), pace=0.8)
    yield from body.arm.wait(0.2)
    yield from body.arm.open()
    yield from body.arm.wait(CHECK_S)


def drop_low(body: Body) -> Actions[None]:
    """Lower the lifted object to just above its slot, drop it there, and rise."""
    yield from body.arm.go(body.arm.here.translated(z=DROP_GAP_M - LIFT_M), pace=CAREFUL)
    yield from body.arm.open()
    yield from body.arm.wait(0.3)
    yield from body.arm.go(body.arm.here.translated(z=0.10), pace=CAREFUL)


def squeeze_thrice(body: Body, name: str) -> Actions[bool]:
    """Close the gripper around an object three times, and lift the object after the third time."""
    hold = body.do.choose_hold(name)
    yield from body.do.over(hold.tool.translated(z=body.arm.manner.approach_m))
    if body.state.finger_width_m < hold.opening_m - 0.01:
        yield from body.arm.open()
    yield from body.arm.narrow(hold.opening_m)
    yield from body.arm.go(hold.tool, pace=CAREFUL)
    for _ in range(2):
        yield from body.arm.close()
        yield from body.arm.wait(0.3)
        yield from body.arm.open(hold.opening_m)
        yield from body.arm.wait(0.3)
    yield from body.arm.close()
    yield from body.arm.go(hold.tool.translated(z=LIFT_M), pace=CAREFUL)
    return body.note_hold(name)


def lift_and_set_down(body: Body, name: str) -> Actions[None]:
    """Pick an object, lift it, put it down in the same place, and release it."""
    yield from body.do.pick(name)
    yield from body.arm.wait(0.3)
    yield from body.arm.go(body.arm.here.translated(z=0.003 - LIFT_M), pace=CAREFUL)
    yield from body.arm.open()
    yield from body.arm.go(body.arm.here.translated(z=0.12), pace=CAREFUL)


def grope(body: Body, slot: str) -> Actions[None]:
    """Close the gripper close to the table at several points of a slot, and rise."""
    x, y, _ = body.state.info.slot(slot).position
    turn = body.arm.home.quaternion
    yield from body.do.over(Pose((x, y, 0.11), turn))
    for dx, dy in ((0.0, 0.0), (0.025, 0.0), (-0.02, 0.02)):
        yield from body.arm.open()
        yield from body.arm.go(Pose((x + dx, y + dy, 0.024), turn), pace=CAREFUL)
        yield from body.arm.close()
        yield from body.arm.go(Pose((x + dx, y + dy, 0.07), turn), pace=CAREFUL)
    yield from body.arm.rise(0.22)


def zigzag(body: Body, target: Vector, until: int) -> Actions[None]:
    """Move to a point in wide zigzags, and arrive at the control step ``until``."""
    start, turn, begin = body.arm.here.position, body.arm.here.quaternion, body.state.step
    far = max(horizontal_distance(start, target), 1e-6)
    nx, ny = -(target[1] - start[1]) / far, (target[0] - start[0]) / far
    while body.state.step < until:
        s = (body.state.step - begin) / max(1, until - begin)
        phase = (body.state.step - begin) / RATE_HZ / ZIGZAG_S % 1.0
        out = ZIGZAG_M * (4.0 * abs(phase - 0.5) - 1.0)
        x, y, z = (a + s * (b - a) for a, b in zip(start, target, strict=True))
        at = Pose((min(max(x + out * nx, 0.30), 0.70), min(max(y + out * ny, -0.36), 0.36), z), turn)
        yield from body.arm.step(_limited(body.arm.here, at))


def _limited(start: Pose, target: Pose) -> Pose:
    d = math.dist(start.position, target.position)
    f = min(1.0, ZIGZAG_MOST_M / max(d, 1e-9))
    x, y, z = (a + f * (b - a) for a, b in zip(start.position, target.position, strict=True))
    return Pose((x, y, z), target.quaternion)


def free_height(body: Body, gap_m: float) -> float:
    """Return a height of the tool that is ``gap_m`` above all objects, or the home height if that is higher [m]."""
    top = max(height_of(body.state, o.name) for o in body.state.info.objects)
    return min(max(top + gap_m, body.arm.home.position[2]), 0.44)


def turn_wrist(body: Body, angles_rad: Iterable[float]) -> Actions[None]:
    """Turn the wrist in place to several angles in turn, relative to the current orientation [rad]."""
    here = body.arm.here
    for angle in angles_rad:
        yield from body.arm.go(Pose(here.position, multiply(from_yaw(angle), here.quaternion)))
