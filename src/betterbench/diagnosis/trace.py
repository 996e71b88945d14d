"""What the detectors read from a record: its columns by object, with contacts and relations as arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from betterbench.diagnosis.limits import LIMITS
from betterbench.errors import RecordError
from betterbench.recording import Record
from betterbench.state import SceneInfo

Floats = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Trace:
    """One episode as arrays. ``T`` rows, ``n`` objects, ``g`` subgoals; world frame, metres, seconds.

    Attributes:
        info: The scene.
        rate_hz: Control rate [Hz].
        time: (T,) time since reset.
        tool: (T, 3) tool centre point.
        width: (T,) distance of the finger pads.
        closing: (T,) whether the gripper is commanded to close; a command of zero keeps the last one.
        positions: (T, n, 3) object positions (centre of the bottom face).
        quaternions: (T, n, 4) object rotations (w, x, y, z).
        left: (T, n) whether the left finger touches the object.
        right: (T, n) whether the right finger touches it.
        held: (T,) index of the held object, or -1.
        there: (T, n) whether the object is at the target of the task (the relation holds).
        done: (T, g) whether the subgoal is done: related, released and at rest.
        items: Indices of the movable items and distractors.
        pick_slots: Names of the slots that are no stand of a container or fixture.
    """

    info: SceneInfo
    rate_hz: float
    time: Floats
    tool: Floats
    width: Floats
    closing: Bools
    positions: Floats
    quaternions: Floats
    left: Bools
    right: Bools
    held: npt.NDArray[np.int16]
    there: Bools
    done: Bools
    items: tuple[int, ...]
    pick_slots: tuple[str, ...]

    @property
    def rows(self) -> int:
        """Number of rows."""
        return int(self.time.shape[0])

    def steps(self, seconds: float) -> int:
        """Return the number of control steps in a time, at least one."""
        return max(1, round(seconds * self.rate_hz))

    def on_table(self, row: int, i: int) -> bool:
        """Tell whether an object has not fallen off the table."""
        return bool(self.positions[row, i, 2] > -LIMITS.fallen_below)

    def box_distances(self, row: int, point: Floats) -> Floats:
        """Return the distance of a point to every object's oriented bounding box.

        Args:
            row: Row of the object poses.
            point: (3,) point.

        Returns:
            (n,) distances [m], zero inside a box.
        """
        size = np.array([o.size_m for o in self.info.objects]).reshape(-1, 3)
        offset = point - self.positions[row]
        q = self.quaternions[row]
        axis = -q[:, 1:]
        twice = 2.0 * _cross(axis, offset)
        local = offset + q[:, :1] * twice + _cross(axis, twice)
        local[:, 2] -= 0.5 * size[:, 2]
        outside: Floats = np.linalg.norm(np.maximum(np.abs(local) - 0.5 * size, 0.0), axis=1)
        return outside

    def centre_distances(self, row: int, point: Floats) -> Floats:
        """Return the horizontal distance [m] of a point to every object, shape (n,)."""
        distances: Floats = np.linalg.norm(self.positions[row, :, :2] - point[:2], axis=1)
        return distances

    def slot_near(self, point: Floats, reach: float) -> str | None:
        """Return the nearest pick slot within a horizontal distance of a point, or None."""
        best: tuple[float, str] | None = None
        for name in self.pick_slots:
            x, y, _ = self.info.slot(name).position
            gap = float(np.hypot(point[0] - x, point[1] - y))
            if gap <= reach and (best is None or (gap, name) < best):
                best = (gap, name)
        return None if best is None else best[1]


def trace_of(record: Record, *, relation: str, step_limit: int) -> Trace:
    """Return the arrays of a record that the detectors read.

    Args:
        record: The record.
        relation: Name of the relation that the subgoals of its task ask for.
        step_limit: Steps after which an episode of its condition ends; later rows are left out, so that idle time
            added to a record changes nothing.

    Raises:
        RecordError: If the record lacks a predicate of a movable object.
    """
    info = record.metadata.scene
    rows = min(len(record), step_limit + 1)
    objects = info.objects
    items = tuple(i for i, o in enumerate(objects) if o.role in ("item", "distractor") and not o.fixed)
    there = np.zeros((rows, len(objects)), dtype=np.bool_)
    for i in items:
        there[:, i] = record.predicates[:rows, _column(record, relation, objects[i].name)]
    left, right = _touches(record, rows)
    stands = {o.slot for o in objects if o.role in ("container", "fixture")}
    return Trace(
        info=info,
        rate_hz=record.metadata.control_rate_hz,
        time=record.time[:rows],
        tool=record.ee_position[:rows],
        width=record.finger_width[:rows],
        closing=_closing(record.gripper_command[:rows]),
        positions=record.object_positions[:rows],
        quaternions=record.object_quaternions[:rows],
        left=left,
        right=right,
        held=record.held[:rows],
        there=there,
        done=record.subgoals[:rows],
        items=items,
        pick_slots=tuple(s.name for s in info.slots if s.name not in stands),
    )


def _cross(a: Floats, b: Floats) -> Floats:
    """Return the cross products of two lists of vectors, shape (n, 3); numpy's own is slow on short lists."""
    x = a[:, 1] * b[:, 2] - a[:, 2] * b[:, 1]
    y = a[:, 2] * b[:, 0] - a[:, 0] * b[:, 2]
    z = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return np.stack((x, y, z), axis=1)


def _column(record: Record, relation: str, name: str) -> int:
    """Return the column of the predicate that says whether an object is at the target."""
    start = f"{relation}({name}, "
    for column, predicate in enumerate(record.metadata.predicate_names):
        if predicate.startswith(start):
            return column
    m = record.metadata
    raise RecordError(
        f"{m.task}/{m.condition} seed {m.seed}: the record has no predicate {start}...); record the trial again."
    )


def _closing(command: Floats) -> Bools:
    """Return whether the gripper is commanded to close, keeping the last command through zeros."""
    last = np.maximum.accumulate(np.where(command != 0.0, np.arange(command.shape[0]), -1))
    closing: Bools = np.where(last >= 0, command[last] > 0.0, False)
    return closing


def _touches(record: Record, rows: int) -> tuple[Bools, Bools]:
    """Return which object the left and the right finger touch, each of shape (rows, n)."""
    contacts = record.contacts
    names = {o.name: i for i, o in enumerate(record.metadata.scene.objects)}
    shape = (rows, len(names))
    left, right = np.zeros(shape, dtype=np.bool_), np.zeros(shape, dtype=np.bool_)
    stop = int(contacts.offsets[rows])
    row = np.repeat(np.arange(rows), np.diff(contacts.offsets[: rows + 1]))
    index = np.array([names.get(b, -1) for b in record.bodies] or [-1])
    pairs = contacts.bodies[:stop]
    for finger, touched in (("left_finger", left), ("right_finger", right)):
        if finger not in record.bodies:
            continue
        number = record.bodies.index(finger)
        for mine, other in ((0, 1), (1, 0)):
            chosen = (pairs[:, mine] == number) & (index[pairs[:, other]] >= 0)
            touched[row[chosen], index[pairs[chosen, other]]] = True
    return left, right
