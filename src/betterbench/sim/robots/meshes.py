"""Visual meshes of the arm. They are read from an installed package, decimated once, and cached for the user.

The STL files come with the ``gymnasium-robotics`` wheel. They contain 134,000 triangles, which would take up most of
the time of software rendering. Each file is split into its connected parts, and the parts are sorted by paint. All
parts together are then decimated to a fixed number of triangles. Parts with more detail keep more triangles
(:mod:`~betterbench.sim.robots.decimation`).

The name of the cache file is a hash of the source files, the number of triangles and the version of the recipe. The
file is written under a temporary name and then renamed, so that two processes may write it at the same time. Its first
line is the SHA-256 of the file name and the rest of the content. If the file is changed or unreadable, it is generated
again.
"""

from __future__ import annotations

import hashlib
import importlib.util
import io
import logging
import os
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import platformdirs

from betterbench.installation import missing_packages
from betterbench.json_form import content_digest
from betterbench.ordinary_file import open_ordinary
from betterbench.sim.robots.decimation import creased, decimated, welded
from betterbench.sim.robots.spec import Progress

_log = logging.getLogger(__name__)

RECIPE_VERSION = 2
"""Version of the mesh preparation. Increment it with every change, so that old cache files are not used."""

_WELD_M = 1e-4
"""Grid size for merging vertices [m]. The files have open seams of some hundredths of a millimeter."""

_CREASE_DEGREES = 38.0
"""Angle above which an edge is drawn sharp. The housings of the arm are round, with edges at flanges and covers."""

_CACHE_SUFFIX, _MOST_CACHE_BYTES = ".meshes", 1 << 26

_PACKAGE, _AGAIN = "gymnasium-robotics>=1.4.2", "--force-reinstall"
_MESH_FOLDER = Path("envs/assets/kitchen_franka/franka_assets/meshes/visual")


@dataclass(frozen=True, slots=True)
class MeshPart:
    """Part of a robot link that has a single paint (surface color).

    The link is named after its source file ("link3", "hand").

    Attributes:
        paint: Name of the paint ("shell", "dark").
        vertices: Corners in the link frame [m], shape (V, 3), float32.
        faces: Vertex indices of each triangle, shape (F, 3), int32.
    """

    link: str
    paint: str
    vertices: np.ndarray
    faces: np.ndarray

    @property
    def name(self) -> str:
        """Name of the part in models and in the cache file."""
        return f"{self.link}_{self.paint}"


PaintRule = Callable[[str, int], str]
"""Function from a link and the rank of a connected part by area (largest first) to the name of a paint."""


def mesh_folder() -> Path:
    """Return the folder with the visual STL files. Raises MissingDependencyError if they are not installed."""
    found = importlib.util.find_spec("gymnasium_robotics")
    folders = list(found.submodule_search_locations or ()) if found is not None else []
    for folder in folders:
        if (Path(folder) / _MESH_FOLDER).is_dir():
            return Path(folder) / _MESH_FOLDER
    raise missing_packages(
        "The Panda's meshes are part of the package gymnasium-robotics, which is missing or incomplete", _PACKAGE
    )


def visual_parts(
    shares: dict[str, float],
    paint: PaintRule,
    *,
    faces: int,
    cache_folder: Path | None = None,
    progress: Progress | None = None,
) -> tuple[MeshPart, ...]:
    """Return the decimated visual meshes, ordered by link and paint, from the cache if possible.

    ``shares`` contains the weight of shape errors for each file, by the name of the file without its extension.
    ``faces`` is the maximum number of triangles of all parts together. ``paint`` chooses the paint of each connected
    part. ``progress`` is called for each link unless the cache is used. Raises MissingDependencyError if a source file
    is missing.
    """
    folder = mesh_folder()
    sources: dict[str, bytes] = {}
    key = hashlib.sha256(f"recipe {RECIPE_VERSION}, {faces} faces, {sorted(shares.items())}".encode())
    for link in shares:
        path = folder / f"{link}.stl"
        try:
            sources[link] = path.read_bytes()
        except FileNotFoundError:
            raise missing_packages(
                f"The mesh {path.name} is missing from the installed gymnasium-robotics", _AGAIN, _PACKAGE
            ) from None
        key.update(hashlib.sha256(sources[link]).digest())
        key.update(" ".join(paint(link, rank) for rank in range(64)).encode())
    home = cache_folder or platformdirs.user_cache_path("betterbench") / "robots"
    cached = home / f"{key.hexdigest()[:24]}{_CACHE_SUFFIX}"
    parts = _read_cache(cached)
    if parts is None:
        parts = _prepare(sources, shares, paint, faces, progress)
        _write_cache(cached, parts)
    return parts


def _prepare(
    sources: dict[str, bytes], shares: dict[str, float], paint: PaintRule, budget: int, progress: Progress | None
) -> tuple[MeshPart, ...]:
    """Split all source files into parts, sort them by paint, and decimate all parts together to the triangle budget."""
    import trimesh  # noqa: PLC0415 - takes 0.6 s, which only the first process of a machine needs

    painted: dict[tuple[str, str], tuple[np.ndarray, np.ndarray]] = {}
    for done, (link, data) in enumerate(sources.items()):
        if progress is not None:
            progress("reading the arm's meshes", done, len(sources))
        mesh = trimesh.load_mesh(io.BytesIO(data), file_type="stl", process=False)
        mesh.merge_vertices()
        labels = _connected(len(mesh.vertices), np.asarray(mesh.faces))[mesh.faces[:, 0]]
        areas = np.bincount(labels, weights=mesh.area_faces)
        rank_of = np.empty(len(areas), dtype=np.int64)
        rank_of[np.argsort(-areas, kind="stable")] = np.arange(len(areas))
        names = np.array([paint(link, int(rank)) for rank in rank_of])[labels]
        for name in sorted(set(names.tolist())):
            chosen = np.asarray(mesh.faces)[names == name]
            used, renumbered = np.unique(chosen, return_inverse=True)
            painted[link, name] = (np.asarray(mesh.vertices)[used], renumbered.reshape(-1, 3))
    if progress is not None:
        progress("decimating the arm's meshes", 0, 1)
    order = sorted(painted)
    pieces = [welded(*painted[key], _WELD_M) for key in order]
    small = decimated(pieces, [shares[link] for link, _ in order], budget)
    parts = []
    for (link, name), piece in zip(order, small, strict=True):
        vertices, triangles = creased(*piece, _CREASE_DEGREES)
        parts.append(MeshPart(link, name, vertices.astype(np.float32), triangles.astype(np.int32)))
    if progress is not None:
        progress("decimating the arm's meshes", 1, 1)
    return tuple(parts)


def _connected(count: int, faces: np.ndarray) -> np.ndarray:
    """Find the connected parts of a mesh with triangles (F, 3). Return the part index of each vertex (count,)."""
    labels = np.arange(count)
    while True:
        before = labels.copy()
        lowest = labels[faces].min(axis=1)
        for corner in range(3):
            np.minimum.at(labels, faces[:, corner], lowest)
        labels = labels[labels]
        if np.array_equal(labels, before):
            return np.unique(labels, return_inverse=True)[1]


def parts_from_bytes(data: bytes) -> tuple[MeshPart, ...]:
    """Read the mesh parts from the bytes of an NPZ archive, as :func:`parts_as_bytes` returns them."""
    with np.load(io.BytesIO(data), allow_pickle=False) as stored:
        parts = []
        for name in stored["names"].tolist():
            link, _, paint = str(name).rpartition("_")
            parts.append(MeshPart(link, paint, stored[f"{name}.v"], stored[f"{name}.f"]))
        return tuple(parts)


def parts_as_bytes(parts: tuple[MeshPart, ...], *, compressed: bool = False) -> bytes:
    """Return the mesh parts as the bytes of an NPZ archive."""
    arrays: dict[str, np.ndarray] = {"names": np.array([p.name for p in parts])}
    for part in parts:
        arrays[f"{part.name}.v"] = part.vertices
        arrays[f"{part.name}.f"] = part.faces
    packed = io.BytesIO()
    (np.savez_compressed if compressed else np.savez)(packed, allow_pickle=False, **arrays)
    return packed.getvalue()


def _read_cache(path: Path) -> tuple[MeshPart, ...] | None:
    """Return the mesh parts in a cache file, or None if the file is missing or damaged."""
    try:
        with open_ordinary(path) as stream:
            seal, _, data = stream.read(_MOST_CACHE_BYTES).partition(b"\n")
        if seal != content_digest(path.stem, data).encode():
            _log.warning("The mesh cache %s is damaged or was changed, so it is generated again.", path)
            return None
        return parts_from_bytes(data)
    except FileNotFoundError:
        return None
    except Exception:  # noqa: BLE001 - what reading a damaged archive raises
        _log.warning("The mesh cache %s cannot be read, so it is generated again.", path)
        return None


_LEFTOVER_S = 3600.0


def _remove_leftovers(folder: Path) -> None:
    """Delete temporary files that are older than an hour. The processes that wrote them were killed."""
    for part in folder.glob(f"tmp*{_CACHE_SUFFIX}.part"):
        if time.time() - part.stat().st_mtime > _LEFTOVER_S:
            part.unlink(missing_ok=True)


def _write_cache(path: Path, parts: tuple[MeshPart, ...]) -> None:
    """Write the mesh parts to the cache file. If this fails, only the next start is slower."""
    packed = parts_as_bytes(parts)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        _remove_leftovers(path.parent)
        handle, beside = tempfile.mkstemp(dir=path.parent, suffix=f"{_CACHE_SUFFIX}.part")
        try:
            with os.fdopen(handle, "wb") as stream:
                stream.write(content_digest(path.stem, packed).encode() + b"\n" + packed)
            Path(beside).replace(path)
        except OSError:
            Path(beside).unlink(missing_ok=True)
            raise
    except OSError as error:
        _log.warning(
            "The mesh cache %s cannot be written (%s), so the meshes are prepared on every start.", path, error
        )
