"""Apply the changes made in a review to an imported object.

The result depends only on the imported object and on the changes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import TypeVar, assert_never

import numpy as np

from betterbench.errors import InvalidInputError
from betterbench.geometry import (
    IDENTITY_QUATERNION,
    Quaternion,
    Vector,
    angle_between,
    conjugate,
    distance,
    from_axis_angle,
    multiply,
    normalize,
    rotate,
)
from betterbench.interface.state import Region
from betterbench.sim.assets.asset import Grasp, VisualPart
from betterbench.sim.assets.authoring.draft import Draft
from betterbench.sim.assets.authoring.mass import MassProperties
from betterbench.sim.assets.importing.cavity import cavity_of
from betterbench.sim.assets.importing.foot import foot_under
from betterbench.sim.assets.importing.grasping import proposals
from betterbench.sim.assets.importing.hulls import convex_hulls
from betterbench.sim.assets.importing.importer import (
    Imported,
    collision_part,
    described,
    mass_properties,
    regions_of,
    shape_of,
)
from betterbench.sim.assets.importing.kinds import kind_of
from betterbench.sim.assets.importing.raw import RawPart, joined
from betterbench.sim.assets.importing.review.changes import (
    Change,
    GraspChange,
    MassChange,
    NameChange,
    Plane,
    PoseChange,
    RegionChange,
    ScaleChange,
    SupportChange,
    said,
)
from betterbench.sim.assets.importing.solid import mass_of_cells, solid_of

SAME_RAD, SAME_M, SAME_SHARE = 2e-3, 2e-4, 5e-3
"""Tolerances for comparing a value with the value that the reviewer saw. The two can differ slightly because of
rounding and differences between CPUs."""

ItemT = TypeVar("ItemT", Grasp, Region)


@dataclass(frozen=True, slots=True, eq=False)
class ReviewState:
    """State of an object during a review.

    Attributes:
        imported: The object with all changes made so far.
        turned: Rotation (w, x, y, z) from the imported pose of the object to its current pose.
    """

    imported: Imported
    turned: Quaternion = IDENTITY_QUATERNION

    @property
    def size_m(self) -> Vector:
        """Extents of the object's bounding box [m]."""
        return size_of(self.imported.draft)

    @property
    def name(self) -> str:
        """Name of the object."""
        return str(self.imported.draft.parameters["name"])


def apply(imported: Imported, changes: Iterable[Change], *, where: str = "review") -> Imported:
    """Apply changes to an object, in order.

    The same object and the same changes always give the same bytes
    (:func:`~betterbench.sim.assets.importing.stored.to_bytes`).

    Args:
        imported: The object as it was imported.
        changes: The changes, in the order in which they were made.
        where: Name of the object, for messages.

    Raises:
        InvalidInputError: If a change was recorded for a different state of the object, or if a change makes the object
            unusable.
    """
    state = ReviewState(imported)
    for change in changes:
        state = changed(state, change, where=where)
    return state.imported


def changed(state: ReviewState, change: Change, *, where: str = "review") -> ReviewState:
    """Apply one change to an object. The arguments and the errors are the same as for :func:`apply`."""
    draft, turned = state.imported.draft, state.turned
    match change:
        case PoseChange():
            if angle_between(normalize(change.before), turned) > SAME_RAD:
                raise _other(where, "rotation", _quaternion(change.before), _quaternion(turned))
            turn, turned = multiply(normalize(change.after), conjugate(turned)), normalize(change.after)
            new = _refound(state.imported, _moved(draft, turn, to_bottom=True), where)
        case ScaleChange():
            longest = max(state.size_m)
            if abs(change.before - longest) > SAME_SHARE * longest:
                raise _other(where, "longest side", f"{change.before:g} m", f"{longest:g} m")
            new = _refound(state.imported, _scaled(draft, change.after / longest), where)
        case SupportChange():
            turn = _leveling(change, where)
            turned = normalize(multiply(turn, turned))
            new = _refound(state.imported, _moved(draft, turn, lower_m=change.after.height_m), where)
        case GraspChange():
            grasps = _replaced("grasp", draft.grasps, (change.before, change.after), _is_same_grasp, where=where)
            new = replace(state.imported, draft=replace(draft, grasps=grasps))
        case RegionChange():
            regions = _replaced(
                "placement frame", draft.regions, (change.before, change.after), _is_same_region, where=where
            )
            new = replace(state.imported, draft=replace(draft, regions=regions))
        case MassChange():
            if abs(change.before - draft.mass_kg) > SAME_SHARE * draft.mass_kg:
                raise _other(where, "mass", f"{change.before:g} kg", f"{draft.mass_kg:g} kg")
            new = replace(state.imported, draft=_weighing(draft, change.after))
        case NameChange():
            if change.before != state.name:
                raise _other(where, "name", repr(change.before), repr(state.name))
            new = _called(state.imported, change.after)
        case _:
            assert_never(change)
    return ReviewState(replace(new, notes=(*new.notes, f"reviewed: {said(change)}")), turned)


def size_of(draft: Draft) -> Vector:
    """Return the extents of the bounding box of an asset draft's visual parts [m]."""
    points = np.concatenate([part.vertices for part in _visual(draft)]).astype(float)
    x, y, z = (round(float(e), 6) for e in np.ptp(points, axis=0))
    return x, y, z


# ------------------------------------------------------------------------------------------------ moving and scaling


def _visual(draft: Draft) -> list[VisualPart]:
    return [part for part in draft.parts if isinstance(part, VisualPart)]


def _placed(draft: Draft, place: Callable[[np.ndarray], np.ndarray]) -> Draft:
    """Move the visual parts of a draft. The collision parts are dropped, because they are computed again later."""
    parts = []
    for part in _visual(draft):
        vertices = np.ascontiguousarray((np.round(place(part.vertices.astype(float)), 7) + 0.0).astype(np.float32))
        vertices.setflags(write=False)
        parts.append(replace(part, vertices=vertices))
    return replace(draft, parts=tuple(parts))


def _moved(draft: Draft, turn: Quaternion, *, to_bottom: bool = False, lower_m: float = 0.0) -> Draft:
    """Rotate a draft, center it above the origin, and lower it by ``lower_m`` [m] or until its bottom is at z = 0."""
    matrix = np.array([rotate(turn, axis) for axis in np.eye(3).tolist()])
    points = np.concatenate([part.vertices for part in _visual(draft)]).astype(float) @ matrix
    low, high = points.min(axis=0), points.max(axis=0)
    shift = np.array([*(-0.5 * (low[:2] + high[:2])), -low[2] if to_bottom else -lower_m])
    return _placed(draft, lambda vertices: vertices @ matrix + shift)


def _scaled(draft: Draft, factor: float) -> Draft:
    return _placed(draft, lambda vertices: vertices * factor)


def _leveling(change: SupportChange, where: str) -> Quaternion:
    """Return the smallest rotation that turns the normal of the new support plane upward."""
    if distance(change.before.normal, Plane().normal) > SAME_RAD or abs(change.before.height_m) > SAME_M:
        raise _other(where, "support plane", f"{change.before}", f"{Plane()}")
    x, y, z = change.after.normal
    length = math.sqrt(x * x + y * y + z * z)
    if abs(length - 1.0) > 1e-3:
        problem = f"the normal of its support plane has the length {length:g}"
        raise InvalidInputError(where, problem, "Use a normal of length 1")
    across = math.hypot(x, y)
    angle = math.atan2(across, z)
    axis = (y / across, -x / across, 0.0) if across > 1e-9 else (1.0, 0.0, 0.0)
    return from_axis_angle([angle * v for v in axis])


def _refound(imported: Imported, draft: Draft, where: str) -> Imported:
    """Compute the collision shape, inertia, grasps and regions again, after the visual parts were moved."""
    raw = [
        RawPart(p.name, np.maximum(p.vertices.astype(float), (-np.inf, -np.inf, 0.0)), p.faces.astype(np.int64))
        for p in _visual(draft)
    ]
    surface = joined(raw)
    size = np.ptp(surface[0], axis=0)
    if float(size.min()) <= 0.0:
        raise InvalidInputError(where, "the whole object is below its support plane", "Undo the change")
    solid = solid_of(*surface)
    cavity = cavity_of(solid)
    hulls, fit = convex_hulls(solid, surface, cavity)
    if not hulls:
        raise InvalidInputError(where, "it has no volume above its support plane", "Undo the change")
    center, inertia = mass_of_cells(solid, draft.mass_kg)
    foot = foot_under(hulls, center)
    new = replace(
        draft,
        shape=shape_of(solid, cavity, size),
        parts=(*draft.parts, *map(collision_part, [*hulls, *([] if foot is None else [foot])])),
        body=mass_properties(draft.mass_kg, center, inertia),
        grasps=tuple(p.grasp for p in proposals(solid, center)),
        regions=tuple(regions_of(solid, cavity, size)),
        parameters={**draft.parameters, "hulls": len(hulls)},
    )
    return replace(imported, draft=new, fit=fit)


def _weighing(draft: Draft, mass: float) -> Draft:
    body = draft.body
    if body is not None:
        share = mass / draft.mass_kg
        ixx, iyy, izz, ixy, ixz, iyz = (float(f"{share * v:.6g}") for v in body.inertia)
        body = MassProperties(mass, body.center_of_mass, (ixx, iyy, izz, ixy, ixz, iyz))
    return replace(draft, mass_kg=mass, body=body)


def _called(imported: Imported, name: str) -> Imported:
    description, tags = described(name)
    parameters = {**imported.draft.parameters, "name": name}
    new = replace(imported.draft, description=description, tags=tags, parameters=parameters)
    return replace(imported, draft=new, kind=kind_of(name))


# ------------------------------------------------------------------------------------------------ grasps and regions


def _replaced(
    what: str,
    items: tuple[ItemT, ...],
    before_after: tuple[ItemT | None, ItemT | None],
    is_same: Callable[[ItemT, ItemT], bool],
    *,
    where: str,
) -> tuple[ItemT, ...]:
    """Move, add or remove one of several named items, i.e. one of the grasps or regions of an object."""
    named = {item.name: item for item in items}
    before, after = before_after
    if before is None and after is None:
        raise InvalidInputError(
            where, f"a change to a {what} has no frame", "Add the frame before the change, the frame after it, or both"
        )
    if before is not None:
        if before.name not in named:
            known = ", ".join(named) or "none"
            raise InvalidInputError(where, f"it has no {what} {before.name!r} (known: {known})", _OTHER_CURE)
        if not is_same(before, named[before.name]):
            raise _other(where, f"{what} {before.name!r}", str(before), str(named[before.name]))
    if after is not None and after.name in named and (before is None or after.name != before.name):
        raise InvalidInputError(where, f"{what} {after.name!r} already exists", "Choose a different name")
    if before is None:
        return items if after is None else items + (after,)  # noqa: RUF005 - mypy infers the type of a sum
    new = [after if item.name == before.name else item for item in items]
    return tuple(item for item in new if item is not None)


def _is_same_grasp(a: Grasp, b: Grasp) -> bool:
    apart = distance(a.pose.position, b.pose.position), abs(a.width_m - b.width_m)
    return max(apart) < SAME_M and angle_between(a.pose.quaternion, b.pose.quaternion) < SAME_RAD


def _is_same_region(a: Region, b: Region) -> bool:
    apart = max(distance(a.position, b.position), distance(a.half_size, b.half_size))
    return apart < SAME_M and angle_between(a.quaternion, b.quaternion) < SAME_RAD


_OTHER_CURE = "Import it with the same options as in the review (name, size_m, up), or review it again"


def _other(where: str, what: str, found: str, here: str) -> InvalidInputError:
    """Return the error for a change that was recorded for a different state of the object."""
    return InvalidInputError(where, f"its {what} was {found} in the review, but is {here} here", _OTHER_CURE)


def _quaternion(q: Quaternion) -> str:
    return "(" + ", ".join(f"{v:.4g}" for v in q) + ")"
