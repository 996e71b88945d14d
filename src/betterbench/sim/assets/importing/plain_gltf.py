"""Rewrite glTF features that trimesh would silently drop.

The features are replaced by plain nodes, triangles and texture coordinates that look the same. This is done for skins
in their rest pose, triangle fans, quantized positions and texture coordinates, texture transforms, additional sets of
texture coordinates, glossy materials, and files without a scene. Shape keys in use, posed skeletons and instances
cannot be rewritten and raise an error.
"""

from __future__ import annotations

import base64
import copy
import json
import struct
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from betterbench.errors import InvalidInputError, one_line

Form = dict[str, Any]
"""JSON description of a glTF file (glTF 2.0, section 5)."""

_TRANSFORM = "KHR_texture_transform"
_GLOSS = "KHR_materials_pbrSpecularGlossiness"
_INSTANCES = "EXT_mesh_gpu_instancing"
_FLOAT, _UINT = 5126, 5125
_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
_FAN, _TRIANGLES = 6, 4
_ALIKE = 1e-3
"""Maximum difference between the joint matrices of a skin in its rest pose, relative to their size."""


def plain(data: bytes, form: Form, read: Callable[[str], bytes], where: str) -> bytes | None:
    """Rewrite a glTF file as a GLB file without the features that trimesh would drop.

    Args:
        data: Content of the glTF file, either GLB or JSON.
        form: JSON description in the file.
        read: Function that returns the content of another file, given its URI.
        where: Name of the file, for messages.

    Returns:
        The rewritten file, or None if the file has none of these features and can be used unchanged.

    Raises:
        InvalidInputError: If the file has a feature that cannot be rewritten.
        Exception: If the JSON does not describe a glTF file.
    """
    _require_shape(form, where)
    document = _Document(copy.deepcopy(form), data, read)
    changes = [
        _with_a_scene(document.form),
        _without_skins(document, where),
        _without_gloss(document.form),
        *(_plain_surface(document, surface) for surface in _surfaces(document.form)),
    ]
    return document.glb() if any(changes) else None


def _surfaces(form: Form) -> Iterator[Form]:
    return (surface for mesh in form.get("meshes", []) for surface in mesh.get("primitives", []))


def _require_shape(form: Form, where: str) -> None:
    """Raise an error if a glTF file has instances, or shape keys (morph targets) that are in use."""
    meshes = form.get("meshes", [])
    for node in form.get("nodes", []):
        if _INSTANCES in node.get("extensions", {}):
            cure = "Make the instances real objects before the export"
            raise InvalidInputError(where, f"it has instances ({_INSTANCES}), which are not supported", cure)
        mesh = meshes[node["mesh"]] if "mesh" in node else {}
        has_keys = any(surface.get("targets") for surface in mesh.get("primitives", []))
        if has_keys and any(node.get("weights", mesh.get("weights", []))):
            name = one_line(repr(mesh.get("name", "")), most=60)
            problem = f"its mesh {name} has shape keys (morph targets) that are not at 0"
            raise InvalidInputError(where, problem, "Apply the shape keys in a mesh editor")


def _with_a_scene(form: Form) -> bool:
    """Add a scene with all root nodes to a glTF file that has no scene. Return whether a scene was added."""
    if form.get("scenes") or not form.get("nodes"):
        return False
    below = {child for node in form["nodes"] for child in node.get("children", [])}
    form["scenes"], form["scene"] = [{"nodes": [k for k in range(len(form["nodes"])) if k not in below]}], 0
    return True


def _without_gloss(form: Form) -> bool:
    """Use the diffuse color of glossy materials as their base color. Return whether the file has glossy materials.

    A glossy material uses an extension of glTF (specular-glossiness) in place of the usual metallic material. trimesh
    ignores the color factor in this extension. If the extension has a texture but no factor, trimesh ignores the
    texture as well.
    """
    glossy = [material for material in form.get("materials", []) if _GLOSS in material.get("extensions", {})]
    for material in glossy:
        gloss = material["extensions"].pop(_GLOSS)
        base = {"baseColorFactor": gloss.get("diffuseFactor", [1.0, 1.0, 1.0, 1.0]), "metallicFactor": 0.0}
        if "diffuseTexture" in gloss:
            base["baseColorTexture"] = gloss["diffuseTexture"]
        material["pbrMetallicRoughness"] = base
    return bool(glossy)


def _without_skins(document: _Document, where: str) -> bool:
    """Replace each mesh that has a skin by a plain mesh at the pose of the skin's joints.

    Return whether the file has skins. The pose of the node that contains the mesh is ignored, as glTF requires for a
    mesh with a skin (glTF 2.0, section 3.7.3.3).
    """
    form = document.form
    skinned = [node for node in form.get("nodes", []) if "mesh" in node and "skin" in node]
    if not skinned:
        return False
    poses = _world_poses(form)
    places = [_rest_pose(document, form["skins"][node["skin"]], poses, where) for node in skinned]
    for node, place in zip(skinned, places, strict=True):
        del node["skin"]
        form["nodes"].append({"mesh": node.pop("mesh"), "matrix": place.T.ravel().tolist()})
        form["scenes"][form.get("scene", 0)].setdefault("nodes", []).append(len(form["nodes"]) - 1)
    return True


def _rest_pose(document: _Document, skin: Form, poses: list[np.ndarray], where: str) -> np.ndarray:
    """Return the (4, 4) transform that all joints of a skin share. Raises InvalidInputError if they differ."""
    joints = np.array([poses[joint] for joint in skin["joints"]])
    if "inverseBindMatrices" in skin:
        bound = document.values(skin["inverseBindMatrices"]).reshape(-1, 4, 4)[: len(joints)]
        joints = joints @ bound.transpose(0, 2, 1)
    size = float(np.abs(joints[0, :3, :3]).max())
    if not np.abs(joints - joints[0]).max() <= _ALIKE * size:
        problem = "its skeleton (skin) is not in its rest pose"
        raise InvalidInputError(where, problem, "Apply the armature in a mesh editor")
    return np.asarray(joints[0])


def _world_poses(form: Form) -> list[np.ndarray]:
    """Return the (4, 4) pose of each node in the frame of the scene."""
    above = {child: k for k, node in enumerate(form["nodes"]) for child in node.get("children", [])}
    found = []
    for number in range(len(form["nodes"])):
        place, at, steps = np.eye(4), number, 0
        while True:
            place = _own_pose(form["nodes"][at]) @ place
            steps += 1
            if at not in above or steps > len(form["nodes"]):
                break
            at = above[at]
        found.append(place)
    return found


def _own_pose(node: Form) -> np.ndarray:
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    x, y, z, w = node.get("rotation", (0.0, 0.0, 0.0, 1.0))
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    place = np.eye(4)
    place[:3, :3] = turn * np.array(node.get("scale", (1.0, 1.0, 1.0)))
    place[:3, 3] = node.get("translation", (0.0, 0.0, 0.0))
    return place


def _plain_surface(document: _Document, surface: Form) -> bool:
    """Rewrite the unsupported features of one surface in place. Return whether the surface has changed."""
    attributes = surface["attributes"]
    changed = False
    if surface.get("mode", _TRIANGLES) == _FAN:
        count = document.form["accessors"][attributes["POSITION"]]["count"]
        ring = document.values(surface["indices"])[:, 0] if "indices" in surface else np.arange(count)
        faces = np.stack([np.full(len(ring) - 2, ring[0]), ring[1:-1], ring[2:]], axis=1)
        surface["indices"], surface["mode"] = document.add(faces.reshape(-1, 1), "SCALAR", _UINT), _TRIANGLES
        changed = True
    position = attributes.get("POSITION")
    if position is not None and document.is_quantized(position):
        attributes["POSITION"] = document.add(document.values(position), "VEC3")
        changed = True
    return _plain_coordinates(document, surface) or changed


def _plain_coordinates(document: _Document, surface: Form) -> bool:
    """Apply the texture transform of the base color, and make its texture coordinates the first set.

    Returns:
        Whether the surface has changed.
    """
    attributes, form = surface["attributes"], document.form
    material = form["materials"][surface["material"]] if "material" in surface else {}
    texture = material.get("pbrMetallicRoughness", {}).get("baseColorTexture", {})
    change = texture.get("extensions", {}).get(_TRANSFORM, {})
    number = change.get("texCoord", texture.get("texCoord", 0))
    used = attributes.get(f"TEXCOORD_{number}")
    if not texture or used is None or not (number or change or document.is_quantized(used)):
        return False
    scale, turn = np.array(change.get("scale", (1.0, 1.0))), float(change.get("rotation", 0.0))
    u, v = (document.values(used)[:, :2] * scale).T
    cos, sin = np.cos(turn), np.sin(turn)
    turned = np.stack([cos * u + sin * v, cos * v - sin * u], axis=1) + np.array(change.get("offset", (0.0, 0.0)))
    attributes["TEXCOORD_0"] = document.add(turned, "VEC2")
    return True


class _Document:
    """A glTF file with all buffers joined into one, so that new values can be appended."""

    def __init__(self, form: Form, data: bytes, read: Callable[[str], bytes]) -> None:
        self.form = form
        self._data, self._read = data, read
        self._joined: bytearray | None = None

    def is_quantized(self, accessor: int) -> bool:
        """Return whether the values of an accessor are stored as integers."""
        return bool(self.form["accessors"][accessor]["componentType"] != _FLOAT)

    def values(self, accessor: int) -> np.ndarray:
        """Return the values of an accessor as a float64 array of shape (count, width)."""
        form = self.form["accessors"][accessor]
        kind, width, count = np.dtype(_TYPES[form["componentType"]]), _WIDTHS[form["type"]], int(form["count"])
        if "bufferView" not in form:
            raise ValueError("its compressed values cannot be changed. Export the object without Draco compression")
        buffer = self._buffer()
        view = self.form["bufferViews"][form["bufferView"]]
        start = int(view.get("byteOffset", 0)) + int(form.get("byteOffset", 0))
        stride = int(view.get("byteStride", kind.itemsize * width))
        row = kind.itemsize * width
        if count < 1 or start < 0 or stride < row or start + (count - 1) * stride + row > len(buffer):
            raise ValueError("an accessor reaches beyond its buffer")
        rows = np.ndarray((count, width), kind, buffer, start, (stride, kind.itemsize)).astype(np.float64)
        if form.get("normalized"):
            rows = np.maximum(rows / np.iinfo(kind).max, -1.0)
        return rows

    def add(self, values: np.ndarray, kind: str, component: int = _FLOAT) -> int:
        """Append values to the buffer, and return the index of their new accessor."""
        buffer = self._buffer()
        buffer.extend(bytes(-len(buffer) % 4))
        raw = np.ascontiguousarray(values, dtype=_TYPES[component]).tobytes()
        self.form["bufferViews"].append({"buffer": 0, "byteOffset": len(buffer), "byteLength": len(raw)})
        buffer.extend(raw)
        form: Form = {"bufferView": len(self.form["bufferViews"]) - 1, "componentType": component}
        self.form["accessors"].append({**form, "count": len(values), "type": kind})
        return len(self.form["accessors"]) - 1

    def _buffer(self) -> bytearray:
        """Return the joined bytes of all buffers.

        The buffers are joined on the first call. All buffer views are then changed to refer to the joined buffer.
        """
        if self._joined is None:
            self._joined, starts = bytearray(), []
            for buffer in self.form.get("buffers", []):
                self._joined.extend(bytes(-len(self._joined) % 4))
                starts.append(len(self._joined))
                self._joined.extend(self._bytes_of(buffer.get("uri")))
            for view in self.form.get("bufferViews", []):
                view["byteOffset"] = int(view.get("byteOffset", 0)) + starts[view["buffer"]]
                view["buffer"] = 0
        return self._joined

    def _bytes_of(self, uri: str | None) -> bytes:
        if uri is None:
            start = 20 + struct.unpack("<I", self._data[12:16])[0]
            length = struct.unpack("<I", self._data[start : start + 4])[0]
            return self._data[start + 8 : start + 8 + length]
        return base64.b64decode(uri.partition(",")[2]) if uri.startswith("data:") else self._read(uri)

    def glb(self) -> bytes:
        """Return the document in the GLB format."""
        buffer = self._buffer()
        buffer.extend(bytes(-len(buffer) % 4))
        self.form["buffers"] = [{"byteLength": len(buffer)}]
        text = json.dumps(self.form).encode()
        text += b" " * (-len(text) % 4)
        head = struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(buffer))
        return (
            head + struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(buffer), b"BIN\0") + buffer
        )
