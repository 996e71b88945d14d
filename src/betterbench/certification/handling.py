"""Motion primitives of an episode (picks, puts and slides), derived from the recorded states.

A **pick** contains the last pose in which the object was at rest before the gripper touched it. A **put** contains the
point at which the object was released, and the resulting relation between the object and a target. A **slide** is a
motion of a drawer along its rails. An object is **pre-placed** if it is at its target from the start. Its pose is then
stored.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

from betterbench.geometry import Pose, distance
from betterbench.interface.state import WorldState
from betterbench.sim.robots.physics import PHYSICS
from betterbench.tasks import Condition, Task
from betterbench.tasks.relations import RELATIONS, Relation, RestWatch
from betterbench.tasks.relations.closed import GAP
from betterbench.tasks.relations.placing import foot

SLIDE_M = GAP
"""Minimum distance that a drawer must move to count as moved [m]."""
LONGEST_CHAIN = 8
"""Largest number of supports between a target and a slot.

For example, a stack of four objects on an object in a drawer has six supports.
"""


@dataclass(frozen=True, slots=True)
class Pick:
    """Motion primitive in which the gripper picks up an object.

    ``pose`` is the last pose ``T_world_object`` in which the object was at rest before the gripper touched it.
    """

    object: str
    kind: str
    pose: Pose


class Release(NamedTuple):
    """Position of an object when the gripper released it [m].

    The height is that of the object's base above the table. The horizontal position is given in the frame of the
    target, relative to the center of the target region.
    """

    height_m: float
    x: float
    y: float


@dataclass(frozen=True, slots=True)
class Put:
    """Motion primitive in which the gripper puts down an object, with the target and the slot below the target.

    Attributes:
        kind: Kind of the object.
        asset: Identity of the object's asset.
        relation: Name of the object's relation to the target, or None if the object was dropped on the way.
        region: Region of the target, if the target has several regions.
        slot: Slot of the target or of the support below it, or None if there is none.
        level: Number of objects between this object and the slot. Cabinets in which drawers are mounted are not
            counted.
        pose: Pose ``T_world_object`` at rest.
        target_asset: Identity of the target's asset.
        target_pose: Pose ``T_world_middle`` of the center of the target region when the object came to rest. Without a
            target, it is equal to ``pose``.
        release: Position of the object when the gripper released it.
    """

    object: str
    kind: str
    asset: str
    relation: str | None
    target_kind: str
    target_asset: str
    region: str
    slot: str | None
    level: int
    base_pose: Pose
    base_fixed: bool
    pose: Pose
    target_pose: Pose
    release: Release


@dataclass(frozen=True, slots=True)
class Preplaced:
    """Object that is at its target in the initial state.

    Attributes:
        kind: Kind of the object.
        asset: Identity of the object's asset.
        target_asset: Identity of the target's asset.
        pose: Pose ``T_middle_object`` of the object relative to the center of the target region.
    """

    object: str
    kind: str
    asset: str
    target_kind: str
    target_asset: str
    region: str
    pose: Pose

    @property
    def place(self) -> tuple[str, str, str]:
        """Target of the object: kind of the target, asset of the target, and region."""
        return self.target_kind, self.target_asset, self.region


@dataclass(frozen=True, slots=True)
class DrawerMove:
    """Motion primitive in which a drawer is opened or closed.

    It contains the slot in which the drawer's cabinet stands.
    """

    object: str
    kind: str
    slot: str | None


Primitive = Pick | Put | DrawerMove | Preplaced


class Handling:
    """Tracker of the motion primitives in an episode. It must be given all states since the reset, in order."""

    def __init__(self, task: Task, condition: Condition, *, finger_moves_m: float = 0.0) -> None:
        """Prepare for an episode.

        Args:
            task: Task of the episode.
            condition: Condition of the episode.
            finger_moves_m: Distance that the gripper moves to bring its fixed finger into contact before the jaw closes
                [m]; see ``Jaw.closing_shift_m``. It is 0 for parallel jaws. If the gripper pushes an object by at most
                this distance, the push counts as part of the grasp, even if contact is lost before the jaw closes.
        """
        self._finger_moves_m = finger_moves_m
        self._condition = condition
        self._relations = tuple(RELATIONS[n] for n in (task.template.relation, *task.template.also) if n in RELATIONS)
        self._resting_on: dict[str, str] = {name: place.target for name, place in condition.preplaced.items()}
        self._rest = RestWatch(rate_hz=PHYSICS.control_rate_hz)
        self._stood: dict[str, Pose] = {}
        self._shut_at: dict[str, Pose] = {}
        self._carried: str | None = None
        self._grasped: WorldState | None = None
        self._settling: str | None = None
        self._found: list[Primitive] = []
        self._slid: dict[str, DrawerMove] = {}
        self._last: WorldState | None = None

    def update(self, state: WorldState) -> None:
        """Process the next state of the episode."""
        if self._last is None:
            for o in state.info.objects:
                (self._shut_at if o.role == "drawer" else self._stood)[o.name] = state.pose(o.name)
            self._found.extend(_preplaced(self._condition, self._relations[0], state))
        self._last = state
        self._rest.see(state)
        for name, start in self._shut_at.items():
            if name not in self._slid and distance(state.pose(name).position, start.position) > SLIDE_M:
                kind = state.info.object(name).kind
                self._slid[name] = DrawerMove(name, kind, ground_of(self._condition, name, self._resting_on)[0])
        if self._carried is not None and not _in_fingers(state, self._carried):
            self._settling, self._carried = self._carried, None
        held = state.held
        if held is not None and held != self._carried and held not in self._shut_at:
            self._settle(state)
            self._carried = held
            self._found.append(Pick(held, state.info.object(held).kind, self._stood[held]))
            self._resting_on.pop(held, None)
        if self._carried is not None and _between_fingers(state, self._carried):
            self._grasped = state
        for name, stood in self._stood.items():
            i = state.info.index(name)
            if state.positions[i] == stood.position and state.quaternions[i] == stood.quaternion:
                continue
            if distance(state.positions[i], stood.position) <= self._finger_moves_m:
                continue
            if name != self._carried and not state.touched_by_gripper(name) and self._rest.at_rest(name):
                self._stood[name] = state.pose(name)
        if (
            self._settling is not None
            and not state.touched_by_gripper(self._settling)
            and self._rest.at_rest(self._settling)
        ):
            self._settle(state)

    def finish(self) -> tuple[Primitive, ...]:
        """Return all motion primitives of the episode, sorted by the time at which they began. Slides come last."""
        if self._last is not None:
            self._settle(self._last)
        return (*self._found, *self._slid.values())

    def left(self) -> tuple[Preplaced, ...]:
        """Return the objects that rest at a target at the end, with their final poses.

        Other trials may start with an object in such a pose. The final pose of an object may differ from the pose after
        it was put down, because objects placed later can move it.
        """
        state, relation = self._last, self._relations[0]
        if state is None or relation.surface is None:
            return ()
        found: list[Preplaced] = []
        for name, target in self._resting_on.items():
            info, base = state.info.object(name), state.info.object(target)
            if info.role not in relation.roles or not relation.regions(base):
                continue
            region = relation.where(state, name, target)
            if region is None:
                continue
            pose = _middle_of(state, target, relation.name, region).inverse() @ state.pose(name)
            found.append(Preplaced(name, info.kind, info.asset, base.kind, base.asset, region, pose))
        return tuple(sorted(found, key=lambda p: (p.kind, p.asset, p.target_kind, p.region)))

    def _settle(self, state: WorldState) -> None:
        """Store the pose in which a released object came to rest."""
        name = self._settling
        if name is None:
            return
        self._settling = None
        self._stood[name] = state.pose(name)
        info = state.info.object(name)
        for relation in self._relations:
            if info.role not in relation.roles:
                continue
            for target in state.info.objects:
                if target.name == name or not relation.regions(target):
                    continue
                place = relation.where(state, name, target.name)
                if place is not None:
                    self._resting_on[name] = target.name
                    self._found.append(self._put(state, name, target.name, relation.name, place))
                    return
        self._found.append(self._put(state, name))

    def _put(
        self, state: WorldState, name: str, target: str | None = None, relation: str | None = None, region: str = ""
    ) -> Put:
        """Return the motion primitive of putting down an object.

        If no target is given, the object was dropped on the way.
        """
        info, to = state.info.object(name), target or name
        slot, level, base = ground_of(self._condition, to, self._resting_on) if target else (None, 0, name)
        let_go = self._grasped or state
        x, y, _ = _middle_of(let_go, to, relation, region).inverse().apply(foot(let_go, name))
        return Put(
            object=name,
            kind=info.kind,
            asset=info.asset,
            relation=relation,
            target_kind=state.info.object(to).kind if target else "",
            target_asset=state.info.object(to).asset if target else "",
            region=region,
            slot=slot,
            level=level,
            base_pose=state.pose(base),
            base_fixed=state.info.object(base).fixed,
            pose=state.pose(name),
            target_pose=_middle_of(state, to, relation, region),
            release=Release(foot(let_go, name)[2], x, y),
        )


def _middle_of(state: WorldState, target: str, relation: str | None, region: str) -> Pose:
    """Return the pose ``T_world_middle`` of the center of a target region.

    If no relation to a target is given, return the object's pose.
    """
    frame = state.pose(target)
    if relation is None:
        return frame
    return frame @ Pose(RELATIONS[relation].middle(state.info.object(target), region))


def _preplaced(condition: Condition, relation: Relation, state: WorldState) -> list[Preplaced]:
    """Return the objects that are at rest at a target when the episode starts.

    The order of the returned objects does not depend on their names.
    """
    found = []
    for name, place in condition.preplaced.items():
        pose = _middle_of(state, place.target, relation.name, place.region).inverse() @ state.pose(name)
        info, target = state.info.object(name), state.info.object(place.target)
        found.append(Preplaced(name, info.kind, info.asset, target.kind, target.asset, place.region, pose))
    return sorted(found, key=lambda p: (p.kind, p.target_kind, p.region))


def _between_fingers(state: WorldState, name: str) -> bool:
    return state.touching("left_finger", name) and state.touching("right_finger", name)


def _in_fingers(state: WorldState, name: str) -> bool:
    return state.touching("left_finger", name) or state.touching("right_finger", name)


def ground_of(condition: Condition, name: str, resting_on: Mapping[str, str]) -> tuple[str | None, int, str]:
    """Return the slot below an object (or None), the object's level above the slot, and the lowest object of the stack.

    Cabinets in which drawers are mounted are not counted as levels.
    """
    level = 1
    for _ in range(LONGEST_CHAIN):
        mount = condition.object(name).mount
        if name in resting_on:
            name = resting_on[name]
            level += 1
        elif mount is not None:
            name = mount.target
        else:
            break
    return condition.layout.get(name), level, name
