"""Contacts and relations in LIBERO's simulator. For speed, they are read by the indices of geoms, sites and bodies.

LIBERO's own contact check looks up four names for each contact of the scene, and its check of whether an object is in a
region takes a dozen NumPy calls. Here, the same data are read by index. This module is imported in an environment
without betterbench, so it uses only NumPy.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

_RESTS = {"arm", "table", "floor"}
"""Labels of bodies whose contacts with each other are not recorded."""

_HEIGHT_M = 0.1
_SUNK_M = 0.005
"""Depth below the top of a site, and height above it, at which an object still counts as on the site [m].

The values are those of LIBERO's ``under``.
"""

_BELOW_M = 0.01
"""Depth below a box at which an object is still considered to be in the box [m] (LIBERO's ``in_box``)."""

_UNSURE_M = 1e-9
"""Distance from the limit of a relation below which LIBERO's own check decides [m].

So close to the limit, the two checks can disagree, because LIBERO adds the terms of matrix products in another order.
"""


class Touching:
    """Contacts in a LIBERO simulation."""

    def __init__(self, mujoco: Any, env: Any, labels: Sequence[str]) -> None:  # noqa: ANN401 - another environment's
        """Index the geoms of all bodies. ``labels`` contains the label of each body."""
        self._model, self._data, self._read_force = env.sim.model._model, env.sim.data._data, mujoco.mj_contactForce
        self._numbers = {self._name(mujoco, geom): geom for geom in range(self._model.ngeom)}
        names = sorted(set(labels))
        rank = {name: i for i, name in enumerate(names)}
        ranks = [rank[labels[body]] for body in self._model.geom_bodyid.tolist()]
        self.pairs = [[a, b] for a in names for b in names if a < b and not {a, b} <= _RESTS]
        """All possible pairs of labels in contact, except pairs of the arm, the table and the floor."""
        # Index of a pair, given the ranks of its two labels in either order. It is -1 for pairs that are not recorded.
        codes = [[-1] * len(names) for _ in names]
        for code, (a, b) in enumerate(self.pairs):
            codes[rank[a]][rank[b]] = codes[rank[b]][rank[a]] = code
        # The same table for the indices of two geoms. All geoms of an object share one list.
        rows = [[row[other] for other in ranks] for row in codes]
        self._codes = [rows[own] for own in ranks]
        self._elliptic = self._model.opt.cone == mujoco.mjtCone.mjCONE_ELLIPTIC
        self._masks: dict[Any, np.ndarray] = {}

    def now(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the indices of the pairs in contact, in ascending order, and the normal force of each pair [N].

        The forces are summed as plain Python numbers, because there are only a few dozen contacts. One NumPy operation
        on an array that is not in the cache takes as long as ten plain additions.
        """
        contacts, codes = self._data.contact, self._codes
        sums: dict[int, float] = {}
        for (one, other), force in zip(contacts.geom.tolist(), self._forces(contacts), strict=True):
            code = codes[one][other]
            if code >= 0:
                sums[code] = sums.get(code, 0.0) + force
        found = sorted(sums)
        return np.array(found, np.int64), np.array([sums[code] for code in found], np.float64)

    def _forces(self, contacts: Any) -> list[float]:  # noqa: ANN401 - MuJoCo's own
        address = contacts.efc_address.tolist()
        if self._elliptic and self._data.nefc:
            # The same formula as in mj_contactForce. A contact without a row in efc_force is too far away to exert a
            # force.
            forces = self._data.efc_force.tolist()
            return [forces[row] if row >= 0 else 0.0 for row in address]
        rows = np.zeros((len(address), 6))
        for i, row in enumerate(rows):
            self._read_force(self._model, self._data, i, row)
        return list(rows[:, 0].tolist())

    def between(self, one: Any, other: Any) -> bool:  # noqa: ANN401 - models of robosuite
        """Return whether two models touch.

        The result equals that of robosuite's ``check_contact``, but takes less time.
        """
        geoms = self._data.contact.geom
        return bool((self._mask(one)[geoms] & self._mask(other)[geoms[:, ::-1]]).any())

    def _mask(self, thing: Any) -> np.ndarray:  # noqa: ANN401 - a model of robosuite
        """Return a mask (ngeom,) of the geoms of a model that can be in contact."""
        mask = self._masks.get(thing)
        if mask is None:
            mask = self._masks[thing] = np.zeros(self._model.ngeom, bool)
            mask[[self._numbers[name] for name in thing.contact_geoms if name in self._numbers]] = True
        return mask

    def _name(self, mujoco: Any, geom: int) -> str | None:  # noqa: ANN401
        name: str | None = mujoco.mj_id2name(self._model, mujoco.mjtObj.mjOBJ_GEOM, geom)
        return name


class Relations:
    """Relations that are named in a task's BDDL file.

    Relations between an object and a box on the table or on a fixture are computed by this class. All others are
    computed by LIBERO.
    """

    def __init__(self, mujoco: Any, env: Any, relations: Sequence[list[str]], touching: Touching) -> None:  # noqa: ANN401
        """Look up the indices of the sites and bodies that the relations name."""
        self._env, self._data, self._touching = env, env.sim.data._data, touching
        self._relations = [list(relation) for relation in relations]
        self._placed = [i for i, relation in enumerate(self._relations) if self._is_placed(relation)]
        self._asked = [i for i in range(len(self._relations)) if i not in self._placed]
        placed = [self._relations[i] for i in self._placed]
        site, model = mujoco.mjtObj.mjOBJ_SITE, env.sim.model._model
        self._sites = np.array([mujoco.mj_name2id(model, site, relation[2]) for relation in placed], np.int64)
        self._bodies = np.array([int(env.obj_body_id[relation[1]]) for relation in placed], np.int64)
        boxes = [env.object_sites_dict[relation[2]] for relation in placed]
        slacks = [_slack_on if relation[0] == "on" else _slack_in for relation in placed]
        halves = [[float(x) for x in box.size] for box in boxes]
        holders = [env.get_object(env.object_states_dict[relation[2]].parent_name) for relation in placed]
        things = [env.get_object(relation[1]) for relation in placed]
        # LIBERO's relation "on" also requires a contact with the box's owner. "in" does not require a contact.
        needed = [h if relation[0] == "on" else None for h, relation in zip(holders, placed, strict=True)]
        self._known = list(zip(self._placed, slacks, halves, needed, things, strict=True))

    def hold(self) -> np.ndarray:
        """Return a mask (n,) of the relations that hold now."""
        found, unsure = np.zeros(len(self._relations), bool), self._asked
        if self._known:
            data, sites = self._data, self._sites
            turns = data.site_xmat[sites].tolist()
            apart = (data.xpos[self._bodies] - data.site_xpos[sites]).tolist()
            for turn, away, (i, slack_of, half, holder, thing) in zip(turns, apart, self._known, strict=True):
                slack = slack_of(turn, away, half)
                if abs(slack) < _UNSURE_M:
                    unsure = [*unsure, i]
                elif slack > 0.0:
                    found[i] = holder is None or self._touching.between(holder, thing)
        if unsure:
            # Evaluate LIBERO's own predicates, but with our faster contact check.
            self._env.check_contact = self._touching.between
            try:
                for i in unsure:
                    found[i] = self._env._eval_predicate(self._relations[i])
            finally:
                del self._env.check_contact
        return found

    def hold_by_libero(self) -> np.ndarray:
        """Return a mask (n,) of the relations that hold now, computed only by LIBERO's own predicates."""
        return np.array([bool(self._env._eval_predicate(relation)) for relation in self._relations], bool)

    def _is_placed(self, relation: list[str]) -> bool:
        """Return whether a relation says that an object is on or in a box that belongs to the table or to a fixture."""
        if len(relation) != 3 or relation[0] not in ("on", "in") or relation[1] not in self._env.obj_body_id:
            return False
        place = self._env.object_states_dict[relation[2]]
        return place.object_state_type == "site" and hasattr(self._env.object_sites_dict[relation[2]], "under")


def _slack_on(turn: list[float], away: list[float], half: list[float]) -> float:
    """Return the margin by which an object is on a box [m], as in LIBERO's ``under``.

    The margin is positive if the object is on the box.
    """
    (a, b, c, d, e, f, g, h, i), (x, y, z) = turn, away
    up = g * x + h * y + i * z
    return min(
        half[0] - abs(a * x + b * y + c * z),
        half[1] - abs(d * x + e * y + f * z),
        up - half[2] + _SUNK_M,
        half[2] + _HEIGHT_M - up,
    )


def _slack_in(turn: list[float], away: list[float], half: list[float]) -> float:
    """Return the margin by which an object is in a box [m], as in LIBERO's ``in_box``.

    The margin is positive if the object is in the box.
    """
    (a, b, c, d, e, f, g, h, i), (x, y, z) = turn, half
    high = abs(g * x + h * y + i * z)
    return min(
        abs(a * x + b * y + c * z) - abs(away[0]),
        abs(d * x + e * y + f * z) - abs(away[1]),
        high - away[2],
        away[2] + high + _BELOW_M,
    )
