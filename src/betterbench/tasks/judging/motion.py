"""Arrays with the motion of the gripper and the objects, up to the current state.

Grasp attempts are detected from these arrays, both live and in records.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from betterbench.interface.state import ObjectInfo, SceneInfo, WorldState
from betterbench.tasks.judging.picked_slots import PickedSlot
from betterbench.tasks.thresholds import THRESHOLDS

Floats = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """Motion of an episode, or of its beginning, as arrays with ``T`` rows and ``n`` objects (world frame, m, s).

    Attributes:
        info: The scene.
        rate_hz: Control rate.
        tool: (T, 3) position of the tool center point.
        width: (T,) width of the gripper's opening.
        closing: (T,) whether the gripper is commanded to close, or to stay closed.
        positions: (T, n, 3) positions of the objects (center of the bottom face).
        quaternions: (T, n, 4) rotations of the objects (w, x, y, z).
        left: (T, n) whether the left finger touches the object.
        right: (T, n) whether the right finger touches the object.
        held: (T,) index of the held object, or -1.
        force: (T, n) largest normal force with which a finger presses on the object [N].
        there: (T, n) whether the object is in a region of any target, requested or not. Closed drawers are left out.
        picked: Slots where training picks up an object.
    """

    info: SceneInfo
    rate_hz: float
    tool: Floats
    width: Floats
    closing: Bools
    positions: Floats
    quaternions: Floats
    left: Bools
    right: Bools
    held: npt.NDArray[np.int16]
    force: Floats
    there: Bools
    picked: tuple[PickedSlot, ...]

    @property
    def rows(self) -> int:
        """Number of rows, one for each state."""
        return int(self.tool.shape[0])

    @property
    def items(self) -> tuple[int, ...]:
        """Indices of the objects that can be grasped: items, distractors and drawers."""
        return graspable(self.info)

    @property
    def pick_slots(self) -> tuple[str, ...]:
        """Names of all slots except those occupied by containers and fixtures."""
        stands = {o.slot for o in self.info.objects if o.role in ("container", "fixture")}
        return tuple(s.name for s in self.info.slots if s.name not in stands)

    def steps(self, seconds: float) -> int:
        """Return the number of control steps in a duration, but at least one."""
        return max(1, round(seconds * self.rate_hz))

    def on_table(self, row: int, i: int) -> bool:
        """Return whether an object is at or above the height of the table, i.e. has not fallen off."""
        return bool(self.positions[row, i, 2] > -THRESHOLDS.fallen_below)

    def is_drawer(self, i: int | None) -> bool:
        """Return whether an object is a drawer."""
        return i is not None and self.info.objects[i].role == "drawer"

    def box_distances(self, row: int, point: Floats) -> Floats:
        """Return the distance from a point to the oriented bounding box of every object [m], shape (n,)."""
        return box_distances(self.info.objects, self.positions[row], self.quaternions[row], point)

    def sideways_distances(self, row: int, point: Floats) -> Floats:
        """Return the distance from a point to every oriented bounding box, seen from above [m], shape (n,).

        The point is moved to half the height of each object. The result is exact for objects that stand upright.
        """
        positions = self.positions[row].copy()
        positions[:, 2] = point[2] - np.array([0.5 * o.size_m[2] for o in self.info.objects])
        return box_distances(self.info.objects, positions, self.quaternions[row], point)

    def center_distances(self, row: int, point: Floats) -> Floats:
        """Return the horizontal distance from a point to the position of every object [m], shape (n,)."""
        distances: Floats = np.linalg.norm(self.positions[row, :, :2] - point[:2], axis=1)
        return distances

    def within_reach(self, row: int, point: Floats) -> Bools:
        """Return whether a gripper at a given point could close on each object, shape (n,).

        The gripper must be near the object's bounding box, or close to its center as seen from above.
        """
        boxes, centers = self.box_distances(row, point), self.center_distances(row, point)
        return in_reach(boxes, centers)

    def slot_of(self, row: int, i: int, reach: float) -> str | None:
        """Return the slot that contains an object, or None.

        The slot where the object started takes precedence, because slots of two layouts may overlap.
        """
        own = self.info.objects[i].slot
        if own in self.pick_slots:
            x, y, _ = self.info.slot(own).position
            if math.dist(self.positions[row, i, :2], (x, y)) <= reach:
                return own
        return self.slot_near(self.positions[row, i], reach)

    def place_of(self, slot: str) -> str:
        """Return the slot that stands for the given slot in rules about motions.

        If several slots are reached by the same motion, the first of them stands for all.
        """
        at = {s.name: s.position[:2] for s in self.info.slots}
        return next(other for other in at if math.dist(at[other], at[slot]) <= THRESHOLDS.same_place)

    def slot_near(self, point: Floats, reach: float) -> str | None:
        """Return the nearest slot within a horizontal distance of a point, or None. Slots of fixtures do not count."""
        best: tuple[float, str] | None = None
        for name in self.pick_slots:
            x, y, _ = self.info.slot(name).position
            gap = float(np.hypot(point[0] - x, point[1] - y))
            if gap <= reach and (best is None or (gap, name) < best):
                best = (gap, name)
        return None if best is None else best[1]

    def picked_slot(self, name: str | None) -> PickedSlot | None:
        """Return the slot with this name, or None if training does not pick an object from it."""
        return next((slot for slot in self.picked if slot.name == name), None)

    def emptied_slot(self, row: int, point: Floats) -> str | None:
        """Return the empty slot where an empty gripper closes, or None.

        This is the slot nearest to the gripper, measured from the points where demonstrations close the gripper in the
        slot. The distance must be at most ``empty_slot_reach``, the slot must be empty, and no object may be nearer.
        """
        near = []
        for slot in self.picked:
            if slot.is_met(point.tolist()) and not self._stands_in(row, slot):
                gap = slot.beyond(point.tolist())
                near.append((gap, math.dist(point[:2].tolist(), slot.middle), slot.name))
        if not near:
            return None
        beyond, _, name = min(near)
        gaps = self.box_distances(row, point)
        return None if any(gaps[i] < beyond and self.on_table(row, i) for i in range(len(gaps))) else name

    def _stands_in(self, row: int, slot: PickedSlot) -> bool:
        """Return whether a slot contains an object that can be grasped."""
        gaps = np.linalg.norm(self.positions[row, :, :2] - np.array(slot.middle), axis=1)
        return any(
            gaps[i] <= THRESHOLDS.slot_reach and not self.there[row, i] and self.on_table(row, i) for i in self.items
        )


def graspable(info: SceneInfo) -> tuple[int, ...]:
    """Return the indices of the objects that can be grasped: items, distractors and drawers that are not fixed."""
    roles = ("item", "distractor", "drawer")
    return tuple(i for i, o in enumerate(info.objects) if o.role in roles and not o.fixed)


def box_distances(objects: Sequence[ObjectInfo], positions: Floats, quaternions: Floats, point: Floats) -> Floats:
    """Return the distance from a point to the oriented bounding box of every object [m], shape (n,).

    Args:
        objects: The n objects.
        positions: (n, 3) centers of the objects' bottom faces [m]. All positions are in the world frame.
        quaternions: (n, 4) rotations of the objects (w, x, y, z).
        point: (3,) the point [m].
    """
    # Plain floats are used, because arrays of a few objects take four times as long.
    px, py, pz = point.tolist()
    distances = []
    for o, (x, y, z), (w, qx, qy, qz) in zip(objects, positions.tolist(), quaternions.tolist(), strict=True):
        width, depth, height = o.size_m
        dx, dy, dz = px - x, py - y, pz - z
        # the offset in the frame of the object: turned back by its rotation
        tx, ty, tz = 2.0 * (qz * dy - qy * dz), 2.0 * (qx * dz - qz * dx), 2.0 * (qy * dx - qx * dy)
        local_x = dx + w * tx + (qz * ty - qy * tz)
        local_y = dy + w * ty + (qx * tz - qz * tx)
        local_z = dz + w * tz + (qy * tx - qx * ty) - 0.5 * height
        out_x = max(abs(local_x) - 0.5 * width, 0.0)
        out_y = max(abs(local_y) - 0.5 * depth, 0.0)
        out_z = max(abs(local_z) - 0.5 * height, 0.0)
        distances.append(math.sqrt(out_x * out_x + out_y * out_y + out_z * out_z))
    return np.array(distances, dtype=np.float64)


class ToolDistances(NamedTuple):
    """Distances from the tool center point to every object in every row of a motion, each an array (T, n).

    Attributes:
        boxes: Distance to the object's oriented bounding box [m].
        centers: Horizontal distance to the object's position [m].
        reach: Whether the gripper could close on the object (see :meth:`Motion.within_reach`).
    """

    boxes: Floats
    centers: Floats
    reach: Bools


@functools.lru_cache(maxsize=1)
def tool_distances(motion: Motion) -> ToolDistances:
    """Return the distances from the tool to the objects.

    They are the same numbers as those of :meth:`Motion.box_distances` and :meth:`Motion.center_distances` for each row.
    The result for the last motion is kept, because many detectors go through the rows one by one.
    """
    offsets = motion.tool[:, None].astype(np.float64) - motion.positions
    dx, dy, dz = np.moveaxis(offsets, 2, 0)
    w, qx, qy, qz = np.moveaxis(motion.quaternions, 2, 0)
    width, depth, height = np.array([o.size_m for o in motion.info.objects]).T
    # the same operations in the same order as in `box_distances`, so that the results are the same to the bit
    tx, ty, tz = 2.0 * (qz * dy - qy * dz), 2.0 * (qx * dz - qz * dx), 2.0 * (qy * dx - qx * dy)
    local_x = dx + w * tx + (qz * ty - qy * tz)
    local_y = dy + w * ty + (qx * tz - qz * tx)
    local_z = dz + w * tz + (qy * tx - qx * ty) - 0.5 * height
    out_x = np.maximum(np.abs(local_x) - 0.5 * width, 0.0)
    out_y = np.maximum(np.abs(local_y) - 0.5 * depth, 0.0)
    out_z = np.maximum(np.abs(local_z) - 0.5 * height, 0.0)
    boxes: Floats = np.sqrt(out_x * out_x + out_y * out_y + out_z * out_z)
    centers: Floats = np.linalg.norm(motion.positions[:, :, :2] - motion.tool[:, None, :2], axis=2)
    return ToolDistances(boxes, centers, in_reach(boxes, centers))


def in_reach(boxes: Floats, centers: Floats) -> Bools:
    """Return whether a closing gripper attempts each object, given its distances to the object's box and center [m]."""
    near: Bools = (boxes <= THRESHOLDS.grasp_reach) | (np.maximum(centers, boxes) <= THRESHOLDS.slot_reach)
    return near


def closing_of(command: Floats, width: Floats, touching: Bools, *, rate_hz: float) -> Bools:
    """Return whether the gripper is commanded to close, or is kept closed by a zero command, at each row (T,).

    The result follows the majority of the commands within a quarter of a second, so that flicker or short pulses do not
    hide a closing. If a zero command keeps the fingers half open for longer than that, and they touch nothing, the
    gripper does not count as closing. The policy has then only set the gripper to the width of an object.

    Args:
        command: Command of the gripper. It is positive to close and negative to open.
        width: Width of the opening [m].
        touching: Whether a finger touches an object.
        rate_hz: Control rate.
    """
    rows = max(1, round(THRESHOLDS.chatter_time * rate_hz))
    told = _most_told(_told(command), 2 * (rows // 2) + 1)
    kept = told & (command == 0.0) & ~touching & (width > THRESHOLDS.closed_width)
    closing: Bools = told & ~_lasting(kept, rows)
    for start, stop in _runs(closing):
        if stop < len(told) and told[stop]:
            closing[start:stop] = False
    return closing


def _told(command: Floats) -> Bools:
    """Return whether the last nonzero command was to close, for each row."""
    last = np.maximum.accumulate(np.where(command != 0.0, np.arange(command.shape[0]), -1))
    told: Bools = np.where(last >= 0, command[last] > 0.0, False)
    return told


def _most_told(told: Bools, window: int) -> Bools:
    """Return the clear majority of the commands around each row. Without a clear majority, the previous value is kept.

    A majority is clear if it exceeds the minority by more than half of the rows, such as four out of five. When the
    majority changes, the change is placed at the row where the new commands begin, so that commands without noise are
    returned unchanged.
    """
    if not (told[1:] != told[:-1]).any():
        return told
    half = window // 2
    padded = np.pad(np.where(told, 1, -1), half, mode="edge")
    sums = np.convolve(padded, np.ones(window, dtype=np.int64), mode="valid")
    steady, state = told.copy(), bool(told[0])
    for row, total in enumerate(sums.tolist()):
        if 2 * abs(total) > window and (total > 0) is not state:
            state, begun = total > 0, row
            while begun > 0 and told[begun - 1] == state and steady[begun - 1] != state:
                begun -= 1
            steady[begun:row] = state
        steady[row] = state
    return steady


def _runs(flags: Bools) -> list[tuple[int, int]]:
    """Return each interval in which the flags are True, given by its first row and the row after its last row."""
    starts, stops = (np.flatnonzero(np.diff(flags, prepend=False, append=False))[k::2].tolist() for k in (0, 1))
    return list(zip(starts, stops, strict=True))


def _lasting(flags: Bools, least: int) -> Bools:
    """Set runs of True that are shorter than ``least`` rows to False. A run at the end is kept even if it is short."""
    lasting = flags.copy()
    for start, stop in _runs(flags):
        if stop - start < least and stop < len(flags):
            lasting[start:stop] = False
    return lasting


class MotionBuilder:
    """Builder that constructs a :class:`Motion` from one state after another."""

    def __init__(self, info: SceneInfo, *, rate_hz: float, picked: tuple[PickedSlot, ...] = ()) -> None:
        self._info, self._rate_hz, self._picked = info, rate_hz, picked
        self._states: list[WorldState] = []
        self._there: list[list[bool]] = []

    def append(self, state: WorldState, there: list[bool]) -> None:
        """Append the next state. ``there`` lists, for each object, whether it is in a region of any target."""
        self._states.append(state)
        self._there.append(there)

    def motion(self) -> Motion:
        """Return the motion up to the last state that was appended."""
        states, n = self._states, len(self._info.objects)
        number = {o.name: i for i, o in enumerate(self._info.objects)}
        left, right = (np.zeros((len(states), n), dtype=np.bool_) for _ in range(2))
        fingers = {"left_finger": left, "right_finger": right}
        pressing: Floats = np.zeros((len(states), n))
        for row, state in enumerate(states):
            for a, b, force in state.contacts:
                for finger, thing in ((a, b), (b, a)):
                    if finger in fingers and thing in number:
                        fingers[finger][row, number[thing]] = True
                        pressing[row, number[thing]] = max(pressing[row, number[thing]], force)
        held = [-1 if s.held is None else number[s.held] for s in states]
        width, command = (np.array([getattr(s, f) for s in states]) for f in ("finger_width_m", "gripper_command"))
        touching: Bools = np.any(left | right, axis=1)
        return Motion(
            info=self._info, rate_hz=self._rate_hz, tool=np.array([s.ee_pose.position for s in states]), width=width,
            closing=closing_of(command, width, touching, rate_hz=self._rate_hz),
            positions=np.array([s.positions for s in states]).reshape(len(states), n, 3),
            quaternions=np.array([s.quaternions for s in states]).reshape(len(states), n, 4), left=left, right=right,
            held=np.array(held, dtype=np.int16), force=pressing,
            there=np.array(self._there, dtype=np.bool_).reshape(len(states), n), picked=self._picked,
        )  # fmt: skip
