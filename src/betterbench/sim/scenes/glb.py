"""Export of a compiled scene as binary glTF, one file per body, for viewers other than MuJoCo.

Each file is in the frame of its body, in meters and with z up. It contains one mesh per material: the visible shapes
with their colors, and the textures of the model as PNG. The format is glTF 2.0 (Khronos), written by trimesh.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np
from PIL import Image

FLOOR_HALF_M = 2.5
"""Half the side of the square that represents an infinite floor [m]."""
ROUGHNESS = 0.75
"""Roughness of all surfaces, from 0 (mirror) to 1 (chalk).

With this value, surfaces look like the matte plastic and wood of the stage.
"""

_VISIBLE_GROUPS = 2
_CORNERS = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], dtype=np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """Triangles with the same color and texture.

    The arrays are vertex positions (n, 3) [m], normals (n, 3), texture coordinates (n, 2) and the corners of each
    triangle (m, 3) as vertex indices.
    """

    positions: np.ndarray
    normals: np.ndarray
    coordinates: np.ndarray
    faces: np.ndarray

    def moved(self, position: np.ndarray, rotation: np.ndarray) -> Surface:
        """Return the triangles rotated by a matrix (3, 3) and then moved by a vector (3,) [m]."""
        turned = self.positions @ rotation.T + position
        return Surface(turned, self.normals @ rotation.T, self.coordinates, self.faces)


def body_files(model: mujoco.MjModel) -> dict[int, bytes]:
    """Return the GLB file of every body that has a visible shape, by body index."""
    looks: dict[int, dict[tuple[float, ...], list[Surface]]] = {}
    for geom in range(model.ngeom):
        color, texture = _look(model, geom)
        if model.geom_group[geom] > _VISIBLE_GROUPS or color[3] <= 0.0:
            continue
        surface = surface_in_body(model, geom)
        looks.setdefault(int(model.geom_bodyid[geom]), {}).setdefault((*color, texture), []).append(surface)
    return {body: _file(model, surfaces) for body, surfaces in looks.items()}


def surface_in_body(model: mujoco.MjModel, geom: int) -> Surface:
    """Return the surface of a geom in the frame of its body.

    Primitives and planes are converted as in :func:`body_files`.
    """
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, model.geom_quat[geom])
    return _surface(model, geom).moved(model.geom_pos[geom], rotation.reshape(3, 3))


def _look(model: mujoco.MjModel, geom: int) -> tuple[tuple[float, ...], int]:
    """Return the color (r, g, b, a) and the texture index of a geom. The index is -1 if there is no texture."""
    material = int(model.geom_matid[geom])
    rgba = model.geom_rgba[geom] if material < 0 else model.mat_rgba[material]
    texture = -1 if material < 0 else int(model.mat_texid[material, int(mujoco.mjtTextureRole.mjTEXROLE_RGB)])
    return tuple(float(v) for v in rgba), texture


def _surface(model: mujoco.MjModel, geom: int) -> Surface:
    """Return the surface of a geom in its own frame. Shapes other than meshes and planes become their bounding box."""
    kind = int(model.geom_type[geom])
    if kind == int(mujoco.mjtGeom.mjGEOM_MESH):
        return _mesh(model, int(model.geom_dataid[geom]))
    if kind == int(mujoco.mjtGeom.mjGEOM_PLANE):
        sides = np.where(model.geom_size[geom, :2] > 0.0, model.geom_size[geom, :2], FLOOR_HALF_M)
        positions = np.column_stack([_CORNERS * sides, np.zeros(4)])
        faces = np.array([[0, 1, 2], [0, 2, 3]])
        return Surface(positions, np.tile([0.0, 0.0, 1.0], (4, 1)), 0.5 + 0.5 * _CORNERS, faces)
    return _box(model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:])


def _box(center: np.ndarray, half: np.ndarray) -> Surface:
    parts: list[Surface] = []
    for axis in range(3):
        across, along = (axis + 1) % 3, (axis + 2) % 3
        for side in (-1.0, 1.0):
            corners = np.zeros((4, 3))
            corners[:, axis] = side
            corners[:, across], corners[:, along] = _CORNERS[:, 0] * side, _CORNERS[:, 1]
            normals = np.zeros((4, 3))
            normals[:, axis] = side
            uv = 0.5 + 0.5 * corners[:, :2]
            parts.append(Surface(center + corners * half, normals, uv, np.array([[0, 1, 2], [0, 2, 3]])))
    return _joined(parts)


def _mesh(model: mujoco.MjModel, mesh: int) -> Surface:
    """Return a mesh with a separate vertex for each combination of position, normal and texture coordinate.

    glTF requires such meshes.
    """

    def rows(array: np.ndarray, address: np.ndarray, number: np.ndarray) -> np.ndarray:
        first = int(address[mesh])
        return np.asarray(array[first : first + int(number[mesh])])

    faces = rows(model.mesh_face, model.mesh_faceadr, model.mesh_facenum)
    normals = rows(model.mesh_facenormal, model.mesh_faceadr, model.mesh_facenum)
    has_coordinates = int(model.mesh_texcoordadr[mesh]) >= 0
    coordinates = rows(model.mesh_facetexcoord, model.mesh_faceadr, model.mesh_facenum)
    corners = np.stack([faces, normals, coordinates if has_coordinates else np.zeros_like(faces)], axis=-1)
    known, index = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    uv = np.zeros((len(known), 2))
    if has_coordinates:
        uv = rows(model.mesh_texcoord, model.mesh_texcoordadr, model.mesh_texcoordnum)[known[:, 2]]
    return Surface(
        rows(model.mesh_vert, model.mesh_vertadr, model.mesh_vertnum)[known[:, 0]].astype(np.float64),
        rows(model.mesh_normal, model.mesh_normaladr, model.mesh_normalnum)[known[:, 1]].astype(np.float64),
        uv,
        index.reshape(-1, 3),
    )


def _joined(parts: list[Surface]) -> Surface:
    starts = np.cumsum([0, *(len(p.positions) for p in parts)])
    return Surface(
        np.concatenate([p.positions for p in parts]),
        np.concatenate([p.normals for p in parts]),
        np.concatenate([p.coordinates for p in parts]),
        np.concatenate([p.faces + start for p, start in zip(parts, starts[:-1], strict=True)]),
    )


def _file(model: mujoco.MjModel, looks: Mapping[tuple[float, ...], list[Surface]]) -> bytes:
    """Return the GLB file for the given surfaces, which are keyed by color and texture."""
    import trimesh  # noqa: PLC0415 - takes 0.6 s, which only a viewer needs

    scene = trimesh.Scene()
    for (*color, texture), surfaces in looks.items():
        surface = _joined(surfaces)
        material = trimesh.visual.material.PBRMaterial(  # type: ignore[no-untyped-call]
            baseColorFactor=[*(_linear(v) for v in color[:3]), color[3]],
            baseColorTexture=_image(model, int(texture)) if texture >= 0 else None,
            metallicFactor=0.0,
            roughnessFactor=ROUGHNESS,
            alphaMode=None if color[3] >= 1.0 else "BLEND",
        )
        # trimesh measures v from the lower edge of the image, whereas MuJoCo and glTF measure it from the upper edge.
        uv = surface.coordinates * (1.0, -1.0) + (0.0, 1.0)
        mesh = trimesh.Trimesh(
            surface.positions,
            surface.faces,
            vertex_normals=surface.normals,
            visual=trimesh.visual.TextureVisuals(uv=uv, material=material),  # type: ignore[no-untyped-call]
            process=False,
        )
        scene.add_geometry(mesh, geom_name=str(len(scene.geometry)))
    data: bytes = trimesh.exchange.gltf.export_glb(scene, include_normals=True)  # type: ignore[no-untyped-call]
    return data


def _linear(value: float) -> float:
    """Convert a color component from sRGB to linear (IEC 61966-2-1), because color factors in glTF are linear."""
    return value / 12.92 if value <= 0.04045 else float(((value + 0.055) / 1.055) ** 2.4)


def _image(model: mujoco.MjModel, texture: int) -> Image.Image:
    first, channels = int(model.tex_adr[texture]), int(model.tex_nchannel[texture])
    height, width = int(model.tex_height[texture]), int(model.tex_width[texture])
    pixels = model.tex_data[first : first + height * width * channels].reshape(height, width, channels)
    return Image.fromarray(np.ascontiguousarray(pixels))
