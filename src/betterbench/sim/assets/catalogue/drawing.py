"""Preview images of mesh files, drawn from surface points without a simulator or graphics library.

Meshes are loaded with trimesh. A file that a mesh refers to is only read if it is in the mesh's folder.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from betterbench.errors import InvalidInputError
from betterbench.json_form import read_bounded

MAX_BYTES = 64 << 20
"""Maximum size of a mesh file that is drawn, and of each file that it refers to [byte]."""
MAX_FACES = 400_000
"""Maximum number of triangles that are drawn."""
_POINTS = 400_000
_GROUND = np.array([0.80, 0.76, 0.70])
_GRAY = np.array([0.62, 0.62, 0.64])
_LIGHT = np.array([0.45, -0.35, 0.82])
"""Direction toward the light in the image frame: x toward the viewer, z up."""


class _SameFolder(trimesh.resolvers.Resolver):
    """Resolver for files that a mesh refers to. It only reads files in the mesh's folder and its subfolders."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder.resolve()

    def get(self, name: str) -> bytes:
        """Return the content of a file that the mesh refers to."""
        path = (self._folder / name).resolve() if "\0" not in name else self._folder
        if not path.is_relative_to(self._folder):
            raise ValueError(f"{name!r} is outside the folder of the mesh")
        return read_bounded(path, max_bytes=MAX_BYTES, cure="Repair the mesh")

    def keys(self) -> list[str]:
        """Return an empty list. trimesh asks for the names of all files, but listing the folder is not supported."""
        return []

    def namespaced(self, namespace: str) -> _SameFolder:
        """Return a resolver for a subfolder."""
        return _SameFolder(self._folder / namespace)

    def write(self, name: str, data: object) -> None:
        """Raise an error, because a preview must not write files."""
        raise ValueError(f"a preview must not write files, but trimesh tried to write {name!r} ({type(data).__name__})")


def mesh_picture(path: Path, *, pixels: int) -> np.ndarray:
    """Draw the mesh in a file, as a (pixels, pixels, 3) uint8 image.

    Raises:
        InvalidInputError: If the file is too large, damaged or empty, or if trimesh cannot read it.
    """
    data = read_bounded(path, max_bytes=MAX_BYTES, cure="Use a smaller mesh")
    try:
        kind = path.suffix.lower().removeprefix(".")
        loaded: Any = trimesh.load_scene(io.BytesIO(data), file_type=kind, resolver=_SameFolder(path.parent))
        points, normals, colors = _surface(loaded.dump())
    except Exception as error:  # mesh readers may raise any exception for damaged files
        raise InvalidInputError(
            str(path), f"it cannot be drawn ({error})", "Check the file in a mesh editor"
        ) from error
    if kind in ("glb", "gltf"):
        points, normals = (values[:, [2, 0, 1]] for values in (points, normals))
    return _drawn(points, normals, colors, pixels)


def _surface(geometry: Sequence[object]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (n, 3) points on the surface, their (n, 3) normals, and their (n, 3) colors in [0, 1]."""
    meshes = [mesh for mesh in geometry if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces)]
    if not meshes or sum(len(mesh.faces) for mesh in meshes) > MAX_FACES:
        raise ValueError(f"the mesh has no triangles, or more than {MAX_FACES}")
    whole = sum(float(mesh.area) for mesh in meshes)
    if not np.isfinite(whole) or whole <= 0.0:
        raise ValueError("the surface of the mesh is empty or not finite")
    rng = np.random.default_rng(0)
    points, normals, colors = [], [], []
    for mesh in meshes:
        count = max(int(_POINTS * float(mesh.area) / whole), 50)
        shares = np.cumsum(mesh.area_faces)
        faces = np.searchsorted(shares, rng.random(count) * shares[-1]).clip(0, len(mesh.faces) - 1)
        first, second = rng.random((2, count, 1))
        outside = (first + second) > 1.0
        first, second = np.where(outside, 1.0 - first, first), np.where(outside, 1.0 - second, second)
        shares_of = np.concatenate([1.0 - first - second, first, second], axis=1)
        corners = mesh.faces[faces]
        points.append((mesh.vertices[corners] * shares_of[:, :, None]).sum(axis=1))
        normals.append(np.asarray(mesh.face_normals)[faces])
        colors.append(_colors(mesh, faces, corners, shares_of))
    return np.concatenate(points), np.concatenate(normals), np.concatenate(colors)


def _colors(mesh: trimesh.Trimesh, faces: np.ndarray, corners: np.ndarray, shares: np.ndarray) -> np.ndarray:
    """Return the color of each point, taken from the mesh's texture, its material, or its vertex or face colors."""
    visual: Any = mesh.visual
    material = getattr(visual, "material", None)
    uv = getattr(visual, "uv", None)
    image = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
    if uv is not None and image is not None and len(uv) == len(mesh.vertices):
        pixels = np.asarray(image.convert("RGB"), float) / 255.0
        at = (np.asarray(uv)[corners] * shares[:, :, None]).sum(axis=1) % 1.0
        rows = ((1.0 - at[:, 1]) * (pixels.shape[0] - 1)).astype(int)
        columns = (at[:, 0] * (pixels.shape[1] - 1)).astype(int)
        return np.asarray(pixels[rows, columns])
    if material is not None:
        plain = getattr(material, "baseColorFactor", None)
        plain = getattr(material, "diffuse", None) if plain is None else plain
        if plain is not None:
            return np.tile(np.asarray(plain, float)[:3] / 255.0, (len(faces), 1))
    if getattr(visual, "kind", None) in ("vertex", "face"):
        return np.asarray(visual.face_colors, float)[faces, :3] / 255.0
    return np.tile(_GRAY, (len(faces), 1))


def _drawn(points: np.ndarray, normals: np.ndarray, colors: np.ndarray, pixels: int) -> np.ndarray:
    """Draw shaded points, seen from the front and above, on a plain background."""
    middle = (points.min(axis=0) + points.max(axis=0)) / 2.0
    half = float(np.linalg.norm(np.ptp(points, axis=0))) / 2.0
    if not np.isfinite(half) or half <= 0.0:
        half = 1.0
    turn, down = np.radians(-25.0), np.radians(30.0)
    back = np.array([np.cos(down) * np.cos(turn), np.cos(down) * np.sin(turn), np.sin(down)])
    right = np.array([-np.sin(turn), np.cos(turn), 0.0])
    up = np.cross(back, right)
    placed = (points - middle) / half
    depth = placed @ back
    side = 2 * pixels  # draw at twice the size and average, for antialiasing
    scale = 0.44 * side
    columns = np.rint(side / 2.0 + scale * (placed @ right)).astype(int)
    rows = np.rint(side / 2.0 - scale * (placed @ up)).astype(int)
    facing = np.where((normals @ back)[:, None] < 0.0, -normals, normals)
    shade = 0.55 + 0.5 * np.clip(facing @ (_LIGHT / np.linalg.norm(_LIGHT)), 0.0, 1.0)
    lit = np.clip(colors * shade[:, None], 0.0, 1.0)
    order = np.argsort(depth, kind="stable")  # write the nearest point of each pixel last
    rows, columns, lit = rows[order], columns[order], np.concatenate([lit[order], _GROUND[None]])
    shown = np.full(side * side, len(order), dtype=np.int32)  # index of the point that each pixel shows
    numbers = np.arange(len(order), dtype=np.int32)
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            shown[(rows + dy).clip(0, side - 1) * side + (columns + dx).clip(0, side - 1)] = numbers
    image = lit[shown]
    small = image.reshape(pixels, 2, pixels, 2, 3).mean(axis=(1, 3))
    return np.asarray(np.rint(255.0 * small), np.uint8)
