"""Three-dimensional objects ready for simulation, from parametric generators and other sources."""

from betterbench.assets import procedural  # noqa: F401  (imported for what it registers)
from betterbench.assets.asset import Asset, CollisionPart, Grasp, Texture, VisualPart
from betterbench.assets.authoring.registry import build, categories, colors, family_of, looks, unseen_looks

__all__ = [
    "Asset",
    "CollisionPart",
    "Grasp",
    "Texture",
    "VisualPart",
    "build",
    "categories",
    "colors",
    "family_of",
    "looks",
    "unseen_looks",
]
