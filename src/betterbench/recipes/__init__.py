"""Recipes of fine-tuning as ready configurations and commands of openpi, GR00T, Being-H and LeRobot."""

from betterbench.recipes.recipe import Framework, Recipe, Setting, recipe_of
from betterbench.recipes.trainer import TrainerSetup
from betterbench.recipes.write import setup_files, trainer_setup, write_setup

__all__ = [
    "Framework",
    "Recipe",
    "Setting",
    "TrainerSetup",
    "recipe_of",
    "setup_files",
    "trainer_setup",
    "write_setup",
]
