"""Predicates on one privileged state. They read states only, so live and offline verdicts are the same code."""

from betterbench.errors import UnknownNameError
from betterbench.tasks.relations.beside import beside, sides
from betterbench.tasks.relations.closed import closed, mounts
from betterbench.tasks.relations.in_hole import holes, in_hole
from betterbench.tasks.relations.inside import inside
from betterbench.tasks.relations.layer import layer, layers
from betterbench.tasks.relations.on_plate import on_plate
from betterbench.tasks.relations.on_ring import foot, on_ring
from betterbench.tasks.relations.relation import Relation, offers, one_place
from betterbench.tasks.relations.released import released
from betterbench.tasks.relations.rest import arm_still, at_rest, upright

RELATIONS: dict[str, Relation] = {
    r.name: r
    for r in (
        Relation("inside", one_place(inside), offers("inside")),
        Relation("on_ring", one_place(on_ring), offers("ring", "spout")),
        Relation("beside", beside, sides),
        Relation("in_hole", in_hole, holes),
        Relation("layer", layer, layers),
        Relation("on_plate", one_place(on_plate), offers("floor")),
        Relation("closed", closed, mounts, roles=("drawer",)),
    )
}


def relation(name: str) -> Relation:
    """Return a relation by name.

    Raises:
        UnknownNameError: If there is no such relation.
    """
    try:
        return RELATIONS[name]
    except KeyError:
        raise UnknownNameError("relation", name, RELATIONS) from None


__all__ = [
    "RELATIONS",
    "Relation",
    "arm_still",
    "at_rest",
    "beside",
    "closed",
    "foot",
    "in_hole",
    "inside",
    "layer",
    "on_plate",
    "on_ring",
    "relation",
    "released",
    "upright",
]
