"""Class ``Asset``, which describes one 3-D object for scenes, experts and predicates."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from betterbench.errors import find_named
from betterbench.geometry import IDENTITY_QUATERNION, Pose, Quaternion, Vector
from betterbench.interface.state import Region

LIBRARY_SOURCE = "betterbench procedural library"
LIBRARY_LICENSE = "Apache-2.0"
"""License of this project, which also covers generated assets."""

CollisionShape = Literal["box", "cylinder", "capsule", "sphere", "ellipsoid", "hull"]


@dataclass(frozen=True, slots=True, eq=False)
class Texture:
    """Texture image of a visual part.

    Attributes:
        pixels: (height, width, 3) uint8 RGB, at most 1024 pixels on each side.
        uv: (n_vertices, 2) float32 texture coordinates, with the origin at the lower left.
        corners: (n_faces, 3) int32 index into ``uv`` for each corner of each face. If None, ``uv`` has one row per
            vertex.
    """

    pixels: np.ndarray
    uv: np.ndarray
    corners: np.ndarray | None = None


@dataclass(frozen=True, slots=True, eq=False)
class VisualPart:
    """Colored mesh of an asset.

    Attributes:
        vertices: (n, 3) float32 positions in the object's frame [m].
        faces: (m, 3) int32 vertex indices, counterclockwise when seen from outside.
        rgba: Red, green, blue and opacity in [0, 1]. If there is a texture, it is multiplied by this color.
        specular: Strength of highlights in [0, 1].
        shininess: Sharpness of highlights in [0, 1].
        smooth: Whether normals are averaged across faces, as for round objects. If False, all edges are sharp.
    """

    name: str
    vertices: np.ndarray
    faces: np.ndarray
    rgba: tuple[float, float, float, float]
    specular: float = 0.2
    shininess: float = 0.3
    texture: Texture | None = None
    smooth: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class CollisionPart:
    """Convex collision geometry.

    Attributes:
        shape: Type of primitive, or "hull" for the convex hull of ``vertices``.
        size: Half sizes of the primitive in MuJoCo's convention [m]: box (x, y, z); cylinder and capsule (radius, half
            length, 0); sphere (radius, 0, 0); ellipsoid (a, b, c). Ignored for a hull.
        position: Center in the object's frame [m].
        quaternion: Rotation in the object's frame (w, x, y, z).
        vertices: (n, 3) points of a hull in the object's frame [m].
        friction: Sliding, torsional [m] and rolling [m] friction coefficients.
    """

    shape: CollisionShape
    size: Vector
    position: Vector = (0.0, 0.0, 0.0)
    quaternion: Quaternion = IDENTITY_QUATERNION
    vertices: np.ndarray | None = None
    friction: Vector = (0.8, 0.01, 0.001)


@dataclass(frozen=True, slots=True)
class Grasp:
    """Grasp of an object with a parallel-jaw gripper.

    Attributes:
        name: Part that is grasped ("handle", "body", "rim").
        pose: Pose ``T_object_tcp`` of the tool center point when the gripper closes. Its z axis is the approach
            direction, and its y axis is the direction in which the fingers open.
        width_m: Thickness of the object between the finger pads [m].
        clearance_m: Free space for the open jaw on each side of the object [m].
        symmetric_yaw: Whether the grasp may be rotated freely about the vertical axis of the object.
        preference: Rank of the grasp. Grasps with lower values are tried first.
    """

    name: str
    pose: Pose
    width_m: float
    clearance_m: float = 0.012
    symmetric_yaw: bool = False
    preference: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class Asset:
    """Simulation-ready 3-D object. Its origin is the center of the bottom face of its bounding box at rest, with z up.

    Attributes:
        category: Kind of object, such as "mug".
        look: Variant number of the asset within its category.
        color: Color word.
        shape: Coarse word for the shape: "round", "cylinder", "box" or "irregular".
        description: One sentence of free text, used for retrieval.
        size_m: Extents of the bounding box [m].
        center_of_mass: Center of mass in the object's frame [m].
        inertia: Inertia about the center of mass, along the axes of the object's frame (ixx, iyy, izz, ixy, ixz, iyz)
            [kg m^2].
        visual: Colored meshes, with at most 600 faces in total (1,200 for imported objects with thin walls).
        collision: Convex collision parts, usually at most 12.
        regions: Named regions, such as opening, ring, handle and top.
        parameters: Random parameters that the generator drew. They are stored only for information.
        keeps_upright: Whether objects of this category, such as drinks, must not lie on their side in a container.
        traits: Tags that describe the material, place or use of the object but are not names for it.
    """

    category: str
    look: int
    color: str
    shape: str
    description: str
    tags: tuple[str, ...]
    size_m: Vector
    mass_kg: float
    center_of_mass: Vector
    inertia: tuple[float, float, float, float, float, float]
    visual: tuple[VisualPart, ...]
    collision: tuple[CollisionPart, ...]
    grasps: tuple[Grasp, ...] = ()
    regions: tuple[Region, ...] = ()
    source: str = LIBRARY_SOURCE
    license: str = LIBRARY_LICENSE
    parameters: Mapping[str, float | str] = field(default_factory=dict)
    keeps_upright: bool = False
    traits: tuple[str, ...] = ()

    @property
    def identity(self) -> str:
        """Name that identifies an asset by its category, color and variant number, such as "mug-red#3"."""
        return f"{self.category}-{self.color}#{self.look}"

    @property
    def face_count(self) -> int:
        """Number of triangles in all visual parts."""
        return sum(len(part.faces) for part in self.visual)

    def grasp(self, name: str) -> Grasp:
        """Return the grasp with the given name.

        Raises:
            UnknownNameError: If the asset has no such grasp.
        """
        return find_named(f"grasp of {self.category}", name, self.grasps)

    def region(self, name: str) -> Region:
        """Return the region with the given name.

        Raises:
            UnknownNameError: If the asset has no such region.
        """
        return find_named(f"region of {self.category}", name, self.regions)

    def content_hash(self) -> str:
        """Return a hash of all properties of the asset that affect physics or images (16 hexadecimal digits)."""
        digest = hashlib.sha256()
        numbers = (self.identity, self.size_m, self.mass_kg, self.center_of_mass, self.inertia, self.grasps)
        digest.update(repr(numbers).encode() + repr(self.regions).encode())
        for part in self.visual:
            digest.update(repr((part.name, part.rgba, part.specular, part.shininess, part.smooth)).encode())
            digest.update(part.vertices.tobytes() + part.faces.tobytes())
            if part.texture is not None:
                digest.update(part.texture.pixels.tobytes() + part.texture.uv.tobytes())
                if part.texture.corners is not None:
                    digest.update(part.texture.corners.tobytes())
        for shape in self.collision:
            digest.update(repr((shape.shape, shape.size, shape.position, shape.quaternion, shape.friction)).encode())
            if shape.vertices is not None:
                digest.update(shape.vertices.tobytes())
        return digest.hexdigest()[:16]


def origin_of(asset: Asset) -> tuple[str, str]:
    """Return the source and the license of an asset, for the list of assets in a record.

    Both are empty for an asset from the procedural library.
    """
    return ("", "") if asset.source == LIBRARY_SOURCE else (asset.source, asset.license)
