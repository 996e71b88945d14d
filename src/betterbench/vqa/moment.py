"""One frame of a trial, with the data for questions about it (state, camera view and episode)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

from betterbench.geometry import Vector
from betterbench.interface.state import FrameView, ObjectInfo, SeenObject, WorldState
from betterbench.tasks import Condition
from betterbench.tasks.relations import RELATIONS, Relation
from betterbench.tasks.relations.loose import middle
from betterbench.vqa.episode import Episode
from betterbench.vqa.nouns import mistakable
from betterbench.vqa.question import FrameSource
from betterbench.vqa.visible import clear, hidden, large


@dataclass(frozen=True)
class Moment:
    """One row of an episode, as seen by one camera.

    Questions refer to an object by its kind, and only if no other object in the scene has the same kind. Each kind in
    the mappings below therefore stands for a single object.
    """

    episode: Episode
    row: int
    view: FrameView

    @cached_property
    def state(self) -> WorldState:
        """World state at this row."""
        return self.episode.record.state(self.row)

    @property
    def condition(self) -> Condition:
        """Condition of the trial."""
        return self.episode.resolved.condition

    @property
    def source(self) -> FrameSource:
        """Frame of the record to which this moment belongs."""
        m = self.episode.record.metadata
        time_s = round(float(self.episode.record.time[self.row]), 6)
        return FrameSource(m.task, m.condition, m.seed, self.row, time_s, self.view.camera)

    @property
    def objects(self) -> tuple[ObjectInfo, ...]:
        """All objects in the scene."""
        return self.episode.trace.info.objects

    def seen(self, name: str) -> SeenObject | None:
        """Return the visible part of an object, or None if the object is not visible."""
        return self.view.objects.get(name)

    def is_clear(self, name: str) -> bool:
        """Return whether enough of an object is visible to ask questions about it."""
        return clear(self.seen(name))

    def is_large(self, name: str) -> bool:
        """Return whether the visible part of an object is large enough, even if most of the object is hidden."""
        return large(self.seen(name))

    def is_hidden(self, name: str) -> bool:
        """Return whether no part of an object is visible."""
        return hidden(self.seen(name))

    @cached_property
    def single(self) -> dict[str, ObjectInfo]:
        """Objects whose kind occurs only once in the scene, sorted by kind."""
        kinds = [o.kind for o in self.objects]
        return {o.kind: o for o in sorted(self.objects, key=lambda o: o.kind) if kinds.count(o.kind) == 1}

    @cached_property
    def named(self) -> dict[str, ObjectInfo]:
        """Clearly visible objects whose kind occurs only once in the scene, by kind."""
        return {kind: o for kind, o in self.single.items() if self.is_clear(o.name)}

    @cached_property
    def things(self) -> dict[str, ObjectInfo]:
        """Clearly visible objects that can be picked up and whose kind occurs only once in the scene, by kind."""
        return {k: o for k, o in self.named.items() if o.role in ("item", "distractor") and not o.fixed}

    @cached_property
    def kinds(self) -> frozenset[str]:
        """Kinds of all objects in the scene, visible or not."""
        return frozenset(o.kind for o in self.objects)

    def surely_absent(self, kind: str) -> bool:
        """Return whether the scene contains no object of a kind, and no object that could be mistaken for this kind.

        Kinds of the same task are easy to distinguish by design. For kinds of other tasks, the scene must not contain a
        similar object.
        """
        if kind in self.kinds:
            return False
        known = self.episode.vocabulary
        return not any(mistakable(kind, o.kind) for o in self.objects if kind not in known or o.kind not in known)

    def center(self, name: str) -> Vector:
        """Return the center of an object's bounding box in the world frame [m]."""
        return middle(self.state, name)

    def relations_of(self, target: ObjectInfo) -> Iterator[Relation]:
        """Yield the relations that allow an object to be the target of a placement."""
        return (r for r in RELATIONS.values() if r.carried and r.regions(target))

    def place(self, relation: Relation, name: str, target: str) -> str | None:
        """Return the target region that certainly contains an object.

        The result is "" if the target has only one region, and None if the object is in no region.

        Raises:
            LookupError: If the state is ambiguous, because the object leans, is only partly inside, or is in the
                gripper at the target.
        """
        region = relation.where(self.state, name, target)
        doubtful = relation.anyhow(self.state, name, target) is not None if region is None else self.state.held == name
        if doubtful:
            raise LookupError(name)
        return region
