"""Roles of the objects in a cast (a scenario with chosen assets), and the look-alikes of these objects."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping
from dataclasses import replace

from betterbench.errors import InvalidInputError
from betterbench.generation.cast import Cast
from betterbench.generation.measures import assets_of
from betterbench.sim.assets import colors
from betterbench.tasks.condition import ObjectSpec, Role

BYSTANDER_M = 0.10
"""Maximum footprint of an object that is not moved [m]."""
_LONGEST_M = 0.14
"""Maximum footprint of a look-alike in a fixture slot [m]."""
_FALLBACK = "block"
"""Category of the substitute for a missing look-alike.

This category has the most colors. It resembles items only by color.
"""


def group(cast: Cast, group_id: str, role: Role, at_least: int, at_most: int) -> tuple[ObjectSpec, ...]:
    """Return the objects of a cast group, with the given role assigned to them.

    Raises:
        InvalidInputError: If the number of objects in the group is not allowed.
    """
    objects = cast.groups.get(group_id, ())
    if not at_least <= len(objects) <= at_most:
        expected = f"{at_least}" if at_least == at_most else f"{at_least} to {at_most}"
        where, names = f"cast group {group_id!r}", ", ".join(o.name for o in objects) or "none"
        raise InvalidInputError(
            where, f"has {len(objects)} objects ({names})", f"This pattern needs {expected} objects in the group"
        )
    return tuple(replace(spec, role=role) for spec in objects)


def in_role(role: Role, objects: Iterable[ObjectSpec]) -> tuple[ObjectSpec, ...]:
    """Return copies of objects with the given role."""
    return tuple(replace(spec, role=role) for spec in objects)


def second(cast: Cast, spec: ObjectSpec) -> ObjectSpec:
    """Return a second instance of an object, with a name that the cast does not use yet."""
    taken = {o.name for objects in (*cast.groups.values(), *cast.look_alikes.values()) for o in objects}
    return replace(spec, name=next(n for i in itertools.count(2) if (n := f"{spec.name}_{i}") not in taken))


def look_alikes_of(cast: Cast, spec: ObjectSpec) -> tuple[ObjectSpec, ...]:
    """Return the look-alikes of an object, starting with the most similar one.

    The returned objects have the role of distractors.
    """
    return in_role("distractor", cast.look_alikes.get(spec.name, ()))


def standing_look_alikes(cast: Cast, items: tuple[ObjectSpec, ...]) -> Mapping[str, ObjectSpec]:
    """Return a look-alike distractor for each item, by the name of the item.

    The distractor is the first look-alike in the cast (the scenario with its chosen assets) that is narrow enough for a
    slot. If there is none, a toy block of the item's color is used, unless the cast already contains a block. An item
    is left out if it has neither a look-alike nor a block.
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
    return length <= _LONGEST_M


def _block_like(item: ObjectSpec, taken: set[str]) -> ObjectSpec | None:
    color = item.color or colors(item.category)[0]
    name = f"{color}_toy_block"
    if color not in colors(_FALLBACK) or name in taken:
        return None
    return ObjectSpec(name, f"{color} toy block", _FALLBACK, color, role="distractor")
