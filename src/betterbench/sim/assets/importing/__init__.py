"""Import of mesh, URDF and MJCF files as assets.

- ``raw``, ``object_file``: read one object from a file of any supported format. ``mesh_file`` reads GLB, glTF, OBJ, STL
  and PLY files and the files that they refer to. ``plain_gltf`` rewrites features of glTF that trimesh would drop.
  ``urdf`` and ``mjcf`` read rigid bodies (``rigid``).
- ``kinds``: the usual size, mass and use of each kind of object. The name of an object determines its kind.
- ``upright``: find the unit, the up axis and the origin of a mesh.
- ``solid``, ``cavity``: find the volume that an object occupies, its hollow, and its level surfaces.
- ``appearance``, ``coloring``, ``hulls``, ``grasping``: make the visual shape, the color word, the collision shape and
  the grasps.
- ``physics``: use the mass and the collision shapes that a file states, if they fit the visual shape.
- ``importer``: run the complete import and return a draft of the asset. ``stored`` defines the file format of an
  imported object.
- ``child``: run the import in a process with limited time and memory, and cache the result.
- ``registration``: register a mesh as a category that tasks can name.
"""

from typing import TYPE_CHECKING

from betterbench.lazy_names import lazy_names

__all__ = ["imported"]

if TYPE_CHECKING:
    from betterbench.sim.assets.importing.registration import imported
else:
    __getattr__ = lazy_names(__name__, {"registration": ["imported"]})
