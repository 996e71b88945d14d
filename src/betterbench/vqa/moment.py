"""One frame with all data that questions about it may use: the state, the view of the camera and the episode."""

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
    """One row of an episode as one camera shows it.

    Objects are called by their kind, and only where a kind names one object of the scene; hence the names of kinds
    below are names of single objects.
    """

    episode: Episode
    row: int
    view: FrameView

    @cached_property
    def state(self) -> WorldState:
        """The state."""
        return self.episode.record.state(self.row)

    @property
    def condition(self) -> Condition:
        """The condition of the trial."""
        return self.episode.resolved.condition

    @property
    def source(self) -> FrameSource:
        """Frame of the record that the moment is taken from."""
        m = self.episode.record.metadata
        time_s = round(float(self.episode.record.time[self.row]), 6)
        return FrameSource(m.task, m.condition, m.seed, self.row, time_s, self.view.camera)

    @property
    def objects(self) -> tuple[ObjectInfo, ...]:
        """All objects of the scene."""
        return self.episode.trace.info.objects

    def seen(self, name: str) -> SeenObject | None:
        """Return the visible part of an object, or None."""
        return self.view.objects.get(name)

    def is_clear(self, name: str) -> bool:
        """Tell whether an object is seen well enough to be asked about."""
        return clear(self.seen(name))

    def is_large(self, name: str) -> bool:
        """Tell whether the visible part of an object is large enough, however much of the object is hidden."""
        return large(self.seen(name))

    def is_hidden(self, name: str) -> bool:
        """Tell whether nothing of an object is seen."""
        return hidden(self.seen(name))

    @cached_property
    def single(self) -> dict[str, ObjectInfo]:
        """The objects whose kind names them and nothing else in the scene, by kind, sorted."""
        kinds = [o.kind for o in self.objects]
        return {o.kind: o for o in sorted(self.objects, key=lambda o: o.kind) if kinds.count(o.kind) == 1}

    @cached_property
    def named(self) -> dict[str, ObjectInfo]:
        """Those of them that are clearly seen."""
        return {kind: o for kind, o in self.single.items() if self.is_clear(o.name)}

    @cached_property
    def things(self) -> dict[str, ObjectInfo]:
        """Those of them that can be picked up."""
        return {k: o for k, o in self.named.items() if o.role in ("item", "distractor") and not o.fixed}

    @cached_property
    def kinds(self) -> frozenset[str]:
        """All kinds of the scene, seen or not."""
        return frozenset(o.kind for o in self.objects)

    def surely_absent(self, kind: str) -> bool:
        """Tell whether nothing in the scene is of a kind or could be called so.

        Kinds of one task are meant to be told apart; of those of other tasks nothing similar may be there.
        """
        if kind in self.kinds:
            return False
        known = self.episode.vocabulary
        return not any(mistakable(kind, o.kind) for o in self.objects if kind not in known or o.kind not in known)

    def center(self, name: str) -> Vector:
        """Return the middle of an object's bounding box in the world [m]."""
        return middle(self.state, name)

    def relations_of(self, target: ObjectInfo) -> Iterator[Relation]:
        """Yield the relations of which an object can be the target and for which something is carried."""
        return (r for r in RELATIONS.values() if r.carried and r.regions(target))

    def place(self, relation: Relation, name: str, target: str) -> str | None:
        """Return the region of a target at which an object beyond doubt is, "" for the only one, or None.

        Raises:
            LookupError: If it is neither surely there nor surely not: leaning, half in, or in the gripper there.
        """
        region = relation.where(self.state, name, target)
        doubtful = relation.anyhow(self.state, name, target) is not None if region is None else self.state.held == name
        if doubtful:
            raise LookupError(name)
        return region
