"""Manifest of an asset folder, which lists the imported assets."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from pydantic import Field, TypeAdapter

from betterbench.errors import InvalidInputError, one_line
from betterbench.geometry import Vector
from betterbench.json_form import Digest, read_bounded, read_form, strict_form
from betterbench.tasks.user_files import ASSET_MANIFEST

FORMAT = 1
"""Version of the manifest format."""
_MAX_MANIFEST_BYTES = 64 << 20
CURE = "Import the assets again with `better assets import`"
"""Remedy for a damaged folder."""
_NAME = re.compile(r"[a-z][a-z0-9_]{0,63}")

_Text = Annotated[str, Field(max_length=500)]
_Positive = Annotated[float, Field(gt=0.0)]


@strict_form
@dataclass(frozen=True, slots=True, kw_only=True)
class FolderAsset:
    """Entry for one asset in the manifest of a folder.

    Attributes:
        file: Name of the asset's file in the folder.
        sha256: SHA-256 of the file.
        color: Color word.
        kind: Kind of object. The size and the mass were determined from it. Empty if the kind is unknown.
        size_m: Extents of the bounding box [m].
        mass_kg: Mass.
        license: License of the mesh.
        author: Author of the mesh. Empty if unknown.
        source: Where the mesh comes from.
        source_files: SHA-256 of each source file, keyed by its name. The first is the file that the user gave.
        options: Options of the import.
        notes: What the importer decided, and why.
        importer: Version of the importer.
    """

    file: _Text
    sha256: Digest
    color: _Text
    kind: _Text = ""
    size_m: Vector
    mass_kg: _Positive
    license: _Text
    author: _Text = ""
    source: _Text
    source_files: dict[_Text, Digest] = field(default_factory=dict)
    options: dict[str, str | float | bool] = field(default_factory=dict)
    notes: tuple[_Text, ...] = ()
    importer: int = 1


@strict_form
@dataclass(frozen=True, slots=True, kw_only=True)
class Manifest:
    """Manifest of an asset folder. The keys of ``assets`` are the names that tasks use for the assets."""

    format: int
    assets: dict[str, FolderAsset]


_MANIFEST = TypeAdapter(Manifest)


def read_manifest(text: bytes | str, where: str) -> Manifest:
    """Parse the text of a manifest.

    Raises:
        InvalidInputError: If the text is not a manifest, or the name or the file of an asset is invalid.
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
    """Read the manifest of a folder. If the folder has none, return an empty manifest.

    Raises:
        InvalidInputError: If the manifest cannot be read.
    """
    path = folder / ASSET_MANIFEST
    if not path.is_file():
        return Manifest(format=FORMAT, assets={})
    return read_manifest(read_bounded(path, max_bytes=_MAX_MANIFEST_BYTES, cure=CURE), str(path))


def manifest_bytes(assets: Mapping[str, FolderAsset]) -> bytes:
    """Serialize a manifest, with the assets sorted by name."""
    ordered = {name: assets[name] for name in sorted(assets)}
    return _MANIFEST.dump_json(Manifest(format=FORMAT, assets=ordered), indent=1) + b"\n"


def is_asset_name(name: str) -> bool:
    """Return whether a name begins with a letter and uses only lower-case letters, digits and underscores."""
    return _NAME.fullmatch(name) is not None
