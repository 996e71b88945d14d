"""Hash of a mesh file and of all files that it refers to. The hash identifies an object in a review."""

from __future__ import annotations

import hashlib
import json
import struct
from pathlib import Path

from betterbench.errors import BetterError, one_line
from betterbench.json_form import read_bounded
from betterbench.sim.assets.importing.mesh_file import MAX_FILE_BYTES, FolderResolver


def content_hash(path: Path) -> str:
    """Return the hexadecimal SHA-256 of a mesh file with its materials, textures and buffers.

    A referenced file that cannot be read counts as missing. The import of the mesh then raises an error.

    Raises:
        InvalidInputError: If the mesh file itself cannot be read.
    """
    data = read_bounded(path, max_bytes=MAX_FILE_BYTES, cure="Reduce the mesh in a mesh editor")
    digest = hashlib.sha256(hashlib.sha256(data).digest())
    resolver = FolderResolver(path.parent, one_line(path.name, most=120))
    queue, seen = _references(path.suffix.lower(), data), set[str]()
    while queue:
        name = queue.pop(0)
        if name in seen:
            continue
        seen.add(name)
        try:
            found = resolver.get(name)
        except BetterError:
            digest.update(f"missing {name}\n".encode())
            continue
        digest.update(f"{name}\n".encode() + hashlib.sha256(found).digest())
        queue += _references(Path(name).suffix.lower(), found)
    return digest.hexdigest()


def _references(suffix: str, data: bytes) -> list[str]:
    """Return the names of the files that a file refers to, in the order in which they appear."""
    if suffix == ".obj":
        return _after(data, (b"mtllib",))
    if suffix == ".mtl":
        return [name.split()[-1] for name in _after(data, (b"map_", b"bump", b"disp", b"decal", b"norm", b"refl"))]
    if suffix == ".glb":
        data = data[20 : 20 + struct.unpack("<I", data[12:16])[0]] if len(data) >= 20 else b""
    elif suffix != ".gltf":
        return []
    try:
        form = json.loads(data)
        listed = [item.get("uri") for key in ("buffers", "images") for item in form.get(key, ())]
    except (ValueError, RecursionError, AttributeError, TypeError):
        return []
    return [uri for uri in listed if isinstance(uri, str) and not uri.startswith("data:")]


def _after(data: bytes, keywords: tuple[bytes, ...]) -> list[str]:
    """Return the rest of each line that begins with one of the keywords, without the keyword."""
    found = []
    for line in data.splitlines():
        words = line.strip().split(None, 1)
        if len(words) == 2 and words[0].lower().startswith(keywords):
            found.append(words[1].decode("utf-8", "replace").strip())
    return found
