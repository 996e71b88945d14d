"""What the detectors read from a record: its columns by object, with contacts and relations as arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from betterbench.errors import RecordError
from betterbench.geometry import Pose, Vector, distance
from betterbench.recording import Record
from betterbench.state import SceneInfo
from betterbench.tasks import THRESHOLDS, Condition
from betterbench.tasks.relations import RELATIONS, relation

Floats = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Whereabout:
    """When an object was at one place of a target, asked for or not.

    Attributes:
        place: TargetRegion of the target, "" if it offers just one.
        rows: (T,) whether it was there.
    """

    object: int
    relation: str
    target: int
    region: str
    rows: Bools


@dataclass(frozen=True, slots=True, eq=False)
class Trace:
    """One episode as arrays. ``T`` rows, ``n`` objects, ``g`` subgoals; world frame, meters, seconds.

    Attributes:
        time: (T,) time since reset.
        tool: (T, 3) tool center point.
        width: (T,) distance of the finger pads.
        closing: (T,) whether the gripper is commanded to close; a command of zero keeps the last one.
        positions: (T, n, 3) object positions (center of the bottom face).
        quaternions: (T, n, 4) object rotations (w, x, y, z).
        left: (T, n) whether the left finger touches the object.
        right: (T, n) whether the right finger touches it.
        held: (T,) index of the held object, or -1.
        whereabouts: Per object and place of a target when it was there; shut drawers are left out.
        there: (T, n) whether the object is at some place of a target, asked for or not.
        serves: (T, g, n) whether the object is where the subgoal wants it.
        done: (T, g) whether the subgoal is done: related, released and at rest.
        meant: Per subgoal the indices of the objects that it can mean.
        targets: Per subgoal the index of its target.
        items: Indices of what can be grasped: items, distractors and drawers.
        drawers: Per drawer its index, that of its cabinet, and the place of the closed drawer in the cabinet's frame.
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
    whereabouts: tuple[Whereabout, ...]
    there: Bools
    serves: Bools
    done: Bools
    meant: tuple[tuple[int, ...], ...]
    targets: tuple[int, ...]
    items: tuple[int, ...]
    drawers: tuple[tuple[int, int, Vector], ...]
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
        return bool(self.positions[row, i, 2] > -THRESHOLDS.fallen_below)

    def placed(self, row: int, i: int) -> Whereabout | None:
        """Return where an object is with respect to a target at a row, or None if at no place of any."""
        return next((w for w in self.whereabouts if w.object == i and w.rows[row]), None)

    def is_drawer(self, i: int | None) -> bool:
        """Tell whether an object is a drawer."""
        return any(i == drawer for drawer, _, _ in self.drawers)

    def opening(self, row: int, drawer: int) -> float:
        """Return how far a drawer is drawn out [m]; 0 for what is no drawer."""
        for i, cabinet, place in self.drawers:
            if i == drawer:
                p, q = self.positions[row, cabinet].tolist(), self.quaternions[row, cabinet].tolist()
                home = Pose((p[0], p[1], p[2]), (q[0], q[1], q[2], q[3])).apply(place)
                return distance(self.positions[row, drawer].tolist(), home)
        return 0.0

    def box_distances(self, row: int, point: Floats) -> Floats:
        """Return the distance of a point to every object's oriented bounding box."""
        size = np.array([o.size_m for o in self.info.objects]).reshape(-1, 3)
        offset = point - self.positions[row]
        q = self.quaternions[row]
        axis = -q[:, 1:]
        twice = 2.0 * _cross(axis, offset)
        local = offset + q[:, :1] * twice + _cross(axis, twice)
        local[:, 2] -= 0.5 * size[:, 2]
        outside: Floats = np.linalg.norm(np.maximum(np.abs(local) - 0.5 * size, 0.0), axis=1)
        return outside

    def center_distances(self, row: int, point: Floats) -> Floats:
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


def trace_of(record: Record, condition: Condition, *, step_limit: int) -> Trace:
    """Return the arrays of a record that the detectors read.

    Args:
        record: The record.
        condition: The condition in force. Objects are found by kind and slot, so that their names carry no meaning.
        step_limit: Steps after which an episode of its condition ends; later rows are left out, so that idle time
            added to a record changes nothing.

    Raises:
        RecordError: If the record lacks a predicate of a movable object.
    """
    info = record.metadata.scene
    rows = min(len(record), step_limit + 1)
    objects = info.objects
    items = tuple(i for i, o in enumerate(objects) if o.role in ("item", "distractor", "drawer") and not o.fixed)
    goals = condition.instruction.subgoals
    meant = tuple(
        tuple(
            i
            for i in items
            if (
                objects[i].kind == goal.reference.kind
                if goal.reference.slot is None
                else objects[i].slot == goal.reference.slot
            )
        )
        for goal in goals
    )
    whereabouts = _whereabouts(record, rows, items)
    there = np.zeros((rows, len(objects)), dtype=np.bool_)
    for w in whereabouts:
        there[:, w.object] |= w.rows
    serves = np.zeros((rows, len(goals), len(objects)), dtype=np.bool_)
    targets = tuple(_index_of_kind(info, condition.object(goal.target).kind) for goal in goals)
    for g, goal in enumerate(goals):
        for i in meant[g]:
            label = relation(goal.relation).label(objects[i].name, objects[targets[g]].name, goal.region)
            serves[:, g, i] = record.predicates[:rows, _column(record, label)]
    left, right = _touches(record, rows)
    stands = {o.slot for o in objects if o.role in ("container", "fixture")}
    return Trace(
        info=info, rate_hz=record.metadata.control_rate_hz, time=record.time[:rows], tool=record.ee_position[:rows],
        width=record.finger_width[:rows], closing=_closing(record.gripper_command[:rows]),
        positions=record.object_positions[:rows], quaternions=record.object_quaternions[:rows], left=left, right=right,
        held=record.held[:rows], whereabouts=whereabouts, there=there, serves=serves, done=record.subgoals[:rows],
        meant=meant, targets=targets, items=items, drawers=_drawers(info, condition),
        pick_slots=tuple(s.name for s in info.slots if s.name not in stands),
    )  # fmt: skip


def _cross(a: Floats, b: Floats) -> Floats:
    """Return the cross products of two lists of vectors, shape (n, 3); numpy's own is slow on short lists."""
    x = a[:, 1] * b[:, 2] - a[:, 2] * b[:, 1]
    y = a[:, 2] * b[:, 0] - a[:, 0] * b[:, 2]
    z = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return np.stack((x, y, z), axis=1)


def _column(record: Record, label: str) -> int:
    """Return the column of a predicate.

    Raises:
        RecordError: If the record lacks it.
    """
    try:
        return record.metadata.predicate_names.index(label)
    except ValueError:
        m = record.metadata
        text = f"{m.task}/{m.condition} seed {m.seed}: the record has no predicate {label}; record the trial again."
        raise RecordError(text) from None


def _whereabouts(record: Record, rows: int, items: tuple[int, ...]) -> tuple[Whereabout, ...]:
    """Return when which object was at which place of which target, from all predicates of the record."""
    objects = record.metadata.scene.objects
    column = {name: c for c, name in enumerate(record.metadata.predicate_names)}
    names = {label.partition("(")[0] for label in column}
    found = []
    for kind in (RELATIONS[name] for name in sorted(names & RELATIONS.keys()) if RELATIONS[name].carried):
        for t, target in enumerate(objects):
            for place in kind.regions(target):
                for i in items:
                    c = column.get(kind.label(objects[i].name, target.name, place))
                    if c is not None:
                        found.append(Whereabout(i, kind.name, t, place, record.predicates[:rows, c]))
    return tuple(found)


def _index_of_kind(info: SceneInfo, kind: str) -> int:
    return next(i for i, o in enumerate(info.objects) if o.kind == kind)


def _drawers(info: SceneInfo, condition: Condition) -> tuple[tuple[int, int, Vector], ...]:
    found = []
    for o in condition.objects:
        if o.mount is not None:
            cabinet = _index_of_kind(info, condition.object(o.mount.target).kind)
            place = info.objects[cabinet].region(o.mount.region).position
            found.append((_index_of_kind(info, o.kind), cabinet, place))
    return tuple(found)


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
