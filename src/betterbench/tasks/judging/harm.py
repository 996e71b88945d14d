"""Harm: what a success must not have done to anything that was not asked for (law 7 of the suite), for all tasks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from betterbench.geometry import Pose, Quaternion, Vector, tilt_of
from betterbench.interface.state import ObjectInfo, SceneInfo, WorldState
from betterbench.tasks.judging.targets import Asked, Intruder, Places, Targets
from betterbench.tasks.relations import on_floor
from betterbench.tasks.thresholds import CYLINDER_STANDS_FROM, DISPLACED, OTHER_STANDS_FROM, THRESHOLDS
from betterbench.tasks.words import agreeing, place_words

STANDS_FROM = {"cylinder": CYLINDER_STANDS_FROM, "box": OTHER_STANDS_FROM, "irregular": OTHER_STANDS_FROM}
"""By shape. What is round is left out: fruit and burgers roll, and plates and bowls are flat."""

NO_HARM = (
    "Nothing that was not asked for lies on the floor, was carried or pushed out of its place by more than 5 cm, was "
    "knocked over, or is at a target in any posture, and no container lies on its side."
)
"""What no success may do, as documents say it."""

HarmSort = Literal["on_the_floor", "knocked_over", "displaced", "at_the_target", "target_brought"]


@dataclass(frozen=True, slots=True)
class Harm:
    """One harm.

    Attributes:
        sort: What was done. "target_brought": the target itself was brought to the object, which stays where it was.
        object: What it was done to.
        target: The target at which something stands that was not asked for, else None.
        region: The region of that target, if it offers several.
    """

    sort: HarmSort
    object: str
    target: str | None = None
    region: str = ""

    def words(self, info: SceneInfo) -> str:
        """Return a clause that says it, "the mouse lies on the floor"."""
        kind = info.object(self.object).kind
        if self.sort == "on_the_floor":
            return f"the {kind} {agreeing(kind, 'lies', 'lie')} on the floor"
        if self.sort == "knocked_over":
            return f"the {kind} {agreeing(kind, 'was', 'were')} knocked over"
        if self.sort == "displaced":
            was, its = agreeing(kind, "was", "were"), agreeing(kind, "its", "their")
            return f"the {kind} {was} moved out of {its} place by more than {100 * DISPLACED:.0f} cm"
        if self.sort == "target_brought" and self.target is not None:
            target = info.object(self.target).kind
            return f"the {target} {agreeing(target, 'was', 'were')} brought to the {kind} without having been asked for"
        where = "" if self.target is None else place_words(info.object(self.target).kind, self.region)
        return f"the {kind} {agreeing(kind, 'is', 'are')} at {where} without having been asked for there"


def bystanders(asked: Sequence[Asked], info: SceneInfo) -> tuple[str, ...]:
    """Return the names of all loose objects that an instruction neither means nor names as a target.

    Drawers are none: to move them is on the way.
    """
    named = {name for a in asked for name in (*a.candidates, a.target)}
    return tuple(o.name for o in info.objects if not o.fixed and o.role != "drawer" and o.name not in named)


class HarmWatch:
    """Watches an episode for harm. Feed it the state at reset first, then others in order of time."""

    def __init__(self, asked: Sequence[Asked], targets: Targets, info: SceneInfo, *, exclusive: bool) -> None:
        """Prepare; where a template is not ``exclusive``, other things may be at its targets."""
        self._targets, self._exclusive = targets, exclusive
        self._watched = tuple(info.index(name) for name in bystanders(asked, info))
        self._loose = tuple(o.name for o in info.objects if not o.fixed)
        self._containers = tuple(o.name for o in info.objects if not o.fixed and o.role == "container")
        self._can_stand = frozenset(o.name for o in info.objects if not o.fixed and can_stand(o))
        self._standing: frozenset[str] = frozenset()
        self._middles = tuple((0.0, 0.0, 0.5 * o.size_m[2]) for o in info.objects)
        self._start: tuple[Vector, ...] = ()
        self._before: tuple[tuple[Vector, ...], tuple[Quaternion, ...]] = ((), ())
        self._at_start: Places = ()
        self._displaced: dict[str, None] = {}

    def see(self, state: WorldState, places: Places) -> None:
        """Take note of a state and of where every subject is in it, strictly."""
        if not self._start:
            self._start = tuple(self._middle(state, i) for i in range(len(state.positions)))
            self._at_start = self._targets.in_any_posture(state, places)
            self._standing = frozenset(n for n in self._can_stand if _tilt(state, n) <= THRESHOLDS.upright_tilt)
        positions, quaternions = state.positions, state.quaternions
        was, turned = self._before
        if positions == was and quaternions == turned:
            return
        self._before = positions, quaternions
        for i in self._watched:
            if was and positions[i] == was[i] and quaternions[i] == turned[i]:
                continue
            if self._moved(state, i) > DISPLACED:
                self._displaced[state.info.objects[i].name] = None

    def _middle(self, state: WorldState, i: int) -> Vector:
        """Return the middle of an object: one that has been knocked over lies beside its place."""
        return Pose(state.positions[i], state.quaternions[i]).apply(self._middles[i])

    def _moved(self, state: WorldState, i: int) -> float:
        return math.dist(self._middle(state, i), self._start[i])

    def found(self, state: WorldState, places: Places) -> tuple[Harm, ...]:
        """Return the harm that was done up to a state that was seen; empty if there is none."""
        floor = {name: Harm("on_the_floor", name) for name in self._loose if on_floor(state, name)}
        upright = [state.info.objects[i].name for i in self._watched]
        upright += self._targets.left_over(places)
        upright = [n for n in dict.fromkeys(upright) if n in self._standing]
        over = {n: Harm("knocked_over", n) for n in (*self._containers, *upright) if n not in floor and _lies(state, n)}
        away = [*self._displaced, *self._left_over_away(state, places)]
        moved = [Harm("displaced", name) for name in away if name not in floor and name not in over]
        intruder = self._targets.intruder(state, places, self._at_start) if self._exclusive else None
        there = [] if intruder is None else [self._at_target(state, intruder)]
        return (*floor.values(), *over.values(), *moved, *there)

    def _at_target(self, state: WorldState, intruder: Intruder) -> Harm:
        """Return the harm of something at a target that was not asked for there, told by which of the two moved."""
        moved, other = (
            self._moved(state, state.info.index(name)) > DISPLACED for name in (intruder.target, intruder.object)
        )
        return Harm("target_brought" if moved and not other else "at_the_target", *intruder)

    def _left_over_away(self, state: WorldState, places: Places) -> list[str]:
        """Return what is left over of its kind and is not in its place; one may be taken first and brought back."""
        index = state.info.index
        return [name for name in self._targets.left_over(places) if self._moved(state, index(name)) > DISPLACED]


def can_stand(thing: ObjectInfo) -> bool:
    """Tell whether an object stands upright and can be knocked over: neither flat nor one that rolls."""
    width, depth, height = thing.size_m
    return thing.shape in STANDS_FROM and height >= STANDS_FROM[thing.shape] * min(width, depth)


def _lies(state: WorldState, name: str) -> bool:
    return _tilt(state, name) > THRESHOLDS.knocked_tilt


def _tilt(state: WorldState, name: str) -> float:
    return tilt_of(state.quaternions[state.info.index(name)])
