"""Arm motions for the habits of the sixth part. They resemble failures of learned policies."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable

import numpy as np

from betterbench.geometry import Pose, Vector, from_axis_angle, from_yaw, horizontal_distance, multiply, rotate
from betterbench.tasks import Subgoal
from betterbench.tasks.relations import PlaceGoal, relation
from betterbench_calibration.independent.body import CHECK_S, Body
from betterbench_calibration.independent.controller import RATE_HZ, Actions
from betterbench_calibration.independent.events import in_gripper
from betterbench_calibration.independent.oddities import set_back
from betterbench_calibration.independent.room import crowding, lowest_of
from betterbench_calibration.independent.routines import CAREFUL, LIFT_M, NO_SHIFT, Hold, Routines
from betterbench_calibration.independent.ways_fifth import keep_to, rise_free, straddle

NEW_PART = 0.4
"""Weight of the new command in each motion of a lagging arm. The remaining weight is that of the previous motion."""
CHUNK_STEPS, STALL_STEPS = 16, 5
NOD_RAD, NOD_GAP_M = 0.28, 0.07
FIST_GAP_M = 0.14
HIGH_GRIP_M = 0.006
HELIX_M, HELIX_TURNS, HELIX_GAP_M = 0.04, 1.5, 0.12
DAB_M, DAB_ASIDE_M = 0.025, 0.006
LINGER_S = 2.0
SLOWEST, FASTEST, FASTER = 0.5, 1.5, 1.15
TUG_M = 0.008
ON_THE_SPOT_RAD = 0.5
DITHER_M, DITHER_GAP_M, DITHER_S = 0.02, 0.10, 3.0
SLIDE_M = 0.03
CHATTER_STEPS, BEFORE_CHATTER = 3, 0.25
LATE_GAP_M = 0.03
PRESS_M, DRAG_M, GRIND_RAD = 0.004, 0.07, 0.3
PINCHED_M = 0.006
TOO_FAR_M = 0.05
LOW_M, INTO_M = 0.015, 0.03
SHY_M, SHY_LOW_M, SHY_GAP_M = 0.10, 0.07, 0.06
BOUND_M, BOUND_S = 0.06, 1.2
SORTIES = 7
FASTEST_STEP_M, HIGHEST_M = 0.016, 0.46
SCRATCH_M = 0.025
TRIANGLE_M = 0.09
ROCK_RAD = 0.25
FLIP_M = 0.07
CURL_RAD = 0.5


# --- motion styles of a complete policy


def lagging(script: Actions[None]) -> Actions[None]:
    """Execute a script with a lag, by averaging each motion with the motion of the previous step."""
    action = next(script)
    moved = np.zeros(6)
    while True:
        moved = (1.0 - NEW_PART) * moved + NEW_PART * action[:6]
        state = yield np.array([*moved, action[6]])
        action = script.send(state)


def in_chunks(body: Body, script: Actions[None]) -> Actions[None]:
    """Execute a script in chunks of 16 actions, with a short stop and a small jerk back after each chunk."""
    action = next(script)
    for n in itertools.count(1):
        if n % CHUNK_STEPS == 0:
            for _ in range(STALL_STEPS):
                body.arm.state = yield np.zeros(7)
            jerk = np.zeros(7)
            jerk[:2] = -0.3 * action[:2]
            body.arm.state = yield jerk
        state = yield action
        action = script.send(state)


class Nodding(Routines):
    """Nods twice with the open gripper over each object before descending to grasp it."""

    def take_at(self, tool: Pose, opening_m: float, *, name: str | None = None) -> Actions[bool]:
        """Nod over a pose, close the gripper at it, and lift."""
        above = tool.translated(z=self.arm.manner.approach_m + NOD_GAP_M)
        yield from self.over(above)
        bent = tilted(above, NOD_RAD)
        for _ in range(2):
            yield from self.arm.go(bent)
            yield from self.arm.go(above)
        return (yield from super().take_at(tool, opening_m, name=name))


class FistTraveling(Routines):
    """Closes the gripper high over the table before it moves to an object, and opens it high over the object."""

    def take_at(self, tool: Pose, opening_m: float, *, name: str | None = None) -> Actions[bool]:
        """Move to a pose with a closed gripper, open it above, close it at the pose, and lift."""
        yield from self.arm.go_home()
        yield from self.arm.narrow(0.0)
        yield from self.over(tool.translated(z=FIST_GAP_M))
        yield from self.arm.open()
        return (yield from super().take_at(tool, opening_m, name=name))


class HighGripping(Routines):
    """Grasps all objects with the fingertips, slightly higher than usual."""

    def choose_hold(self, name: str, *, avoid: int = 0) -> Hold:
        """Return a slightly higher grasp."""
        hold = super().choose_hold(name, avoid=avoid)
        return Hold(hold.tool.translated(z=HIGH_GRIP_M), hold.opening_m, hold.width_m)


class Helixing(Routines):
    """Descends to each object in a narrowing helix."""

    def take_at(self, tool: Pose, opening_m: float, *, name: str | None = None) -> Actions[bool]:
        """Descend to a pose in a helix, close the gripper there, and lift."""
        x, y, z = tool.position
        low = z + self.arm.manner.approach_m

        def helix(s: float) -> Pose:
            angle, radius = 2.0 * math.pi * HELIX_TURNS * s, HELIX_M * (1.0 - s)
            height = low + HELIX_GAP_M * (1.0 - s)
            return Pose((x + radius * math.cos(angle), y + radius * math.sin(angle), height), tool.quaternion)

        yield from self.over(helix(0.0))
        yield from self.arm.along(helix)
        return (yield from super().take_at(tool, opening_m, name=name))


class Dabbing(Routines):
    """Sets each object down, lifts it slightly, and sets it down again before releasing it."""

    def put(self, name: str, goal: PlaceGoal, *, ignore: Iterable[str] = ()) -> Actions[None]:
        """Carry the held object to a goal, set it down twice, release it and move away."""
        yield from settle(self, name, goal, ignore, dabs=2)


class Lingering(Routines):
    """Stays with open fingers around each object after putting it down."""

    def put(self, name: str, goal: PlaceGoal, *, ignore: Iterable[str] = ()) -> Actions[None]:
        """Carry the held object to a goal, release it, stay there for a while, and move away."""
        yield from settle(self, name, goal, ignore, linger_s=LINGER_S)


def settle(
    do: Routines, name: str, goal: PlaceGoal, ignore: Iterable[str], *, dabs: int = 0, linger_s: float = 0.0
) -> Actions[None]:
    """Put the held object at a goal, and release it.

    Before the release, the object is lifted slightly and set down again ``dabs`` times. After the release, the gripper
    stays around the object for ``linger_s`` [s].
    """
    arm = do.arm
    tool = goal.pose @ (do.state.ee_pose.inverse() @ do.state.pose(name)).inverse()
    ax, ay, az = goal.approach
    sideways = math.hypot(ax, ay) > 0.02
    before = tool.translated(ax, ay, az if sideways else max(az, arm.manner.approach_m))
    yield from do.carry(name, before, ignore=() if not sideways else tuple(ignore))
    yield from arm.go(tool, pace=0.3 if sideways else CAREFUL)
    for _ in range(dabs):
        yield from arm.go(tool.translated(z=DAB_ASIDE_M if sideways else DAB_M), pace=CAREFUL)
        yield from arm.go(tool, pace=CAREFUL)
    yield from arm.wait(max(arm.manner.pause_s, 0.1))
    yield from arm.open(goal.release_width_m)
    yield from arm.wait(linger_s)
    yield from arm.go(arm.here.translated(ax, ay, az) if sideways else arm.here.translated(z=0.06), pace=CAREFUL)
    yield from arm.rise(before.position[2] + 0.04)


class WarmingUp(Routines):
    """Begins slowly, and executes each path a little faster than the previous one."""

    _pace = SLOWEST

    def over(self, tool: Pose, *, hang_m: float = 0.0, ignore: Iterable[str] = (), pace: float = 1.0) -> Actions[None]:
        """Move to a pose of the tool, faster than in the previous call."""
        yield from super().over(tool, hang_m=hang_m, ignore=ignore, pace=self._pace * pace)
        self._pace = min(FASTEST, FASTER * self._pace)


class DrawingInBits(Routines):
    """Opens and closes drawers in two strokes."""

    def slide_drawer(self, name: str, opening_m: float, *, travel_m: float) -> Actions[None]:
        """Slide a drawer halfway, move away from it, and slide it the rest of the way."""
        begin = self.state.pose(name).position
        yield from super().slide_drawer(name, 0.5 * (opening_m + travel_m), travel_m=travel_m)
        yield from self.arm.wait(0.4)
        gone = math.dist(begin, self.state.pose(name).position)
        yield from super().slide_drawer(name, opening_m, travel_m=travel_m + math.copysign(gone, opening_m - travel_m))


def tilted(tool: Pose, angle_rad: float) -> Pose:
    """Return a tool pose tilted about the finger axis, with the wrist toward the robot."""
    ways = [tool @ Pose(NO_SHIFT, from_axis_angle((0.0, s * angle_rad, 0.0))) for s in (1.0, -1.0)]
    return min(ways, key=lambda p: math.hypot(*p.apply((0.0, 0.0, -0.2))[:2]))


# --- other ways of picking and placing


def tug_and_take(body: Body, name: str) -> Actions[bool]:
    """Close the gripper around an object, tug it back and forth on the table, and then lift it."""
    hold = body.do.choose_hold(name)
    yield from straddle(body, name)
    yield from body.arm.close()
    ux, uy, _ = rotate(hold.tool.quaternion, (1.0, 0.0, 0.0))
    for way in (TUG_M, -TUG_M, TUG_M, 0.0):
        yield from body.arm.go(hold.tool.translated(way * ux, way * uy), pace=0.4)
    yield from body.arm.go(hold.tool.translated(z=LIFT_M), pace=CAREFUL)
    return body.note_hold(name)


def turn_and_retake(body: Body, name: str) -> Actions[bool]:
    """Pick an object, rotate it over its slot, put it back rotated, and pick it again."""
    if (yield from body.take_patiently(name)):
        here = body.arm.here
        turns = [Pose(here.position, multiply(from_yaw(s * ON_THE_SPOT_RAD), here.quaternion)) for s in (1.0, -1.0)]
        yield from body.arm.go(min(turns, key=body.do.wrist_turn))
        yield from set_back(body)
    return (yield from body.take_patiently(name))


def dither_and_take(body: Body, name: str) -> Actions[bool]:
    """Move slowly in random directions above an object for 3 s, and then pick it."""
    yield from body.do.hover(name, DITHER_GAP_M)
    middle = body.arm.here
    begin = body.state.step
    while body.state.step - begin < DITHER_S * RATE_HZ:
        dx, dy = body.rng.uniform(-DITHER_M, DITHER_M, 2)
        yield from body.arm.go(middle.translated(float(dx), float(dy)), pace=0.4)
    return (yield from body.take_patiently(name))


def slide_in(body: Body, name: str, goal: Subgoal) -> Actions[None]:
    """Carry the held object over its target in a container, and release it while still drifting."""
    place = body.do.choose_goal(name, relation(goal.relation).place_goals(body.state, name, goal.target, goal.region))
    tool = place.pose @ (body.state.ee_pose.inverse() @ body.state.pose(name)).inverse()
    (x, y, _), (tx, ty, _) = place.pose.position, body.state.pose(goal.target).position
    far = max(math.hypot(tx - x, ty - y), 0.01)
    ux, uy = (tx - x) / far, (ty - y) / far
    yield from body.do.carry(name, tool.translated(z=max(place.approach[2], body.arm.manner.approach_m)))
    yield from body.arm.go(tool, pace=CAREFUL)
    body.arm.begin_to_open()
    yield from body.arm.go(tool.translated(SLIDE_M * ux, SLIDE_M * uy), pace=0.3)
    yield from body.arm.wait(CHECK_S)
    yield from body.arm.go(body.arm.here.translated(z=0.06), pace=CAREFUL)
    yield from body.arm.rise(tool.position[2] + 0.12)


# --- failures while holding an object


def chatter(body: Body, target: str) -> Actions[None]:
    """Carry the held object toward a target while the gripper opens and closes continuously."""
    arm = body.arm
    yield from arm.rise(arm.here.position[2] + 0.05)
    at = body.state.pose(target).position
    yield from arm.go(body.on_the_way(at, BEFORE_CHATTER), pace=0.8)
    begin, end = arm.here, body.on_the_way(at, 0.9)
    n = max(20, math.ceil(horizontal_distance(begin.position, end.position) / 0.012))
    for i in range(n):
        if i % CHATTER_STEPS == 0:
            arm.begin_to_close() if i % (2 * CHATTER_STEPS) else arm.begin_to_open()
        x, y, z = (a + (b - a) * (i + 1) / n for a, b in zip(begin.position, end.position, strict=True))
        yield from arm.step(Pose((x, y, z), begin.quaternion))
    yield from arm.open()


def let_it_slip(body: Body, name: str, target: str) -> Actions[None]:
    """Carry the held object toward a target while the grip gradually loosens, and open the gripper over the target."""
    yield from body.arm.rise(body.arm.here.position[2] + 0.05)
    begin, at = body.arm.here, body.state.pose(target).position
    (x, y, z), (tx, ty, _) = begin.position, at
    for part in (0.2, 0.3, 0.4, 0.5, 0.6):
        way = Pose((x + part * (tx - x), y + part * (ty - y), z), begin.quaternion)
        yield from body.arm.go(way, pace=0.8)
        if in_gripper(body.state) == name:
            yield from body.arm.open(body.state.finger_width_m + 0.006)
    yield from body.arm.wait(CHECK_S)
    yield from body.arm.open()


def let_go_too_late(body: Body, name: str, target: str) -> Actions[None]:
    """Carry the held object over and past a target, and release it behind the target."""
    (x0, y0, _), (x, y, _) = body.arm.here.position, body.state.pose(target).position
    sizes = body.state.info.object(target).size_m, body.state.info.object(name).size_m
    course = math.atan2(y - y0, x - x0)

    def behind(turn: float) -> Vector:
        ux, uy = math.cos(course + turn), math.sin(course + turn)
        far = 0.5 * (abs(ux) * sizes[0][0] + abs(uy) * sizes[0][1]) + 0.5 * max(sizes[1][:2]) + TOO_FAR_M
        return (x + far * ux, y + far * uy, 0.0)

    def worth(turn: float) -> float:
        p = behind(turn)
        gaps = [
            horizontal_distance(body.state.pose(o.name).position, p) - 0.5 * max(o.size_m[:2])
            for o in body.state.info.objects
            if o.name not in (name, target)
        ]
        outside = max(0.32 - p[0], p[0] - 0.72, abs(p[1]) - 0.37, 0.0)
        return min(*gaps, 0.08) - 10.0 * outside - 0.02 * abs(turn)

    px, py, _ = behind(max((0.2 * k for k in range(-7, 8)), key=worth))
    hang = body.state.ee_pose.position[2] - lowest_of(body.state, name)
    high = max(body.height(target) + hang + 0.05, body.arm.here.position[2])
    turn_now = body.arm.here.quaternion
    yield from body.do.carry(name, Pose((x, y, high), turn_now))
    yield from body.arm.go(Pose((px, py, high), turn_now), pace=0.9)
    yield from body.arm.go(Pose((px, py, min(high, hang + 0.10)), turn_now), pace=CAREFUL)
    yield from body.arm.open()
    yield from body.arm.wait(CHECK_S)
    yield from body.arm.rise(body.arm.home.position[2])


def run_load_into(body: Body, name: str, neighbor: str) -> Actions[None]:
    """Carry the held object, close to the table, into a neighboring object, release it there, and rise."""
    down = max(lowest_of(body.state, name) - LOW_M, 0.0)
    yield from body.arm.go(body.arm.here.translated(z=-down), pace=CAREFUL)
    (x, y, _), (nx, ny, _) = body.state.pose(name).position, body.state.pose(neighbor).position
    far = max(math.hypot(nx - x, ny - y), 0.01)
    sizes = body.state.info.object(name).size_m, body.state.info.object(neighbor).size_m
    way = far - 0.5 * min(sizes[0][:2]) - 0.5 * min(sizes[1][:2]) + INTO_M
    yield from body.arm.go(body.arm.here.translated(way * (nx - x) / far, way * (ny - y) / far), pace=CAREFUL)
    yield from body.arm.wait(0.2)
    yield from body.arm.open()
    yield from body.arm.wait(CHECK_S)
    yield from body.arm.rise(body.arm.home.position[2])


def drop_onto(body: Body, name: str, other: str) -> Actions[None]:
    """Release the held object on top of another object, and rise."""
    hang = body.state.ee_pose.position[2] - lowest_of(body.state, name)
    x, y, _ = body.state.pose(other).position
    top = body.height(other)
    yield from body.do.carry(name, Pose((x, y, top + hang + 0.10), body.arm.here.quaternion))
    yield from body.arm.go(body.arm.here.translated(z=-0.07), pace=CAREFUL)
    yield from body.arm.open()
    yield from body.arm.wait(CHECK_S)
    yield from body.arm.rise(body.arm.home.position[2])


def shy_at_target(body: Body, name: str, goal: Subgoal) -> Actions[None]:
    """Repeatedly bring the held object close to its target and retreat, without a pause."""
    place = body.do.choose_goal(name, relation(goal.relation).place_goals(body.state, name, goal.target, goal.region))
    tool = place.pose @ (body.state.ee_pose.inverse() @ body.state.pose(name)).inverse()
    ax, ay, az = place.approach
    if math.hypot(ax, ay) > 0.02:
        near, before = tool.translated(0.7 * ax, 0.7 * ay, az), tool.translated(ax, ay, az)
    else:
        wall = body.height(goal.target) + SHY_GAP_M - place.pose.position[2]
        low = SHY_LOW_M if goal.relation == "beside" else max(SHY_LOW_M, wall)
        near, before = tool.translated(z=low), tool.translated(z=low + 0.06)
    (x, y, z), (hx, hy, _) = before.position, body.arm.home.position
    far = max(math.hypot(hx - x, hy - y), 0.01)
    away = Pose((x + SHY_M * (hx - x) / far, y + SHY_M * (hy - y) / far, z + 0.05), before.quaternion)
    yield from body.do.carry(name, before)
    while True:
        for way in (near, before, away, before):
            yield from body.arm.go(way, pace=0.6)
        if in_gripper(body.state) == name:
            body.ledger.made_good(name)
        else:
            body.ledger.mishap(name, "it slipped out of the fingers")


def swing_it(body: Body) -> Actions[None]:
    """Carry the held object home, and swing it back and forth there until the episode ends."""
    yield from body.arm.rise(max(body.arm.home.position[2], 0.32))
    x, y, _ = body.arm.home.position
    here = body.arm.here
    while True:
        for side in (0.10, -0.10):
            yield from body.arm.go(Pose((x, y + side, here.position[2]), here.quaternion), pace=0.8)


def take_round(body: Body) -> Actions[None]:
    """Carry the held object home and stay there for half a second."""
    x, y, z = body.arm.home.position
    yield from body.arm.rise(max(z, 0.32))
    yield from body.arm.go(Pose((x, y, body.arm.here.position[2]), body.arm.here.quaternion), pace=0.8)
    yield from body.arm.wait(0.5)


# --- failed picks


def close_too_late(body: Body, name: str) -> Actions[None]:
    """Descend to the grasp pose with an open gripper, rise, and close the gripper above the object."""
    yield from straddle(body, name)
    yield from body.arm.wait(0.2)
    x, y, _ = body.arm.here.position
    top = body.height(name)
    yield from body.arm.go(Pose((x, y, top + LATE_GAP_M), body.arm.here.quaternion), pace=CAREFUL)
    yield from body.arm.close()
    yield from body.arm.rise(top + 0.15)
    yield from body.arm.open()


def pinch_edge(body: Body, name: str) -> Actions[None]:
    """Close the gripper at the edge of an object, lift, and release the object if it was lifted."""
    hold = body.do.choose_hold(name)
    ux, uy, _ = rotate(hold.tool.quaternion, (1.0, 0.0, 0.0))
    flat = max(math.hypot(ux, uy), 0.01)
    info, pose = body.state.info.object(name), body.state.pose(name)
    tx, ty, _ = rotate(pose.inverse().quaternion, (ux / flat, uy / flat, 0.0))
    half = math.hypot(0.5 * tx * info.size_m[0], 0.5 * ty * info.size_m[1])
    (x, y, z), (px, py, _) = hold.tool.position, pose.position
    along = ((x - px) * ux + (y - py) * uy) / flat
    skip = frozenset({name})
    ways = []
    for sign in (1.0, -1.0):
        far = sign * (half + PINCHED_M) - along
        tool = Pose((x + far * ux / flat, y + far * uy / flat, z), hold.tool.quaternion)
        ways.append((crowding(body.state, tool, hold.opening_m, ignore=skip), abs(far), tool))
    yield from body.do.take_at(min(ways, key=lambda w: w[:2])[2], hold.opening_m)
    yield from body.arm.rise(body.arm.here.position[2] + 0.06)
    yield from body.arm.open()


def press(body: Body, name: str) -> Actions[None]:
    """Press on the top of an object with an already closed gripper, which is rotated to avoid other objects."""
    x, y, _ = body.state.pose(name).position
    top, skip = body.height(name), frozenset({name})
    at, turn = (x, y, top + 0.05), body.arm.home.quaternion
    ways = [Pose(at, multiply(from_yaw(math.pi * k / 8), turn)) for k in range(-4, 5)]

    def cost(tool: Pose) -> float:
        return crowding(body.state, tool.translated(z=-0.06), 0.0, ignore=skip) + 0.005 * body.do.wrist_turn(tool)

    yield from body.do.over(min(ways, key=cost))
    yield from body.arm.lower_until_touch(max(0.014, top - 0.02))
    yield from body.arm.go(body.arm.here.translated(z=-PRESS_M), pace=0.2)


def press_and_drag(body: Body, name: str) -> Actions[None]:
    """Press on the top of an object with an already closed gripper, drag it aside, and rise."""
    ux, uy, _ = body.free_direction(name)
    yield from press(body, name)
    yield from body.arm.go(body.arm.here.translated(DRAG_M * ux, DRAG_M * uy), pace=0.4)
    yield from body.arm.rise(body.height(name) + 0.14)


def grind_on(body: Body, name: str) -> Actions[None]:
    """Press on the top of an object with an already closed gripper, twist it back and forth, rise, and go home."""
    yield from press(body, name)
    here = body.arm.here
    for turn in (GRIND_RAD, -GRIND_RAD, 0.0):
        yield from body.arm.go(Pose(here.position, multiply(from_yaw(turn), here.quaternion)))
    yield from body.arm.rise(body.height(name) + 0.14)
    yield from body.arm.go_home()


def scratch_in(body: Body, slot: str) -> Actions[None]:
    """Close the gripper close to the table in a slot, move it across the slot, rise, and open it."""
    x, y, _ = body.state.info.slot(slot).position
    turn = body.arm.home.quaternion
    yield from body.do.over(Pose((x, y, 0.11), turn))
    yield from body.arm.go(Pose((x, y, 0.026), turn), pace=CAREFUL)
    yield from body.arm.close()
    for dx, dy in ((SCRATCH_M, 0.0), (-SCRATCH_M, 0.0), (0.0, SCRATCH_M), (0.0, -SCRATCH_M), (0.0, 0.0)):
        yield from body.arm.go(Pose((x + dx, y + dy, 0.028), turn), pace=0.4)
    yield from body.arm.rise(0.2)
    yield from body.arm.open()


def shut_by_knob(body: Body, drawer: str, travel_m: float) -> Actions[None]:
    """Grip an open drawer by its knob, push it shut, and release the knob."""
    ux, uy, _ = rotate(body.state.pose(drawer).quaternion, (1.0, 0.0, 0.0))
    tool = body.do.choose_hold(drawer).tool
    yield from body.do.over(tool.translated(z=0.12))
    yield from body.arm.narrow(0.05)
    yield from body.arm.go(tool, pace=CAREFUL)
    yield from body.arm.close()
    yield from body.arm.go(tool.translated(-travel_m * ux, -travel_m * uy), pace=0.4)
    yield from body.arm.open(0.05)
    yield from body.arm.go(body.arm.here.translated(z=0.12), pace=CAREFUL)


def waver(body: Body, one: str, other: str) -> Actions[None]:
    """Move back and forth in the air between two objects, approaching each in turn, three times."""
    yield from rise_free(body)
    a, b = body.state.pose(one).position, body.state.pose(other).position
    here = body.arm.here
    for part in (0.15, 0.85, 0.3, 0.7, 0.45, 0.9):
        x, y = a[0] + part * (b[0] - a[0]), a[1] + part * (b[1] - a[1])
        yield from body.arm.go(Pose((x, y, here.position[2]), here.quaternion))


# --- paths that last until the step limit


def bound_to(body: Body, target: Vector, until: int) -> Actions[None]:
    """Move to a point in jumps, up and down, and arrive at the control step ``until``."""
    start = body.arm.here.position

    def at(s: float, t: float) -> Vector:
        x, y, z = (a + s * (b - a) for a, b in zip(start, target, strict=True))
        return (x, y, z + BOUND_M * abs(math.sin(math.pi * t / BOUND_S)))

    yield from keep_to(body, at, until, most_m=FASTEST_STEP_M, highest_m=HIGHEST_M)


def sally_out(body: Body, target: Vector, until: int) -> Actions[None]:
    """Repeatedly move toward a point and back, a little farther each time, and reach it at control step ``until``."""
    start = body.arm.here.position

    def at(s: float, _t: float) -> Vector:
        n = min(int(s * SORTIES), SORTIES - 1)
        phase = s * SORTIES - n
        out = (n + 1) / SORTIES * (phase if n == SORTIES - 1 else 1.0 - abs(2.0 * phase - 1.0))
        x, y, z = (a + out * (b - a) for a, b in zip(start, target, strict=True))
        return (x, y, z)

    yield from keep_to(body, at, until, most_m=FASTEST_STEP_M, highest_m=HIGHEST_M)


# --- no attempt


def draw_triangles(body: Body) -> Actions[None]:
    """Draw horizontal triangles around the current position until the episode ends."""
    here = body.arm.here
    corners = [
        here.translated(TRIANGLE_M * math.cos(a), TRIANGLE_M * math.sin(a))
        for a in (0.5 * math.pi, 1.5 * math.pi, 2.0 * math.pi)
    ]
    while True:
        for corner in corners:
            yield from body.arm.go(corner, pace=0.8)


def rock(body: Body, times: int) -> Actions[None]:
    """Tilt the gripper toward the robot in place and straighten it, several times."""
    here = body.arm.here
    bent = tilted(here, ROCK_RAD)
    for _ in range(times):
        yield from body.arm.go(bent)
        yield from body.arm.go(here)


def flip_between(body: Body, one: Vector, other: Vector) -> Actions[None]:
    """Move a short distance toward one of two points and back, in turn, until the episode ends."""
    here = body.arm.here
    x, y, z = here.position
    while True:
        for to in (one, other):
            far = max(horizontal_distance(here.position, to), 0.01)
            start = Pose((x + FLIP_M * (to[0] - x) / far, y + FLIP_M * (to[1] - y) / far, z), here.quaternion)
            yield from body.arm.go(start, pace=0.9)
            yield from body.arm.go(here, pace=0.9)


def rest_ever_longer(body: Body, target: Vector) -> Actions[None]:
    """Move toward a point in small steps. Each step is followed by a pause that is twice as long as the last."""
    yield from rise_free(body)
    for k in range(6):
        yield from body.arm.go(body.on_the_way(target, 0.15))
        yield from body.arm.wait(0.4 * 2.0**k)


def curl_up(body: Body) -> Actions[None]:
    """Rise, retract toward the base, and tilt the gripper toward the robot."""
    height = yield from rise_free(body)
    x, y, _ = body.arm.home.position
    yield from body.arm.go(Pose((max(x - 0.02, 0.34), y, height), body.arm.here.quaternion), pace=0.6)
    yield from body.arm.go(tilted(body.arm.here, CURL_RAD), pace=0.6)


def doze_off(body: Body) -> Actions[None]:
    """Go home, then circle there with a shrinking radius until the tool is still."""
    yield from body.arm.go_home()
    x, y, z = body.arm.here.position
    turn = body.arm.here.quaternion
    n = round(7.0 * RATE_HZ)
    for i in range(n):
        radius = 0.08 * min(1.0, i / 20.0) * (1.0 - i / n)
        angle = 2.0 * math.pi * i / (2.5 * RATE_HZ)
        yield from body.arm.step(Pose((x + radius * math.cos(angle), y + radius * math.sin(angle), z), turn))
    yield from body.arm.go(Pose((x, y, z), turn))
