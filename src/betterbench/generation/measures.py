"""Measurements of objects over all variants of their category, and checks that gripper and camera can handle them.

The variant (look) of an object is drawn by seed, so each measurement covers all variants of a category, including
held-out variants.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.geometry import Vector, rotate
from betterbench.interface.actions import USUAL_ROBOT
from betterbench.interface.state import Region
from betterbench.sim.assets import Asset, CollisionPart, build_unpainted, colors, looks, unseen_looks
from betterbench.sim.assets.authoring.registry import Generator, generator_of
from betterbench.sim.robots import robot
from betterbench.tasks.condition import ObjectSpec
from betterbench.tasks.relations.placing import RELEASE_GAP_M

ROBOT = robot(USUAL_ROBOT)
"""Robot for which generated tasks are designed."""
WIDEST_GRASP_M = ROBOT.gripper_opening_m - 0.006
"""Maximum width of an object between the finger pads [m]: the gripper opening minus 3 mm on each side."""
LOW_M = 0.009
"""Minimum height of a grasp above the base of an object [m].

Measured: the expert finds collision-free grasps at 9.8 mm (rolls of tape), but at 5.5 mm (thin stacks of napkins) the
fingers touch the table.
"""
FINGER_M = (0.015, 0.010)
"""Thickness of a finger at its tip, measured outward from the pad, and half the width of the finger [m].

Both are from Franka's public model.
"""
CLEAR_M = 0.004
"""Clearance that the expert's planner keeps between the fingers and all other geometry, except the held object [m]."""
SEEN_M = 0.050
"""Minimum apparent size of an object that an instruction names [m]: 19 pixels in the front camera at the slots next to
the robot.

The camera has a focal length of 523 pixels and is 1.4 m away from these slots (523 · 0.050 / 1.4 = 18.7). Objects of
the suite have at least 24 pixels.
"""


@dataclass(frozen=True, slots=True)
class Footprint:
    """Measurements of an asset category over all its variants (looks), including held-out variants.

    Attributes:
        category: Name of the category.
        radius_m: Largest horizontal distance of a visible point from the origin of the object [m].
        x_m: Smallest and largest x of a visible point, in the frame of the object [m].
        y_m: Smallest and largest y of a visible point, in the frame of the object [m].
        height_m: Largest height [m].
        seen_m: Smallest apparent size from 45 degrees above [m]. The apparent size of a variant is the larger of two
            lengths: its longer horizontal side, and the extent of its shorter side and height as seen from above at
            this angle.
        layer_m: Smallest and largest height of the surface on which the next object of a stack stands [m].
        grip_m: Width of the narrowest grasp of a variant, maximum over all variants [m]. None if a variant has no
            grasp.
        low_m: Height of the highest grasp of a variant, minimum over all variants [m]. 0 if a variant has no grasp.
        longish: Whether a variant is more than 1.5 times as long as it is wide.
        inside_m: Smallest half width along x, half width along y, and depth of the region "inside" [m]. None if a
            variant has no such region.
        regions: Names of the regions that all variants have.
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
    """Return the measurements of a category.

    The measurements are the same for all colors, because color does not affect shape.

    Raises:
        UnknownNameError: If the category does not exist.
    """
    return _footprint(category, generator_of(category))


@functools.lru_cache(maxsize=4096)
def _footprint(category: str, _generator: Generator) -> Footprint:
    """Measure a category. Building all variants without textures takes about 0.1 s."""
    return _measured(category, _all_looks(category))


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


def assets_of(spec: ObjectSpec) -> tuple[Asset, ...]:
    """Return the assets of all variants of an object, untextured and in the first color of its category."""
    if spec.color is not None and spec.color not in colors(spec.category):
        raise UnknownNameError(f"color of {spec.category}", spec.color, colors(spec.category))
    return _all_looks(spec.category)


def _all_looks(category: str) -> tuple[Asset, ...]:
    return tuple(build_unpainted(category, look=look) for look in (*looks(category), *unseen_looks(category)))


def refused(spec: ObjectSpec, problem: str, cure: str) -> InvalidInputError:
    """Create an InvalidInputError that explains why an object cannot be used in a task."""
    return InvalidInputError(f"object {spec.name!r} ({spec.kind})", problem, cure)


def mm(length_m: float) -> str:
    """Format a length in millimeters."""
    return f"{1000.0 * length_m:.1f} mm".replace(".0 mm", " mm")


def region_of(spec: ObjectSpec, asset: Asset, name: str) -> Region:
    """Return the region of an asset that has a given name.

    Raises:
        InvalidInputError: If the asset does not have this region.
    """
    regions = {region.name: region for region in asset.regions}
    if name not in regions:
        known = ", ".join(sorted(regions)) or "none"
        raise refused(spec, f"has no region {name!r} (it has {known})", f"Choose an object with a region {name!r}")
    return regions[name]


def require_grasp(spec: ObjectSpec) -> None:
    """Check that the gripper can hold every variant of an object.

    Raises:
        InvalidInputError: If a variant has no grasp, or only grasps that are too wide or too low.
    """
    size = footprint(spec.category)
    if size.grip_m is None:
        raise refused(spec, "has no grasp", "Choose an object with grasps")
    if size.grip_m > WIDEST_GRASP_M:
        cure = f"The gripper needs {mm(WIDEST_GRASP_M)} or less; choose a smaller object"
        raise refused(spec, f"is {mm(size.grip_m)} thick at its narrowest grasp", cure)
    if size.low_m < LOW_M:
        cure = f"The gripper needs {mm(LOW_M)} or more; choose a taller object"
        raise refused(spec, f"would be grasped {mm(size.low_m)} above the table", cure)


def require_usable(objects: Iterable[ObjectSpec]) -> None:
    """Check that the gripper can hold objects, and that they are large enough in the camera image.

    Raises:
        InvalidInputError: If a variant of an object has no grasp, has only grasps that are too wide or too low, or is
            too small.
    """
    for spec in objects:
        require_grasp(spec)
        size = footprint(spec.category)
        if size.seen_m < SEEN_M:
            cure = f"The camera needs at least {mm(SEEN_M)}; choose a larger object"
            raise refused(spec, f"can look as small as {mm(size.seen_m)}", cure)


def require_footprint(spec: ObjectSpec, most_m: float, place: str) -> None:
    """Check that no variant of an object is too long for the place where the object is put.

    Raises:
        InvalidInputError: If a variant is longer than ``most_m``.
    """
    found = max(max(asset.size_m[:2]) for asset in assets_of(spec))
    if found > most_m:
        raise refused(spec, f"is {mm(found)} long", f"{place} has room for {mm(most_m)}; choose a smaller object")


def foot_of(asset: Asset) -> tuple[float, float]:
    """Return the x and y coordinates of the center of an asset's base, in the frame of the asset [m]."""
    for region in asset.regions:
        if region.name == "base":
            return region.position[0], region.position[1]
    return 0.0, 0.0


def radius_below(asset: Asset, height_m: float) -> float:
    """Return the largest horizontal distance of an asset's collision geometry from the axis of its base [m].

    Parts that begin at or above ``height_m`` are ignored. A part that begins below this height is completely included.
    """
    x, y = foot_of(asset)
    largest = 0.0
    for part in asset.collision:
        turned = [rotate(part.quaternion, corner) for corner in _corners(part)]
        points = [tuple(map(sum, zip(part.position, corner, strict=True))) for corner in turned]
        if min(z for _, _, z in points) < height_m:
            # a cylinder extends by its radius, not to the corners of its bounding box
            round_m = part.size[0] if part.shape in ("cylinder", "capsule", "sphere") else 0.0
            axis = math.hypot(part.position[0] - x, part.position[1] - y)
            far = max(math.hypot(px - x, py - y) for px, py, _ in points)
            largest = max(largest, axis + round_m if round_m and _stands_upright(part) else far)
    return largest


def _corners(part: CollisionPart) -> list[Vector]:
    if part.vertices is not None:
        return [(float(px), float(py), float(pz)) for px, py, pz in part.vertices]
    match part.shape:
        case "cylinder":
            half = (part.size[0], part.size[0], part.size[1])
        case "capsule":
            half = (part.size[0], part.size[0], part.size[0] + part.size[1])
        case "sphere":
            half = (part.size[0],) * 3
        case _:
            half = part.size
    signs = itertools.product((-1.0, 1.0), repeat=3)
    return [(sx * half[0], sy * half[1], sz * half[2]) for sx, sy, sz in signs]


def _stands_upright(part: CollisionPart) -> bool:
    return abs(rotate(part.quaternion, (0.0, 0.0, 1.0))[2]) > 0.999


def require_finger_room(spec: ObjectSpec, support: ObjectSpec) -> None:
    """Check that the open fingers do not touch a support (such as the rim of a plate) when an object is put on it.

    The object is placed at the center of the region "top". The fingers may have any orientation, so only the distance
    from the center matters.

    Raises:
        InvalidInputError: If the fingers would come too close to a variant of the support.
    """
    held = min(max((g.pose.position[2] for g in asset.grasps), default=0.0) for asset in assets_of(spec))
    near, far = 0.5 * ROBOT.gripper_opening_m, math.hypot(0.5 * ROBOT.gripper_opening_m + FINGER_M[0], FINGER_M[1])
    for asset in assets_of(support):
        tip = region_of(support, asset, "top").position[2] + RELEASE_GAP_M + held - ROBOT.tip_below_tcp_m
        surface = _height_between(asset, near, far)
        if tip - surface < CLEAR_M:
            problem = (
                f"is held so low that the fingers come within {mm(max(0.0, tip - surface))} of the {support.kind} "
                f"(look {asset.look})"
            )
            cure = f"The fingers need {mm(CLEAR_M)}; choose a thicker object, or a support without a rim"
            raise refused(spec, problem, cure)


@functools.lru_cache(maxsize=4096)
def _height_between(asset: Asset, near_m: float, far_m: float) -> float:
    """Return the maximum height of a collision shape within a range of distances from the asset's vertical axis [m]."""
    points = (point for part in asset.collision for point in _surface(part))
    return max((z for x, y, z in points if near_m <= math.hypot(x, y) <= far_m), default=0.0)


def _surface(part: CollisionPart) -> Iterator[tuple[float, float, float]]:
    """Yield points on the upper and lower faces of a box or a cylinder, and the corners of any other shape [m]."""
    steps = [i / 20.0 for i in range(-20, 21)]
    if part.shape == "box":
        x, y, z = part.size[:3]
        points = [(x * u, y * v, side) for u in steps for v in steps[::5] for side in (-z, z)]
    elif part.shape == "cylinder":
        radius, half = part.size[:2]
        around = [math.pi * step for step in steps]
        points = [
            (radius * r * math.cos(t), radius * r * math.sin(t), side)
            for r in steps[20:]
            for t in around[::5]
            for side in (-half, half)
        ]
    else:
        points = _corners(part)
    for point in points:
        px, py, pz = map(sum, zip(part.position, rotate(part.quaternion, point), strict=True))
        yield px, py, pz
