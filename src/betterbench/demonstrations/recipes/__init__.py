"""Fine-tuning recipes: configuration files and commands that train openpi, GR00T, Being-H and LeRobot policies."""

from betterbench.demonstrations.recipes.recipe import Framework, Recipe, Setting, recipe_of
from betterbench.demonstrations.recipes.trainer import TrainerSetup
from betterbench.demonstrations.recipes.write import setup_files, trainer_setup, write_setup

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
