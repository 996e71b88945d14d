"""Objects at the targets of a condition: requested objects, and objects that were not requested there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from betterbench.interface.state import SceneInfo, WorldState
from betterbench.tasks.condition import Condition
from betterbench.tasks.relations import Relation, is_at, relation

Places = tuple[tuple[str | None, ...], ...]
"""Region that contains each watched object, for each watched target.

If regions overlap, the entry contains the names of all of them. It is None if no region contains the object.
"""


@dataclass(frozen=True, slots=True)
class Asked:
    """Subgoal of a condition, with the names of its objects in the scene.

    Attributes:
        relation: Name of the relation.
        target: Name of the target.
        region: Region of the target.
        candidates: Names of the objects that the subgoal may refer to.
        count: Number of these objects that must be at the target.
    """

    relation: str
    target: str
    region: str
    candidates: tuple[str, ...]
    count: int


def asked_by(condition: Condition) -> tuple[Asked, ...]:
    """Return the subgoals of a condition, with the names of the objects in the scene."""
    goals = condition.instruction.subgoals
    return tuple(Asked(g.relation, g.target, g.region, condition.resolve(g.reference), g.count) for g in goals)


@dataclass(frozen=True, slots=True)
class Watch:
    """Watched target, with its relation, the objects that are tracked at it, and its regions by name."""

    relation: Relation
    target: str
    subjects: tuple[str, ...]
    places: tuple[str, ...]


class Due(NamedTuple):
    """Requirement of a subgoal: a minimum number of objects that must be in a region of a watched target.

    Attributes:
        watch: Index of the watched target.
        region: Region of the target.
        candidates: Indices of the objects that count, among the tracked objects of the target.
        least: Number of these objects that must be in the region.
    """

    watch: int
    region: str
    candidates: tuple[int, ...]
    least: int


class Intruder(NamedTuple):
    """Object at a target where it was not requested, or where there are more objects than requested."""

    object: str
    target: str
    region: str


class Targets:
    """Watched targets: the requested targets, and other targets of the same kind in the scene."""

    def __init__(self, asked: Sequence[Asked], info: SceneInfo, *, placing: str) -> None:
        """Prepare the check.

        Args:
            asked: Subgoals of the condition.
            info: The scene.
            placing: Name of the relation for which intruders are detected, i.e. objects at a target where they were not
                requested.
        """
        self.info, self.watches = info, _watches(asked, info)
        self.due = tuple(self._due(a) for a in asked)
        self._placing = placing
        self._allowed = self._what_is_allowed()

    def places(self, state: WorldState) -> Places:
        """Return the region that contains each tracked object, or None for an object in a wrong posture."""
        return tuple([tuple([w.relation.where(state, name, w.target) for name in w.subjects]) for w in self.watches])

    def relations(self, places: Places) -> tuple[bool, ...]:
        """Return whether each predicate holds. The results are sorted by target, then by object, then by region."""
        return tuple(
            is_at(place, region)
            for watch, there in zip(self.watches, places, strict=True)
            for place in there
            for region in watch.places
        )

    def in_any_posture(self, state: WorldState, strictly: Places) -> Places:
        """Return the region that contains each tracked object, in any posture.

        For a wide relation such as "beside", an object may be in the region without having been brought there. For such
        a relation, a looser check with a smaller region is used instead.

        Args:
            state: The state.
            strictly: Region that contains each tracked object in the right posture.
        """
        return tuple(
            tuple(
                w.relation.loosely(state, name, w.target)
                if w.relation.loosely and (place is None or w.relation.wide)
                else place
                for name, place in zip(w.subjects, places, strict=True)
            )
            for w, places in zip(self.watches, strictly, strict=True)
        )

    def intruder(self, state: WorldState, strictly: Places, at_start: Places) -> Intruder | None:
        """Return the first object at a target, in any posture, that was not requested there and did not start there.

        Args:
            state: The state.
            strictly: Region that contains each tracked object in the right posture.
            at_start: Region that contained each tracked object at the start, in any posture.
        """
        served = self._served(strictly)
        for w, places in enumerate(self.in_any_posture(state, strictly)):
            watch = self.watches[w]
            if watch.relation.name != self._placing:
                continue  # closing a drawer on the way is allowed
            there: dict[str, list[int]] = {}
            for s, place in enumerate(places):
                if place is not None:
                    there.setdefault(place, []).append(s)
            for place, subjects in there.items():
                allowed = self._allowed.get((w, place), ())
                for s in subjects:
                    if watch.subjects[s] in served:
                        continue  # an object on the top plate of a stack is also on the plates below
                    if at_start[w][s] != place and not any(s in group for group, _ in allowed):
                        return Intruder(watch.subjects[s], watch.target, place)
                for group, count in allowed:
                    of_group = [s for s in subjects if s in group]
                    if len(of_group) > count:
                        return Intruder(watch.subjects[of_group[-1]], watch.target, place)
        return None

    def left_over(self, strictly: Places) -> tuple[str, ...]:
        """Return the surplus objects. They are of a requested kind but are no longer needed.

        For example, if one burger was requested and one is at the target, the second burger is surplus.
        """
        served, found = self._served(strictly), dict[str, None]()
        for d in self.due:
            subjects, places = self.watches[d.watch].subjects, strictly[d.watch]
            if sum(is_at(places[s], d.region) for s in d.candidates) >= d.least:
                found.update((subjects[s], None) for s in d.candidates if subjects[s] not in served)
        return tuple(found)

    def _served(self, strictly: Places) -> frozenset[str]:
        """Return the objects that are in a region where they were requested."""
        at = ((d, s) for d in self.due for s in d.candidates if is_at(strictly[d.watch][s], d.region))
        return frozenset(self.watches[d.watch].subjects[s] for d, s in at)

    def _due(self, asked: Asked) -> Due:
        watch = next(
            w for w, it in enumerate(self.watches) if (it.relation.name, it.target) == (asked.relation, asked.target)
        )
        subjects = self.watches[watch].subjects
        return Due(
            watch, asked.region, tuple(subjects.index(n) for n in asked.candidates if n in subjects), asked.count
        )

    def _what_is_allowed(self) -> dict[tuple[int, str], tuple[tuple[tuple[int, ...], int], ...]]:
        """Return which objects are allowed in each region of a watched target, and how many are allowed."""
        most: dict[tuple[int, str], dict[tuple[int, ...], int]] = {}
        for due in self.due:
            counts = most.setdefault((due.watch, due.region), {})
            counts[due.candidates] = max(counts.get(due.candidates, 0), due.least)
        return {where: tuple(counts.items()) for where, counts in most.items()}


def _watches(asked: Sequence[Asked], info: SceneInfo) -> tuple[Watch, ...]:
    """Return the targets of the instruction, followed by other targets of the same kind, such as the wrong drawer."""
    targets = dict.fromkeys((a.relation, a.target) for a in asked)
    for name, target in tuple(targets):
        like = info.object(target)
        for o in info.objects:
            if o.role == like.role and relation(name).regions(o):
                targets.setdefault((name, o.name))
    watches = []
    for name, target in targets:
        kind = relation(name)
        subjects = tuple(o.name for o in info.objects if o.role in kind.roles and not o.fixed and o.name != target)
        watches.append(Watch(kind, target, subjects, kind.regions(info.object(target))))
    return tuple(watches)
