"""Interventions on where things stand: swap, move and pre-place."""

from __future__ import annotations

from betterbench.errors import InvalidInputError
from betterbench.interventions.operation import Changes, operation
from betterbench.tasks import Condition, TargetRegion


@operation
def swap(condition: Condition, *, a: str, b: str) -> tuple[Condition, Changes]:
    """Let two objects exchange their slots.

    Raises:
        InvalidInputError: If one of them does not start in a slot.
    """
    layout = dict(condition.layout)
    for name in (a, b):
        _require_slot(condition, name)
    layout[a], layout[b] = layout[b], layout[a]
    return condition.with_(layout=layout), Changes(frozenset({a, b}))


@operation
def move(condition: Condition, *, object: str, slot: str) -> tuple[Condition, Changes]:  # noqa: A002 - the word of do()
    """Put an object into another, free slot.

    Raises:
        InvalidInputError: If the slot is taken or the object does not start in one.
    """
    _require_slot(condition, object)
    require_free(condition, slot)
    return condition.with_(layout={**condition.layout, object: slot}), Changes(frozenset({object}))


@operation
def preplace(condition: Condition, *, object: str, target: str, at: str = "") -> tuple[Condition, Changes]:  # noqa: A002
    """Let an object rest at its target from the start; ``at`` names the place where the target offers several.

    Raises:
        InvalidInputError: If the object does not start in a slot.
        UnknownNameError: If the target is no object of the condition.
    """
    _require_slot(condition, object)
    condition.object(target)
    layout = {name: slot for name, slot in condition.layout.items() if name != object}
    changed = condition.with_(layout=layout, preplaced={**condition.preplaced, object: TargetRegion(target, at)})
    return changed, Changes(frozenset({object}))


@operation
def draw_out(condition: Condition, *, drawer: str, distance_m: float) -> tuple[Condition, Changes]:
    """Let a drawer stand open by ``distance_m`` at the start; 0 shuts it.

    Raises:
        UnknownNameError: If the condition has no such object.
        InvalidInputError: If it is no drawer, or the distance is negative.
    """
    if condition.object(drawer).mount is None:
        raise InvalidInputError(f"{condition.id} object {drawer!r}", "it is no drawer", "Name one that has a mount")
    if not distance_m >= 0.0:
        raise InvalidInputError(f"{condition.id} distance_m", f"{distance_m} m", "Give 0 or more; 0 shuts the drawer")
    return condition.with_(opened={**condition.opened, drawer: distance_m}), Changes(frozenset({drawer}))


def require_free(condition: Condition, slot: str) -> None:
    """Check that nothing starts in a slot.

    Raises:
        InvalidInputError: If something does.
    """
    occupant = condition.occupant(slot)
    if occupant is not None:
        raise InvalidInputError(
            f"{condition.id} slot {slot!r}", f"{occupant} already stands there", "Remove or move it first"
        )


def _require_slot(condition: Condition, name: str) -> None:
    condition.object(name)
    if name not in condition.layout:
        raise InvalidInputError(f"{condition.id} object {name!r}", "it starts in no slot", "Name one that does")
