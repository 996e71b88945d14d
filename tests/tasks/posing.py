"""Puts things at places of their targets by hand, and asks relations about it from several points of view."""

from __future__ import annotations

import dataclasses
import math

from betterbench.geometry import Pose, Vector, from_axis_angle, from_yaw, multiply, normalize, rotate
from betterbench.interface.state import WorldState
from betterbench.tasks import THRESHOLDS
from betterbench.tasks.relations import relation

MM = 1e-3
HALF_MM = 0.5 * MM
MOVES = (Pose((0.3, -0.2, 0.05), from_yaw(2.0)), Pose((-0.1, 0.4, -0.02), from_yaw(-0.7)))
"""Rigid motions of the whole scene: turned about the vertical axis and moved."""


def base_of(state: WorldState, name: str) -> Vector:
    """Returns the center of an object's foot in its own frame [m], found without the code under test."""
    return next((r.position for r in state.info.object(name).regions if r.name == "base"), (0.0, 0.0, 0.0))


def foot_at(
    state: WorldState, name: str, point: Vector, *, frame: Pose | None = None, turn: float = 0.0, tilt: float = 0.0
) -> Pose:
    """Returns the pose of an object whose foot is at a point.

    Args:
        state: The state.
        name: Name of the object.
        point: Where its foot is, in ``frame`` [m].
        frame: Frame of the point and of the heading, or None for the world.
        turn: Heading [rad].
        tilt: Tilt about the object's own y axis [rad]; the foot stays where it is.
    """
    frame = frame or Pose((0.0, 0.0, 0.0))
    q = normalize(multiply(frame.quaternion, multiply(from_yaw(turn), from_axis_angle((0.0, tilt, 0.0)))))
    gx, gy, gz = frame.apply(point)
    x, y, z = rotate(q, base_of(state, name))
    return Pose((gx - x, gy - y, gz - z), q)


def center_at(state: WorldState, name: str, point: Vector, *, frame: Pose, turn: float = 0.0) -> Pose:
    """Returns the pose of an object whose bounding box has its center at a point of a frame."""
    x, y, z = frame.apply(point)
    q = normalize(multiply(frame.quaternion, from_yaw(turn)))
    return Pose((x, y, z - 0.5 * state.info.object(name).size_m[2]), q)


def region_frame(state: WorldState, target: str, region: str) -> Pose:
    """Returns ``T_world_region``."""
    return state.pose(target) @ state.info.object(target).region(region).pose


def half_size(state: WorldState, target: str, region: str) -> Vector:
    """Returns the half extents of a region [m]."""
    return state.info.object(target).region(region).half_size


def drawn(state: WorldState, drawer: str, meters: float) -> Pose:
    """Returns the pose of a drawer that stands open by a distance [m]; it runs along its own x axis."""
    shut = region_frame(state, "cabinet", drawer)
    return shut @ Pose((meters, 0.0, 0.0))


def along(angle: float, radius: float, height: float = 0.0) -> Vector:
    """Returns a point on a circle [m]."""
    return (radius * math.cos(angle), radius * math.sin(angle), height)


def moved(state: WorldState, motion: Pose) -> WorldState:
    """Returns the state with the whole scene moved rigidly."""
    poses = [motion @ Pose(p, q) for p, q in zip(state.positions, state.quaternions, strict=True)]
    return dataclasses.replace(
        state,
        positions=tuple(p.position for p in poses),
        quaternions=tuple(p.quaternion for p in poses),
        ee_pose=motion @ state.ee_pose,
        commanded_pose=motion @ state.commanded_pose,
    )


def other_name(name: str) -> str:
    """Returns another name, in another alphabetical order."""
    return f"thing_{name[::-1]}"


def renamed(state: WorldState) -> WorldState:
    """Returns the same scene with every object renamed and listed in the opposite order."""
    names = {o.name for o in state.info.objects}

    def new(name: str) -> str:
        return other_name(name) if name in names else name

    objects = tuple(dataclasses.replace(o, name=new(o.name)) for o in reversed(state.info.objects))
    return dataclasses.replace(
        state,
        info=dataclasses.replace(state.info, objects=objects),
        positions=state.positions[::-1],
        quaternions=state.quaternions[::-1],
        linear_speeds=state.linear_speeds[::-1],
        angular_speeds=state.angular_speeds[::-1],
        contacts=tuple(c._replace(a=new(c.b), b=new(c.a)) for c in reversed(state.contacts)),
        held=None if state.held is None else new(state.held),
    )


class Watched(WorldState):
    """A state that refuses questions about the contacts of bodies that do not exist."""

    @classmethod
    def of(cls, state: WorldState) -> Watched:
        """Returns the same state, watched."""
        return cls(**{field.name: getattr(state, field.name) for field in dataclasses.fields(state)})

    def touching(self, a: str, b: str) -> bool:
        """Returns whether two bodies touch, after seeing to it that both names exist."""
        for body in (a, b):
            known = [o.name for o in self.info.objects] + [
                "table",
                "floor",
                "hand",
                "arm",
                "left_finger",
                "right_finger",
            ]
            assert body in known, f"the relation asks about the contacts of {body!r}, which does not exist"
        return WorldState.touching(self, a, b)


def where(name: str, state: WorldState, thing: str, target: str) -> str | None:
    """Returns the place at which a relation sees an object, after seeing to it that no point of view changes that.

    Every verdict is asked for again with the scene moved and turned, and with its objects renamed, listed in another
    order and their contacts told the other way round.

    Args:
        name: Name of the relation.
        state: The state.
        thing: Name of the object.
        target: Name of the target.
    """
    see = relation(name).where
    found = see(Watched.of(state), thing, target)
    for motion in MOVES:
        assert see(moved(state, motion), thing, target) == found, f"moving the scene by {motion} changes a verdict"
    again = see(renamed(state), other_name(thing), other_name(target))
    assert again == found, "renaming the objects changes a verdict"
    return found


class Course:
    """An episode that is told state by state; what was put elsewhere comes to rest before a state counts."""

    def __init__(self, tracker, rate=20.0):
        self.tracker, self.step = tracker, -1
        self.rest_steps = max(1, round(THRESHOLDS.rest_time * rate))
        self.poses = None

    def see(self, state, times=1):
        """Returns the truth after the last of so many equal states."""
        poses = state.positions, state.quaternions
        for _ in range(self.rest_steps if self.poses not in (None, poses) else 0):
            self.next(state)
        self.poses = poses
        truth = None
        for _ in range(times):
            truth = self.next(state)
        return truth

    def next(self, state):
        """Returns the truth at the next control step, in which things may still move."""
        self.step += 1
        return self.tracker.update(dataclasses.replace(state, step=self.step))

    def done(self, state):
        """Returns the names of the subgoals that are done in the next state."""
        truth = self.see(state)
        return {n for n, done in zip(self.tracker.subgoal_names, truth.subgoals, strict=True) if done}
