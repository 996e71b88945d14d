"""A compiled scene as binary glTF, one file per body, for viewers that are not MuJoCo.

The frame of a file is that of its body, in meters and with z up. A file holds one mesh with one primitive per material:
the visible shapes in their colors, with the textures of the model as PNG inside. The format is glTF 2.0 (Khronos).
"""

from __future__ import annotations

import io
import json
import struct
from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np
from PIL import Image

FLOOR_HALF_M = 2.5
"""Half the side of the square that stands for an endless floor [m]."""
ROUGHNESS = 0.75
"""Roughness of all surfaces (0 mirror, 1 chalk): the matt plastic and wood of the stage."""

_FLOAT, _UINT, _ARRAY, _ELEMENTS, _LINEAR, _REPEAT = 5126, 5125, 34962, 34963, 9729, 10497
_VISIBLE_GROUPS = 2
_CORNERS = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], dtype=np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class _Surface:
    """Triangles of one look: (n, 3) positions [m] and normals, (n, 2) texture coordinates, (m, 3) corners."""

    positions: np.ndarray
    normals: np.ndarray
    coordinates: np.ndarray
    faces: np.ndarray

    def moved(self, position: np.ndarray, rotation: np.ndarray) -> _Surface:
        """Return it in the frame of the body: turned by (3, 3), then moved by (3,) [m]."""
        turned = self.positions @ rotation.T + position
        return _Surface(turned, self.normals @ rotation.T, self.coordinates, self.faces)


def body_files(model: mujoco.MjModel) -> dict[int, bytes]:
    """Return the GLB of every body that has a visible shape, by the number of the body."""
    looks: dict[int, dict[tuple[float, ...], list[_Surface]]] = {}
    for geom in range(model.ngeom):
        color, texture = _look(model, geom)
        if model.geom_group[geom] > _VISIBLE_GROUPS or color[3] <= 0.0:
            continue
        rotation = np.empty(9)
        mujoco.mju_quat2Mat(rotation, model.geom_quat[geom])
        surface = _surface(model, geom).moved(model.geom_pos[geom], rotation.reshape(3, 3))
        looks.setdefault(int(model.geom_bodyid[geom]), {}).setdefault((*color, texture), []).append(surface)
    return {body: _file(model, surfaces) for body, surfaces in looks.items()}


def _look(model: mujoco.MjModel, geom: int) -> tuple[tuple[float, ...], int]:
    """Return color (r, g, b, a) and texture of a shape, -1 without one."""
    material = int(model.geom_matid[geom])
    rgba = model.geom_rgba[geom] if material < 0 else model.mat_rgba[material]
    texture = -1 if material < 0 else int(model.mat_texid[material, int(mujoco.mjtTextureRole.mjTEXROLE_RGB)])
    return tuple(float(v) for v in rgba), texture


def _surface(model: mujoco.MjModel, geom: int) -> _Surface:
    """Return a shape in its own frame; what is neither mesh nor plane is drawn as its bounding box."""
    kind = int(model.geom_type[geom])
    if kind == int(mujoco.mjtGeom.mjGEOM_MESH):
        return _mesh(model, int(model.geom_dataid[geom]))
    if kind == int(mujoco.mjtGeom.mjGEOM_PLANE):
        sides = np.where(model.geom_size[geom, :2] > 0.0, model.geom_size[geom, :2], FLOOR_HALF_M)
        positions = np.column_stack([_CORNERS * sides, np.zeros(4)])
        faces = np.array([[0, 1, 2], [0, 2, 3]])
        return _Surface(positions, np.tile([0.0, 0.0, 1.0], (4, 1)), 0.5 + 0.5 * _CORNERS, faces)
    return _box(model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:])


def _box(center: np.ndarray, half: np.ndarray) -> _Surface:
    parts: list[_Surface] = []
    for axis in range(3):
        across, along = (axis + 1) % 3, (axis + 2) % 3
        for side in (-1.0, 1.0):
            corners = np.zeros((4, 3))
            corners[:, axis] = side
            corners[:, across], corners[:, along] = _CORNERS[:, 0] * side, _CORNERS[:, 1]
            normals = np.zeros((4, 3))
            normals[:, axis] = side
            uv = 0.5 + 0.5 * corners[:, :2]
            parts.append(_Surface(center + corners * half, normals, uv, np.array([[0, 1, 2], [0, 2, 3]])))
    return _joined(parts)


def _mesh(model: mujoco.MjModel, mesh: int) -> _Surface:
    """Return a mesh with its corners told apart by position, normal and texture coordinate."""

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
    return _Surface(
        rows(model.mesh_vert, model.mesh_vertadr, model.mesh_vertnum)[known[:, 0]].astype(np.float64),
        rows(model.mesh_normal, model.mesh_normaladr, model.mesh_normalnum)[known[:, 1]].astype(np.float64),
        uv,
        index.reshape(-1, 3),
    )


def _joined(parts: list[_Surface]) -> _Surface:
    starts = np.cumsum([0, *(len(p.positions) for p in parts)])
    return _Surface(
        np.concatenate([p.positions for p in parts]),
        np.concatenate([p.normals for p in parts]),
        np.concatenate([p.coordinates for p in parts]),
        np.concatenate([p.faces + start for p, start in zip(parts, starts[:-1], strict=True)]),
    )


class _Buffer:
    """The binary part of a file, with its views and accessors."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.views: list[dict[str, int]] = []
        self.accessors: list[dict[str, object]] = []

    def view(self, data: bytes, target: int | None = None) -> int:
        self.data.extend(b"\0" * (-len(self.data) % 4))
        form = {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data)}
        self.views.append(form if target is None else {**form, "target": target})
        self.data.extend(data)
        return len(self.views) - 1

    def accessor(self, array: np.ndarray, kind: str, *, is_index: bool = False) -> int:
        array = np.ascontiguousarray(array, dtype=np.uint32 if is_index else np.float32)
        form: dict[str, object] = {
            "bufferView": self.view(array.tobytes(), _ELEMENTS if is_index else _ARRAY),
            "componentType": _UINT if is_index else _FLOAT,
            "count": len(array),
            "type": kind,
        }
        if kind == "VEC3":
            form |= {"min": array.min(0).tolist(), "max": array.max(0).tolist()}
        self.accessors.append(form)
        return len(self.accessors) - 1


def _file(model: mujoco.MjModel, looks: Mapping[tuple[float, ...], list[_Surface]]) -> bytes:
    """Return the GLB of surfaces by look: color and texture."""
    buffer = _Buffer()
    primitives, materials, images = [], [], []
    for (*color, texture), surfaces in looks.items():
        surface = _joined(surfaces)
        attributes = {
            "POSITION": buffer.accessor(surface.positions, "VEC3"),
            "NORMAL": buffer.accessor(surface.normals, "VEC3"),
            "TEXCOORD_0": buffer.accessor(surface.coordinates, "VEC2"),
        }
        indices = buffer.accessor(surface.faces.ravel(), "SCALAR", is_index=True)
        look: dict[str, object] = {
            "baseColorFactor": [*(_linear(v) for v in color[:3]), color[3]],
            "metallicFactor": 0.0,
            "roughnessFactor": ROUGHNESS,
        }
        if texture >= 0:
            images.append({"bufferView": buffer.view(_png(model, int(texture))), "mimeType": "image/png"})
            look["baseColorTexture"] = {"index": len(images) - 1}
        material: dict[str, object] = {"pbrMetallicRoughness": look}
        materials.append(material if color[3] >= 1.0 else {**material, "alphaMode": "BLEND"})
        primitives.append({"attributes": attributes, "indices": indices, "material": len(materials) - 1})
    document: dict[str, object] = {
        "asset": {"version": "2.0", "generator": "betterbench"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": primitives}],
        "materials": materials,
        "accessors": buffer.accessors,
        "bufferViews": buffer.views,
        "buffers": [{"byteLength": len(buffer.data)}],
    }
    if images:
        document["images"] = images
        document["samplers"] = [{"magFilter": _LINEAR, "minFilter": _LINEAR, "wrapS": _REPEAT, "wrapT": _REPEAT}]
        document["textures"] = [{"source": i, "sampler": 0} for i in range(len(images))]
    return _packed(document, bytes(buffer.data))


def _packed(document: Mapping[str, object], binary: bytes) -> bytes:
    """Return header, JSON chunk and binary chunk, each padded to four bytes."""
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    binary += b"\0" * (-len(binary) % 4)
    total = 12 + 8 + len(text) + 8 + len(binary)
    header = struct.pack("<4sII", b"glTF", 2, total)
    return header + struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(binary), b"BIN\0") + binary


def _linear(value: float) -> float:
    """Return a color component without the sRGB curve (IEC 61966-2-1): factors of glTF are linear, textures are not."""
    return value / 12.92 if value <= 0.04045 else float(((value + 0.055) / 1.055) ** 2.4)


def _png(model: mujoco.MjModel, texture: int) -> bytes:
    first, channels = int(model.tex_adr[texture]), int(model.tex_nchannel[texture])
    height, width = int(model.tex_height[texture]), int(model.tex_width[texture])
    pixels = model.tex_data[first : first + height * width * channels].reshape(height, width, channels)
    out = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(pixels)).save(out, "PNG")
    return out.getvalue()
