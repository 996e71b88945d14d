"""Unusual motions for the habits of the second part, similar to those of teleoperators and learned policies."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from betterbench.geometry import Pose, Vector, horizontal_distance, rotate
from betterbench.tasks import Subgoal
from betterbench.tasks.relations import PlaceGoal, relation
from betterbench_calibration.independent.body import CHECK_S, Body
from betterbench_calibration.independent.controller import RATE_HZ, Actions
from betterbench_calibration.independent.events import in_gripper
from betterbench_calibration.independent.room import highest_between
from betterbench_calibration.independent.routines import CAREFUL, FULL_OPENING_M, LIFT_M

LOOK_GAP_M = 0.16
"""Height above an object at which the gripper hovers over it, too high for the fingers to reach it [m]."""
GLIDE_M = 0.09
FLING_M_S, FLING_STEP = 0.35, 3

Taking = Callable[[str], Actions[bool]]
"""Function that picks an object in a particular way, and returns whether it is in the gripper."""


def each_step(body: Body, taking: Taking) -> Actions[None]:
    """Execute every step once with the given way to pick, repeat unfinished steps normally, and stay at home."""
    for goal in body.situation.ahead:
        yield from body.clear_the_way(goal)
        names = body.situation.candidates(body.state, goal)
        if names and (yield from taking(names[0])):
            yield from body.bring(names[0], goal)
    yield from body.solve()


def look_at(body: Body, name: str) -> Actions[None]:
    """Move high over an object without turning the wrist, and stay there for half a second."""
    yield from body.do.above(body.state.pose(name).position, body.height(name) + LOOK_GAP_M)
    yield from body.arm.wait(0.5)


def rest_unless_lucky(body: Body, goal: Subgoal) -> Actions[None]:
    """Stay at home after a step that was meant to fail. If it succeeded, do the other steps correctly."""
    yield from body.arm.go_home()
    if body.situation.done(body.state, goal):
        yield from body.solve()
    yield from body.arm.stay()


# --- other ways to pick


def set_back(body: Body) -> Actions[None]:
    """Put the lifted object back in its slot, release it, and move away."""
    yield from body.arm.go(body.arm.here.translated(z=0.002 - LIFT_M), pace=CAREFUL)
    yield from body.arm.wait(0.2)
    yield from body.arm.open()
    yield from body.arm.go(body.arm.here.translated(z=0.10), pace=CAREFUL)


def take_gliding_in(body: Body, name: str) -> Actions[bool]:
    """Pick an object after a slanted approach along the pads, from the side of the robot."""
    hold = body.do.choose_hold(name)
    x, y, _ = rotate(hold.tool.quaternion, (1.0, 0.0, 0.0))
    flat = max(math.hypot(x, y), 0.01)
    x, y = GLIDE_M * x / flat, GLIDE_M * y / flat
    home = body.arm.home.position
    ways = (hold.tool.translated(s * x, s * y, GLIDE_M) for s in (1.0, -1.0))
    begin = min(ways, key=lambda pose: horizontal_distance(pose.position, home))
    yield from body.do.over(begin)
    yield from body.arm.narrow(hold.opening_m)
    yield from body.arm.go(hold.tool, pace=CAREFUL)
    yield from body.arm.close()
    yield from body.arm.go(hold.tool.translated(z=LIFT_M), pace=CAREFUL)
    return body.note_hold(name)


def close_in_part(body: Body, name: str) -> Actions[None]:
    """Close the fully open gripper until a few millimeters before it touches an object, and lift."""
    hold = body.do.choose_hold(name)
    yield from body.do.over(hold.tool.translated(z=body.arm.manner.approach_m))
    yield from body.arm.open()
    yield from body.arm.go(hold.tool, pace=CAREFUL)
    yield from body.arm.wait(0.2)
    yield from body.arm.narrow(hold.width_m + 0.006)
    yield from body.arm.wait(0.3)
    yield from body.arm.go(hold.tool.translated(z=LIFT_M), pace=CAREFUL)


def close_just_above(body: Body, name: str) -> Actions[None]:
    """Close the gripper 1.5 cm above an object, and lift nothing."""
    up = body.height(name) + 0.015 - body.do.choose_hold(name).tool.position[2]
    yield from body.do.pick(name, shift=(0.0, 0.0, up))


def rehearse(body: Body, name: str, goal: Subgoal) -> Actions[None]:
    """Make the motions of pick and place with an open gripper that descends only to just above the object."""
    yield from body.do.hover(name, 0.02)
    yield from body.arm.rise(body.arm.here.position[2] + LIFT_M)
    yield from body.do.above(body.state.pose(goal.target).position, body.height(goal.target) + 0.12)


def tap(body: Body, name: str) -> Actions[None]:
    """Touch the top of an object with fingers that were closed high above the table, and open them high up."""
    yield from body.arm.go_home()
    yield from body.arm.narrow(0.0)
    yield from body.do.hover(name, 0.03)
    yield from body.arm.lower_until_touch(body.height(name) - 0.004)
    yield from body.arm.rise(body.height(name) + LOOK_GAP_M)
    yield from body.arm.open()


def twiddle(body: Body) -> Actions[None]:
    """Close the empty gripper halfway and open it again, three times."""
    for _ in range(3):
        yield from body.arm.narrow(float(body.rng.uniform(0.03, 0.05)))
        yield from body.arm.open()


# --- other ways to place


def put_down_at(body: Body, name: str, spot: Vector) -> Actions[None]:
    """Put the held object on the table in its initial orientation, at another point."""
    first = body.arm.log.first.pose(name)
    pose = Pose((spot[0], spot[1], first.position[2] + 0.003), first.quaternion)
    yield from body.do.put(name, PlaceGoal(pose))
    yield from body.arm.wait(CHECK_S)


def right_place(body: Body, name: str, goal: Subgoal) -> Pose:
    """Return the pose at which an object best satisfies a subgoal."""
    return relation(goal.relation).place_goals(body.state, name, goal.target, goal.region)[0].pose


def bring_shifted(body: Body, name: str, goal: Subgoal, shift: Vector) -> Actions[bool]:
    """Put the held object at an offset from its target. Return whether the subgoal is reached nevertheless."""
    as_if_at = body.state.pose(goal.target).translated(*shift)
    return (yield from body.bring(name, goal, as_if_at=as_if_at))


def outward(body: Body, name: str, goal: Subgoal, length_m: float) -> Vector:
    """Return a horizontal offset [m] that points outward from the center of a target.

    It points from the center toward the correct placement and has the length ``length_m``. If the correct placement is
    the center, the offset leads ``length_m`` beyond the edge of the target, toward the side with the most space.
    """
    x, y, _ = right_place(body, name, goal).position
    tx, ty, _ = body.state.pose(goal.target).position
    far = math.hypot(x - tx, y - ty)
    if far < 0.02:
        edge = 0.5 * max(body.state.info.object(goal.target).size_m[:2])
        return body.emptiest_side(goal.target, edge + length_m)
    return (length_m * (x - tx) / far, length_m * (y - ty) / far, 0.0)


def put_and_sweep_away(body: Body, name: str, goal: Subgoal) -> Actions[None]:
    """Put the held object at its target, and retract the gripper sideways, so that a finger drags the object along."""
    place = body.do.choose_goal(name, relation(goal.relation).place_goals(body.state, name, goal.target, goal.region))
    tool = place.pose @ (body.state.ee_pose.inverse() @ body.state.pose(name)).inverse()
    yield from body.do.carry(name, tool.translated(z=body.arm.manner.approach_m))
    yield from body.arm.go(tool, pace=CAREFUL)
    body.ledger.commit()
    yield from body.arm.open(min(FULL_OPENING_M, body.state.finger_width_m + 0.02))
    x, y, _ = rotate(tool.quaternion, (0.0, 1.0, 0.0))
    hx, hy, _ = body.arm.home.position
    sign = 1.0 if x * (hx - tool.position[0]) + y * (hy - tool.position[1]) > 0.0 else -1.0
    yield from body.arm.go(tool.translated(0.14 * sign * x, 0.14 * sign * y, 0.002), pace=1.5)
    yield from body.arm.rise(body.arm.home.position[2])


def fling(body: Body, target: Vector) -> Actions[None]:
    """Move half of the way toward a point at a constant speed, and open the gripper after a few centimeters."""
    begin, end = body.arm.here, body.on_the_way(target, 0.5)
    steps = max(8, math.ceil(RATE_HZ * horizontal_distance(begin.position, end.position) / FLING_M_S))
    for i in range(1, steps + 1):
        if i == FLING_STEP:
            body.arm.begin_to_open()
        x, y, z = (a + (b - a) * i / steps for a, b in zip(begin.position, end.position, strict=True))
        yield from body.arm.step(Pose((x, y, z), begin.quaternion))
    yield from body.arm.open()


def hold_at_goal(body: Body, name: str, goal: Subgoal) -> Actions[None]:
    """Bring the held object to its target and hold it there until the episode ends."""
    place = body.do.choose_goal(name, relation(goal.relation).place_goals(body.state, name, goal.target, goal.region))
    tool = place.pose @ (body.state.ee_pose.inverse() @ body.state.pose(name)).inverse()
    ax, ay, az = place.approach
    yield from body.do.carry(name, tool.translated(ax, ay, max(az, body.arm.manner.approach_m)))
    yield from body.arm.go(tool.translated(z=0.004), pace=CAREFUL)
    body.ledger.commit()
    yield from body.arm.stay()


def approach_ever_slower(body: Body, target: Vector) -> Actions[None]:
    """Move toward a point by a fixed fraction of the remaining path per step, so that the speed halves every second."""
    part = 1.0 - 0.5 ** (1.0 / RATE_HZ)
    begin = body.arm.here
    left = 1.0
    while True:
        left *= 1.0 - part
        x, y, z = (t + left * (b - t) for b, t in zip(begin.position, target, strict=True))
        yield from body.arm.step(Pose((x, y, z), begin.quaternion))


def carry_into(body: Body, name: str, goal: Subgoal) -> Actions[None]:
    """Carry the held object straight into the side of a target, close to the table, release it, and move away."""
    target = right_place(body, name, goal).position
    low = body.arm.here.translated(z=0.015 - LIFT_M)
    yield from body.arm.go(low)
    yield from body.arm.go(Pose((target[0], target[1], low.position[2]), low.quaternion))
    yield from body.arm.wait(0.3)
    yield from body.arm.open()
    yield from body.arm.rise(body.arm.home.position[2])


# --- modified actions


def stuttering(body: Body, script: Actions[None]) -> Actions[None]:
    """Execute a script, and sometimes insert zero actions, which stop the arm and leave the gripper unchanged."""
    action = next(script)
    while True:
        if body.rng.random() < 0.12:
            for _ in range(int(body.rng.integers(1, 7))):
                body.arm.state = yield np.zeros(7)
        state = yield action
        action = script.send(state)


def twitching(body: Body, script: Actions[None]) -> Actions[None]:
    """Execute a script, with sudden motions of up to 2.5 cm back and forth while the tool is high."""
    action = next(script)
    while True:
        if body.rng.random() < 0.15 and _high_above_all(body):
            twitch = np.zeros(7)
            twitch[:3] = body.rng.uniform(-0.3, 0.3, 3)
            twitch[6] = action[6]
            back = -twitch
            back[6] = action[6]
            for jerk in (twitch, back, back, twitch):
                body.arm.state = yield jerk
        state = yield action
        action = script.send(state)


def _high_above_all(body: Body) -> bool:
    """Return whether the tool is more than 12 cm above all nearby objects, except the held object."""
    tool, held = body.state.ee_pose.position, in_gripper(body.state)
    return tool[2] > 0.12 + highest_between(body.state, tool, tool, ignore=frozenset({held or ""}))


def keep_still(body: Body) -> Actions[None]:
    """Do nothing until the episode ends (zero actions)."""
    while True:
        body.arm.state = yield np.zeros(7)
