"""Learned policies: their inputs, networks and checkpoints.

Only :mod:`network`, :mod:`pixels`, :mod:`networks`, :mod:`checkpoint` and :mod:`policy` need torch. :mod:`loading`
imports these modules on demand.
"""

from betterbench.policies.learned.loading import is_seeing, learned_info, make_learned, make_seeing
from betterbench.policies.learned.recipe import TrainingRecipe, read_training_recipe

__all__ = [
    "TrainingRecipe",
    "is_seeing",
    "learned_info",
    "make_learned",
    "make_seeing",
    "read_training_recipe",
]
