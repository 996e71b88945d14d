"""Simulation-ready 3-D objects, from parametric generators and other sources.

- ``asset``: the immutable description of one object: visual parts, collision parts, mass, grasps, regions.
- ``authoring``: meshes, solids, paint and the registry, for writing generators.
- ``procedural``: the generators, one file per category.
- ``importing``: conversion of mesh, URDF and MJCF files to assets.
- ``folders``: folders of imported assets.
- ``catalogue``: a searchable catalogue of assets from several sources.
- ``licenses``, ``names``: names of licenses, and names of objects derived from file names.
- ``gltf``, ``xml_file``: checks of untrusted files.
"""

from betterbench.sim.assets import folders, procedural  # noqa: F401  (imported to register the assets)
from betterbench.sim.assets.asset import Asset, CollisionPart, Grasp, Texture, VisualPart
from betterbench.sim.assets.authoring.registry import (
    build,
    build_unpainted,
    categories,
    colors,
    family_of,
    looks,
    unseen_looks,
)

__all__ = [
    "Asset",
    "CollisionPart",
    "Grasp",
    "Texture",
    "VisualPart",
    "build",
    "build_unpainted",
    "categories",
    "colors",
    "family_of",
    "looks",
    "unseen_looks",
]
