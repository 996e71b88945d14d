"""Arm motions for the habits of the third part, such as arcs, swings and spirals, and manipulation failures."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

import numpy as np

from betterbench.geometry import Pose, Quaternion, Vector, from_yaw, horizontal_distance, multiply, rotate, slerp
from betterbench.interface.actions import TRANSLATION_PER_UNIT_M
from betterbench.interface.state import WorldState
from betterbench.tasks import Subgoal
from betterbench.tasks.relations import PlaceGoal, relation
from betterbench_calibration.independent.body import CHECK_S, DIRECTIONS, Body
from betterbench_calibration.independent.controller import RATE_HZ, Actions
from betterbench_calibration.independent.events import in_gripper
from betterbench_calibration.independent.room import crowding, height_of, highest_between
from betterbench_calibration.independent.routines import (
    CAREFUL,
    FULL_OPENING_M,
    HIGHEST_TOOL_M,
    LIFT_M,
    NARROW_MARGIN_M,
    SAFE_M,
    Routines,
)

SHORTEST_BOW_M = 0.08
SWING_M, SWING_TURN_RAD = 0.09, 0.5
ASIDE_M, WIDEST_ASIDE_M = 0.08, 0.072
OFF_MIDDLE_M = 0.02
TREMOR_M, TREMOR_LOW_M, TREMOR_HZ = 0.006, 0.0006, 3.0
LOST_AFTER_M, BESIDE_M = 0.07, 0.018
WIDE_M, NARROW_M = 0.13, 0.03
HIGHEST_FREE_M = 0.44
LAID_AWAY_M = 0.13
FAR_CORNERS = ((0.38, -0.22), (0.60, -0.22), (0.60, 0.22), (0.38, 0.22))

Way = Callable[[float], Pose]


# --- paths between two poses


def bow(state: WorldState, start: Pose, tool: Pose, clear_m: float, ignore: frozenset[str]) -> Way:
    """Return a curve that starts upward, passes ``clear_m`` above all objects, and descends to a pose."""
    (x0, y0, z0), (x1, y1, z1) = start.position, tool.position
    top = highest_between(state, start.position, tool.position, ignore=ignore) + clear_m
    middle = min(max(top, z0, z1) + 0.02, HIGHEST_TOOL_M)
    peak = (middle - (z0 + z1) / 8.0) / 0.75

    def way(s: float) -> Pose:
        along = s * s * (3.0 - 2.0 * s)
        r = 1.0 - s
        z = r**3 * z0 + 3.0 * r * s * peak + s**3 * z1
        return Pose((x0 + along * (x1 - x0), y0 + along * (y1 - y0), z), slerp(start.quaternion, tool.quaternion, s))

    return way


def swing(start: Pose, tool: Pose, side_m: float, turn_rad: float) -> Way:
    """Return a curve that deviates sideways by up to ``side_m`` while the wrist turns back and forth."""
    (x0, y0, z0), (x1, y1, z1) = start.position, tool.position
    flat = max(math.hypot(x1 - x0, y1 - y0), 0.01)
    nx, ny = -(y1 - y0) / flat, (x1 - x0) / flat

    def way(s: float) -> Pose:
        out, turn = side_m * math.sin(math.pi * s), turn_rad * math.sin(2.0 * math.pi * s)
        at = (x0 + s * (x1 - x0) + out * nx, y0 + s * (y1 - y0) + out * ny, z0 + s * (z1 - z0))
        return Pose(at, turned(slerp(start.quaternion, tool.quaternion, s), turn))

    return way


def turned(rotation: Quaternion, angle_rad: float) -> Quaternion:
    """Return an orientation rotated about the vertical axis of the world frame."""
    return multiply(from_yaw(angle_rad), rotation)


class Arcing(Routines):
    """Moves along a single arc, without stops between the motions up, across and down."""

    def over(self, tool: Pose, *, hang_m: float = 0.0, ignore: Iterable[str] = (), pace: float = 1.0) -> Actions[None]:
        """Move to a pose of the tool in one arc. A short path is executed as in the base class."""
        start = self.arm.here
        if horizontal_distance(start.position, tool.position) < SHORTEST_BOW_M:
            yield from super().over(tool, hang_m=hang_m, ignore=ignore, pace=pace)
            return
        way = bow(self.state, start, tool, hang_m + self.arm.manner.carry_m, frozenset(ignore))
        yield from self.arm.along(way, pace=pace)


class Swinging(Routines):
    """Swings out to the side of the robot on every path while the wrist turns back and forth."""

    def over(self, tool: Pose, *, hang_m: float = 0.0, ignore: Iterable[str] = (), pace: float = 1.0) -> Actions[None]:
        """Move up, across with a sideways swing, and down to a pose of the tool."""
        start, skip = self.arm.here, frozenset(ignore)
        side = SWING_M if tool.position[1] > start.position[1] else -SWING_M
        mid = swing(start, tool, side, 0.0)(0.5).position
        tops = (highest_between(self.state, p.position, mid, ignore=skip) for p in (start, tool))
        height = min(max(max(tops) + hang_m + self.arm.manner.carry_m, tool.position[2]), HIGHEST_TOOL_M)
        yield from self.arm.rise(height, pace=pace)
        x, y, _ = tool.position
        here = self.arm.here
        across = Pose((x, y, max(height, min(here.position[2], height + 0.05))), tool.quaternion)
        yield from self.arm.along(swing(here, across, side, SWING_TURN_RAD), pace=1.2 * pace)
        yield from self.arm.go(tool, pace=CAREFUL * pace)


class Faltering(Routines):
    """Moves in short steps, retracts slightly after each, and overshoots at first."""

    def over(self, tool: Pose, *, hang_m: float = 0.0, ignore: Iterable[str] = (), pace: float = 1.0) -> Actions[None]:
        """Move up, across in short steps with an overshoot, and down to a pose of the tool."""
        start = self.arm.here
        top = highest_between(self.state, start.position, tool.position, ignore=frozenset(ignore))
        height = min(max(top + hang_m + self.arm.manner.carry_m, tool.position[2]), HIGHEST_TOOL_M)
        yield from self.arm.rise(height, pace=pace)
        begin = self.arm.here
        x, y, _ = tool.position
        across = Pose((x, y, max(height, min(begin.position[2], height + 0.05))), tool.quaternion)
        way = swing(begin, across, 0.0, 0.0)
        far = horizontal_distance(begin.position, across.position)
        for s in (0.4, 0.3, 0.75, 0.68, 1.0 + min(0.03 / max(far, 0.03), 0.3)) if far > SHORTEST_BOW_M else ():
            yield from self.arm.go(_straight(way, s), pace=1.4 * pace)
        yield from self.arm.go(across, pace=pace)
        yield from self.arm.go(tool, pace=CAREFUL * pace)


def _straight(way: Way, s: float) -> Pose:
    a, b = way(0.0), way(1.0)
    x, y, z = (p + s * (q - p) for p, q in zip(a.position, b.position, strict=True))
    return Pose((x, y, z), slerp(a.quaternion, b.quaternion, min(s, 1.0)))


class Sidling(Arcing):
    """Descends next to an object and approaches it from the side, low over the table, with one finger on each side."""

    def _best_opening(self, tool: Pose, width_m: float, name: str) -> tuple[float, float]:
        narrow = min(FULL_OPENING_M, width_m + NARROW_MARGIN_M)
        return narrow, self._cost(tool, narrow, frozenset({name}))

    def take_at(self, tool: Pose, opening_m: float, *, name: str | None = None) -> Actions[bool]:
        """Approach a pose from a free side, or from above if no side is free, and close the gripper there."""
        ux, uy, _ = rotate(tool.quaternion, (1.0, 0.0, 0.0))
        flat = max(math.hypot(ux, uy), 0.01)
        sides = [tool.translated(s * ASIDE_M * ux / flat, s * ASIDE_M * uy / flat) for s in (-1.0, 1.0)]
        skip = frozenset({name or ""})
        begin = min(sides, key=lambda p: crowding(self.state, p, opening_m, ignore=skip))
        middle = self.state.pose(name).position if name is not None else tool.position
        aside = opening_m <= WIDEST_ASIDE_M and horizontal_distance(middle, tool.position) < OFF_MIDDLE_M
        if not aside or crowding(self.state, begin, opening_m, ignore=skip) > 0.0:
            return (yield from super().take_at(tool, opening_m, name=name))
        if self.state.finger_width_m < opening_m - 0.01:
            yield from self.arm.rise(self.arm.here.position[2] + SAFE_M)
            yield from self.arm.open()
        yield from self.over(begin.translated(z=self.arm.manner.approach_m))
        yield from self.arm.narrow(opening_m)
        yield from self.arm.go(begin, pace=CAREFUL)
        yield from self.arm.go(tool, pace=CAREFUL)
        yield from self.arm.close()
        yield from self.arm.go(tool.translated(z=LIFT_M), pace=CAREFUL)
        return name is not None and in_gripper(self.state) == name


# --- motion styles of a complete policy


def shivering(body: Body, script: Actions[None]) -> Actions[None]:
    """Execute a script with an additional tremor of the tool, which is larger far above the objects."""
    phase = body.rng.uniform(0.0, 2.0 * math.pi, 3)
    step = 0
    action = next(script)
    while True:
        tool = body.state.ee_pose.position
        free = tool[2] - highest_between(body.state, tool, tool) > 0.10
        size = TREMOR_M if free else TREMOR_LOW_M
        now = size * np.sin(2.0 * math.pi * TREMOR_HZ * step / RATE_HZ * np.array((1.0, 1.3, 0.8)) + phase)
        shaken = np.array(action, dtype=float)
        shaken[:3] = np.clip(shaken[:3] + now / TRANSLATION_PER_UNIT_M, -1.0, 1.0)
        step += 1
        state = yield shaken
        action = script.send(state)


def open_height(body: Body, gap_m: float) -> float:
    """Return the height of the tool ``gap_m`` above all objects, including lids, limited by the reach [m]."""
    state = body.state
    tops = (max(height_of(state, o.name), state.pose(o.name).position[2] + o.size_m[2]) for o in state.info.objects)
    return min(max(tops) + gap_m, HIGHEST_FREE_M)


def circle_in(
    body: Body, center: Vector, until: int, *, low_m: float | None = None, speed_m_s: float = 0.09
) -> Actions[None]:
    """Circle around a point with decreasing radius until the control step ``until`` of the episode.

    The tool stays at the height of the point, or descends from there to ``low_m``.
    """
    turn, begin, angle = body.arm.here.quaternion, body.state.step, 0.0
    while body.state.step < until:
        left = 1.0 - (body.state.step - begin) / max(1, until - begin)
        radius = NARROW_M + (WIDE_M - NARROW_M) * left
        z = center[2] if low_m is None else low_m + (center[2] - low_m) * left
        angle += speed_m_s / (RATE_HZ * radius)
        x, y = center[0] + radius * math.cos(angle), center[1] + radius * math.sin(angle)
        at = (min(max(x, 0.33), 0.68), min(max(y, -0.34), 0.34), z)
        yield from body.arm.step(Pose(toward(body.arm.here.position, at, 0.012), turn))


def toward(a: Vector, b: Vector, most_m: float) -> Vector:
    """Return b, or the point on the path from a to b at a distance of ``most_m`` from a if b is farther away."""
    f = min(1.0, most_m / max(math.dist(a, b), 1e-9))
    return (a[0] + f * (b[0] - a[0]), a[1] + f * (b[1] - a[1]), a[2] + f * (b[2] - a[2]))


def tour(body: Body, height_m: float, until: int, *, pace: float = 0.4) -> Actions[None]:
    """Visit the corners of the workspace in turn until the control step ``until`` of the episode."""
    yield from body.arm.rise(height_m)
    n = 0
    while body.state.step < until:
        x, y = FAR_CORNERS[n % 4]
        target = Pose((x, y, height_m), body.arm.here.quaternion)
        far = max(1, math.ceil(math.dist(body.arm.here.position, target.position) / 0.08))
        begin = body.arm.here
        for i in range(1, far + 1):
            if body.state.step < until:
                yield from body.arm.go(_straight(swing(begin, target, 0.0, 0.0), i / far), pace=pace)
        n += 1


def drift(body: Body, direction: Vector, speed_m_s: float = 0.001) -> Actions[None]:
    """Drift very slowly in a direction until the episode ends, without a gripper command."""
    unit = speed_m_s / (RATE_HZ * TRANSLATION_PER_UNIT_M)
    while True:
        body.arm.state = yield np.array([*(unit * v for v in direction), 0.0, 0.0, 0.0, 0.0])


# --- failures


def lose_on_the_way(body: Body, target: Vector) -> Actions[None]:
    """Carry the held object toward a target, open the gripper early on the way, and continue to the target.

    Above the target, the gripper is commanded to open again.
    """
    arm = body.arm
    yield from arm.rise(arm.here.position[2] + 0.03)
    begin = arm.here
    end = Pose((target[0], target[1], max(target[2], begin.position[2])), begin.quaternion)
    part = min(0.45, LOST_AFTER_M / max(horizontal_distance(begin.position, end.position), LOST_AFTER_M))
    yield from arm.go(_straight(swing(begin, end, 0.0, 0.0), part), pace=0.8)
    arm.begin_to_open()
    yield from arm.wait(0.2)
    yield from arm.go(end, pace=0.8)
    yield from arm.open()


def beside_hold(body: Body, name: str) -> Pose:
    """Return a grasp pose that is shifted along the finger pads, so that the fingers close next to the object."""
    hold = body.do.choose_hold(name)
    ux, uy, _ = rotate(hold.tool.quaternion, (1.0, 0.0, 0.0))
    flat = max(math.hypot(ux, uy), 0.01)
    info, pose = body.state.info.object(name), body.state.pose(name)
    tx, ty, _ = rotate(pose.inverse().quaternion, (ux / flat, uy / flat, 0.0))
    half = 0.5 * (abs(tx) * info.size_m[0] + abs(ty) * info.size_m[1])
    ax = (hold.tool.position[0] - pose.position[0]) * ux + (hold.tool.position[1] - pose.position[1]) * uy
    others = [body.state.pose(o.name).position for o in body.state.info.objects if o.name != name]
    ways = []
    for sign in (1.0, -1.0):
        far = sign * (half + BESIDE_M) - ax / flat
        tool = hold.tool.translated(far * ux / flat, far * uy / flat)
        gap = min((horizontal_distance(tool.position, p) for p in others), default=1.0)
        ways.append((crowding(body.state, tool, 0.08, ignore=frozenset()) - gap, abs(far), tool))
    return min(ways, key=lambda w: w[:2])[2]


def close_over(body: Body, name: str, gap_m: float, turn_rad: float) -> Actions[None]:
    """Close the gripper ``gap_m`` above the top of an object, rotated away from its grasp, and rise."""
    hold = body.do.choose_hold(name)
    x, y, _ = hold.tool.position
    tool = Pose((x, y, body.height(name) + gap_m), turned(hold.tool.quaternion, turn_rad))
    yield from body.do.take_at(tool, 0.08)


def play_put(body: Body, goal: Subgoal) -> Actions[None]:
    """Move over a target, with or without an object, and open the gripper there."""
    x, y, _ = body.state.pose(goal.target).position
    yield from body.do.over(Pose((x, y, min(body.height(goal.target) + 0.12, 0.45)), body.arm.home.quaternion))
    yield from body.arm.open()


def wanted_place(body: Body, name: str, goal: Subgoal) -> Vector:
    """Return the position of an object at the target of a subgoal [m]."""
    return relation(goal.relation).place_goals(body.state, name, goal.target, goal.region)[0].pose.position


def run_into(body: Body, name: str, direction: Vector) -> Actions[None]:
    """Approach an object from the side with nearly closed fingers, shove it, retract slightly, close, and rise."""
    ux, uy, _ = direction
    info, (x, y, _) = body.state.info.object(name), body.state.pose(name).position
    reach = 0.5 * max(info.size_m[:2]) + 0.05
    low = max(0.016, min(0.5 * info.size_m[2], 0.05))
    turn = body.do.choose_hold(name).tool.quaternion
    begin = Pose((x - reach * ux, y - reach * uy, low), turn)
    yield from body.do.over(begin.translated(z=0.10))
    yield from body.arm.narrow(0.008)
    yield from body.arm.go(begin)
    yield from body.arm.go(begin.translated((reach + 0.02) * ux, (reach + 0.02) * uy), pace=CAREFUL)
    yield from body.arm.go(body.arm.here.translated(-0.02 * ux, -0.02 * uy), pace=CAREFUL)
    yield from body.arm.close()
    yield from body.arm.go(body.arm.here.translated(z=LIFT_M))


def put_crooked(body: Body, name: str, goal: Subgoal, angle_rad: float) -> Actions[None]:
    """Put the held object at its target, rotated about the vertical axis by an angle."""
    place = relation(goal.relation).place_goals(body.state, name, goal.target, goal.region)[0]
    pose = Pose(place.pose.position, turned(place.pose.quaternion, angle_rad))
    yield from body.do.put(name, PlaceGoal(pose, release_width_m=place.release_width_m))
    yield from body.arm.wait(CHECK_S)


def let_go_outside(body: Body, name: str, goal: Subgoal, gap_m: float) -> Actions[None]:
    """Carry the held object toward a target, and release it at a free point outside the edge of the target.

    The point is far from the slot of the object, so that it does not look as if the object is put back.
    """
    target, thing = body.state.info.object(goal.target), body.state.info.object(name)
    x, y, _ = body.state.pose(goal.target).position
    first = body.arm.log.first.pose(name).position
    far = 0.5 * math.hypot(*target.size_m[:2]) + 0.5 * max(thing.size_m[:2]) + gap_m
    rim = [(x + far * math.cos(a), y + far * math.sin(a), 0.0) for a in DIRECTIONS]
    others = [o.name for o in body.state.info.objects if o.name not in (name, goal.target)]

    def room(p: Vector) -> float:
        gap = min((horizontal_distance(body.state.pose(n).position, p) for n in others), default=1.0)
        away = min(0.0, horizontal_distance(first, p) - LAID_AWAY_M)
        return min(gap, 0.15) + 10.0 * away - 10.0 * max(0.34 - p[0], p[0] - 0.70, abs(p[1]) - 0.34, 0.0)

    px, py, _ = max(rim, key=room)
    end = Pose((px, py, body.arm.here.position[2]), body.arm.here.quaternion)
    yield from body.do.carry(name, end)
    yield from body.arm.go(end.translated(z=-0.03), pace=CAREFUL)
    yield from body.arm.open()
    yield from body.arm.rise(body.arm.home.position[2])
