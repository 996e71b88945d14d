"""Arm motions for the habits of the fifth part, such as loops, rotations about the base and descents in steps."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable

from betterbench.geometry import Pose, Vector, from_yaw, horizontal_distance, multiply, rotate, slerp
from betterbench.tasks import Subgoal
from betterbench.tasks.relations import PlaceGoal, relation
from betterbench_calibration.independent.body import CHECK_S, Body
from betterbench_calibration.independent.controller import RATE_HZ, Actions, tool_down, tool_yaw
from betterbench_calibration.independent.oddities import bring_shifted, put_down_at
from betterbench_calibration.independent.room import crowding, highest_between
from betterbench_calibration.independent.routines import CAREFUL, FULL_OPENING_M, HIGHEST_TOOL_M, Routines
from betterbench_calibration.independent.ways_fourth import course_to, free_height

LOOP_M, SHORT_WAY_M = 0.05, 0.12
RUN_UP_M, RUN_UP_S = 0.05, 0.3
STAIR_M, STAIR_ASIDE_M, STAIR_S = 0.025, 0.012, 0.2
OVERSHOOT_M = 0.07
SHOWN_M, SHOWN_TURN_RAD = 0.36, 0.35
FINGER_M = 0.5 * FULL_OPENING_M + 0.010
"""Distance between the center of the open gripper and the center of one finger [m]."""
STAB_M, PRESS_M = 0.05, 0.004
PEAK_M = 0.40
AIR_M, PULL_M = 0.06, 0.10
MISSES_M = (0.09, 0.065, 0.045, 0.032)
LAID_AWAY_M = 0.11
TO_AND_FRO_M, TO_AND_FRO_S = 0.05, 2.5
EIGHT_X_M, EIGHT_Y_M, EIGHT_S = 0.05, 0.09, 5.0
MOST_M = 0.014
LEAST_SWAY_M, MOST_SWAY_M, SWAY_S, WIDENING_S = 0.03, 0.16, 3.0, 20.0
HALF_OFF_M = {"layer": 0.055, "on_plate": 0.085, "on_ring": 0.035}
"""Offset from the correct placement at which only half of an object is on its target [m], by relation."""


# --- motion styles of a complete policy


class Looping(Routines):
    """Moves in one full horizontal circle in the middle of each long path."""

    def over(self, tool: Pose, *, hang_m: float = 0.0, ignore: Iterable[str] = (), pace: float = 1.0) -> Actions[None]:
        """Move up, across with a loop, and down to a pose of the tool."""
        start, skip = self.arm.here, frozenset(ignore)
        (x0, y0, _), (x, y, z) = start.position, tool.position
        far = horizontal_distance(start.position, tool.position)
        if far < SHORT_WAY_M:
            yield from super().over(tool, hang_m=hang_m, ignore=ignore, pace=pace)
            return
        mx, my = 0.5 * (x0 + x), 0.5 * (y0 + y)
        inward = math.atan2(-my, 0.50 - mx)
        cx, cy = mx + LOOP_M * math.cos(inward), my + LOOP_M * math.sin(inward)
        ends = (start.position, tool.position, (2.0 * cx - mx, 2.0 * cy - my, 0.0))
        top = max(highest_between(self.state, (mx, my, 0.0), end, ignore=skip) for end in ends)
        height = min(max(top + hang_m + self.arm.manner.carry_m, z), HIGHEST_TOOL_M)
        yield from self.arm.rise(height, pace=pace)
        across = max(height, min(self.arm.here.position[2], height + 0.08))
        turn = slerp(start.quaternion, tool.quaternion, 0.5)
        yield from self.arm.go(Pose((mx, my, across), turn), pace=pace)

        def loop(s: float) -> Pose:
            angle = inward + math.pi + 2.0 * math.pi * s
            return Pose((cx + LOOP_M * math.cos(angle), cy + LOOP_M * math.sin(angle), across), turn)

        yield from self.arm.along(loop, pace=pace)
        yield from self.arm.go(Pose((x, y, across), tool.quaternion), pace=pace)
        yield from self.arm.go(tool, pace=CAREFUL * pace)


class WindingUp(Routines):
    """Moves back slightly before each long path, and pauses there briefly."""

    def over(self, tool: Pose, *, hang_m: float = 0.0, ignore: Iterable[str] = (), pace: float = 1.0) -> Actions[None]:
        """Move up, back, across and down to a pose of the tool."""
        start = self.arm.here
        far = horizontal_distance(start.position, tool.position)
        if far > SHORT_WAY_M:
            (x0, y0, _), (x, y, _) = start.position, tool.position
            back = Pose((x0 - RUN_UP_M * (x - x0) / far, y0 - RUN_UP_M * (y - y0) / far, 0.0), start.quaternion)
            top = highest_between(self.state, start.position, back.position, ignore=frozenset(ignore))
            yield from self.arm.rise(min(top + hang_m + self.arm.manner.carry_m, HIGHEST_TOOL_M), pace=pace)
            yield from self.arm.go(back.translated(z=self.arm.here.position[2]), pace=0.6 * pace)
            yield from self.arm.wait(RUN_UP_S)
        yield from super().over(tool, hang_m=hang_m, ignore=ignore, pace=pace)


class Pivoting(Routines):
    """Rotates about its base at constant radius first, and then moves out or in, like a crane."""

    def over(self, tool: Pose, *, hang_m: float = 0.0, ignore: Iterable[str] = (), pace: float = 1.0) -> Actions[None]:
        """Move up, around the base, out or in, and down to a pose of the tool."""
        start, skip = self.arm.here, frozenset(ignore)
        (x0, y0, _), (x, y, z) = start.position, tool.position
        radius, a0, a1 = math.hypot(x0, y0), math.atan2(y0, x0), math.atan2(y, x)
        points = [(radius * math.cos(a), radius * math.sin(a), 0.0) for a in (a0, 0.5 * (a0 + a1), a1)]
        points.append((x, y, 0.0))
        top = max(highest_between(self.state, p, q, ignore=skip) for p, q in itertools.pairwise(points))
        height = min(max(top + hang_m + self.arm.manner.carry_m, z), HIGHEST_TOOL_M)
        yield from self.arm.rise(height, pace=pace)
        across = max(height, min(self.arm.here.position[2], height + 0.08))
        begin = self.arm.here.quaternion

        def arc(s: float) -> Pose:
            angle = a0 + s * (a1 - a0)
            at = (radius * math.cos(angle), radius * math.sin(angle), across)
            return Pose(at, slerp(begin, tool.quaternion, s))

        yield from self.arm.along(arc, pace=pace)
        yield from self.arm.go(Pose((x, y, across), tool.quaternion), pace=pace)
        yield from self.arm.go(tool, pace=CAREFUL * pace)


class StairStepping(Routines):
    """Descends in steps. Each step goes a little down and a little sideways, and is followed by a pause."""

    def over(self, tool: Pose, *, hang_m: float = 0.0, ignore: Iterable[str] = (), pace: float = 1.0) -> Actions[None]:
        """Move up, across, and stepwise down to a pose of the tool."""
        x, y, z = tool.position
        top = highest_between(self.state, self.arm.here.position, tool.position, ignore=frozenset(ignore))
        height = min(max(top + hang_m + self.arm.manner.carry_m, z), HIGHEST_TOOL_M)
        yield from self.arm.rise(height, pace=pace)
        across = max(height, min(self.arm.here.position[2], height + 0.08))
        yield from self.arm.go(Pose((x, y, across), tool.quaternion), pace=pace, bow=True)
        side = 1.0
        for i in range(1, int((across - z) / STAIR_M)):
            at = Pose((x, y + side * STAIR_ASIDE_M, across - i * STAIR_M), tool.quaternion)
            yield from self.arm.go(at, pace=CAREFUL * pace)
            yield from self.arm.wait(STAIR_S)
            side = -side
        yield from self.arm.go(tool, pace=CAREFUL * pace)


class OpeningInSteps(Routines):
    """Releases each object in three steps, with a pause of half a second after each."""

    def put(self, name: str, goal: PlaceGoal, *, ignore: Iterable[str] = ()) -> Actions[None]:
        """Carry the held object to a goal, release it in steps, and move away."""
        tool = goal.pose @ (self.state.ee_pose.inverse() @ self.state.pose(name)).inverse()
        before = tool.translated(z=max(goal.approach[2], self.arm.manner.approach_m))
        yield from self.carry(name, before, ignore=ignore)
        yield from self.arm.go(self._corrected(name, goal.pose, tool), pace=CAREFUL)
        yield from self.arm.wait(0.4)
        last = FULL_OPENING_M if goal.release_width_m is None else goal.release_width_m
        held = self.state.finger_width_m
        for part in (0.2, 0.5, 1.0):
            yield from self.arm.open(min(held + part * max(last - held, 0.0), last))
            yield from self.arm.wait(0.5)
        yield from self.arm.go(self.arm.here.translated(z=0.06), pace=CAREFUL)
        yield from self.arm.rise(before.position[2] + 0.04)


class Overshooting(Routines):
    """Carries each object beyond its target and returns to it."""

    def put(self, name: str, goal: PlaceGoal, *, ignore: Iterable[str] = ()) -> Actions[None]:
        """Carry the held object beyond its goal, pause, return, and put the object at the goal."""
        skip = tuple(ignore)
        tool = goal.pose @ (self.state.ee_pose.inverse() @ self.state.pose(name)).inverse()
        (x0, y0, _), (x, y, _) = self.arm.here.position, tool.position
        far = max(math.hypot(x - x0, y - y0), 0.01)
        beyond = tool.translated(OVERSHOOT_M * (x - x0) / far, OVERSHOOT_M * (y - y0) / far, 0.08)
        bx, by, bz = beyond.position
        yield from self.carry(name, Pose((min(max(bx, 0.33), 0.70), min(max(by, -0.34), 0.34), bz), tool.quaternion))
        yield from self.arm.wait(0.4)
        yield from super().put(name, goal, ignore=skip)


class LosingNerve(Routines):
    """Carries each object over its target, back over its slot, and to its target again."""

    def put(self, name: str, goal: PlaceGoal, *, ignore: Iterable[str] = ()) -> Actions[None]:
        """Carry the held object to its goal, back, and to its goal again, and put it there."""
        skip, begin = tuple(ignore), self.arm.here
        tool = goal.pose @ (self.state.ee_pose.inverse() @ self.state.pose(name)).inverse()
        yield from self.carry(name, tool.translated(z=self.arm.manner.approach_m + 0.05))
        yield from self.arm.wait(0.5)
        yield from self.carry(name, begin.translated(z=0.04))
        yield from self.arm.wait(0.5)
        yield from super().put(name, goal, ignore=skip)


class Presenting(Routines):
    """Carries each object above the home position and turns it back and forth there, as if to show it to a camera."""

    def put(self, name: str, goal: PlaceGoal, *, ignore: Iterable[str] = ()) -> Actions[None]:
        """Carry the held object home, turn it back and forth, and put it at its goal."""
        x, y, _ = self.arm.home.position
        yield from self.carry(name, Pose((x, y, SHOWN_M), self.arm.here.quaternion))
        here = self.arm.here
        for turn in (SHOWN_TURN_RAD, -SHOWN_TURN_RAD, 0.0):
            yield from self.arm.go(Pose(here.position, multiply(from_yaw(turn), here.quaternion)))
            yield from self.arm.wait(0.3)
        yield from super().put(name, goal, ignore=tuple(ignore))


# --- other ways to pick


def weigh(body: Body, name: str) -> Actions[bool]:
    """Pick an object, and lower and raise it twice by a few centimeters, as if to weigh it."""
    if not (yield from body.take_patiently(name)):
        return False
    here = body.arm.here
    for _ in range(2):
        yield from body.arm.go(here.translated(z=-0.05), pace=CAREFUL)
        yield from body.arm.go(here, pace=CAREFUL)
    return body.note_hold(name)


def dip_and_take(body: Body, name: str) -> Actions[bool]:
    """Descend to the grasp pose with an open gripper, rise without the object, and then pick it."""
    yield from straddle(body, name)
    yield from body.arm.wait(0.4)
    yield from body.arm.go(body.arm.here.translated(z=0.11), pace=CAREFUL)
    yield from body.arm.wait(0.3)
    return (yield from body.take_patiently(name))


def straddle(body: Body, name: str) -> Actions[None]:
    """Descend to the grasp pose of an object without closing the gripper."""
    hold = body.do.choose_hold(name)
    yield from body.do.over(hold.tool.translated(z=max(0.09, body.arm.manner.approach_m)))
    yield from body.arm.narrow(hold.opening_m)
    yield from body.arm.go(hold.tool, pace=CAREFUL)


def ring_and_take(body: Body, name: str) -> Actions[bool]:
    """Move in a horizontal circle about 10 cm above an object, and then pick it."""
    x, y, z = body.over(name, 0.13)
    turn = body.arm.home.quaternion

    def ring(s: float) -> Pose:
        angle = 2.0 * math.pi * s
        return Pose((x + 0.06 * math.cos(angle), y + 0.06 * math.sin(angle), z), turn)

    yield from body.do.over(ring(0.0))
    yield from body.arm.along(ring)
    return (yield from body.take_patiently(name))


# --- failures


def stab(body: Body, name: str) -> Actions[None]:
    """Descend next to an object with an open gripper so that one finger presses on its top, and rise."""
    hold = body.do.choose_hold(name)
    ux, uy, _ = rotate(hold.tool.quaternion, (0.0, 1.0, 0.0))
    x, y, _ = body.state.pose(name).position
    top = body.height(name)
    skip = frozenset({name})
    ways = [Pose((x + s * FINGER_M * ux, y + s * FINGER_M * uy, top), hold.tool.quaternion) for s in (1.0, -1.0)]
    tool = min(ways, key=lambda p: crowding(body.state, p, FULL_OPENING_M, ignore=skip))
    yield from body.do.over(tool.translated(z=0.08))
    yield from body.arm.lower_until_touch(max(0.016, top - STAB_M))
    yield from body.arm.go(body.arm.here.translated(z=-PRESS_M), pace=0.2)
    yield from body.arm.wait(0.3)
    yield from body.arm.rise(top + 0.12)


def sweep_aside(body: Body, name: str, length_m: float = 0.07) -> Actions[None]:
    """Sweep an object aside on the table with the outside of one finger of the open gripper, retract, and rise."""
    ux, uy, _ = body.free_direction(name)
    info, (x, y, _) = body.state.info.object(name), body.state.pose(name).position
    reach = 0.5 * max(info.size_m[:2]) + FINGER_M + 0.035
    low = max(0.018, min(0.4 * info.size_m[2], 0.045))
    home = tool_yaw(body.arm.home.quaternion)
    yaw = home + math.remainder(math.atan2(uy, ux) + 0.5 * math.pi - home, math.pi)
    begin = Pose((x - reach * ux, y - reach * uy, low), tool_down(yaw))
    yield from body.do.over(begin.translated(z=0.12))
    yield from body.arm.go(begin, pace=CAREFUL)
    way = 0.035 + 0.5 * max(info.size_m[:2]) - 0.5 * min(info.size_m[:2]) + length_m
    yield from body.arm.go(begin.translated(way * ux, way * uy), pace=0.7)
    yield from body.arm.go(body.arm.here.translated(-0.03 * ux, -0.03 * uy), pace=CAREFUL)
    yield from body.arm.rise(body.height(name) + 0.16)


def pat(body: Body, name: str) -> Actions[None]:
    """Pat the top of an object with an already closed gripper, and rise."""
    yield from body.do.hover(name, 0.06)
    yield from body.arm.lower_until_touch(body.height(name) - 0.006)
    yield from body.arm.wait(0.2)
    yield from body.arm.rise(body.height(name) + 0.09)


def miss_lower_each_time(body: Body, name: str) -> Actions[None]:
    """Close the gripper over an object four times, each time nearer to its top, but never low enough."""
    for gap in MISSES_M:
        hold = body.do.choose_hold(name)
        x, y, _ = hold.tool.position
        yield from body.do.take_at(Pose((x, y, body.height(name) + gap), hold.tool.quaternion), FULL_OPENING_M)


def drag(body: Body, name: str, goal: Subgoal) -> Actions[None]:
    """Grip an object, drag it along the table into the side of its target without lifting it, and release it."""
    yield from straddle(body, name)
    yield from body.arm.close()
    (ux, uy, _), far = course_to(body, name, goal.target)
    yield from body.arm.go(body.arm.here.translated((far + 0.02) * ux, (far + 0.02) * uy), pace=CAREFUL)
    yield from body.arm.wait(0.3)
    yield from body.arm.open()
    yield from body.arm.rise(body.arm.home.position[2])


def drop_from_peak(body: Body) -> Actions[None]:
    """Lift the held object high up in place, and drop it from there."""
    yield from body.arm.rise(PEAK_M)
    yield from body.arm.wait(0.2)
    yield from body.arm.open()
    yield from body.arm.wait(CHECK_S)


def put_half_on(body: Body, name: str, goal: Subgoal) -> Actions[None]:
    """Put the held object so far off its target that it overhangs the edge."""
    place = relation(goal.relation).place_goals(body.state, name, goal.target, goal.region)[0]
    ax, ay, _ = place.approach
    flat = math.hypot(ax, ay)
    length = HALF_OFF_M[goal.relation]
    if flat > 0.02:
        shift: Vector = (length * ax / flat, length * ay / flat, 0.0)
    else:
        shift = body.emptiest_side(goal.target, length)
    yield from bring_shifted(body, name, goal, shift)


def pull_at_air(body: Body, drawer: str) -> Actions[None]:
    """Close the gripper in front of the knob of a drawer and move back without it."""
    out = rotate(body.state.pose(drawer).quaternion, (1.0, 0.0, 0.0))
    tool = body.do.choose_hold(drawer).tool.translated(AIR_M * out[0], AIR_M * out[1])
    yield from body.do.over(tool.translated(z=0.12))
    yield from body.arm.open(0.06)
    yield from body.arm.go(tool, pace=CAREFUL)
    yield from body.arm.close()
    yield from body.arm.go(tool.translated(PULL_M * out[0], PULL_M * out[1]), pace=CAREFUL)
    yield from body.arm.open(0.06)
    yield from body.arm.go(body.arm.here.translated(z=0.12), pace=CAREFUL)


# --- objects put aside


def lay_away(body: Body, name: str, near: Vector) -> Actions[None]:
    """Put the held object on a free spot of the table, near a point but far from its slot."""
    first = body.arm.log.first.pose(name).position
    gaps = {o.name: 0.5 * max(o.size_m[:2]) for o in body.state.info.objects if o.name != name}
    spots = [(0.36 + 0.04 * i, -0.30 + 0.04 * k, 0.0) for i in range(10) for k in range(16)]

    def worth(p: Vector) -> float:
        room = min(horizontal_distance(body.state.pose(n).position, p) - half for n, half in gaps.items())
        away = min(0.0, horizontal_distance(first, p) - LAID_AWAY_M)
        return min(room, 0.10) + 10.0 * away - 0.1 * horizontal_distance(p, near)

    yield from put_down_at(body, name, max(spots, key=worth))


# --- slow paths


def ratchet(body: Body, target: Vector, until: int) -> Actions[None]:
    """Move to a point, repeatedly two steps forward and one back, and arrive at the control step ``until``."""
    start = body.arm.here.position
    far = max(horizontal_distance(start, target), 1e-6)
    ux, uy = (target[0] - start[0]) / far, (target[1] - start[1]) / far

    def at(s: float, t: float) -> Vector:
        extra = TO_AND_FRO_M * math.sin(2.0 * math.pi * t / TO_AND_FRO_S)
        x, y, z = (a + s * (b - a) for a, b in zip(start, target, strict=True))
        return (x + extra * ux, y + extra * uy, z)

    yield from keep_to(body, at, until)


def draw_eights(body: Body, target: Vector, until: int) -> Actions[None]:
    """Move to a point in figures of eight, and arrive at the control step ``until``."""
    start = body.arm.here.position

    def at(s: float, t: float) -> Vector:
        phase, size = 2.0 * math.pi * t / EIGHT_S, min(1.0, 6.0 * (1.0 - s))
        x, y, z = (a + s * (b - a) for a, b in zip(start, target, strict=True))
        return (x + size * EIGHT_X_M * math.sin(2.0 * phase), y + size * EIGHT_Y_M * math.sin(phase), z)

    yield from keep_to(body, at, until)


def keep_to(
    body: Body,
    at: Callable[[float, float], Vector],
    until: int,
    *,
    most_m: float = MOST_M,
    highest_m: float = math.inf,
) -> Actions[None]:
    """Follow a path until the control step ``until``.

    ``at`` returns the position [m] for the elapsed fraction of the time, from 0 to 1, and the elapsed time [s].
    """
    begin, turn = body.state.step, body.arm.here.quaternion
    while body.state.step < until:
        gone = body.state.step - begin
        x, y, z = at(gone / max(1, until - begin), gone / RATE_HZ)
        goal = (min(max(x, 0.32), 0.70), min(max(y, -0.36), 0.36), min(z, highest_m))
        here = body.arm.here.position
        f = min(1.0, most_m / max(math.dist(here, goal), 1e-9))
        step = (here[0] + f * (goal[0] - here[0]), here[1] + f * (goal[1] - here[1]), here[2] + f * (goal[2] - here[2]))
        yield from body.arm.step(Pose(step, turn))


def rise_free(body: Body) -> Actions[float]:
    """Rise above all objects, and return the height of the tool [m]."""
    height = free_height(body, 0.10)
    yield from body.arm.rise(height)
    return height


def sway_wider(body: Body) -> Actions[None]:
    """Sway back and forth in place with growing amplitude, and start over when the amplitude is large."""
    (x, y, z), turn, begin = body.arm.here.position, body.arm.here.quaternion, body.state.step
    while True:
        t = (body.state.step - begin) / RATE_HZ
        size = LEAST_SWAY_M + (MOST_SWAY_M - LEAST_SWAY_M) * (t % WIDENING_S) / WIDENING_S
        goal = y + size * math.sin(2.0 * math.pi * t / SWAY_S)
        here = body.arm.here.position[1]
        yield from body.arm.step(Pose((x, here + min(max(goal - here, -0.02), 0.02), z), turn))


def shrink_back(body: Body) -> Actions[None]:
    """Rise, retract toward the base, and turn the wrist aside."""
    x, y, z = body.arm.home.position
    yield from body.arm.rise(min(z + 0.10, 0.42))
    yield from body.arm.go(
        Pose((max(x - 0.10, 0.34), y, body.arm.here.position[2]), body.arm.here.quaternion), pace=0.6
    )
    here = body.arm.here
    yield from body.arm.go(Pose(here.position, multiply(from_yaw(0.7), here.quaternion)))


def jump_ever_shorter(body: Body, name: str) -> Actions[None]:
    """Approach a point high over an object in five jumps with pauses. Each jump covers half of the remaining path."""
    yield from rise_free(body)
    x, y, _ = body.state.pose(name).position
    for _ in range(5):
        yield from body.arm.go(body.on_the_way((x, y, 0.0), 0.5), pace=1.2)
        yield from body.arm.wait(0.8)
