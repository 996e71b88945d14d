"""The network of each family."""

from __future__ import annotations

from betterbench.learned.network import LearnerNetwork, ObjectsNetwork
from betterbench.learned.pixels import PixelsNetwork
from betterbench.learned.recipe import FamilyName, TrainingRecipe
from betterbench.learned.vocabulary import Vocabulary

_NETWORKS: dict[FamilyName, type[LearnerNetwork]] = {"objects": ObjectsNetwork, "pixels": PixelsNetwork}


def new_network(recipe: TrainingRecipe, vocabulary: Vocabulary) -> LearnerNetwork:
    """Return the network that a recipe asks for, with random weights drawn by torch's own generator."""
    return _NETWORKS[recipe.family](recipe, vocabulary)
