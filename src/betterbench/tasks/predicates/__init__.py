"""Predicates on one privileged state. They read states only, so live and offline verdicts are the same code.

Each relation has the signature ``relation(state, object_name, target_name) -> bool``.
"""

from collections.abc import Callable

from betterbench.errors import UnknownNameError
from betterbench.state import WorldState
from betterbench.tasks.predicates.inside import inside
from betterbench.tasks.predicates.on_ring import on_ring
from betterbench.tasks.predicates.released import released
from betterbench.tasks.predicates.rest import arm_still, at_rest, upright

Relation = Callable[[WorldState, str, str], bool]

RELATIONS: dict[str, Relation] = {"inside": inside, "on_ring": on_ring}


def relation(name: str) -> Relation:
    """Return a relation by name.

    Raises:
        UnknownNameError: If there is no such relation.
    """
    try:
        return RELATIONS[name]
    except KeyError:
        raise UnknownNameError("relation", name, RELATIONS) from None


__all__ = ["RELATIONS", "Relation", "arm_still", "at_rest", "inside", "on_ring", "relation", "released", "upright"]
