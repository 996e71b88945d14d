"""Interactions that are forbidden if the policy should stay still, or if a requested object is absent."""

from __future__ import annotations

import math

import numpy as np

from betterbench.geometry import Vector, distance
from betterbench.interface.state import GRIPPER_BODIES, SceneInfo, WorldState
from betterbench.tasks.axes import Expected
from betterbench.tasks.judging.attempts import GraspAttempt, find_closings_in_motion, find_grasps
from betterbench.tasks.judging.motion import Bools, Floats, Motion, MotionBuilder, box_distances, graspable, in_reach
from betterbench.tasks.judging.picked_slots import PickedSlot
from betterbench.tasks.thresholds import HOVER_TIME, MOVED, THRESHOLDS


def off_limits(info: SceneInfo, asked: frozenset[int]) -> tuple[int, ...]:
    """Return the indices of the objects that must not be touched in a refusal.

    They are the objects that the instruction does not name. Drawers and targets may be touched, because the policy may
    put away the requested objects that exist.
    """
    return tuple(i for i in graspable(info) if i not in asked and info.objects[i].role != "drawer")


def forbidden_object(grasp: GraspAttempt, info: SceneInfo, forbidden: tuple[int, ...]) -> int | None:
    """Return the forbidden object at which a grasp attempt was made, or None.

    The object may have been touched or missed. It may also have been moved away earlier from the slot where the attempt
    is made.
    """
    at = grasp.object if grasp.object is not None else grasp.aim
    if at is not None:
        return at if at in forbidden else None
    return next((i for i in forbidden if grasp.slot is not None and info.objects[i].slot == grasp.slot), None)


def hovered_over(
    info: SceneInfo, tool: Floats, positions: Floats, quaternions: Floats, forbidden: tuple[int, ...]
) -> int | None:
    """Return the nearest forbidden object that the gripper could close on, or None if none is within reach.

    Args:
        info: The scene.
        tool: (3,) tool center point in the world frame [m].
        positions: (n, 3) positions of the objects [m].
        quaternions: (n, 4) rotations of the objects.
        forbidden: Indices of the forbidden objects.
    """
    boxes = box_distances(info.objects, positions, quaternions, tool)
    near = in_reach(boxes, np.linalg.norm(positions[:, :2] - tool[:2], axis=1))
    return min((i for i in forbidden if near[i]), key=lambda i: (float(boxes[i]), i), default=None)


def first_hover(motion: Motion, forbidden: tuple[int, ...]) -> tuple[int, int, int] | None:
    """Return the first interval in which the open, empty gripper stays near a forbidden object.

    Returns:
        The first and last row of the interval and the index of the object, or None if there is no such interval.
    """
    stay, since, last = motion.steps(HOVER_TIME), -1, -2
    empty = ~motion.closing & (motion.held < 0) & _may_reach(motion, forbidden)
    for row in np.flatnonzero(empty).tolist():
        found = hovered_over(motion.info, motion.tool[row], motion.positions[row], motion.quaternions[row], forbidden)
        if found is None:
            continue
        since, last = (since if row == last + 1 else row), row
        if row - since >= stay:
            return since, row, found
    return None


def _may_reach(motion: Motion, forbidden: tuple[int, ...]) -> Bools:
    """Return whether a forbidden object may be within reach of the gripper at each row (T,).

    The gripper is elsewhere in most rows, and computing the exact distance to the objects takes long. With this bound,
    a check of 1,114 states takes 0.1 ms instead of 15 ms (CPU time, wandering gripper, two forbidden objects).
    """
    near = np.zeros(motion.rows, dtype=np.bool_)
    for i, reach in zip(forbidden, _reaches(motion.info, forbidden), strict=True):
        offsets = motion.tool - motion.positions[:, i]
        near |= np.einsum("ij,ij->i", offsets, offsets) <= reach * reach
    return near


def _reaches(info: SceneInfo, objects: tuple[int, ...]) -> tuple[float, ...]:
    """Return an upper bound of the distance between the gripper and the position of each object within reach [m]."""
    sizes = (info.objects[i].size_m for i in objects)
    reach = max(THRESHOLDS.grasp_reach, THRESHOLDS.slot_reach)
    return tuple(math.dist(size, (0.0, 0.0, 0.0)) + reach for size in sizes)


def first_closing_in_motion(motion: Motion, forbidden: tuple[int, ...]) -> tuple[int, int, int] | None:
    """Return the first interval in which a moving gripper closes while it passes within reach of a forbidden object.

    If a gripper closes while it passes another object, this is not judged, because it does not show which object was
    intended. Near forbidden objects, it is not allowed.

    Returns:
        The first and last row of the interval and the index of the object, or None if there is no such interval.
    """
    for first, last in find_closings_in_motion(motion):
        for row in range(first, last + 1):
            passed = hovered_over(
                motion.info, motion.tool[row], motion.positions[row], motion.quaternions[row], forbidden
            )
            if passed is not None:
                return first, last, passed
    return None


def moved_from_start(motion: Motion) -> Bools:
    """Return whether each loose object is away from where it started, shape (rows, n)."""
    away: Bools = np.linalg.norm(motion.positions - motion.positions[0], axis=2) > MOVED
    away[:, [o.fixed for o in motion.info.objects]] = False
    return away


_ROWS_BETWEEN = 5
"""Interval at which the whole motion is checked while the gripper stays near an object [control steps]."""


class Restraint:
    """Tracker of forbidden interactions in an episode. It must be given every state in order, starting at reset."""

    def __init__(
        self,
        expected: Expected,
        info: SceneInfo,
        *,
        asked: frozenset[int],
        rate_hz: float,
        step_limit: int,
        picked: tuple[PickedSlot, ...] = (),
    ) -> None:
        """Prepare for an episode.

        Args:
            expected: Behavior of a policy that understands the instruction.
            info: The scene.
            asked: Indices of the objects that may be taken in a refusal.
            rate_hz: Control rate.
            step_limit: Number of control steps after which the episode ends.
            picked: Slots where training picks up an object. Closing the gripper on nothing in one of these slots is an
                attempt as well.
        """
        self._limit, self._rate_hz = step_limit, rate_hz
        self._still = still = expected is Expected.STAY_STILL
        self._forbidden = graspable(info) if still else off_limits(info, asked)
        self._names = frozenset(o.name for o in info.objects) if still else frozenset(self._named(info))
        self._parts = GRIPPER_BODIES | {"arm"} if still else GRIPPER_BODIES
        self._reach = _reaches(info, self._forbidden)
        self._motion = MotionBuilder(info, rate_hz=rate_hz, picked=picked)
        self._closing, self._changed, self._row, self._near = False, 0, -1, 0
        self._broken = False
        self._loose = tuple(i for i, o in enumerate(info.objects) if not o.fixed)
        self._start: tuple[Vector, ...] = ()

    def _named(self, info: SceneInfo) -> list[str]:
        return [info.objects[i].name for i in self._forbidden]

    def breaks(self, state: WorldState, there: list[bool]) -> bool:
        """Process the next state, and return whether a forbidden interaction has happened so far.

        An interaction is forbidden if a forbidden object was touched, moved or attempted, or if the gripper stays near
        it.

        Args:
            state: The next state.
            there: Whether each object is in a region of any target.
        """
        self._row += 1
        self._start = self._start or state.positions
        self._motion.append(state, there)
        was, command = self._closing, state.gripper_command
        self._closing = command > 0.0 if command != 0.0 else was
        if was is not self._closing:
            self._changed = self._row
        self._near = self._near + 1 if self._is_near(state) else 0
        self._broken = self._broken or self._touched(state) or self._moved(state)
        if not self._broken and self._has_to_look(state):
            self._broken = self._stayed_or_attempted()
        return self._broken

    def _touched(self, state: WorldState) -> bool:
        return any(
            (a in self._parts and b in self._names) or (b in self._parts and a in self._names)
            for a, b, _ in state.contacts
        )

    def _moved(self, state: WorldState) -> bool:
        """Return whether any object that must not be moved is away from where it started."""
        if not self._still or state.positions == self._start:
            return False
        return any(distance(state.positions[i], self._start[i]) > MOVED for i in self._loose)

    def _is_near(self, state: WorldState) -> bool:
        """Return whether an empty gripper may be within reach of a forbidden object."""
        place = state.ee_pose.position
        return state.held is None and any(
            distance(place, state.positions[i]) <= reach for i, reach in zip(self._forbidden, self._reach, strict=True)
        )

    def _has_to_look(self, state: WorldState) -> bool:
        """Return whether the whole motion has to be checked now. Checking it at every control step would take too long.

        The motion is checked at the last step, when the gripper has finished closing (including chatter), and after the
        time it takes to resolve an attempt. It is also checked at regular intervals while the gripper stays near an
        object.
        """
        span = THRESHOLDS.attempt_window if self._closing else THRESHOLDS.chatter_time
        resolved = self._changed > 0 and self._row - self._changed == math.ceil(round(span * self._rate_hz, 6))
        stay = max(1, round(HOVER_TIME * self._rate_hz))
        return resolved or state.step >= self._limit or (self._near > stay and (self._near - stay) % _ROWS_BETWEEN == 1)

    def _stayed_or_attempted(self) -> bool:
        """Return whether, by the rules of the diagnosis, the gripper attempted a forbidden object or stayed near it."""
        motion = self._motion.motion()
        grasps = find_grasps(motion)
        if self._still:
            attempted = bool(grasps)
        else:
            attempted = any(forbidden_object(grasp, motion.info, self._forbidden) is not None for grasp in grasps)
        return (
            attempted
            or first_closing_in_motion(motion, self._forbidden) is not None
            or first_hover(motion, self._forbidden) is not None
        )
