"""Import of mesh, URDF and MJCF files as assets.

- ``raw``, ``object_file``: one object from a file of any format. ``mesh_file`` reads GLB, glTF, OBJ, STL and PLY with
  the files that they refer to, ``plain_gltf`` rewrites features of glTF that trimesh drops, ``urdf`` and ``mjcf`` read
  rigid bodies (``rigid``).
- ``kinds``: usual size, mass and use of each kind of object. The name determines the kind.
- ``upright``: unit, up axis and origin.
- ``solid``, ``cavity``: occupied volume, hollow, and level surfaces.
- ``appearance``, ``coloring``, ``hulls``, ``grasping``: visual shape, color word, collision shape, grasps.
- ``physics``: mass and collision shapes stated in a file, if they fit the visual shape.
- ``importer``: the complete import, which returns an asset draft. ``stored`` is its file format.
- ``child``: the import in a resource-limited process, with a cache.
- ``registration``: registration of a mesh as a category that tasks can name.
"""

from betterbench.sim.assets.importing.registration import imported

__all__ = ["imported"]
