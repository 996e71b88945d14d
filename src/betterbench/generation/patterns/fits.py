"""Checks of chosen objects: numbers of objects, grasps, sizes, and look-alikes.

Seeds draw the look of every object, so each check covers all looks of a category.
"""

import itertools
import math
from collections.abc import Iterable, Mapping
from dataclasses import replace

from betterbench.errors import InvalidInputError
from betterbench.generation.cast import Cast
from betterbench.geometry import Vector, rotate
from betterbench.interface.state import Region
from betterbench.sim.assets import Asset, CollisionPart, build, colors, looks
from betterbench.sim.robots import PANDA
from betterbench.tasks.authoring import Variation
from betterbench.tasks.condition import ObjectSpec, Role

GRASP_M = PANDA.gripper_opening_m - 0.006
"""Largest thickness of an object between the pads [m]: the opening, with 3 mm of free distance on each side."""

LOWEST_M = 0.010
"""Least height of a grasp above the foot of an object [m]: lower down, the fingers touch the table."""

BYSTANDER_M = 0.10
"""Largest footprint of an object that only stands aside [m]."""

_FALLBACK = "block"
"""Category that exists in most colors: its objects look like another object by color alone."""


def assets_of(spec: ObjectSpec) -> tuple[Asset, ...]:
    """Return the assets of all looks of an object.

    Raises:
        UnknownNameError: If its category or its color does not exist.
    """
    return tuple(build(spec.category, look=look, color=spec.color) for look in looks(spec.category))


def refused(spec: ObjectSpec, problem: str, cure: str) -> InvalidInputError:
    """Return the error for an object that does not fit a pattern."""
    return InvalidInputError(f"object {spec.name!r} ({spec.kind})", problem, cure)


def mm(length_m: float) -> str:
    """Return a length in millimeters for a message."""
    return f"{1000.0 * length_m:.1f} mm".replace(".0 mm", " mm")


def group(cast: Cast, group_id: str, role: Role, at_least: int, at_most: int) -> tuple[ObjectSpec, ...]:
    """Return the objects of a group in their role.

    Raises:
        InvalidInputError: If the group has another number of objects than allowed.
    """
    objects = cast.groups.get(group_id, ())
    if not at_least <= len(objects) <= at_most:
        expected = f"{at_least}" if at_least == at_most else f"{at_least} to {at_most}"
        where, names = f"cast group {group_id!r}", ", ".join(o.name for o in objects) or "none"
        raise InvalidInputError(where, f"has {len(objects)} objects ({names})", f"This pattern needs {expected}")
    return tuple(replace(spec, role=role) for spec in objects)


def region_of(spec: ObjectSpec, asset: Asset, name: str) -> Region:
    """Return a region of an asset.

    Raises:
        InvalidInputError: If the asset does not have it.
    """
    regions = {region.name: region for region in asset.regions}
    if name not in regions:
        known = ", ".join(sorted(regions)) or "none"
        raise refused(spec, f"has no region {name!r} (it has {known})", f"Choose an object with a region {name!r}")
    return regions[name]


def require_grasp(spec: ObjectSpec) -> None:
    """Check that the gripper can hold every look of an object.

    Raises:
        InvalidInputError: If a look has no grasp, or only grasps that are too wide or too low.
    """
    for asset in assets_of(spec):
        if not asset.grasps:
            raise refused(spec, "has no grasp", "Choose an object with a grasp annotation")
        width = min(grasp.width_m for grasp in asset.grasps)
        if width > GRASP_M:
            raise refused(
                spec,
                f"is {mm(width)} thick at its narrowest grasp",
                f"The gripper needs {mm(GRASP_M)} or less; choose a smaller object",
            )
        height = max(grasp.pose.position[2] for grasp in asset.grasps)
        if height < LOWEST_M:
            cure = f"The gripper needs {mm(LOWEST_M)} or more; choose a higher object"
            raise refused(spec, f"is held {mm(height)} above the table", cure)


def require_footprint(spec: ObjectSpec, most_m: float, place: str) -> None:
    """Check the horizontal size of every look of an object.

    Raises:
        InvalidInputError: If a look is longer than ``most_m``.
    """
    found = max(max(asset.size_m[:2]) for asset in assets_of(spec))
    if found > most_m:
        raise refused(spec, f"is {mm(found)} long", f"{place} has room for {mm(most_m)}; choose a smaller object")


def foot_of(asset: Asset) -> tuple[float, float]:
    """Return the center of an asset's foot in its frame [m]."""
    for region in asset.regions:
        if region.name == "base":
            return region.position[0], region.position[1]
    return 0.0, 0.0


def radius_below(asset: Asset, height_m: float) -> float:
    """Return the largest horizontal distance of an asset's collision geometry from the axis of its foot [m].

    Parts that begin at ``height_m`` or higher are left out; a part that begins below counts as a whole.
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


def in_order(variations: Iterable[Variation]) -> tuple[Variation, ...]:
    """Return variations in the order of their axes: layout, recomposition, object, time."""
    return tuple(sorted(variations, key=lambda variation: "LROT".index(variation.name[0])))


def words_of(items: Iterable[ObjectSpec]) -> tuple[dict[str, str], str | None]:
    """Return the distinguishing word of each item by its name, and the noun that all items share.

    The kinds "red mug" and "blue mug" give the words "red" and "blue" and the noun "mug". Without a shared noun, the
    word is the whole kind, and the noun is None.
    """
    kinds = {spec.name: spec.kind.split() for spec in items}
    nouns = {words[-1] for words in kinds.values()}
    if len(nouns) == 1 and all(len(words) > 1 for words in kinds.values()):
        return {name: " ".join(words[:-1]) for name, words in kinds.items()}, nouns.pop()
    return {name: " ".join(words) for name, words in kinds.items()}, None


def look_alikes(cast: Cast, items: tuple[ObjectSpec, ...]) -> Mapping[str, ObjectSpec]:
    """Return a distractor that looks like each item, by the item's name.

    It is the first look-alike of the cast that is narrow enough to stand in a slot, otherwise a toy block of the item's
    color, unless the cast has a block. An item without either is left out.
    """
    found: dict[str, ObjectSpec] = {}
    taken = {spec.name for specs in cast.groups.values() for spec in specs}
    nouns = {spec.kind for specs in cast.groups.values() for spec in specs}
    blocks = not any(spec.category == _FALLBACK for specs in cast.groups.values() for spec in specs)
    for item in items:
        fitting = (
            spec
            for spec in cast.look_alikes.get(item.name, ())
            if spec.name not in taken and spec.kind not in nouns and spec.category != item.category and _stands(spec)
        )
        spec = next(fitting, None) or (_block_like(item, taken) if blocks else None)
        if spec is not None:
            found[item.name] = replace(spec, role="distractor", fixed=False, mount=None)
            taken.add(spec.name)
            nouns.add(spec.kind)
    return found


def _stands(spec: ObjectSpec) -> bool:
    length = max(max(asset.size_m[:2]) for asset in assets_of(spec))
    return length <= 0.14


def _block_like(item: ObjectSpec, taken: set[str]) -> ObjectSpec | None:
    color = item.color or colors(item.category)[0]
    name = f"{color}_toy_block"
    if color not in colors(_FALLBACK) or name in taken:
        return None
    return ObjectSpec(name, f"{color} toy block", _FALLBACK, color, role="distractor")
