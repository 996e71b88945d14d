"""Support: the picks, puts and slides of a training regime, and whether those of an episode lie among them.

Three kinds of primitive are watched in the states of an episode, by what happens to the objects and not by what a
policy says it does. A **pick** counts with the pose in which the object last stood at rest before the gripper touched
it. A **put** counts with the relation that the object bears to a target after it was let go. A **slide** is a drawer
that was moved along its rails.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from betterbench.geometry import Pose, distance, yaw_of
from betterbench.state import WorldState
from betterbench.state.world import GRIPPER_BODIES
from betterbench.tasks import Condition, Slot, Task
from betterbench.tasks.relations import RELATIONS, at_rest
from betterbench.tasks.relations.closed import GAP

POSITION_TOLERANCE_M = 0.001
"""Distance beyond a slot's jitter that still counts as inside [m]: the drift that clause (c) allows."""
YAW_TOLERANCE_RAD = 0.02
"""Turning beyond a slot's yaw jitter that still counts as inside [rad]; a resting asset turns by less."""
PUSHED_TOLERANCE_M = 0.005
"""The same for a movable target at the time something is put on it [m]: setting things down may push it so far."""
SLIDE_M = GAP
"""Distance from which a drawer counts as moved [m]."""
LONGEST_CHAIN = 8
"""Most hops from a target down to what stands in a slot: a stack of four on something in a mounted drawer has six."""


@dataclass(frozen=True, slots=True)
class Pick:
    """An object taken from ``pose`` (``T_world_object``), in which it last stood at rest before the gripper's touch."""

    object: str
    kind: str
    pose: Pose


@dataclass(frozen=True, slots=True)
class Put:
    """An object let go, and the pose of what stands in the slot below it.

    Attributes:
        relation: Name of the relation to its target, or None where it bears none: it was lost on the way.
        region: TargetRegion of the target, where it offers several.
        slot: Slot that the target, or what carries it, stands in; None if it stands in none.
        level: Number of things below, down to the slot; the mount of a drawer does not count.
        pose: Pose ``T_world_object`` at rest.
    """

    object: str
    relation: str | None
    target_kind: str
    region: str
    slot: str | None
    level: int
    base_pose: Pose
    base_fixed: bool
    pose: Pose


@dataclass(frozen=True, slots=True)
class DrawerMove:
    """A drawer opened or shut, and the slot of its cabinet."""

    object: str
    kind: str
    slot: str | None


Primitive = Pick | Put | DrawerMove


@dataclass(frozen=True, slots=True)
class Found:
    """What the regime says to one primitive: what was done, why it is outside the trained (or None), and the slack.

    The slack is the distance to the border of the jitter region [m], negative outside; None where there is none.
    """

    text: str
    problem: str | None
    slack_m: float | None


class Handling:
    """Watches an episode and lists its primitives. Feed it every state from reset on, in order."""

    def __init__(self, task: Task, condition: Condition) -> None:
        self._condition = condition
        self._relations = tuple(RELATIONS[n] for n in (task.template.relation, *task.template.also) if n in RELATIONS)
        self._resting_on: dict[str, str] = {name: place.target for name, place in condition.preplaced.items()}
        self._stood: dict[str, Pose] = {}
        self._shut_at: dict[str, Pose] = {}
        self._carried: str | None = None
        self._settling: str | None = None
        self._found: list[Primitive] = []
        self._slid: dict[str, DrawerMove] = {}
        self._last: WorldState | None = None

    def update(self, state: WorldState) -> None:
        """Take in the next state."""
        if self._last is None:
            for o in state.info.objects:
                (self._shut_at if o.role == "drawer" else self._stood)[o.name] = state.pose(o.name)
        self._last = state
        for name, start in self._shut_at.items():
            if name not in self._slid and distance(state.pose(name).position, start.position) > SLIDE_M:
                kind = state.info.object(name).kind
                self._slid[name] = DrawerMove(name, kind, _ground(self._condition, name, self._resting_on)[0])
        if self._carried is not None and not _in_fingers(state, self._carried):
            self._settling, self._carried = self._carried, None
        held = state.held
        if held is not None and held != self._carried and held not in self._shut_at:
            self._settle(state)
            self._carried = held
            self._found.append(Pick(held, state.info.object(held).kind, self._stood[held]))
            self._resting_on.pop(held, None)
        touched = {n for a, b, _ in state.contacts for n in (a, b) if a in GRIPPER_BODIES or b in GRIPPER_BODIES}
        for name in self._stood:
            if name not in touched and name != self._carried and at_rest(state, name):
                self._stood[name] = state.pose(name)
        if (
            self._settling is not None
            and not state.touched_by_gripper(self._settling)
            and at_rest(state, self._settling)
        ):
            self._settle(state)

    def finish(self) -> tuple[Primitive, ...]:
        """Return all primitives of the episode in the order in which they began; slides come last."""
        if self._last is not None:
            self._settle(self._last)
        return (*self._found, *self._slid.values())

    def _settle(self, state: WorldState) -> None:
        """Note where the object that was let go has come to rest."""
        name = self._settling
        if name is None:
            return
        self._settling = None
        self._stood[name] = state.pose(name)
        for relation in self._relations:
            if state.info.object(name).role not in relation.roles:
                continue
            for target in state.info.objects:
                if target.name == name or not relation.regions(target):
                    continue
                place = relation.where(state, name, target.name)
                if place is not None:
                    self._resting_on[name] = target.name
                    slot, level, base = _ground(self._condition, target.name, self._resting_on)
                    fixed = state.info.object(base).fixed
                    pose = state.pose(name)
                    kind = target.kind
                    put = Put(name, relation.name, kind, place, slot, level, state.pose(base), fixed, pose)
                    self._found.append(put)
                    return
        pose = state.pose(name)
        self._found.append(Put(name, None, "", "", None, level=0, base_pose=pose, base_fixed=False, pose=pose))


def _in_fingers(state: WorldState, name: str) -> bool:
    return state.touching("left_finger", name) or state.touching("right_finger", name)


def _ground(condition: Condition, name: str, resting_on: Mapping[str, str]) -> tuple[str | None, int, str]:
    """Return the slot (or None) below an object, the number of things up to it without mounts, and what is in it."""
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


@dataclass(frozen=True)
class TrainedSupport:
    """The support of a task's training regime.

    Attributes:
        targets: Relation, kind of target and place of every put.
        spots: Slot, relation, place and level of every put: where in the world things were let go.
    """

    pick_slots: tuple[Slot, ...] = ()
    grasped: frozenset[str] = frozenset()
    targets: frozenset[tuple[str, str, str]] = frozenset()
    spots: frozenset[tuple[str, str, str, int]] = frozenset()
    slides: frozenset[tuple[str, str]] = frozenset()
    slots: Mapping[str, Slot] = field(default_factory=dict)

    @classmethod
    def of(cls, task: Task) -> TrainedSupport:
        """Collect the primitives that the training conditions ask for.

        A subgoal of a drawer that has to be shut is a slide; every other one picks its object and puts it at a target.
        """
        picks: dict[str, Slot] = {}
        grasped: set[str] = set()
        targets: set[tuple[str, str, str]] = set()
        spots: set[tuple[str, str, str, int]] = set()
        slides: set[tuple[str, str]] = set()
        for condition in task.training:
            resting_on = {name: place.target for name, place in condition.preplaced.items()}
            for goal in condition.instruction.subgoals:
                names = condition.resolve(goal.reference)
                if not RELATIONS[goal.relation].carried:
                    grounds = ((name, _ground(condition, name, resting_on)[0]) for name in names)
                    slides.update((condition.object(name).kind, slot) for name, slot in grounds if slot is not None)
                    continue
                placed = [name for name in names if name in condition.layout]
                picks.update((slot, task.slot(slot)) for slot in (condition.layout[name] for name in placed))
                grasped.update(condition.object(name).kind for name in placed)
                targets.add((goal.relation, condition.object(goal.target).kind, goal.region))
                slot, level, _ = _ground(condition, goal.target, resting_on)
                if slot is not None:
                    spots.add((slot, goal.relation, goal.region, level))
                resting_on.update(dict.fromkeys(names, goal.target))
        return cls(
            tuple(picks.values()),
            frozenset(grasped),
            frozenset(targets),
            frozenset(spots),
            frozenset(slides),
            {s.name: s for s in task.slots},
        )

    def judge(self, primitive: Primitive) -> Found:
        """Tell whether a primitive lies inside the support."""
        if isinstance(primitive, Pick):
            return self._judge_pick(primitive)
        if isinstance(primitive, DrawerMove):
            text = f"moves the {primitive.kind} of the cabinet in {primitive.slot}"
            known = (primitive.kind, primitive.slot or "") in self.slides
            return Found(text, None if known else f"{text}, which no demonstration does", None)
        return self._judge_put(primitive)

    def _judge_pick(self, pick: Pick) -> Found:
        x, y, _ = pick.pose.position
        nearest = max(self.pick_slots, key=lambda s: slack_m(s, pick.pose), default=None)
        if nearest is None or slack_m(nearest, pick.pose) < -POSITION_TOLERANCE_M:
            text = f"picks the {pick.kind} at ({x:.3f}, {y:.3f})"
            beyond = None if nearest is None else slack_m(nearest, pick.pose)
            where = "" if nearest is None else f", {-1000 * (beyond or 0.0):.1f} mm outside {nearest.name}"
            return Found(text, f"{text}, in no pick slot of the training regime{where}", beyond)
        slack = slack_m(nearest, pick.pose)
        text = f"picks the {pick.kind} in {nearest.name}"
        if pick.kind not in self.grasped:
            return Found(text, f"{text}, but no demonstration grasps a {pick.kind}", slack)
        turned = abs(math.remainder(yaw_of(pick.pose.quaternion) - nearest.yaw, math.tau)) - nearest.yaw_jitter
        if turned > YAW_TOLERANCE_RAD:
            return Found(text, f"{text}, turned {math.degrees(turned):.1f} degrees beyond the slot's jitter", slack)
        return Found(text, None, slack)

    def _judge_put(self, put: Put) -> Found:
        if put.relation is None:
            return Found(f"loses the {put.object} on the way", None, None)
        where = f"{put.target_kind}{'.' if put.region else ''}{put.region}"
        level = f" at level {put.level}" if put.level > 1 else ""
        text = f"puts {put.object} {put.relation} {where} in {put.slot}{level}"
        if (put.relation, put.target_kind, put.region) not in self.targets:
            return Found(text, f"{text}, but no demonstration puts anything {put.relation} {where}", None)
        if put.slot is None:
            return Found(text, f"{text}: the target stands in no slot", None)
        if not self._is_spot(put):
            return Found(text, f"{text}, a place in the world that no demonstration uses", None)
        slack = slack_m(self.slots[put.slot], put.base_pose)
        allowed = POSITION_TOLERANCE_M if put.base_fixed else PUSHED_TOLERANCE_M
        if slack < -allowed:
            return Found(text, f"{text}, which stands {-1000 * slack:.1f} mm outside that slot", slack)
        return Found(text, None, slack if self.slots[put.slot].jitter_m > 0.0 else None)

    def _is_spot(self, put: Put) -> bool:
        return (put.slot or "", put.relation or "", put.region, put.level) in self.spots


def slack_m(slot: Slot, pose: Pose) -> float:
    """Return how far inside the jitter region of a slot a pose lies [m]; negative outside."""
    dx, dy = abs(pose.position[0] - slot.x), abs(pose.position[1] - slot.y)
    return slot.jitter_m - max(dx, dy)
