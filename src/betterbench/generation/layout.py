"""Layouts: slots on the table that are reachable, visible and far enough apart."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass

from betterbench.generation.measures import footprint
from betterbench.geometry import Pose, from_yaw
from betterbench.tasks.condition import Condition, ObjectSpec, Slot

FREE_M = 0.002
"""Minimum distance between two objects at the largest jitter of their slots [m]."""


@dataclass(frozen=True, slots=True)
class Table:
    """Slots on the table that the tasks of a template use.

    All slots are reachable, and visible with the margins of docs/framing.md.

    Attributes:
        starts: Slots that objects are picked from. The slots of several layouts are listed one after the other.
        stands: Slots for the target, such as a container.
        besides: Slots for objects that are not moved.
    """

    starts: tuple[Slot, ...]
    stands: tuple[Slot, ...]
    besides: tuple[Slot, ...] = ()

    @property
    def slots(self) -> tuple[Slot, ...]:
        """All slots of the table."""
        return (*self.starts, *self.stands, *self.besides)


def crowding(condition: Condition, slots: Mapping[str, Slot]) -> str | None:
    """Return a message if two objects of a condition can touch when their poses are jittered, or None.

    Containers, fixtures and elongated objects are represented by the rectangle of their bounding box. Other objects are
    represented by circles around their origin. Objects that start at a target are ignored.
    """
    placed = [(condition.object(name), slots[slot]) for name, slot in condition.layout.items()]
    for (a, at), (b, there) in itertools.combinations(placed, 2):
        gap = _gap_m(a, at, b, there)
        if gap < FREE_M:
            lacking = 1000.0 * (FREE_M - gap)
            return f"{a.kind} in {at.name} and {b.kind} in {there.name} may touch: {lacking:.0f} mm are missing"
    return None


def _gap_m(a: ObjectSpec, at: Slot, b: ObjectSpec, there: Slot) -> float:
    """Return the smallest possible distance between two objects when their slots are jittered [m].

    The distance is negative if the objects may overlap.
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
    """Return the center of the shape that represents an object in a slot, in the world frame [m].

    The center of a rectangle is the center of the bounding box. The center of a circle is the origin of the object.
    """
    if not _is_rectangle(spec):
        return slot.x, slot.y
    size = footprint(spec.category)
    x, y, _ = Pose((slot.x, slot.y, 0.0), from_yaw(slot.yaw)).apply((sum(size.x_m) / 2, sum(size.y_m) / 2, 0.0))
    return x, y


def _half_sizes(spec: ObjectSpec, slot: Slot) -> tuple[tuple[float, float], float]:
    """Return the half sides of the rectangle that represents an object in a slot, and a radius around it [m].

    A rectangle is large enough for any yaw jitter of the slot, and the returned radius is 0. For a circle, the returned
    sides are 0, and the returned radius is the radius of the circle.
    """
    size = footprint(spec.category)
    if not _is_rectangle(spec):
        return (0.0, 0.0), size.radius_m
    half_x, half_y = (0.5 * (high - low) for low, high in (size.x_m, size.y_m))
    turns = [abs(slot.yaw + sign * slot.yaw_jitter) for sign in (-1.0, 0.0, 1.0)]
    along = max(half_x * abs(math.cos(t)) + half_y * abs(math.sin(t)) for t in turns)
    across = max(half_x * abs(math.sin(t)) + half_y * abs(math.cos(t)) for t in turns)
    return (along, across), 0.0
