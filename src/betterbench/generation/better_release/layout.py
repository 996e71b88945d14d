"""Transfer of the initial positions of a BeTTER release task to our table.

Both world frames have the robot base at the origin, x away from the robot and y to the left, so positions are used
unchanged. Positions within 2.5 cm of each other become one slot. Each slot is then moved as little as necessary, until
it is reachable, visible to the front camera, and free of overlaps between our assets in every scene. In each scene, the
order of the objects from left to right and from near to far is kept. The headings in the release are not used, because
the axes of our assets are oriented differently. Instead, the heading of each slot is chosen so that the gripper can
open there.
"""

from __future__ import annotations

import functools
import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from betterbench.generation.better_release.matching import Match
from betterbench.generation.better_release.resolved import Resolved
from betterbench.geometry import Pose, Vector, from_yaw, rotate
from betterbench.sim.assets import CollisionPart
from betterbench.tasks import Slot, get_task, suite_tasks

SAME_SLOT_M = 0.025
"""Maximum distance between positions that are merged into one slot [m]: jitter of 15 mm plus precision of manual
placement.
"""
JITTER_M, TARGET_JITTER_M = 0.01, 0.005
"""Position jitter of object slots and of target slots [m]."""
GAP_M = 0.04
"""Clearance between two objects [m]: the thickness of a finger plus the position jitter of both objects."""
TARGET_GAP_M = 0.05
"""Clearance between an object and a target [m]. The finger and the palm must fit next to a container wall."""
NEAR_X_M, FAR_X_M = 0.36, 0.69
"""Minimum and maximum distance of the suite's pick slots from the robot base along x [m]."""
FAR_TARGET_X_M = 0.60
"""Maximum distance between the center of a target and the robot base along x [m]."""
SEEN_AT_0_M, SEEN_SLOPE = 0.36, 0.19
"""Maximum |y| of positions in view of the front camera: 0.36 - 0.19 x [m].

The limit includes a margin of 8 mm for camera jitter and 1 cm for slot jitter. A test compares the limit with the
camera.
"""
FRONT_CAMERA_M = (1.45, 0.0, 0.95)
"""Position of the front camera in the world frame [m]. A test compares it with the camera in the scene."""
_QUARTERS = (0.0, math.pi / 2, -math.pi / 2, math.pi)
_ORDERED_M, _KEPT_M = 0.02, 0.004
_ROUNDS, _MOST_STEPS = 900, 2_000_000
"""Maximum number of rounds in which slots are pushed apart, and maximum number of pairs pushed in all rounds."""
_TINY, _ROUNDING_M = 1e-12, 1e-3


def beyond_workspace_m(x: float, y: float) -> float:
    """Return the distance of a position from the reachable and visible part of our table [m].

    The distance is 0 if the position is inside this part.
    """
    inside_x = min(max(x, NEAR_X_M), FAR_X_M)
    limit = SEEN_AT_0_M - SEEN_SLOPE * inside_x
    inside_y = min(max(y, -limit), limit)
    return math.hypot(x - inside_x, y - inside_y)


@dataclass
class _Cluster:
    """Positions that are merged into one slot."""

    name: str
    x: float
    y: float
    yaw: float
    is_target: bool
    half_x: float = 0.0
    half_y: float = 0.0
    users: list[tuple[str, str]] = field(default_factory=list)

    def take_in(self, variation: str, name: str, match: Match) -> None:
        """Add an object of a variation to the cluster, and increase the space that the cluster's slot needs."""
        half_x, half_y = _half_extents(match, self.yaw)
        # The heading of an object's slot is not known yet, so the longer extent is used in both directions.
        if not self.is_target:
            half_x = half_y = max(half_x, half_y)
        self.half_x, self.half_y = max(self.half_x, half_x), max(self.half_y, half_y)
        self.users.append((variation, name))


@dataclass(frozen=True)
class PlacedSlots:
    """Slots of a task, placed on our table.

    Attributes:
        slots: Slots by name.
        of: Name of the slot for each pair of a variation and an object.
        moved_m: Distance of each slot from its position in the release [m].
        crowded: Pairs of slots in the same scene that could not be moved far enough apart, with the missing distance
            [m].
        hidden: Pairs of a variation and an object whose center is hidden from the front camera by the target.
    """

    slots: Mapping[str, Slot]
    of: Mapping[tuple[str, str], str]
    moved_m: Mapping[str, float]
    crowded: tuple[tuple[str, str, float], ...]
    hidden: frozenset[tuple[str, str]]


def place_slots(
    variations: Sequence[Resolved], present: Mapping[str, tuple[str, ...]], matches: Mapping[str, Match]
) -> PlacedSlots:
    """Place the slots for the objects of all variations on our table.

    Args:
        variations: Variations of the task, starting with the training variations.
        present: Objects that start in a slot, by variation.
        matches: Library asset that represents each object, by object id.
    """
    clusters: list[_Cluster] = []
    target_yaw = {name: _open_yaw(name, variations, present, matches) for name in {v.container for v in variations}}
    for variation in variations:
        for name in present[variation.name]:
            is_target = name == variation.container
            x, y, _ = variation.poses[name].position
            cluster = _same_slot(clusters, variation.name, (x, y), is_target=is_target)
            if cluster is None:
                kind = "stand" if is_target else "slot"
                number = 1 + sum(c.is_target == is_target for c in clusters)
                cluster = _Cluster(f"{kind}_{number}", x, y, target_yaw[name] if is_target else 0.0, is_target)
                clusters.append(cluster)
            cluster.take_in(variation.name, name, matches[name])
    found, crowded = _separated(clusters)
    near: list[list[int]] = [[] for _ in clusters]
    for i, j in _together(clusters):
        near[i] += [j] if clusters[j].is_target else []
        near[j] += [i] if clusters[i].is_target else []
    slots = {
        c.name: Slot(
            c.name,
            round(float(x), 4),
            round(float(y), 4),
            round(c.yaw if c.is_target else _free_yaw(i, near[i], clusters, found, matches), 4),
            jitter_m=TARGET_JITTER_M if c.is_target else JITTER_M,
            yaw_jitter=0.03 if c.is_target else 0.15,
        )
        for i, (c, (x, y)) in enumerate(zip(clusters, found, strict=True))
    }
    of = {user: c.name for c in clusters for user in c.users}
    hidden = {
        (v.name, name)
        for v in variations
        for name in present[v.name]
        if name != v.container and (v.name, v.container) in of
        if _hides(matches[v.container], slots[of[v.name, v.container]], matches[name], slots[of[v.name, name]])
    }
    return PlacedSlots(
        slots=slots,
        of=of,
        moved_m={c.name: round(math.dist((c.x, c.y), (x, y)), 4) for c, (x, y) in zip(clusters, found, strict=True)},
        crowded=crowded,
        hidden=frozenset(hidden),
    )


def _same_slot(
    clusters: Iterable[_Cluster], variation: str, place: tuple[float, float], *, is_target: bool
) -> _Cluster | None:
    """Return the existing cluster (slot) that a position belongs to, or None.

    It is the nearest cluster within the merging distance that no other object of the same variation uses.
    """
    near = [
        c
        for c in clusters
        if c.is_target == is_target
        and math.dist((c.x, c.y), place) <= SAME_SLOT_M
        and all(variation != other for other, _ in c.users)
    ]
    return min(near, key=lambda c: math.dist((c.x, c.y), place), default=None)


def _open_yaw(
    name: str, variations: Iterable[Resolved], present: Mapping[str, tuple[str, ...]], matches: Mapping[str, Match]
) -> float:
    """Return the target heading that hides the fewest goal objects from the camera [rad].

    Among equally good headings, the usual heading in the suite is preferred.
    """
    if name not in matches:
        return 0.0
    usual = _usual_yaw(matches[name].category)

    def hidden(turn: float) -> int:
        count = 0
        for v in variations:
            if v.container == name and name in present[v.name]:
                stand = Slot("stand", *v.poses[name].position[:2], usual + turn)
                others = [one for one in v.goals if one in present[v.name] and one != name]
                places = (Slot("slot", *v.poses[one].position[:2]) for one in others)
                pairs = zip(others, places, strict=True)
                count += sum(_hides(matches[name], stand, matches[one], place) for one, place in pairs)
        return count

    return math.remainder(usual + min(_QUARTERS, key=hidden), math.tau)


def _hides(target: Match, stand: Slot, match: Match, place: Slot) -> bool:
    """Return whether a target blocks the front camera's view of the center of an object.

    The collision shapes of the target are approximated by their bounding boxes.
    """
    frame = Pose((stand.x, stand.y, 0.0), from_yaw(stand.yaw)).inverse()
    eye, middle = frame.apply(FRONT_CAMERA_M), frame.apply((place.x, place.y, 0.5 * match.asset.size_m[2]))
    return any(_crosses(part, eye, middle) for part in target.asset.collision)


def _crosses(part: CollisionPart, start: Vector, end: Vector) -> bool:
    """Return whether a line segment crosses the bounding box of a collision shape.

    The end points of the segment are given in the frame of the shape's asset.
    """
    center, half = np.zeros(3), np.asarray(part.size)
    if part.shape == "hull" and part.vertices is not None:
        low, high = part.vertices.min(axis=0), part.vertices.max(axis=0)
        center, half = 0.5 * (low + high), 0.5 * (high - low)
    elif part.shape in ("cylinder", "capsule"):
        half = np.array([part.size[0], part.size[0], part.size[1]])
    elif part.shape == "sphere":
        half = np.full(3, part.size[0])
    frame = Pose(part.position, part.quaternion).inverse()
    a, b = np.asarray(frame.apply(start)) - center, np.asarray(frame.apply(end)) - center
    way = np.where(np.abs(b - a) < _TINY, _TINY, b - a)
    one, other = (-half - a) / way, (half - a) / way
    enters, leaves = float(np.minimum(one, other).max()), float(np.maximum(one, other).min())
    return max(enters, 0.0) <= min(leaves, 1.0)


@functools.cache
def _usual_yaw(category: str) -> float:
    """Return the most frequent heading of a category's targets in the suite [rad], or 0 if the suite has none."""
    yaws = Counter(
        task.slot(condition.layout[spec.name]).yaw
        for task in map(get_task, suite_tasks("better60"))
        for condition in task.training
        for spec in condition.objects
        if spec.category == category and spec.name in condition.layout
    )
    return yaws.most_common(1)[0][0] if yaws else 0.0


def _half_extents(match: Match, yaw: float) -> tuple[float, float]:
    half_x, half_y = 0.5 * match.asset.size_m[0], 0.5 * match.asset.size_m[1]
    c, s = abs(math.cos(yaw)), abs(math.sin(yaw))
    return c * half_x + s * half_y, s * half_x + c * half_y


def _separated(clusters: list[_Cluster]) -> tuple[np.ndarray, tuple[tuple[str, str, float], ...]]:
    """Move the slots apart. Return the positions (n, 2) [m], and the pairs of slots that still overlap."""
    wished = [(float(c.x), float(c.y)) for c in clusters]
    places = [[x, y] for x, y in wished]
    pairs = [_Pair.of(clusters[i], clusters[j], places[i], places[j]) for i, j in _together(clusters)]
    rounds = min(_ROUNDS, 30 + _MOST_STEPS // max(1, len(pairs)))
    for number in range(rounds):
        # After this round, slots are only pushed apart.
        if number < 2 * rounds // 3:
            for place, (x, y) in zip(places, wished, strict=True):
                place[0] += 0.05 * (x - place[0])
                place[1] += 0.05 * (y - place[1])
        for pair in pairs:
            pair.push_apart()
            pair.keep_order()
        for place, c in zip(places, clusters, strict=True):
            place[:] = _inside(c, *place)
    crowded = []
    for pair in pairs:
        missing = min(pair.overlaps()) - _gap_m(pair.a, pair.b)
        # The objects overlap, and not only the clearances around them.
        if missing > _ROUNDING_M:
            crowded.append((pair.a.name, pair.b.name, round(missing, 4)))
    return np.array(places).reshape(-1, 2), tuple(crowded)


def _free_yaw(
    i: int, targets: list[int], clusters: list[_Cluster], places: np.ndarray, matches: Mapping[str, Match]
) -> float:
    """Return the slot heading that makes the gripper open parallel to the nearest wall of a target [rad]."""
    grasps = next((matches[name].asset.grasps for _, name in clusters[i].users if matches[name].asset.grasps), ())
    if not grasps or not targets:
        return 0.0
    opens = rotate(min(grasps, key=lambda g: g.preference).pose.quaternion, (0.0, 1.0, 0.0))
    free = [np.abs(places[i] - places[j]) - (clusters[j].half_x, clusters[j].half_y) for j in targets]
    beside = min(free, key=max)
    wanted = 0.0 if beside[1] > beside[0] else 0.5 * math.pi
    return math.remainder(wanted - math.atan2(opens[1], opens[0]), math.pi)


def _together(clusters: list[_Cluster]) -> list[tuple[int, int]]:
    """Return the index pairs of the slots that occur together in a scene."""
    scenes = [{variation for variation, _ in c.users} for c in clusters]
    return [(i, j) for i in range(len(clusters)) for j in range(i + 1, len(clusters)) if scenes[i] & scenes[j]]


def _gap_m(a: _Cluster, b: _Cluster) -> float:
    return GAP_M if a.is_target == b.is_target else TARGET_GAP_M


@dataclass(frozen=True, slots=True)
class _Pair:
    """Two slots that occur together in a scene.

    Attributes:
        a: First slot.
        b: Second slot.
        at: Position of the first slot [m], which is changed in place.
        other: Position of the second slot [m], which is changed in place.
        needed: Minimum distance of the slots [m], along x and along y. One of the two is enough.
        toward: Direction from the second to the first slot in the requested layout, along x and y: 1 or -1.
        ordered: Axes along which the slots must keep their order, each with the direction in ``toward``.
        share: Part of a push that moves the first slot. A target is moved less than the objects around it.
    """

    a: _Cluster
    b: _Cluster
    at: list[float]
    other: list[float]
    needed: tuple[float, float]
    toward: tuple[float, float]
    ordered: tuple[tuple[int, float], ...]
    share: float

    @classmethod
    def of(cls, a: _Cluster, b: _Cluster, at: list[float], other: list[float]) -> _Pair:
        """Create the pair of two slots at their requested positions."""
        gap = _gap_m(a, b)
        apart = (a.x - b.x, a.y - b.y)
        return cls(
            a=a,
            b=b,
            at=at,
            other=other,
            needed=(a.half_x + b.half_x + gap, a.half_y + b.half_y + gap),
            toward=(1.0 if a.x >= b.x else -1.0, 1.0 if a.y >= b.y else -1.0),
            ordered=tuple((i, math.copysign(1.0, d)) for i, d in enumerate(apart) if abs(d) > _ORDERED_M),
            share=0.5 if a.is_target == b.is_target else 0.1 if a.is_target else 0.9,
        )

    def overlaps(self) -> tuple[float, float]:
        """Return the additional clearance that the slots need along x and y [m].

        Negative values mean that the clearance is large enough.
        """
        at, other, needed = self.at, self.other, self.needed
        return needed[0] - abs(at[0] - other[0]), needed[1] - abs(at[1] - other[1])

    def push_apart(self) -> None:
        x, y = self.overlaps()
        if x <= 0.0 or y <= 0.0:
            return
        axis, lack = (1, y) if y <= x else (0, x)
        toward = self.toward[axis]
        self.at[axis] += toward * self.share * lack
        self.other[axis] -= toward * (1.0 - self.share) * lack

    def keep_order(self) -> None:
        for axis, toward in self.ordered:
            lack = _KEPT_M - toward * (self.at[axis] - self.other[axis])
            if lack > 0.0:
                self.at[axis] += 0.5 * toward * lack
                self.other[axis] -= 0.5 * toward * lack


def _inside(cluster: _Cluster, x: float, y: float) -> tuple[float, float]:
    """Return the position inside the workspace that is nearest to a given position."""
    far = FAR_TARGET_X_M if cluster.is_target else FAR_X_M
    x = min(max(x, NEAR_X_M), far)
    limit = max(0.0, SEEN_AT_0_M - SEEN_SLOPE * x - (0.5 * cluster.half_y if cluster.is_target else 0.0))
    return x, min(max(y, -limit), limit)
