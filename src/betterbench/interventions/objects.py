"""Interventions on what is there: replace, add and remove."""

from __future__ import annotations

from betterbench.errors import InvalidInputError
from betterbench.interventions.layout import require_free
from betterbench.interventions.operation import Changes, operation
from betterbench.tasks import Condition, ObjectSpec


@operation
def remove(condition: Condition, *, object: str) -> tuple[Condition, Changes]:  # noqa: A002 - the word of do()
    """Take an object out of the scene.

    Raises:
        UnknownNameError: If the condition has no such object.
        InvalidInputError: If something else rests at it or slides in it.
    """
    condition.object(object)
    guests = [o.name for o in condition.objects if o.mount is not None and o.mount.target == object]
    guests += [name for name, place in condition.preplaced.items() if place.target == object]
    if guests:
        raise InvalidInputError(f"{condition.id} object {object!r}", f"it holds {guests[0]}", "Remove that first")
    changed = condition.with_(
        objects=tuple(o for o in condition.objects if o.name != object),
        layout={name: slot for name, slot in condition.layout.items() if name != object},
        preplaced={name: target for name, target in condition.preplaced.items() if name != object},
        opened={name: opening for name, opening in condition.opened.items() if name != object},
    )
    return changed, Changes(frozenset({object}))


@operation
def add(condition: Condition, *, object: ObjectSpec, slot: str) -> tuple[Condition, Changes]:  # noqa: A002
    """Put a further object into a free slot.

    Raises:
        InvalidInputError: If the slot is taken or the name is in use.
    """
    require_free(condition, slot)
    if any(o.name == object.name for o in condition.objects):
        raise InvalidInputError(f"{condition.id} object {object.name!r}", "the name is in use", "Choose another name")
    changed = condition.with_(objects=(*condition.objects, object), layout={**condition.layout, object.name: slot})
    return changed, Changes(frozenset({object.name}))


@operation
def replace(condition: Condition, *, object: str, by: ObjectSpec) -> tuple[Condition, Changes]:  # noqa: A002
    """Put another object into the slot of an object that is taken away.

    Raises:
        InvalidInputError: If the object does not start in a slot.
        UnknownNameError: If the condition has no such object.
    """
    condition.object(object)
    slot = condition.layout.get(object)
    if slot is None:
        raise InvalidInputError(f"{condition.id} object {object!r}", "it starts in no slot", "Name one that does")
    removed, first = remove(condition, object=object)
    added, second = add(removed, object=by, slot=slot)
    return added, first | second
