"""Trace of an episode: its record, converted to arrays for the detectors of failure modes."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from betterbench.errors import RecordError
from betterbench.geometry import Pose, Vector, distance
from betterbench.interface.state import ObjectInfo, SceneInfo
from betterbench.records import Record
from betterbench.tasks import Condition
from betterbench.tasks.judging.motion import Bools, Floats, Motion, closing_of, graspable
from betterbench.tasks.judging.picked_slots import picked_slots
from betterbench.tasks.relations import RELATIONS, relation


@dataclass(frozen=True, slots=True, eq=False)
class Whereabout:
    """Rows of the trace in which an object had a relation to a target. The instruction need not request this relation.

    Attributes:
        object: Index of the object.
        relation: Name of the relation.
        target: Index of the target.
        region: Region of the target, or "" if the target has only one region.
        rows: (T,) whether the object had this relation to the target.
    """

    object: int
    relation: str
    target: int
    region: str
    rows: Bools


@dataclass(frozen=True, slots=True, eq=False)
class Trace(Motion):
    """Motion and subgoals of an episode as arrays, with ``T`` rows, ``n`` objects and ``g`` subgoals.

    Attributes:
        time: (T,) time since reset [s].
        touched: (T, n) whether the gripper touches the object.
        by_arm: (T, n) whether a part of the arm other than the gripper touches the object.
        whereabouts: Rows in which each object is in each target region. Closed drawers are left out.
        serves: (T, g, n) whether the object satisfies the relation that the subgoal requires.
        done: (T, g) whether the subgoal is done, i.e. its relation holds, and the object is released and at rest.
        meant: For each subgoal, the indices of the objects that can satisfy it.
        targets: For each subgoal, the index of its target.
        drawers: For each drawer, its index, the index of its cabinet, and its closed position in the cabinet's frame.
    """

    time: Floats
    touched: Bools
    by_arm: Bools
    whereabouts: tuple[Whereabout, ...]
    serves: Bools
    done: Bools
    meant: tuple[tuple[int, ...], ...]
    targets: tuple[int, ...]
    drawers: tuple[tuple[int, int, Vector], ...]

    def placed(self, row: int, i: int) -> Whereabout | None:
        """Return the target region that contains an object at a row of the trace, or None if no region does."""
        return next((w for w in self.whereabouts if w.object == i and w.rows[row]), None)

    def opening(self, row: int, drawer: int) -> float:
        """Return how far a drawer is open at a row of the trace [m]. This is 0 for objects that are not drawers."""
        for i, cabinet, place in self.drawers:
            if i == drawer:
                p, q = self.positions[row, cabinet].tolist(), self.quaternions[row, cabinet].tolist()
                home = Pose((p[0], p[1], p[2]), (q[0], q[1], q[2], q[3])).apply(place)
                return distance(self.positions[row, drawer].tolist(), home)
        return 0.0


def place_middle(target: ObjectInfo, kind: str, region: str) -> Vector:
    """Return the center of a target region in the target object's frame [m]."""
    named = next((r.position for r in target.regions if r.name == region), None)
    return relation(kind).middle(target, region) if named is None else named


def trace_of(record: Record, condition: Condition, *, step_limit: int) -> Trace:
    """Convert a record to the arrays that the detectors use.

    Args:
        record: Record of the episode.
        condition: Condition of the trial. Objects are identified by kind and slot, so their names do not matter.
        step_limit: Step limit of the condition. Rows of the record after this step are ignored.

    Raises:
        RecordError: If the record lacks an object of the condition, or a predicate about a movable object.
    """
    info = record.metadata.scene
    rows = min(len(record), step_limit + 1)
    objects = info.objects
    items = graspable(info)
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
    left, right, hand, arm = touches(record, rows, ("left_finger", "right_finger", "hand", "arm"))
    width, command = record.finger_width[:rows], record.gripper_command[:rows]
    rate_hz = record.metadata.control_rate_hz
    return Trace(
        info=info, rate_hz=rate_hz, time=record.time[:rows],
        touched=left | right | hand, by_arm=arm, tool=record.ee_position[:rows],
        width=width, closing=closing_of(command, width, (left | right).any(axis=1), rate_hz=rate_hz),
        positions=record.object_positions[:rows], quaternions=record.object_quaternions[:rows], left=left, right=right,
        held=record.held[:rows], force=finger_forces(record, rows), whereabouts=whereabouts, there=there,
        picked=picked_slots(condition.task, info), serves=serves, done=record.subgoals[:rows], meant=meant,
        targets=targets, drawers=_drawers(info, condition),
    )  # fmt: skip


def _column(record: Record, label: str) -> int:
    """Return the column of the record that holds a predicate.

    Raises:
        RecordError: If the record has no such predicate.
    """
    try:
        return record.metadata.predicate_names.index(label)
    except ValueError:
        m = record.metadata
        text = f"{m.task}/{m.condition} seed {m.seed}: the record has no predicate {label}. Record the trial again."
        raise RecordError(text) from None


def _whereabouts(record: Record, rows: int, items: tuple[int, ...]) -> tuple[Whereabout, ...]:
    """Return the rows in which an object is in a target region, for each object and each region.

    They are determined from all predicates in the record.
    """
    objects = record.metadata.scene.objects
    column = {name: c for c, name in enumerate(record.metadata.predicate_names)}
    names = {label.partition("(")[0] for label in column}
    found = []
    carried = (RELATIONS[name] for name in sorted(names & RELATIONS.keys()) if RELATIONS[name].carried)
    for kind, (t, target) in itertools.product(carried, enumerate(objects)):
        for region, i in itertools.product(kind.regions(target), items):
            c = column.get(kind.label(objects[i].name, target.name, region))
            if c is not None:
                found.append(Whereabout(i, kind.name, t, region, record.predicates[:rows, c]))
    return tuple(found)


def _index_of_kind(info: SceneInfo, kind: str) -> int:
    """Return the index of the first object of a kind in the scene.

    Raises:
        RecordError: If the scene has no object of this kind.
    """
    found = next((i for i, o in enumerate(info.objects) if o.kind == kind), None)
    if found is None:
        raise RecordError(
            f"scene: the record contains no object of the kind {kind!r}, but the condition of the trial requires "
            f"one. Record the trial again."
        )
    return found


def _drawers(info: SceneInfo, condition: Condition) -> tuple[tuple[int, int, Vector], ...]:
    found = []
    for o in condition.objects:
        if o.mount is not None:
            cabinet = _index_of_kind(info, condition.object(o.mount.target).kind)
            place = info.objects[cabinet].region(o.mount.region).position
            found.append((_index_of_kind(info, o.kind), cabinet, place))
    return tuple(found)


def finger_forces(record: Record, rows: int) -> Floats:
    """Return the largest normal force that a finger exerts on each object [N], as a (rows, n) array."""
    contacts, bodies = record.contacts, record.bodies
    names = {o.name: i for i, o in enumerate(record.metadata.scene.objects)}
    finger = np.array([b in ("left_finger", "right_finger") for b in bodies], dtype=np.bool_)
    object_of = np.array([names.get(b, -1) for b in bodies], dtype=np.intp)
    row = np.repeat(np.arange(rows), np.diff(contacts.offsets[: rows + 1]))
    stop = int(contacts.offsets[rows])
    pressing: Floats = np.zeros((rows, len(names)))
    for mine, other in ((0, 1), (1, 0)):
        thing = object_of[contacts.bodies[:stop, other]]
        chosen = finger[contacts.bodies[:stop, mine]] & (thing >= 0)
        np.maximum.at(pressing, (row[chosen], thing[chosen]), contacts.forces[:stop][chosen])
    return pressing


def touches(record: Record, rows: int, parts: tuple[str, ...]) -> Bools:
    """Return whether each part of the gripper touches each object, as a (parts, rows, n) array."""
    contacts = record.contacts
    names = {o.name: i for i, o in enumerate(record.metadata.scene.objects)}
    part_of = np.array([parts.index(b) if b in parts else -1 for b in record.bodies], dtype=np.intp)
    object_of = np.array([names.get(b, -1) for b in record.bodies], dtype=np.intp)
    row = np.repeat(np.arange(rows), np.diff(contacts.offsets[: rows + 1]))
    pairs = contacts.bodies[: int(contacts.offsets[rows])]
    touched = np.zeros((len(parts), rows, len(names)), dtype=np.bool_)
    for mine, other in ((0, 1), (1, 0)):
        part, thing = part_of[pairs[:, mine]], object_of[pairs[:, other]]
        chosen = (part >= 0) & (thing >= 0)
        touched[part[chosen], row[chosen], thing[chosen]] = True
    return touched
