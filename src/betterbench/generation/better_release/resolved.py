"""Variations of a BeTTER release task with the values that they inherit from the base variation."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from betterbench.generation.better_release.files import (
    ChannelChange,
    ReleasePose,
    ReleasePredicate,
    ReleaseTask,
    VariationFile,
)

GROUPS = ("goal", "fail", "decor")
"""Groups of objects that a variation may change."""


@dataclass(frozen=True)
class Resolved:
    """A variation with its inherited values.

    Attributes:
        name: Id of the variation ("TV-01").
        training: Whether the registry lists the variation under ``train``.
        enabled: Whether the release uses the variation.
        groups: Sorted members of the goal, fail and decor groups.
        poses: Initial pose of every object in the scene.
        success: Predicates that must all hold at the end.
        fail: Predicates that must never hold.
    """

    name: str
    training: bool
    enabled: bool
    instruction: str
    container: str
    goal_relation: str
    groups: Mapping[str, tuple[str, ...]]
    poses: Mapping[str, ReleasePose]
    success: tuple[ReleasePredicate, ...]
    fail: tuple[ReleasePredicate, ...]

    @property
    def active(self) -> tuple[str, ...]:
        """Objects in the scene of the release: the container, and all objects with a pose or in a group."""
        grouped = (name for members in self.groups.values() for name in members)
        return tuple(sorted({*self.poses, *grouped, self.container}))

    @property
    def goals(self) -> tuple[str, ...]:
        """Sorted names of the objects that must be moved to fulfill the success predicates."""
        return tuple(sorted({p.subject_id for p in self.success}))

    def xy(self, name: str) -> tuple[float, float] | None:
        """Return the initial position of an object on the table [m], or None if the object has no pose."""
        pose = self.poses.get(name)
        return None if pose is None else pose.position[:2]


def resolve(task: ReleaseTask) -> dict[str, Resolved]:
    """Return the variations of a task by id, without the base variation. Training variations come first."""
    order = (*task.task.variation_registry.train, *task.task.variation_registry.eval)
    return {name: _resolved(task, task.variations[name]) for name in order}


def _resolved(task: ReleaseTask, variation: VariationFile) -> Resolved:
    base, defaults = task.base, task.task.defaults
    container = (
        variation.container_instance_id
        or base.container_instance_id
        or defaults.container_instance_id
        or task.groups["container"][0]
    )
    relation = variation.goal_relation or base.goal_relation or defaults.primary_goal_relation
    groups = {name: _changed(variation, name, _changed(base, name, ())) for name in GROUPS}
    success = [ReleasePredicate(name, relation, container) for name in groups["goal"]]
    fails = defaults.fail_policy.fail_on_relations
    fail = [ReleasePredicate(name, one, container) for name in groups["fail"] for one in fails]
    return Resolved(
        name=variation.variation_id,
        training=variation.variation_id in task.task.variation_registry.train,
        enabled=variation.enabled and base.enabled,
        instruction=variation.instruction or base.instruction or task.task.instruction,
        container=container,
        goal_relation=relation,
        groups=groups,
        poses={**base.pose_overrides, **variation.pose_overrides},
        # The changes of a variation apply to the predicates derived from its groups. Changes of the base are not
        # inherited.
        success=_overridden(success, variation.policy_overrides.success),
        fail=_overridden(fail, variation.policy_overrides.fail),
    )


def _changed(variation: VariationFile, group: str, members: Iterable[str]) -> tuple[str, ...]:
    given: tuple[str, ...] | None = getattr(variation, f"set_{group}_objects")
    found = set(members if given is None else given)
    found |= set(getattr(variation, f"add_{group}_objects"))
    return tuple(sorted(found - set(getattr(variation, f"remove_{group}_objects"))))


def _overridden(predicates: list[ReleasePredicate], change: ChannelChange) -> tuple[ReleasePredicate, ...]:
    found = {*(predicates if change.replace is None else change.replace), *change.append}
    return tuple(sorted(found - set(change.remove)))


REPLACED_M = 0.06
"""Maximum distance between an object and its replacement [m], about the diameter of a fruit."""


@dataclass(frozen=True, slots=True)
class LeftBehind:
    """Object that a variation replaces by another object but does not remove.

    Attributes:
        name: Object that was replaced. It no longer belongs to a group.
        by: New object that replaces it. It is not in the training variations.
        distance_m: Distance between the initial positions of the two objects [m].
    """

    name: str
    by: str
    distance_m: float


def left_behind(variation: Resolved, training: Iterable[Resolved]) -> tuple[LeftBehind, ...]:
    """Return the objects that a variation replaces without removing them from the scene."""
    trained = {name for other in training for name in other.active}
    grouped = {name for members in variation.groups.values() for name in members} | {variation.container}
    found = []
    for name in sorted(set(variation.poses) - grouped):
        new = [other for other in sorted(grouped - trained) if other in variation.poses]
        by = min(new, key=lambda other: _apart_m(variation, name, other), default=None)
        if name in trained and by is not None and _apart_m(variation, name, by) <= REPLACED_M:
            found.append(LeftBehind(name, by, _apart_m(variation, name, by)))
    return tuple(found)


def _apart_m(variation: Resolved, a: str, b: str) -> float:
    return math.dist(variation.poses[a].position[:2], variation.poses[b].position[:2])
