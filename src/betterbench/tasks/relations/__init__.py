"""Relations between an object and a target, with one file each, and the predicates for rest, posture and release.

Relations read only world states, so that live and offline verdicts use the same code. New files in this folder are
found automatically.
"""

import importlib
import pkgutil
from pathlib import Path

from betterbench.errors import errors_explained
from betterbench.tasks.relations.relation import RELATIONS, PlaceGoal, Relation, is_at, relation
from betterbench.tasks.relations.released import released
from betterbench.tasks.relations.rest import RestWatch, arm_still, lies_on_side, on_floor, upright

for _module in pkgutil.iter_modules(__path__):
    with errors_explained(str(Path(__path__[0]) / f"{_module.name}.py")):
        importlib.import_module(f"{__name__}.{_module.name}")

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
