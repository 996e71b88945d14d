"""Meshes as read from files, before any processing: positions, triangles, colors and textures of each part."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

Rgba = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class RawPart:
    """One surface of an object, in the frame and the unit of the file.

    Attributes:
        vertices: (n, 3) float64 positions.
        faces: (m, 3) int64 vertex indices.
        rgba: Color with components in [0, 1]. If there is an image, the image is multiplied by this color.
        image: (height, width, 3) uint8 RGB texture, or None.
        uv: (n, 2) float64 texture coordinates with the origin at the lower left, or None.
        colors: (n, 3) float64 color of each vertex in [0, 1], or None.
    """

    name: str
    vertices: np.ndarray
    faces: np.ndarray
    rgba: Rgba = (0.8, 0.8, 0.8, 1.0)
    image: np.ndarray | None = None
    uv: np.ndarray | None = None
    colors: np.ndarray | None = None

    def moved(self, transform: np.ndarray) -> RawPart:
        """Return the part after a (4, 4) transform. Its triangles face outward even after a reflection."""
        vertices = self.vertices @ transform[:3, :3].T + transform[:3, 3]
        faces = self.faces[:, ::-1] if np.linalg.det(transform[:3, :3]) < 0.0 else self.faces
        return RawPart(self.name, vertices, np.ascontiguousarray(faces), self.rgba, self.image, self.uv, self.colors)

    def is_plain(self) -> bool:
        """Return whether the part has the same color everywhere."""
        return self.image is None and self.colors is None

    def colors_at(self, faces: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """Return the colors of points on the surface as a (k, 3) array in [0, 1].

        Args:
            faces: (k,) index of the triangle that each point lies on.
            weights: (k, 3) barycentric coordinates of each point in its triangle.
        """
        base = np.tile(np.asarray(self.rgba[:3]), (len(faces), 1))
        corners = self.faces[faces]
        if self.colors is not None:
            base = base * np.einsum("kc,kcd->kd", weights, self.colors[corners])
        if self.image is not None and self.uv is not None:
            at = np.einsum("kc,kcd->kd", weights, self.uv[corners])
            height, width = self.image.shape[:2]
            # Textures repeat outside [0, 1] in glTF and OBJ.
            column = np.clip((np.mod(at[:, 0], 1.0) * width).astype(int), 0, width - 1)
            row = np.clip(((1.0 - np.mod(at[:, 1], 1.0)) * height).astype(int), 0, height - 1)
            base = base * (self.image[row, column] / 255.0)
        return base


@dataclass(frozen=True, slots=True, eq=False)
class Stated:
    """Physical properties of an object stated in a URDF or MJCF file, in the frame and the unit of the mesh.

    Attributes:
        mass_kg: Mass, or None if the file does not state it.
        center: (3,) float64 center of mass.
        inertia: (3, 3) float64 inertia tensor about the center of mass [kg unit^2].
        hulls: Points (n, 3) of each collision shape. The shape is the convex hull of the points. Empty if there are no
            collision shapes.
        name: Name of the model. Empty if the model has no name.
        notes: What the reader decided about the file.
    """

    mass_kg: float | None = None
    center: np.ndarray | None = None
    inertia: np.ndarray | None = None
    hulls: tuple[np.ndarray, ...] = ()
    name: str = ""
    notes: tuple[str, ...] = ()

    def moved(self, transform: np.ndarray) -> Stated:
        """Return the properties after a (4, 4) transform made of a rotation, a uniform scale and a translation."""
        linear, shift = transform[:3, :3], transform[:3, 3]
        center = None if self.center is None else linear @ self.center + shift
        inertia = None if self.inertia is None else linear @ self.inertia @ linear.T
        hulls = tuple(points @ linear.T + shift for points in self.hulls)
        return replace(self, center=center, inertia=inertia, hulls=hulls)


@dataclass(frozen=True, slots=True, eq=False)
class RawMesh:
    """All surfaces of one object, as read from its file.

    Attributes:
        up: Axis that points up according to the file format. None if the format does not define one.
        unit_m: Length of one unit [m] according to the file format. None if the format does not define it.
        stated: Physical properties stated in a URDF or MJCF file. None for a file that contains only a mesh.
    """

    parts: tuple[RawPart, ...]
    up: Literal["y", "z"] | None
    unit_m: float | None
    stated: Stated | None = None

    @property
    def face_count(self) -> int:
        """Total number of triangles."""
        return sum(len(part.faces) for part in self.parts)

    def moved(self, transform: np.ndarray) -> RawMesh:
        """Return the mesh, with its stated properties, after a (4, 4) transform."""
        stated = None if self.stated is None else self.stated.moved(transform)
        return RawMesh(tuple(part.moved(transform) for part in self.parts), self.up, self.unit_m, stated)

    def bounds(self) -> np.ndarray:
        """Return the lowest and the highest corner of the bounding box as a (2, 3) array."""
        points = np.concatenate([part.vertices[np.unique(part.faces)] for part in self.parts])
        return np.stack([points.min(axis=0), points.max(axis=0)])

    def surface(self) -> tuple[np.ndarray, np.ndarray]:
        """Return all parts as one surface with (n, 3) vertices, without duplicates, and (m, 3) faces."""
        return joined(self.parts)


def joined(parts: Sequence[RawPart]) -> tuple[np.ndarray, np.ndarray]:
    """Join parts into one surface of (n, 3) vertices and (m, 3) faces.

    Duplicate vertices and degenerate triangles are removed.
    """
    points = np.concatenate([part.vertices for part in parts])
    starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    faces = np.concatenate([part.faces + start for part, start in zip(parts, starts, strict=False)])
    # Vertices closer than a millionth of the size are the same vertex with different texture coordinates or normals.
    step = max(float(np.ptp(points, axis=0).max()), 1e-12) * 1e-6
    _, first, which = np.unique(np.round(points / step), axis=0, return_index=True, return_inverse=True)
    faces = which.ravel()[faces]
    a, b, c = faces.T
    return points[first], faces[(a != b) & (b != c) & (c != a)]
