"""Read the number of triangles and the extents of a mesh from its file, without loading the mesh.

Files that a mesh refers to are not opened, and the number of bytes read per file is limited. Numbers that are missing
or not finite count as unknown.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from betterbench.errors import InvalidInputError
from betterbench.geometry import Vector
from betterbench.json_form import read_bounded
from betterbench.ordinary_file import open_ordinary
from betterbench.sim.assets.gltf import description_of
from betterbench.sim.assets.xml_file import MAX_XML_BYTES, parse_xml

MAX_TEXT_BYTES = 64 << 20
"""Maximum size of an OBJ or text STL file that is read [byte]. Larger files are not read, so the facts about them stay
unknown."""
_MOST_NODES = 20_000
_CURE = "Repair the file or remove it"


@dataclass(frozen=True, slots=True)
class MeshFacts:
    """Facts about a mesh, read from its file.

    Attributes:
        faces: Number of triangles, or None if unknown.
        size: Extents along the axes of the file, in the unit of the file. None if unknown.
        name: Name stated in the file. Empty if there is none.
        refers_to: Relative paths of the mesh files that a URDF or MJCF file uses.
        is_asset: False for an XML file that is neither URDF nor MJCF.
    """

    faces: int | None = None
    size: Vector | None = None
    name: str = ""
    refers_to: tuple[str, ...] = ()
    is_asset: bool = True


def mesh_facts(path: Path) -> MeshFacts:
    """Read facts about a mesh from its file. The extension of the file determines the format.

    Raises:
        InvalidInputError: If the file is damaged or does not have the format of its extension.
    """
    try:
        return _READERS[path.suffix.lower()](path)
    except OSError as error:
        raise InvalidInputError(str(path), f"it cannot be read ({error.strerror or error})", _CURE) from error


def _wrong(path: Path, problem: str) -> InvalidInputError:
    return InvalidInputError(str(path), problem, _CURE)


def _size(low: np.ndarray, high: np.ndarray) -> Vector | None:
    """Return the extents between two corners, or None if an extent is not finite or all extents are zero."""
    with np.errstate(all="ignore"):
        sides = [float(side) for side in np.asarray(high, float) - np.asarray(low, float)]
    if len(sides) != 3 or not all(math.isfinite(side) and side >= 0.0 for side in sides) or not any(sides):
        return None
    return (sides[0], sides[1], sides[2])


# ------------------------------------------------------------------------------------------------------------- glTF


def _gltf(path: Path) -> MeshFacts:
    with open_ordinary(path) as file:
        form = description_of(file, str(path), binary=path.suffix.lower() == ".glb")
    try:
        with np.errstate(all="ignore"):
            return _GltfScene(form).facts()
    except (KeyError, IndexError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise _wrong(path, f"its glTF description is damaged ({error})") from error


class _GltfScene:
    """Reader for a glTF description. It determines the number of triangles and the extents of the default scene."""

    def __init__(self, form: Mapping[str, Any]) -> None:
        self._form = form
        self._nodes = list(form.get("nodes", []))
        self._low, self._high = np.full(3, np.inf), np.full(3, -np.inf)
        self._faces, self._visited = 0, 0

    def facts(self) -> MeshFacts:
        scenes = list(self._form.get("scenes", []))
        roots = list(range(len(self._nodes)))
        if scenes:
            roots = list(scenes[_index(self._form.get("scene", 0), len(scenes))].get("nodes", []))
        stack = [(root, np.eye(4)) for root in roots]
        while stack:
            number, above = stack.pop()
            self._visited += 1
            if self._visited > _MOST_NODES:
                raise ValueError(f"the scene has more than {_MOST_NODES} nodes, or its nodes form a cycle")
            node = self._nodes[_index(number, len(self._nodes))]
            pose = above @ _node_matrix(node)
            if "mesh" in node:
                self._add(self._form["meshes"][_index(node["mesh"], len(self._form["meshes"]))], pose)
            stack += [(child, pose) for child in node.get("children", [])]
        return MeshFacts(faces=self._faces, size=_size(self._low, self._high))

    def _add(self, mesh: Mapping[str, Any], pose: np.ndarray) -> None:
        accessors = self._form["accessors"]
        for primitive in mesh["primitives"]:
            positions = accessors[_index(primitive["attributes"]["POSITION"], len(accessors))]
            shared = primitive.get("indices")
            counts = [
                positions["count"],
                *([] if shared is None else [accessors[_index(shared, len(accessors))]["count"]]),
            ]
            if not all(isinstance(count, int) and not isinstance(count, bool) and count >= 0 for count in counts):
                raise ValueError("the count of an accessor is not a non-negative integer")
            count = counts[-1]
            mode = primitive.get("mode", 4)
            self._faces += count // 3 if mode == 4 else max(count - 2, 0) if mode in (5, 6) else 0
            if "min" in positions and "max" in positions:
                ends = np.array([positions["min"][:3], positions["max"][:3]], dtype=float)
                corners = np.array(
                    [[ends[i, 0], ends[j, 1], ends[k, 2], 1.0] for i in (0, 1) for j in (0, 1) for k in (0, 1)]
                )
                placed = (corners @ pose.T)[:, :3]
                self._low = np.minimum(self._low, placed.min(axis=0))
                self._high = np.maximum(self._high, placed.max(axis=0))


def _index(value: object, count: int) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value < count:
        raise ValueError("an index refers to a missing element")
    return value


def _node_matrix(node: Mapping[str, Any]) -> np.ndarray:
    """Return the (4, 4) pose of a node relative to its parent."""
    if "matrix" in node:
        return np.array(node["matrix"], dtype=float).reshape(4, 4).T
    x, y, z, w = (float(part) for part in node.get("rotation", (0, 0, 0, 1)))
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    matrix = np.eye(4)
    matrix[:3, :3] = turn * np.array(node.get("scale", (1, 1, 1)), dtype=float)
    matrix[:3, 3] = node.get("translation", (0, 0, 0))
    return matrix


# -------------------------------------------------------------------------------------------------------- OBJ, STL


def _obj(path: Path) -> MeshFacts:
    with open_ordinary(path) as file:
        size = file.seek(0, 2)
        if size > MAX_TEXT_BYTES:
            return MeshFacts()
        file.seek(0)
        faces, vertices = 0, []
        for line in file:
            if line.startswith(b"v "):
                vertices.append(line)
            elif line.startswith(b"f "):
                faces += max(len(line.split()) - 3, 0)
    if not vertices:
        raise _wrong(path, "has no vertices")
    return MeshFacts(faces=faces, size=_extent_of_lines(path, vertices))


def _extent_of_lines(path: Path, lines: list[bytes]) -> Vector | None:
    """Return the extents of the points in a list of lines. Each line consists of a word and three numbers."""
    try:
        points = np.array([line.split()[1:4] for line in lines], dtype="S40").astype(float)
    except ValueError as error:
        raise _wrong(path, "it has a vertex that does not consist of three numbers") from error
    if points.ndim != 2 or points.shape[1] != 3:
        raise _wrong(path, "it has a vertex that does not consist of three numbers")
    return _size(points.min(axis=0), points.max(axis=0))


_STL_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def _stl(path: Path) -> MeshFacts:
    with open_ordinary(path) as file:
        actual = file.seek(0, 2)
        file.seek(0)
        head = file.read(84)
        count = struct.unpack("<I", head[80:])[0] if len(head) == 84 else -1
        if count >= 0 and actual == 84 + 50 * count:
            if actual > MAX_TEXT_BYTES:
                return MeshFacts(faces=count)
            corners = np.frombuffer(file.read(), _STL_TRIANGLE)["corners"].reshape(-1, 3)
            size = _size(corners.min(axis=0), corners.max(axis=0)) if count else None
            return MeshFacts(faces=count, size=size)
        if not head.lstrip().startswith(b"solid"):
            raise _wrong(path, f"it is neither a text STL file nor a complete binary STL file ({actual} bytes)")
        if actual > MAX_TEXT_BYTES:
            return MeshFacts()
        file.seek(0)
        lines = [line for line in file if line.lstrip().startswith(b"vertex")]
    if not lines:
        raise _wrong(path, "has no vertices")
    return MeshFacts(faces=len(lines) // 3, size=_extent_of_lines(path, lines))


# -------------------------------------------------------------------------------------------------------- URDF, MJCF


def _xml(path: Path) -> MeshFacts:
    root = parse_xml(read_bounded(path, max_bytes=MAX_XML_BYTES, cure=_CURE), str(path))
    if root.tag not in ("robot", "mujoco"):
        return MeshFacts(is_asset=False)
    folder = ""
    if root.tag == "mujoco":
        compiler = root.find("compiler")
        folder = "" if compiler is None else compiler.get("meshdir", compiler.get("assetdir", ""))
    names = [mesh.get("filename") or mesh.get("file") or "" for mesh in root.iter("mesh")]
    used = tuple(f"{folder}/{name}".lstrip("/") if folder else name for name in names if name)
    return MeshFacts(name=(root.get("name") or root.get("model") or ""), refers_to=used)


_READERS: dict[str, Callable[[Path], MeshFacts]] = {
    ".glb": _gltf,
    ".gltf": _gltf,
    ".obj": _obj,
    ".stl": _stl,
    ".urdf": _xml,
    ".xml": _xml,
}
ENDINGS = tuple(_READERS)
"""Extensions of possible asset files, most preferred first. If an object has several files, its row describes the most
preferred one."""
