"""The constraint templates of the suite."""

from betterbench.tasks.templates.constrained_positioning import CONSTRAINED_POSITIONING
from betterbench.tasks.templates.container_loading import CONTAINER_LOADING
from betterbench.tasks.templates.logical_assembly import LOGICAL_ASSEMBLY
from betterbench.tasks.templates.loose_packing import LOOSE_PACKING
from betterbench.tasks.templates.patterned_arrangement import PATTERNED_ARRANGEMENT
from betterbench.tasks.templates.precision_insertion import PRECISION_INSERTION
from betterbench.tasks.templates.recursive_stacking import RECURSIVE_STACKING

TEMPLATES = {
    t.name: t
    for t in (
        PATTERNED_ARRANGEMENT,
        LOOSE_PACKING,
        CONSTRAINED_POSITIONING,
        CONTAINER_LOADING,
        LOGICAL_ASSEMBLY,
        PRECISION_INSERTION,
        RECURSIVE_STACKING,
    )
}

__all__ = [
    "CONSTRAINED_POSITIONING",
    "CONTAINER_LOADING",
    "LOGICAL_ASSEMBLY",
    "LOOSE_PACKING",
    "PATTERNED_ARRANGEMENT",
    "PRECISION_INSERTION",
    "RECURSIVE_STACKING",
    "TEMPLATES",
]
