"""Small recipes, and what they can be wrong about."""

from __future__ import annotations

from betterbench.policies.learned import TrainingRecipe, read_training_recipe

PIXELS = {"family": "pixels", "eyes": {"views": ["front"], "size": 16}}
TINY = {"width": 16, "layers": 1, "heads": 2}


def tiny(**changes: object) -> TrainingRecipe:
    form = {
        "data": ["set"],
        "capacity": TINY,
        "chunk": 4,
        "execute": 2,
        "steps": 12,
        "batch": 8,
        "warmup": 2,
        "validate_every": 6,
        "save_every": 4,
        "rollouts": 0,
    }
    return read_training_recipe({**form, **changes})
