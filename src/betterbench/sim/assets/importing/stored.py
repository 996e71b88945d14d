"""File format of imported objects: a NumPy archive without pickle that contains the asset draft and its metadata."""

from __future__ import annotations

import io
import math
import zipfile
import zlib
from dataclasses import asdict
from typing import Any

import numpy as np

from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.geometry import Pose
from betterbench.interface.state import Region
from betterbench.json_form import dump_json, parse_json
from betterbench.sim.assets.asset import CollisionPart, Grasp, Texture, VisualPart
from betterbench.sim.assets.authoring.draft import Draft, frozen
from betterbench.sim.assets.authoring.mass import MassProperties
from betterbench.sim.assets.importing.hulls import Fit
from betterbench.sim.assets.importing.importer import Imported
from betterbench.sim.assets.importing.kinds import kind_of

_HEAD = "head"
_CURE = "Delete the file and import the object again"
MAX_UNPACKED_BYTES = 256 << 20
"""Maximum total size of the arrays in a file [byte]."""
_MOST_FACES, _MOST_HULLS, _MOST_CORNERS = 20_000, 64, 256
_LARGEST_TEXTURE = 1024
_FARTHEST_M = 10.0


def to_bytes(imported: Imported) -> bytes:
    """Serialize an imported object. Equal objects give equal bytes."""
    draft, arrays = imported.draft, dict[str, np.ndarray]()
    visual, collision = [], []
    for k, part in enumerate(draft.parts):
        if isinstance(part, VisualPart):
            visual.append(
                {
                    "name": part.name,
                    "rgba": part.rgba,
                    "specular": part.specular,
                    "shininess": part.shininess,
                    "smooth": part.smooth,
                    "part": k,
                    "painted": part.texture is not None,
                }
            )
            arrays |= {f"{k}_vertices": part.vertices, f"{k}_faces": part.faces}
            if part.texture is not None:
                arrays |= {f"{k}_pixels": part.texture.pixels, f"{k}_uv": part.texture.uv}
                if part.texture.corners is not None:
                    arrays[f"{k}_corners"] = part.texture.corners
        else:
            collision.append({"friction": part.friction, "part": k})
            if part.vertices is None:
                raise AssertionError("the collision parts of an imported object must be hulls")
            arrays[f"{k}_vertices"] = part.vertices
    head = {
        "shape": draft.shape,
        "description": draft.description,
        "tags": draft.tags,
        "mass_kg": draft.mass_kg,
        "visual": visual,
        "collision": collision,
        "body": None if draft.body is None else asdict(draft.body),
        "grasps": [asdict(grasp) for grasp in draft.grasps],
        "regions": [asdict(region) for region in draft.regions],
        "parameters": dict(draft.parameters),
        "source": draft.source,
        "license": draft.license,
        "fit": asdict(imported.fit),
        "kind": None if imported.kind is None else imported.kind.name,
        "notes": imported.notes,
    }
    arrays[_HEAD] = np.frombuffer(dump_json(head), dtype=np.uint8)
    return _archive(arrays)


def _archive(arrays: dict[str, np.ndarray]) -> bytes:
    """Write arrays to an archive with reproducible bytes. np.savez would store the current time in the archive."""
    written = io.BytesIO()
    with zipfile.ZipFile(written, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in sorted(arrays):
            one = io.BytesIO()
            np.lib.format.write_array(one, np.ascontiguousarray(arrays[name]), allow_pickle=False)
            archive.writestr(zipfile.ZipInfo(f"{name}.npy"), one.getvalue(), zipfile.ZIP_DEFLATED)
    return written.getvalue()


def from_bytes(data: bytes, where: str) -> Imported:
    """Restore an imported object from the bytes written by :func:`to_bytes`.

    Raises:
        InvalidInputError: If the bytes are not a valid archive of an imported object.
    """
    try:
        arrays = _arrays(data)
        found = _imported(parse_json(arrays.pop(_HEAD).tobytes()), arrays)
        _check(found.draft)
    except _UNREADABLE as error:
        problem = f"it is not an imported object ({type(error).__name__})"
        raise InvalidInputError(where, problem, _CURE) from error
    return found


_UNREADABLE = (
    OSError, ValueError, KeyError, TypeError, IndexError, EOFError, AttributeError, NotImplementedError, MemoryError,
    RecursionError, OverflowError, zipfile.BadZipFile, zlib.error, UnknownNameError,
)  # fmt: skip


def _arrays(data: bytes) -> dict[str, np.ndarray]:
    """Return the arrays in an archive. The sizes declared in the archive are checked before anything is unpacked."""
    if not data.startswith(b"PK\x03\x04"):  # zipfile would accept a file in which other bytes precede the archive
        raise ValueError("the file does not begin with the signature of an archive")
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        members = archive.infolist()
        if len(members) > 8 * (_MOST_HULLS + 64) or sum(m.file_size for m in members) > MAX_UNPACKED_BYTES:
            raise ValueError("the archive is too large when unpacked")
        found = {}
        for member in members:
            with archive.open(member) as file:
                stream = io.BytesIO(file.read(member.file_size))
            if np.lib.format.read_magic(stream) != (1, 0):
                raise ValueError("an array has an unknown version of the NumPy format")
            shape, _, dtype = np.lib.format.read_array_header_1_0(stream)
            if dtype.hasobject or math.prod(shape) * dtype.itemsize != member.file_size - stream.tell():
                raise ValueError("an array has an unexpected size")
            stream.seek(0)
            array = np.lib.format.read_array(stream, allow_pickle=False)
            found[member.filename.removesuffix(".npy")] = frozen(array)
        return found


def _check(draft: Draft) -> None:
    """Raise ValueError if a part of the draft does not have the structure that the simulator expects.

    The check is needed because the file may be untrusted.
    """
    visual = [part for part in draft.parts if isinstance(part, VisualPart)]
    hulls = [part for part in draft.parts if isinstance(part, CollisionPart)]
    if not visual or not hulls or len(hulls) > _MOST_HULLS or sum(len(p.faces) for p in visual) > _MOST_FACES:
        raise ValueError("the object has no parts or too many parts")
    for part in draft.parts:
        points = part.vertices
        if points is None or points.dtype != np.float32 or points.ndim != 2 or points.shape[1] != 3 or len(points) < 3:
            raise ValueError("the vertices of a part have an unexpected array shape or type")
        if not np.isfinite(points).all() or np.abs(points).max() > _FARTHEST_M:
            raise ValueError("a part has vertices far from the origin")
    if any(part.vertices is None or not 4 <= len(part.vertices) <= _MOST_CORNERS for part in hulls):
        raise ValueError("a collision hull has too few or too many corners")
    for part in visual:
        _check_rows(part.faces, len(part.vertices))
        rgba = [float(v) for v in part.rgba]
        if len(rgba) != 4 or not 0.0 <= min(rgba) <= max(rgba) <= 1.0:
            raise ValueError("a part has an invalid color")
        if part.texture is not None:
            _check_texture(part.texture, part)
    _check_body(draft)


def _check_rows(rows: np.ndarray, count: int) -> None:
    if rows.dtype != np.int32 or rows.ndim != 2 or rows.shape[1] != 3 or len(rows) == 0:
        raise ValueError("the triangles of a part have an unexpected array shape or type")
    if rows.min() < 0 or rows.max() >= count:
        raise ValueError("a triangle refers to a missing vertex")


def _check_texture(texture: Texture, part: VisualPart) -> None:
    pixels, uv = texture.pixels, texture.uv
    if pixels.dtype != np.uint8 or pixels.ndim != 3 or pixels.shape[2] != 3:
        raise ValueError("a texture has an unexpected array shape or type")
    if not 1 <= min(pixels.shape[:2]) <= max(pixels.shape[:2]) <= _LARGEST_TEXTURE:
        raise ValueError("a texture has an unexpected size")
    if uv.dtype != np.float32 or uv.ndim != 2 or uv.shape[1] != 2 or not np.isfinite(uv).all():
        raise ValueError("texture coordinates have an unexpected array shape or type")
    if texture.corners is None:
        if len(uv) != len(part.vertices):
            raise ValueError("a part has an unexpected number of texture coordinates")
    else:
        _check_rows(texture.corners, len(uv))
        if len(texture.corners) != len(part.faces):
            raise ValueError("a part has an unexpected number of texture coordinates")


def _check_body(draft: Draft) -> None:
    body = draft.body
    if body is None:
        raise ValueError("the object has no mass properties")
    numbers = [float(v) for v in (body.mass_kg, draft.mass_kg, *body.center_of_mass, *body.inertia)]
    ixx, iyy, izz, ixy, ixz, iyz = (float(v) for v in body.inertia)
    moments = np.linalg.eigvalsh(np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]]))
    if not all(map(math.isfinite, numbers)) or min(numbers[:2]) <= 0.0 or moments[0] <= 0.0:
        raise ValueError("the mass or the inertia of the object is not physically possible")


def _imported(head: dict[str, Any], arrays: dict[str, np.ndarray]) -> Imported:
    parts: dict[int, VisualPart | CollisionPart] = {}
    for form in head["visual"]:
        k = form["part"]
        texture = None
        if form["painted"]:
            texture = Texture(arrays[f"{k}_pixels"], arrays[f"{k}_uv"], arrays.get(f"{k}_corners"))
        parts[k] = VisualPart(
            form["name"],
            arrays[f"{k}_vertices"],
            arrays[f"{k}_faces"],
            tuple(form["rgba"]),
            form["specular"],
            form["shininess"],
            texture,
            form["smooth"],
        )
    for form in head["collision"]:
        k = form["part"]
        parts[k] = CollisionPart(
            "hull", (0.0, 0.0, 0.0), vertices=arrays[f"{k}_vertices"], friction=tuple(form["friction"])
        )
    body = head["body"]
    draft = Draft(
        shape=head["shape"],
        description=head["description"],
        tags=tuple(head["tags"]),
        mass_kg=head["mass_kg"],
        parts=tuple(parts[k] for k in sorted(parts)),
        body=MassProperties(body["mass_kg"], tuple(body["center_of_mass"]), tuple(body["inertia"])),
        grasps=tuple(_grasp(form) for form in head["grasps"]),
        regions=tuple(
            Region(r["name"], tuple(r["position"]), tuple(r["half_size"]), tuple(r["quaternion"]))
            for r in head["regions"]
        ),
        parameters=head["parameters"],
        source=head["source"],
        license=head["license"],
    )
    kind = None if head["kind"] is None else kind_of(head["kind"])
    return Imported(draft, Fit(**head["fit"]), kind, tuple(head["notes"]))


def _grasp(form: dict[str, Any]) -> Grasp:
    pose = Pose(tuple(form["pose"]["position"]), tuple(form["pose"]["quaternion"]))
    return Grasp(**{**form, "pose": pose})
