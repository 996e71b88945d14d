"""Support of a training distribution: the picks, placements and drawer movements that occur in training.

The motion primitives of an episode are compared with this support.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from betterbench.certification.handling import DrawerMove, Pick, Preplaced, Primitive, Put, ground_of
from betterbench.geometry import Pose, angle_between, distance, yaw_of
from betterbench.tasks import Slot, Task
from betterbench.tasks.demonstrated import HEIGHT_MM, REACH_MM, Demonstrated, FlatPose
from betterbench.tasks.relations import RELATIONS

POSITION_TOLERANCE_M = 0.001
"""Tolerance around the region in which objects are placed randomly in a slot [m].

It is equal to the motion of resting objects that clause (c) of a certificate allows.
"""
YAW_TOLERANCE_RAD = 0.02
"""Tolerance beyond the random rotation of an object in a slot [rad]. Objects at rest never rotate by this much."""
PUSHED_TOLERANCE_M = 0.005
"""Position tolerance for a movable target [m], which may be pushed by this distance when an object is placed on it."""
LEFT_M, LEFT_RAD = 0.005, math.radians(5.0)
"""Maximum distance [m] and rotation [rad] of a pre-placed object from the nearest final pose in demonstrations."""


@dataclass(frozen=True, slots=True)
class Found:
    """Result of comparing one motion primitive with the training distribution.

    Attributes:
        text: Description of the primitive.
        problem: Reason why the primitive is outside the training distribution, or None if it is inside.
        slack_m: Distance from the primitive's position to the border of the region in which this position varies in
            training [m]. It is negative outside the region, and None if there is no such region.
    """

    text: str
    problem: str | None
    slack_m: float | None


class Apart(NamedTuple):
    """Largest deviation of several objects from their poses in a demonstration: distance [m] and rotation [rad]."""

    aside_m: float
    turned: float


@dataclass(frozen=True)
class TrainedSupport:
    """Support of a task's training distribution.

    Attributes:
        demonstrated: Release points and final poses in training demonstrations.
        relation: Relation between pre-placed objects and their target.
        pick_slots: Slots from which objects are picked in training.
        grasped: Kinds of objects that are picked in training.
        targets: Relation, kind of target and region of every placement in training.
        spots: Slot, relation, region and level of every placement in training.
        slides: Kind and slot of every drawer that is moved in training.
        slots: All slots of the task by name.
    """

    demonstrated: Demonstrated
    relation: str
    pick_slots: tuple[Slot, ...] = ()
    grasped: frozenset[str] = frozenset()
    targets: frozenset[tuple[str, str, str]] = frozenset()
    spots: frozenset[tuple[str, str, str, int]] = frozenset()
    slides: frozenset[tuple[str, str]] = frozenset()
    slots: Mapping[str, Slot] = field(default_factory=dict)

    @classmethod
    def of(cls, task: Task, demonstrated: Demonstrated) -> TrainedSupport:
        """Collect the motion primitives that occur in a task's training conditions and demonstrations.

        Closing a drawer is a slide. Every other subgoal consists of a pick of its object and a put at its target.
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
                    grounds = ((name, ground_of(condition, name, resting_on)[0]) for name in names)
                    slides.update((condition.object(name).kind, slot) for name, slot in grounds if slot is not None)
                    continue
                placed = [name for name in names if name in condition.layout]
                picks.update((slot, task.slot(slot)) for slot in (condition.layout[name] for name in placed))
                grasped.update(condition.object(name).kind for name in placed)
                targets.add((goal.relation, condition.object(goal.target).kind, goal.region))
                slot, level, _ = ground_of(condition, goal.target, resting_on)
                if slot is not None:
                    spots.add((slot, goal.relation, goal.region, level))
                resting_on.update(dict.fromkeys(names, goal.target))
        return cls(
            demonstrated,
            task.template.relation,
            tuple(picks.values()),
            frozenset(grasped),
            frozenset(targets),
            frozenset(spots),
            frozenset(slides),
            {s.name: s for s in task.slots},
        )

    def judge_all(self, primitives: Sequence[Primitive]) -> tuple[Found, ...]:
        """Compare all motion primitives of an episode with the training distribution. Return one result per primitive.

        Objects that are pre-placed at the same target are judged together.
        """
        places: dict[tuple[str, str, str], list[Preplaced]] = {}
        for p in primitives:
            if isinstance(p, Preplaced):
                places.setdefault(p.place, []).append(p)
        joint = {place: self._apart(there) for place, there in places.items() if len(there) > 1}
        return tuple(
            self.judge(p)
            if not isinstance(p, Preplaced) or (apart := joint.get(p.place)) is None
            else self._judge_together(p, apart)
            for p in primitives
        )

    def judge(self, primitive: Primitive) -> Found:
        """Return whether a motion primitive is inside the training distribution, with the reason if it is not."""
        if isinstance(primitive, Pick):
            return self._judge_pick(primitive)
        if isinstance(primitive, DrawerMove):
            text = f"moves the {primitive.kind} of the cabinet in {primitive.slot}"
            known = (primitive.kind, primitive.slot or "") in self.slides
            return Found(text, None if known else f"{text}, which no demonstration does", None)
        return self._judge_preplaced(primitive) if isinstance(primitive, Preplaced) else self._judge_put(primitive)

    def _judge_pick(self, pick: Pick) -> Found:
        x, y, _ = pick.pose.position
        nearest = max(self.pick_slots, key=lambda s: slack_m(s, pick.pose), default=None)
        if nearest is None or slack_m(nearest, pick.pose) < -POSITION_TOLERANCE_M:
            text = f"picks the {pick.kind} at ({x:.3f}, {y:.3f})"
            beyond = None if nearest is None else slack_m(nearest, pick.pose)
            where = "" if nearest is None else f", {-1000 * (beyond or 0.0):.1f} mm outside {nearest.name}"
            return Found(text, f"{text}, outside every pick slot of the training distribution{where}", beyond)
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
        where = _place(put.target_kind, put.region)
        level = f" at level {put.level}" if put.level > 1 else ""
        text = f"puts {put.object} {put.relation} {where} in {put.slot}{level}"
        if (put.relation, put.target_kind, put.region) not in self.targets:
            return Found(text, f"{text}, but no demonstration puts anything {put.relation} {where}", None)
        if put.slot is None:
            return Found(text, f"{text}: the target is not in a slot", None)
        if not self._is_spot(put):
            return Found(text, f"{text}, at a position that no demonstration uses", None)
        slack = slack_m(self.slots[put.slot], put.base_pose)
        allowed = POSITION_TOLERANCE_M if put.base_fixed else PUSHED_TOLERANCE_M
        if slack < -allowed:
            return Found(text, f"{text}, which is {-1000 * slack:.1f} mm outside that slot", slack)
        astray = self._release_astray(put)
        if astray is not None:
            return Found(text, f"{text}, {astray}", slack)
        return Found(text, None, slack if self.slots[put.slot].jitter_m > 0.0 else None)

    def _is_spot(self, put: Put) -> bool:
        return (put.slot or "", put.relation or "", put.region, put.level) in self.spots

    def _release_astray(self, put: Put) -> str | None:
        """Describe how a release deviates from the releases at the same target in training.

        Return None if it does not deviate.
        """
        trained = self.demonstrated.releases_at((put.slot, put.relation, put.region, put.level))
        if trained is None:
            return "where no measured demonstration releases an object"
        height, x, y = (1000.0 * value for value in put.release)
        off, aside = trained.off_mm(height), trained.aside_mm(x, y)
        if abs(off) > HEIGHT_MM:
            return f"released {abs(off):.1f} mm {'above' if off > 0.0 else 'below'} every height of training"
        if put.relation and RELATIONS[put.relation].falls and aside > REACH_MM:
            return f"released {aside:.1f} mm to the side of every release in training"
        return None

    def _judge_preplaced(self, there: Preplaced) -> Found:
        where = _place(there.target_kind, there.region)
        text = f"finds {there.object} {self.relation} {where}"
        poses = self.demonstrated.final_poses_at(
            there.target_kind, self.relation, there.region, kind=there.kind, assets=(there.asset, there.target_asset)
        )
        if not poses:
            return Found(text, f"{text}, where no demonstration leaves an object", None)
        if any(_is_near(there.pose, pose) for pose in poses):
            return Found(text, None, None)
        nearest = min(poses, key=lambda pose: _offset_m(there.pose, pose))
        turned = math.degrees(min(abs(_turn(there.pose, pose)) for pose in poses))
        far = f"{1000.0 * _offset_m(there.pose, nearest):.1f} mm and {turned:.0f} degrees"
        return Found(text, f"{text}, {far} from the nearest pose in which demonstrations leave such an object", None)

    def _apart(self, there: Sequence[Preplaced]) -> Apart | None:
        """Return how much several objects at one target deviate from the most similar demonstration.

        Return None if no measured demonstration has the same assets at this target.
        """
        known = self.demonstrated.joint_poses_at(there[0].target_asset, self.relation, there[0].region)
        deviations = []
        for joint in known:
            poses = joint.posed([(p.kind, p.asset) for p in there])
            if poses is not None:
                pairs = [(p.pose, pose) for p, pose in zip(there, poses, strict=True)]
                aside = max(distance(a.position, b.position) for a, b in pairs)
                deviations.append(Apart(aside, max(angle_between(a.quaternion, b.quaternion) for a, b in pairs)))
        return min(deviations, key=lambda d: max(d.aside_m / LEFT_M, d.turned / LEFT_RAD), default=None)

    def _judge_together(self, there: Preplaced, apart: Apart) -> Found:
        text = f"finds {there.object} {self.relation} {_place(there.target_kind, there.region)} beside another object"
        if apart.aside_m <= LEFT_M and apart.turned <= LEFT_RAD:
            return Found(text, None, None)
        far = f"{1000.0 * apart.aside_m:.1f} mm and {math.degrees(apart.turned):.0f} degrees"
        return Found(text, f"{text}, {far} from the nearest poses in which a demonstration leaves them together", None)


def _place(target_kind: str, region: str) -> str:
    return f"{target_kind}{'.' if region else ''}{region}"


def _is_near(pose: Pose, trained: FlatPose) -> bool:
    return _offset_m(pose, trained) <= LEFT_M and abs(_turn(pose, trained)) <= LEFT_RAD


def _offset_m(pose: Pose, trained: FlatPose) -> float:
    """Return the horizontal distance between two poses that are relative to the same target [m]."""
    return math.dist(pose.position[:2], (0.001 * trained.x_mm, 0.001 * trained.y_mm))


def _turn(pose: Pose, trained: FlatPose) -> float:
    """Return the yaw of a pose relative to a pose in training [rad]. It is in [-pi, pi]."""
    return math.remainder(yaw_of(pose.quaternion) - math.radians(trained.yaw_deg), math.tau)


def slack_m(slot: Slot, pose: Pose) -> float:
    """Return the distance from a pose to the border of the region in which objects are placed randomly in a slot [m].

    The distance is positive inside the region and negative outside.
    """
    dx, dy = abs(pose.position[0] - slot.x), abs(pose.position[1] - slot.y)
    return slot.jitter_m - max(dx, dy)
