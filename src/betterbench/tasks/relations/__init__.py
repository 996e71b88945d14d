"""Relations between an object and a target, with one file each, and the predicates for rest, posture and release.

Relations read only world states, so that live and offline verdicts use the same code. New files in this folder are
found automatically.
"""

from betterbench.errors import import_registering
from betterbench.tasks.relations.relation import (
    RELATIONS,
    PlaceGoal,
    Relation,
    is_at,
    places_of_relations,
    relation,
)
from betterbench.tasks.relations.released import released
from betterbench.tasks.relations.rest import RestWatch, arm_still, lies_on_side, on_floor, upright

import_registering(
    __name__,
    __path__[0],
    places_of_relations,
    "Pass the relation to register",
    shared=("authoring", "loose", "placing", "relation", "released", "rest"),
)

__all__ = [
    "RELATIONS",
    "PlaceGoal",
    "Relation",
    "RestWatch",
    "arm_still",
    "is_at",
    "lies_on_side",
    "on_floor",
    "relation",
    "released",
    "upright",
]
