"""Manifest of a folder with imported assets."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from pydantic import Field, TypeAdapter

from betterbench.errors import InvalidInputError, one_line
from betterbench.geometry import Vector
from betterbench.json_form import read_bounded, read_form, strict_form
from betterbench.tasks.user_files import ASSET_MANIFEST

FORMAT = 1
"""Version of the manifest format."""
_MAX_MANIFEST_BYTES = 64 << 20
CURE = "Import the assets again with better assets import"
"""Remedy for a damaged folder."""
_NAME = re.compile(r"[a-z][a-z0-9_]{0,63}")

_Text = Annotated[str, Field(max_length=500)]
_Digest = Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
_Positive = Annotated[float, Field(gt=0.0)]


@strict_form
@dataclass(frozen=True, slots=True, kw_only=True)
class FolderAsset:
    """Entry of a folder's manifest for one asset.

    Attributes:
        file: File name in the folder.
        sha256: SHA-256 of the file.
        color: Color word.
        kind: Kind that determined size and mass. It is empty if unknown.
        size_m: Extents of the bounding box [m].
        mass_kg: Mass.
        license: License of the mesh.
        author: Author of the mesh, or empty if unknown.
        source: Origin of the mesh.
        source_files: SHA-256 of each source file by name. The first is the file given by the user.
        options: Options of the import.
        notes: Decisions of the importer, with their reasons.
        importer: Version of the importer.
    """

    file: _Text
    sha256: _Digest
    color: _Text
    kind: _Text = ""
    size_m: Vector
    mass_kg: _Positive
    license: _Text
    author: _Text = ""
    source: _Text
    source_files: dict[_Text, _Digest] = field(default_factory=dict)
    options: dict[str, str | float | bool] = field(default_factory=dict)
    notes: tuple[_Text, ...] = ()
    importer: int = 1


@strict_form
@dataclass(frozen=True, slots=True, kw_only=True)
class Manifest:
    """Manifest of a folder: its assets, by their names in tasks."""

    format: int
    assets: dict[str, FolderAsset]


_MANIFEST = TypeAdapter(Manifest)


def read_manifest(text: bytes | str, where: str) -> Manifest:
    """Parse a manifest.

    Raises:
        InvalidInputError: If the text is not a manifest, or an asset's name or a file is invalid.
    """
    found = read_form(_MANIFEST, text, where=where, cure=CURE)
    if found.format != FORMAT:
        raise InvalidInputError(where, f"it has the format {found.format}, expected {FORMAT}", CURE)
    for name, asset in found.assets.items():
        if not _NAME.fullmatch(name):
            problem = f"{one_line(repr(name), most=80)} is not a valid asset name"
            raise InvalidInputError(
                where, problem, "Use lower-case letters, digits and underscores, and begin with a letter"
            )
        if asset.file != f"{name}.npz":
            problem = f"the file of {name} is {one_line(repr(asset.file), most=80)}, expected {name}.npz"
            raise InvalidInputError(where, problem, CURE)
    return found


def manifest_of(folder: Path) -> Manifest:
    """Return the manifest of a folder, or an empty manifest if the folder has none.

    Raises:
        InvalidInputError: If the manifest cannot be read.
    """
    path = folder / ASSET_MANIFEST
    if not path.is_file():
        return Manifest(format=FORMAT, assets={})
    return read_manifest(read_bounded(path, max_bytes=_MAX_MANIFEST_BYTES, cure=CURE), str(path))


def manifest_bytes(assets: Mapping[str, FolderAsset]) -> bytes:
    """Return a manifest's text, sorted by name."""
    ordered = {name: assets[name] for name in sorted(assets)}
    return _MANIFEST.dump_json(Manifest(format=FORMAT, assets=ordered), indent=1) + b"\n"


def is_asset_name(name: str) -> bool:
    """Return whether a name has only lower-case letters, digits and underscores, and begins with a letter."""
    return _NAME.fullmatch(name) is not None
