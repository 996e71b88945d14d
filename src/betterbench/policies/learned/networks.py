"""Creation of a learner's network from a training recipe."""

from __future__ import annotations

from torch import Tensor
from torch.nn.parameter import UninitializedTensorMixin

from betterbench.errors import InvalidInputError
from betterbench.policies.learned.families import learner_family
from betterbench.policies.learned.network import LearnerNetwork, ObjectsNetwork
from betterbench.policies.learned.pixels import PixelsNetwork
from betterbench.policies.learned.recipe import TrainingRecipe
from betterbench.policies.learned.vocabulary import Vocabulary

_OWN: dict[str, type[LearnerNetwork]] = {"objects": ObjectsNetwork, "pixels": PixelsNetwork}


def new_network(recipe: TrainingRecipe, vocabulary: Vocabulary) -> LearnerNetwork:
    """Create the network that a recipe describes. The weights are drawn from torch's global random generator.

    Raises:
        InvalidInputError: If the code in a user's file does not create a usable network.
    """
    network = (learner_family(recipe.family).make or _OWN[recipe.family])(recipe, vocabulary)
    where = f"learner {recipe.family!r}"
    if not isinstance(network, LearnerNetwork):
        raise InvalidInputError(
            where, f"expected a LearnerNetwork, got {type(network).__name__}", "Derive the class from LearnerNetwork"
        )
    first: dict[int, str] = {}
    for name, tensor in network.state_dict().items():
        if not isinstance(tensor, Tensor):
            raise InvalidInputError(
                where, f"the saved state {name} is not a tensor", "Store this state as a buffer or an option"
            )
        if isinstance(tensor, UninitializedTensorMixin):
            raise InvalidInputError(where, f"the shape of {name} is unknown", "Do not use lazy modules")
        if not tensor.numel():
            continue
        if (other := first.setdefault(tensor.data_ptr(), name)) != name:
            raise InvalidInputError(
                where, f"the weights {other} and {name} are the same tensor", "Register the tensor under one name"
            )
    missing = next((part for part in recipe.frozen if part not in network.parts()), None)
    if missing is not None:
        raise InvalidInputError(
            where,
            f"the network has no part {missing!r}, which the recipe freezes",
            "Correct the parts of the network, or the recipe",
        )
    return network
