"""Import of meshes: from a file that a program for three-dimensional models wrote to an asset.

- ``raw``, ``object_file``: one object of a file of any format. ``mesh_file`` reads GLB, glTF, OBJ, STL and PLY with
  what they refer to, ``urdf`` and ``mjcf`` read rigid bodies (``rigid``).
- ``kinds``: usual size, mass and use of kinds of objects, told from their names.
- ``upright``: unit, up axis and origin.
- ``solid``, ``cavity``: what is inside, what is hollow, which surfaces are level.
- ``appearance``, ``coloring``, ``hulls``, ``grasping``: what is seen, what is touched, how a gripper takes it.
- ``physics``: mass and collision shapes that a file states, as far as they fit.
- ``importer``: all of it, to the draft of an asset; ``stored`` is its form as a file.
- ``child``: the same in a limited process, with a cache.
- ``registration``: the category that a task names.
"""

from betterbench.sim.assets.importing.registration import imported

__all__ = ["imported"]
