"""Footprints of objects, and slots that are in reach, in view and clear of one another."""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from betterbench.errors import InvalidInputError
from betterbench.geometry import Pose, from_yaw
from betterbench.sim.assets import Asset, build, looks, unseen_looks
from betterbench.sim.assets.authoring.registry import Generator, generator_of
from betterbench.tasks.condition import Condition, ObjectSpec, Slot

FREE_M = 0.002
"""Least distance of two objects at the ends of the jitter of their slots [m]."""
GRIP_M = 0.074
"""Largest width that the gripper grasps [m]: its opening of 80 mm, less the margins that the planner keeps."""
LOW_M = 0.009
"""Least height of a grasp above the table [m]: at 9.8 mm (rolls of tape) the expert finds free grasps, at 5.5 mm (thin
stacks of napkins) the fingers touch the table (measured)."""
SEEN_M = 0.050
"""Least apparent size of a named object [m]: 20 pixels in the front camera at the slots next to the robot.

The camera has a focal length of 523 pixels and is 1.4 m from these slots. Objects of the suite have 24 pixels."""


@dataclass(frozen=True, slots=True)
class Footprint:
    """Measures of a category over all of its looks, seen and held out.

    Attributes:
        radius_m: Largest horizontal distance of a visible point from the origin of the object [m].
        x_m: Smallest and largest x of a visible point, in the frame of the object [m].
        y_m: Smallest and largest y of a visible point, in the frame of the object [m].
        height_m: Largest height [m].
        seen_m: Smallest over the looks of the apparent size from 45 degrees above [m]: the longer of both horizontal
            sides, or height and shorter side foreshortened.
        layer_m: Smallest and largest height of the surface that carries the next object [m].
        grip_m: Largest over the looks of the narrowest grasp [m]; None if a look has no grasp.
        low_m: Smallest over the looks of the height of the highest grasp [m]; 0 without grasps.
        longish: Whether the object is more than 1.5 times as long as wide in a look.
        inside_m: Smallest half width along x, half width along y, and depth of the region "inside" [m]; None if a look
            has no such region.
        regions: Names of the regions that all looks have.
    """

    category: str
    radius_m: float
    x_m: tuple[float, float]
    y_m: tuple[float, float]
    height_m: float
    seen_m: float
    layer_m: tuple[float, float]
    grip_m: float | None
    low_m: float
    longish: bool
    inside_m: tuple[float, float, float] | None
    regions: frozenset[str]

    @property
    def width_m(self) -> float:
        """Longer horizontal side of the bounding box [m]."""
        return max(self.x_m[1] - self.x_m[0], self.y_m[1] - self.y_m[0])


def footprint(category: str) -> Footprint:
    """Return the measures of a category; the color never changes the shape.

    Raises:
        UnknownNameError: If there is no such category.
    """
    return _footprint(category, generator_of(category))


@functools.lru_cache(maxsize=4096)
def _footprint(category: str, _generator: Generator) -> Footprint:
    """Measure a category as built by its current generator; building all looks takes about 0.1 s."""
    assets = [build(category, look=look) for look in (*looks(category), *unseen_looks(category))]
    return _measured(category, assets)


def _measured(category: str, assets: Sequence[Asset]) -> Footprint:
    points = [vertex for asset in assets for part in asset.visual for vertex in part.vertices.tolist()]
    xs, ys = [p[0] for p in points], [p[1] for p in points]
    regions = [{r.name: r for r in asset.regions} for asset in assets]
    tops = [
        named["top"].position[2] if "top" in named else asset.size_m[2]
        for named, asset in zip(regions, assets, strict=True)
    ]
    grips = [min((g.width_m for g in asset.grasps), default=math.inf) for asset in assets]
    inside = None
    if all("inside" in named for named in regions):
        halves = [named["inside"].half_size for named in regions]
        inside = (min(h[0] for h in halves), min(h[1] for h in halves), 2.0 * min(h[2] for h in halves))
    return Footprint(
        category,
        max(math.hypot(x, y) for x, y in zip(xs, ys, strict=True)),
        (min(xs), max(xs)),
        (min(ys), max(ys)),
        max(asset.size_m[2] for asset in assets),
        min(max(x, y, (z + min(x, y)) / math.sqrt(2.0)) for x, y, z in (asset.size_m for asset in assets)),
        (min(tops), max(tops)),
        None if math.isinf(max(grips)) else max(grips),
        min(max((g.pose.position[2] for g in asset.grasps), default=0.0) for asset in assets),
        any(asset.size_m[0] > 1.5 * asset.size_m[1] for asset in assets),
        inside,
        frozenset.intersection(*(frozenset(named) for named in regions)),
    )


def require_usable(group_id: str, objects: Iterable[ObjectSpec]) -> None:
    """Check that the gripper can grasp the objects of a group, and that a camera shows them large enough.

    Raises:
        InvalidInputError: If an object has no grasp, is wider than the gripper opens, or is too small.
    """
    for spec in objects:
        size = footprint(spec.category)
        grip = size.grip_m
        where = f"cast group {group_id!r}: {spec.name}"
        if grip is None:
            problem = f"the gripper cannot grasp the {spec.kind} (category {spec.category})"
            raise InvalidInputError(where, problem, "Choose an asset with grasps")
        if grip > GRIP_M:
            problem = f"the {spec.kind} is {1000 * grip:.0f} mm wide where it is grasped; the gripper takes up to 74 mm"
            raise InvalidInputError(where, problem, "Choose a smaller object")
        if size.low_m < LOW_M:
            problem = f"the {spec.kind} can be so flat that the grasp is {1000 * size.low_m:.0f} mm above the table"
            raise InvalidInputError(where, problem, "Choose a thicker object; the fingers need 9 mm")
        if size.seen_m < SEEN_M:
            problem = f"the {spec.kind} can look as small as {1000 * size.seen_m:.0f} mm; the camera needs 50 mm"
            raise InvalidInputError(where, problem, "Choose a larger object")


@dataclass(frozen=True, slots=True)
class Table:
    """Slots of a table for one template: in reach, and in view with the margins of docs/framing.md.

    Attributes:
        starts: Slots from which objects are picked; for several layouts, one after the other.
        stands: Slots of the target.
        besides: Slots of objects that stay.
    """

    starts: tuple[Slot, ...]
    stands: tuple[Slot, ...]
    besides: tuple[Slot, ...] = ()

    @property
    def slots(self) -> tuple[Slot, ...]:
        """All slots."""
        return (*self.starts, *self.stands, *self.besides)


def crowding(condition: Condition, slots: Mapping[str, Slot]) -> str | None:
    """Return which two objects of a condition may touch at the ends of their jitter, or None.

    Containers, fixtures and objects that are longer than wide count as the rectangle of their bounding box, other
    objects as circles around their origin.
    Objects that start at a target are not counted.
    """
    placed = [(condition.object(name), slots[slot]) for name, slot in condition.layout.items()]
    for (a, at), (b, there) in itertools.combinations(placed, 2):
        gap = _gap_m(a, at, b, there)
        if gap < FREE_M:
            lacking = 1000.0 * (FREE_M - gap)
            return f"{a.kind} in {at.name} and {b.kind} in {there.name} may touch: {lacking:.0f} mm are missing"
    return None


def _gap_m(a: ObjectSpec, at: Slot, b: ObjectSpec, there: Slot) -> float:
    """Return the least distance of two objects over the jitter of their slots [m].

    The value is negative if they may overlap.
    """
    jitter = at.jitter_m + there.jitter_m
    (ax, ay), r = _half_sizes(a, at)
    (bx, by), s = _half_sizes(b, there)
    (cx, cy), (dx, dy) = _center(a, at), _center(b, there)
    x = abs(cx - dx) - ax - bx - jitter
    y = abs(cy - dy) - ay - by - jitter
    apart = math.hypot(max(x, 0.0), max(y, 0.0)) if x > 0.0 or y > 0.0 else max(x, y)
    return apart - r - s


def _is_rectangle(spec: ObjectSpec) -> bool:
    return spec.role in ("container", "fixture") or footprint(spec.category).longish


def _center(spec: ObjectSpec, slot: Slot) -> tuple[float, float]:
    """Return the center of an object's bounding box in a slot, or of a circle its origin, in the world frame [m]."""
    if not _is_rectangle(spec):
        return slot.x, slot.y
    size = footprint(spec.category)
    x, y, _ = Pose((slot.x, slot.y, 0.0), from_yaw(slot.yaw)).apply((sum(size.x_m) / 2, sum(size.y_m) / 2, 0.0))
    return x, y


def _half_sizes(spec: ObjectSpec, slot: Slot) -> tuple[tuple[float, float], float]:
    """Return the half sides of the rectangle of an object over the yaw jitter of a slot, and the radius around it [m].

    A circle is a point with a radius, and a rectangle has the radius 0.
    """
    size = footprint(spec.category)
    if not _is_rectangle(spec):
        return (0.0, 0.0), size.radius_m
    half_x, half_y = (0.5 * (high - low) for low, high in (size.x_m, size.y_m))
    turns = [abs(slot.yaw + sign * slot.yaw_jitter) for sign in (-1.0, 0.0, 1.0)]
    along = max(half_x * abs(math.cos(t)) + half_y * abs(math.sin(t)) for t in turns)
    across = max(half_x * abs(math.sin(t)) + half_y * abs(math.cos(t)) for t in turns)
    return (along, across), 0.0
