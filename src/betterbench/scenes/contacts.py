"""Which bodies touch: the contacts of the physics engine as pairs of names, those of sleeping objects included."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np

from betterbench.scenes.builder import LABELS, CompiledScene
from betterbench.state import Contact


class ContactReader:
    """Reads the contacts of one model.

    The engine puts groups of objects that have come to rest to sleep: it neither moves them nor lists their contacts
    until something that is awake touches one of the group. What they rest on is still true, so it is kept. The contacts
    of the sleeping are computed once, when the group has fallen asleep, with everything awake in a second set of data.
    """

    def __init__(self, compiled: CompiledScene, names: tuple[str, ...]) -> None:
        """Prepare for a model; ``names`` are those of its objects in scene order."""
        self._model, self._geom_labels = compiled.model, compiled.geom_labels
        self._names = names
        n = len(names)
        self._numbers, self._pair_names = _pairs((*names, *LABELS), n + 3)
        numbers, left, right, table = self._numbers, n, n + 1, n + 4
        self._holds = tuple(
            (numbers[i][left], numbers[i][right], frozenset({numbers[i][j] for j in (*range(n), table) if j != i}))
            for i in range(n)
        )
        self._bodies = compiled.bodies
        self._trees = self._model.body_treeid[self._bodies]
        self._movable = self._trees >= 0
        self._awake = mujoco.MjData(self._model)
        self._sleep_state = b""
        self._sleeping: np.ndarray = np.empty(0, np.int64)
        self._kept_for: tuple[bytes, bytes] = (b"", b"")
        self._kept: dict[int, float] = {}
        self._kept_contacts: tuple[Contact, ...] = ()
        self._kept_numbers: frozenset[int] = frozenset()

    def read(self, data: mujoco.MjData) -> tuple[tuple[Contact, ...], str | None]:
        """Return all pairs that involve an object or the gripper, in the order of the labels, and the held object.

        An object is held if both fingers touch it and neither another object nor the table does.
        """
        total = self._touching(data)
        sleep_state = data.tree_asleep.tobytes()
        if sleep_state != self._sleep_state:
            self._sleep_state = sleep_state
            asleep = self._movable & (data.tree_asleep[self._trees] >= 0)
            self._sleeping = np.flatnonzero(asleep)
        if len(self._sleeping):
            self._keep(data)
            kept = self._kept_numbers
            total = {number: force for number, force in total.items() if number not in kept}
            if not total:
                return self._kept_contacts, None  # what the gripper touches is awake
            total |= self._kept
        names = self._pair_names
        contacts = tuple([Contact(*names[number], total[number]) for number in sorted(total)])
        return contacts, self._held(total)

    def snapshot(self) -> dict[str, Any]:
        """Return everything that the next reading depends on beside the data; the data of the sleeping are copied."""
        kept = {name: value for name, value in vars(self).items() if name in _KEPT_BETWEEN_READINGS}
        return {**kept, "_awake": copy.copy(self._awake)}

    def restore(self, snapshot: Mapping[str, Any]) -> None:
        """Put back what :meth:`snapshot` returned."""
        vars(self).update(snapshot)
        self._awake = copy.copy(snapshot["_awake"])

    def _touching(self, data: mujoco.MjData) -> dict[int, float]:
        """Return the number of each pair that the engine lists, with the sum of its normal forces [N]."""
        total: dict[int, float] = {}
        if data.ncon == 0:
            return total
        contact = data.contact
        pairs = self._geom_labels[contact.geom].tolist()
        addresses = contact.efc_address.tolist()
        forces = data.efc_force.tolist()
        numbers = self._numbers
        for (a, b), address in zip(pairs, addresses, strict=True):
            number = numbers[a][b]
            if number >= 0:
                force = forces[address] if address >= 0 else 0.0
                total[number] = total[number] + force if number in total else force
        return total

    def _keep(self, data: mujoco.MjData) -> None:
        """Compute what the sleeping objects touch, unless the same ones lie in the same places as at the last call."""
        state = (self._sleeping.tobytes(), data.xpos.take(self._bodies[self._sleeping], 0).tobytes())
        if state == self._kept_for:
            return
        self._kept_for = state
        self._awake.qpos[:] = data.qpos
        mujoco.mj_forward(self._model, self._awake)
        sleeping = self._sleeping.tolist()
        self._kept_numbers = frozenset(number for i in sleeping for number in self._numbers[i] if number >= 0)
        found = self._touching(self._awake)
        self._kept = {number: found[number] for number in sorted(found) if number in self._kept_numbers}
        self._kept_contacts = tuple(Contact(*self._pair_names[number], force) for number, force in self._kept.items())

    def _held(self, touching: dict[int, float]) -> str | None:
        """Return the object that both fingers touch and nothing else supports, from the pairs that touch."""
        for i, (left, right, supports) in enumerate(self._holds):
            if left in touching and right in touching and supports.isdisjoint(touching):
                return self._names[i]
        return None


_KEPT_BETWEEN_READINGS = (
    "_sleep_state",
    "_sleeping",
    "_kept_for",
    "_kept",
    "_kept_contacts",
    "_kept_numbers",
)


def _pairs(labels: tuple[str, ...], relevant: int) -> tuple[list[list[int]], dict[int, tuple[str, str]]]:
    """Return the numbers of all pairs of labels, -1 for a pair that does not count, and the names by number.

    Labels below ``relevant`` are objects or parts of the gripper; pairs without any of them do not count. The last row
    and the last column are for geometries without a label. Numbers are in the order of the labels.
    """
    n = len(labels)
    numbers = [[-1] * (n + 1) for _ in range(n + 1)]
    names = {}
    for a in range(min(relevant, n)):
        for b in range(a + 1, n):
            numbers[a][b] = numbers[b][a] = a * n + b
            names[a * n + b] = (labels[a], labels[b])
    return numbers, names
