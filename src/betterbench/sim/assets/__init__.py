"""Three-dimensional objects ready for simulation, from parametric generators and other sources.

- ``asset``: the frozen description of one object: visual parts, collision parts, mass, grasps, regions.
- ``authoring``: meshes, solids, paint and the registry, with which generators are written.
- ``procedural``: the generators, one file per category.
"""

from betterbench.sim.assets import procedural  # noqa: F401  (imported for what it registers)
from betterbench.sim.assets.asset import Asset, CollisionPart, Grasp, Texture, VisualPart
from betterbench.sim.assets.authoring.registry import build, categories, colors, family_of, looks, unseen_looks

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
