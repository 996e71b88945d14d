"""Seeded variation that is not tied to slots: object variants, room, camera poses, light and start posture of the arm.

A trial and its twin, the training trial with the same seed, share this variation, because it does not depend on the
condition. Object variants and rooms change the compiled model, so each trial draws one of a limited number of
combinations. The rest of this variation does not change the model.
"""

from __future__ import annotations

import functools
import math

import numpy as np

from betterbench.errors import InvalidInputError
from betterbench.geometry import Pose, from_axis_angle
from betterbench.interface.state import CameraOffset, ViewJitter
from betterbench.sim.assets import family_of, looks, unseen_looks
from betterbench.sim.robots import ArmIK, RobotSpec
from betterbench.sim.robots.dynamics import Dynamics, draw_dynamics
from betterbench.sim.scenes.rooms import ROOMS, UNSEEN_ROOMS, Room
from betterbench.sim.scenes.stage import CAMERAS, WRIST_CAMERA
from betterbench.tasks import Looks, ObjectSpec, stream

LOOK_SETS = 16
"""Number of sets of object variants ("looks") per task.

A trial draws one set, which assigns a variant to each kind of object and a room to the scene. Runs therefore compile
and store a few scenes per task instead of one per trial.
"""

UNSEEN_LOOK_SETS = 12
"""Number of held-out sets per task. It is a multiple of the four held-out variants and of the three held-out rooms."""

CAMERA_SHIFT_M = 0.01
"""Maximum distance by which the jitter shifts a camera along each of its axes, in either direction [m]."""

CAMERA_TURN_RAD = math.radians(1.0)
"""Maximum angle by which the jitter rotates a camera about each of its axes, in either direction [rad]."""

LIGHT_TURN_RAD = math.radians(4.0)
"""Maximum angle by which the jitter rotates the key light about each world axis, in either direction [rad]."""

NO_VIEW_JITTER = ViewJitter({}, (0.0, 0.0, 0.0))
"""Jitter that leaves the cameras and the key light in their nominal poses."""

START_SHIFT_M = 0.02
"""Maximum distance of the end effector from its home position at the start, along each world axis [m]."""

START_TURN_RAD = math.radians(5.0)
"""Maximum rotation of the end effector from its home pose at the start, about the tool axis [rad]."""


def look_of(task: str, seed: int, spec: ObjectSpec, *, shown: Looks = "seen") -> int:
    """Return the index of the variant that an object has in a trial.

    In a trial, objects with the same asset have the same variant. The variant does not depend on the scene. Over all
    sets of variants, each variant of an object kind occurs equally often, independently of the other kinds and the
    room. Categories of the same family and color, such as a cabinet and its drawers, have the same variant.
    """
    numbers = looks(spec.category) if shown == "seen" else unseen_looks(spec.category)
    return numbers[_drawn(task, seed, f"{family_of(spec.category)}:{spec.color}", len(numbers), shown)]


def room_of(task: str, seed: int, *, shown: Looks = "seen") -> Room:
    """Return the room of a trial, which determines the table top, wall, floor and light."""
    rooms = ROOMS if shown == "seen" else UNSEEN_ROOMS
    return rooms[_drawn(task, seed, "room", len(rooms), shown)]


def look_set_of(task: str, seed: int, *, shown: Looks = "seen") -> int:
    """Return the index of the set of object variants that a trial draws."""
    return int(stream(task, seed, f"looks:{shown}").integers(LOOK_SETS if shown == "seen" else UNSEEN_LOOK_SETS))


def dynamics_of(task: str, seed: int, robot: RobotSpec) -> Dynamics:
    """Return the drawn dynamics of the robot in a trial. The result is empty if its dynamics do not vary."""
    return draw_dynamics(robot, lambda quantity: stream(task, seed, f"robot dynamics:{quantity}"))


def _drawn(task: str, seed: int, what: str, count: int, shown: Looks) -> int:
    """Return the index, from 0 to ``count - 1``, that a trial has drawn for one kind of object or for the room.

    Successive sets of variants go through the possible indices in a shuffled order, which is different for each kind.
    """
    chosen = look_set_of(task, seed, shown=shown)
    round_, place = divmod(chosen, count)
    return int(_order(task, round_, f"order of {shown} {what}", count)[place])


@functools.lru_cache(maxsize=4096)
def _order(task: str, round_: int, purpose: str, count: int) -> tuple[int, ...]:
    return tuple(stream(task, round_, purpose).permutation(count).tolist())


def view_jitter_of(task: str, seed: int) -> ViewJitter:
    """Return the offsets of a trial's cameras and key light from their nominal poses."""
    cameras = {}
    for camera in (*CAMERAS, WRIST_CAMERA):
        x, y, z, rx, ry, rz = stream(task, seed, f"camera:{camera}").uniform(-1.0, 1.0, 6).tolist()
        shift, turn = CAMERA_SHIFT_M, CAMERA_TURN_RAD
        cameras[camera] = CameraOffset((shift * x, shift * y, shift * z), (turn * rx, turn * ry, turn * rz))
    rx, ry, rz = (LIGHT_TURN_RAD * stream(task, seed, "key light").uniform(-1.0, 1.0, 3)).tolist()
    return ViewJitter(cameras, (rx, ry, rz))


@functools.lru_cache(maxsize=1024)
def start_joints_of(task: str, seed: int, robot: RobotSpec) -> tuple[float, ...]:
    """Return the joint angles at the start of a trial [rad], near the home pose and within the joint limits.

    The end effector is displaced from its home pose by up to 2 cm along each world axis and up to 5 degrees about the
    tool axis.

    Raises:
        InvalidInputError: If the arm cannot reach the displaced pose from its home pose.
    """
    dx, dy, dz, turn = stream(task, seed, "robot start").uniform(-1.0, 1.0, 4).tolist()
    arm = ArmIK(robot)
    home = arm.forward(arm.home)
    shifted = home.translated(START_SHIFT_M * dx, START_SHIFT_M * dy, START_SHIFT_M * dz)
    target = shifted @ Pose((0.0, 0.0, 0.0), from_axis_angle((0.0, 0.0, START_TURN_RAD * turn)))
    found = arm.reach(np.array(robot.home_joints), target, restarts=False)
    if not found.converged:
        problem = f"the start pose of {task} seed {seed} is {1e3 * found.position_error_m:.1f} mm out of reach"
        raise InvalidInputError(
            f"robot {robot.name!r}", problem, "Choose a home pose that is farther from the limits of the arm"
        )
    return tuple(found.q.tolist())
