"""Contacts of the physics engine as pairs of body names, including contacts of sleeping objects."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence
from collections.abc import Set as AbstractSet
from operator import itemgetter
from typing import Any, NamedTuple

import mujoco

from betterbench.geometry import Vector
from betterbench.interface.state import Contact
from betterbench.sim.scenes.builder import LABELS, CompiledScene


class _Sleep(NamedTuple):
    """Objects of a scene that are asleep in the engine.

    Attributes:
        cycles: Bytes of the engine's array ``tree_asleep``, from which the other fields are derived.
        sleeping: Indices of the sleeping objects.
        places: Function that selects the positions of the sleeping objects from the positions of all objects.
    """

    cycles: bytes
    sleeping: tuple[int, ...]
    places: Callable[[Sequence[Vector]], tuple[Vector, ...]]


Groups = tuple[tuple[int, tuple[int, ...]], ...]
"""Pairs of bodies in contact: the index of each pair, and the addresses of the normal forces at its contact points."""


class _Row(NamedTuple):
    """Contacts from the last reading, without their forces.

    They are reused as long as the same pairs of bodies are in contact.

    Attributes:
        groups: Pairs of bodies that the engine lists.
        kept: Contacts of the sleeping objects, by the index of the pair.
        order: Indices of all pairs in contact.
        contacts: Contacts in the order of ``order``. If the force still has to be read, the contact is a placeholder.
        awake: Contacts that still need their force: index in ``contacts``, both names, and addresses of the forces.
        held: Name of the object in the gripper, or None.
    """

    groups: Groups
    kept: Mapping[int, Contact]
    order: tuple[int, ...]
    contacts: tuple[Contact, ...]
    awake: tuple[tuple[int, str, str, tuple[int, ...]], ...]
    held: str | None


class ContactReader:
    """Reader of the contacts between the bodies of one model.

    The engine puts groups of resting objects to sleep. It then neither moves these objects nor lists their contacts,
    until an awake object touches the group. The contacts of a sleeping group do not change, so they are cached. They
    are computed once after the group has fallen asleep, in a second copy of the engine's data in which all objects are
    awake.

    Names and addresses of the last reading are reused while the engine lists the same contact points. This reduces the
    CPU time of a reading from 192 to 48 µs in the task fast_food, and from 308 to 62 µs in breakfast_table. The times
    are means over the control steps of an expert's episode. Both versions were measured alternately on a busy machine
    (2026-11-28).
    """

    def __init__(self, compiled: CompiledScene, names: tuple[str, ...]) -> None:
        """Assign an index to each pair of bodies in the model. ``names`` are the object names in scene order."""
        self._model, self._names = compiled.model, names
        n = len(names)
        numbers, self._pair_names = _pairs((*names, *LABELS), n + 3)
        left, right, table = n, n + 1, n + 4
        self._holds = tuple(
            (numbers[i][left], numbers[i][right], frozenset({numbers[i][j] for j in (*range(n), table) if j != i}))
            for i in range(n)
        )
        self._lefts = frozenset(left for left, _, _ in self._holds)
        self._numbers = numbers
        nothing = len(numbers) - 1
        self._geom_labels = bytes(nothing if label < 0 else label for label in compiled.geom_labels.tolist())
        trees = self._model.body_treeid[compiled.bodies].tolist()
        self._trees = tuple((i, tree) for i, tree in enumerate(trees) if tree >= 0)
        self._data: mujoco.MjData | None = None
        self._asleep: memoryview[int] = memoryview(b"")
        self._sleep = _Sleep(b"", (), tuple)
        self._awake = mujoco.MjData(self._model)
        self._kept_for: tuple[tuple[int, ...], tuple[Vector, ...]] = ((), ())
        self._kept: dict[int, Contact] = {}
        self._kept_numbers: frozenset[int] = frozenset()
        self._listed: tuple[bytes, bytes] = (b"", b"")
        self._groups: Groups = ()
        self._row = _Row((), _NOTHING, (), (), (), None)
        self._by_robot = frozenset({numbers[i][part] for i in range(n) for part in range(n, table)})
        self._passed: dict[int, float] = {}

    def start_step(self) -> None:
        """Forget the transient contacts of the last control step, i.e. the contacts that ended during the step."""
        self._passed = {}

    def see_step(self, data: mujoco.MjData) -> None:
        """Remember the robot's contacts at a physics step between two readings.

        The next reading includes these contacts with their largest force. Without this method, a brief contact that
        begins and ends between two readings would be missed.
        """
        if data.ncon == 0:
            return
        for number, force in self._touching(data).items():
            if number in self._by_robot:
                self._passed[number] = max(force, self._passed.get(number, 0.0))

    def read(self, data: mujoco.MjData, positions: Sequence[Vector]) -> tuple[tuple[Contact, ...], str | None]:
        """Return all contacts that involve an object or the gripper, in label order, and the name of the held object.

        An object is held if both fingers touch it now, and neither another object nor the table touches it.
        ``positions`` are the positions of the objects in ``data``.
        """
        if data is not self._data:  # the engine keeps its arrays at fixed addresses
            self._data, self._asleep = data, data.tree_asleep.data
        groups = self._grouped(data)
        cycles = self._asleep.tobytes()
        if cycles != self._sleep.cycles:
            self._sleep = self._who_sleeps(cycles)
        kept = _NOTHING
        if self._sleep.sleeping:
            self._keep(data, positions)
            kept = self._kept
        row = self._row
        if groups is not row.groups or kept is not row.kept:  # rare: contacts last for many steps
            row = self._row = self._new_row(groups, kept)
        contacts = row.contacts
        if row.awake:
            forces, filled = data.efc_force.data, list(contacts)
            for i, one, other, addresses in row.awake:
                filled[i] = Contact(one, other, _force(forces, addresses))
            contacts = tuple(filled)
        return self._with_passed(row.order, contacts) if self._passed else contacts, row.held

    def snapshot(self) -> dict[str, Any]:
        """Return everything, except ``data``, that affects the next reading.

        The engine's data for the sleeping objects are copied.
        """
        kept = {name: value for name, value in vars(self).items() if name in _KEPT_BETWEEN_READINGS}
        return {**kept, "_awake": copy.copy(self._awake)}

    def restore(self, snapshot: Mapping[str, Any]) -> None:
        """Restore the state that :meth:`snapshot` has returned."""
        vars(self).update(snapshot)
        self._awake = copy.copy(snapshot["_awake"])

    def _touching(self, data: mujoco.MjData) -> dict[int, float]:
        """Return the sum of the normal forces [N] for each pair of bodies in contact, by the index of the pair."""
        forces = data.efc_force.data
        return {number: _force(forces, addresses) for number, addresses in self._grouped(data)}

    def _grouped(self, data: mujoco.MjData) -> Groups:
        """Return the pairs of bodies that the engine lists as in contact.

        While the contact points do not change, the same tuple is returned again.
        """
        if data.ncon == 0:
            return ()
        contact = data.contact
        geoms, rows = contact.geom, contact.efc_address
        listed = geoms.tobytes(), rows.tobytes()
        if listed != self._listed:
            labels, numbers = self._geom_labels, self._numbers
            found: dict[int, list[int]] = {}
            for (one, other), address in zip(geoms.tolist(), rows.tolist(), strict=True):
                number = numbers[labels[one]][labels[other]]
                if number >= 0:
                    found.setdefault(number, []).append(address)
            self._listed = listed
            self._groups = tuple([(number, tuple(addresses)) for number, addresses in found.items()])
        return self._groups

    def _new_row(self, groups: Groups, kept: Mapping[int, Contact]) -> _Row:
        """Return the reading for the given pairs in contact and the given contacts of sleeping objects."""
        asleep = frozenset() if kept is _NOTHING else self._kept_numbers
        awake = {number: addresses for number, addresses in groups if number not in asleep}
        order = tuple(sorted({*awake, *kept}))
        contacts = tuple([kept[n] if n in kept else Contact(*self._pair_names[n], 0.0) for n in order])
        read = tuple([(i, *self._pair_names[n], awake[n]) for i, n in enumerate(order) if n in awake])
        return _Row(groups, kept, order, contacts, read, self._held({*order}) if awake else None)

    def _with_passed(self, order: tuple[int, ...], contacts: tuple[Contact, ...]) -> tuple[Contact, ...]:
        """Return the given contacts together with the transient contacts since the last reading.

        If a pair of bodies has several contacts, the largest force is kept.
        """
        found = dict(zip(order, contacts, strict=True))
        for number, force in self._passed.items():
            before = found[number].force_n if number in found else 0.0
            found[number] = Contact(*self._pair_names[number], max(force, before))
        return tuple([found[number] for number in sorted(found)])

    def _who_sleeps(self, cycles: bytes) -> _Sleep:
        """Return the sleeping objects, derived from the sleep state of the engine's kinematic trees."""
        asleep = self._asleep
        sleeping = [i for i, tree in self._trees if asleep[tree] >= 0]
        picked = (
            sleeping if len(sleeping) > 1 else [slice(i, i + 1) for i in sleeping]
        )  # for a single object, itemgetter with a slice still returns a sequence
        return _Sleep(cycles, tuple(sleeping), itemgetter(*picked) if picked else tuple)

    def _keep(self, data: mujoco.MjData, positions: Sequence[Vector]) -> None:
        """Compute the contacts of the sleeping objects, unless they were already asleep at the same positions."""
        sleeping = self._sleep.sleeping
        state = (sleeping, self._sleep.places(positions))
        if state == self._kept_for:
            return
        self._kept_numbers = frozenset(number for i in sleeping for number in self._numbers[i] if number >= 0)
        if not self._sleep_on(*state):
            self._awake.qpos[:] = data.qpos
            mujoco.mj_forward(self._model, self._awake)
            touching = self._touching(self._awake)
            self._kept = {number: Contact(*self._pair_names[number], touching[number]) for number in sorted(touching)}
        self._kept_for = state
        self._kept = {number: contact for number, contact in self._kept.items() if number in self._kept_numbers}

    def _sleep_on(self, sleeping: tuple[int, ...], places: tuple[Vector, ...]) -> bool:
        """Return whether the cached contacts of the sleeping objects are still valid.

        They are valid if all sleeping objects were already asleep at the same positions at the last call, and none of
        them is in contact with an object that has woken up. Recomputing the contacts would take as long as a control
        step.
        """
        before = dict(zip(*self._kept_for, strict=True))
        if not all(i in before and before[i] == place for i, place in zip(sleeping, places, strict=True)):
            return False
        woken = {number for i in before.keys() - {*sleeping} for number in self._numbers[i]}
        return not any(number in woken and number in self._kept_numbers for number in self._kept)

    def _held(self, touching: AbstractSet[int]) -> str | None:
        """Return the object that both fingers and nothing else touch, given the indices of the pairs in contact."""
        if self._lefts.isdisjoint(touching):
            return None
        for i, (left, right, supports) in enumerate(self._holds):
            if left in touching and right in touching and supports.isdisjoint(touching):
                return self._names[i]
        return None


_NOTHING: Mapping[int, Contact] = {}
"""Contacts of sleeping objects if no object sleeps."""

_KEPT_BETWEEN_READINGS = (
    "_kept_for",
    "_kept",
    "_kept_numbers",
    "_passed",
)


def _force(forces: memoryview[float], addresses: tuple[int, ...]) -> float:
    """Return the sum of the normal forces at the given addresses [N].

    A contact point that the solver omits has no force.
    """
    total = 0.0
    for address in addresses:
        if address >= 0:
            total += forces[address]
    return total


def _pairs(labels: tuple[str, ...], relevant: int) -> tuple[list[list[int]], dict[int, tuple[str, str]]]:
    """Return the index of each pair of labels (-1 for irrelevant pairs), and the two names for each index.

    The labels below ``relevant`` are those of objects and gripper parts. A pair is irrelevant if it contains no such
    label. The last row and column are for geoms without a label. Indices ascend in label order.
    """
    n = len(labels)
    numbers = [[-1] * (n + 1) for _ in range(n + 1)]
    names = {}
    for a in range(min(relevant, n)):
        for b in range(a + 1, n):
            numbers[a][b] = numbers[b][a] = a * n + b
            names[a * n + b] = (labels[a], labels[b])
    return numbers, names
