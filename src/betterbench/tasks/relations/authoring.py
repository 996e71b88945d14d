"""Names that the file of a new relation can import. See docs/adding-a-relation.md."""

from betterbench.interface.state import ObjectInfo, Region, WorldState
from betterbench.tasks.relations.loose import held_upon, reaches_into, rests_on
from betterbench.tasks.relations.placing import foot, slim_opening_m, standing_goals, turned_by
from betterbench.tasks.relations.relation import (
    RELATIONS,
    PlaceGoal,
    Relation,
    offers,
    offers_each,
    register,
    relation,
    single,
    surface_of,
)
from betterbench.tasks.thresholds import THRESHOLDS, threshold

__all__ = [
    "RELATIONS",
    "THRESHOLDS",
    "ObjectInfo",
    "PlaceGoal",
    "Region",
    "Relation",
    "WorldState",
    "foot",
    "held_upon",
    "offers",
    "offers_each",
    "reaches_into",
    "register",
    "relation",
    "rests_on",
    "single",
    "slim_opening_m",
    "standing_goals",
    "surface_of",
    "threshold",
    "turned_by",
]
