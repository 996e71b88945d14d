"""Asset source for folders of mesh files: GLB, glTF, OBJ, STL, URDF and MJCF."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pydantic import Field, TypeAdapter

from betterbench.errors import BetterError, InvalidInputError, one_line
from betterbench.json_form import dump_json, file_digest, read_bounded, read_form, strict_form
from betterbench.sim.assets.catalogue.entry import CatalogueEntry
from betterbench.sim.assets.catalogue.sources.mesh_facts import ENDINGS, MeshFacts, mesh_facts
from betterbench.sim.assets.catalogue.sources.source import SourceItem, SourceKind, SourceOptions, register
from betterbench.sim.assets.licenses import license_name
from betterbench.sim.assets.names import file_words, named_by, words_of

SIDECARS = ("assets.json", "assets.csv")
"""Possible names of the sidecar file, which describes the assets in a folder."""

MAX_FILE_BYTES = 512 << 20
"""Maximum size of a file that is indexed [byte]."""
_MAX_SIDECAR_BYTES = 64 << 20
_CURE = "See docs/asset-catalogue.md for its fields"

_Text = Annotated[str, Field(max_length=2000)]


@strict_form
@dataclass(frozen=True, slots=True)
class _Described:
    """Description of one asset, read from the sidecar file of a folder."""

    file: _Text
    name: _Text = ""
    description: _Text = ""
    category: _Text = ""
    color: _Text = ""
    license: _Text = ""
    author: _Text = ""
    tags: Annotated[tuple[Annotated[str, Field(max_length=200)], ...], Field(max_length=100)] = ()


_DESCRIBED = TypeAdapter(tuple[_Described, ...])


@dataclass(frozen=True, slots=True)
class _Folder:
    """Asset source that contains the mesh files in a folder and its subfolders."""

    root: Path
    name: str
    options: SourceOptions

    @property
    def address(self) -> str:
        """Address of the folder, ``folder:PATH``."""
        return f"folder:{self.root}"

    def items(self, *, on_skip: Callable[[str, str], None]) -> Iterator[SourceItem]:
        """Yield one item for each object. Meshes used by a URDF or MJCF file are part of the object in that file."""
        described, stamp = _sidecar(self.root)
        files = sorted(_mesh_files(self.root))
        used = _used_files(files, on_skip, self.root)
        chosen: dict[tuple[Path, str], Path] = {}
        for file in sorted((f for f in files if f not in used), key=_preference):
            chosen.setdefault(_object_of(file, self.root), file)
        for file in sorted(chosen.values()):
            inside = file.relative_to(self.root).as_posix()
            status = file.stat()
            told = described.get(inside)
            mark = f"{status.st_size} {status.st_mtime_ns} {stamp} {self.options!r}"
            yield SourceItem(f"{self.name}/{inside}", mark, _reader(self, file, inside, told))


def _reader(folder: _Folder, file: Path, inside: str, told: _Described | None) -> Callable[[], CatalogueEntry]:
    def read() -> CatalogueEntry:
        size = file.stat().st_size
        if size > MAX_FILE_BYTES:
            raise InvalidInputError(
                inside, f"it has {size} bytes, more than {MAX_FILE_BYTES}", "Reduce the number of triangles in the mesh"
            )
        facts = mesh_facts(file)
        named = told or _Described(inside)
        return CatalogueEntry(
            id=f"{folder.name}/{inside}",
            source=folder.name,
            name=named.name or " ".join(file_words(file, folder.root)),
            content_hash=file_digest(file),
            path=str(file),
            description=named.description,
            tags=named.tags,
            category=named.category,
            color=named.color,
            size_m=facts.size,
            faces=facts.faces,
            license=license_name(named.license or folder.options.license),
            author=named.author or folder.options.author,
        )

    return read


def _mesh_files(root: Path) -> Iterator[Path]:
    """Yield all files with a mesh extension. Hidden files and links are left out."""
    for place, folders, names in os.walk(root):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        for name in names:
            file = Path(place) / name
            if file.suffix.lower() in ENDINGS and not name.startswith(".") and file.is_file() and not file.is_symlink():
                yield file


def _used_files(files: list[Path], on_skip: Callable[[str, str], None], root: Path) -> set[Path]:
    """Return the files that are not separate objects.

    These are files used by a URDF or MJCF file, and XML files that do not describe an object.
    """
    found: set[Path] = set()
    for file in files:
        if file.suffix.lower() not in (".urdf", ".xml"):
            continue
        try:
            facts = mesh_facts(file)
        except BetterError as error:
            on_skip(file.relative_to(root).as_posix(), str(error))
            facts = MeshFacts(is_asset=False)
        if not facts.is_asset:
            found.add(file)
        found |= {Path(os.path.normpath(file.parent / name)) for name in facts.refers_to if "\0" not in name}
    return found


def _preference(file: Path) -> tuple[int, str]:
    return ENDINGS.index(file.suffix.lower()), file.as_posix()


def _object_of(file: Path, root: Path) -> tuple[Path, str]:
    """Return a key that is the same for all files of one object.

    If the object is named by the folder, the key is the folder. Otherwise, it is the folder and the file name without
    suffix.
    """
    place, stem = named_by(file, root)
    return (place, "") if stem is None else (file.parent, stem)


def _sidecar(root: Path) -> tuple[Mapping[str, _Described], str]:
    """Return the description of each file in the folder's sidecar file, and a fingerprint of the sidecar file."""
    there = [root / name for name in SIDECARS if (root / name).is_file()]
    if not there:
        return {}, ""
    if len(there) > 1:
        raise InvalidInputError(str(root), f"it has both {SIDECARS[0]} and {SIDECARS[1]}", "Keep one of them")
    (path,) = there
    data = read_bounded(path, max_bytes=_MAX_SIDECAR_BYTES, cure=_CURE)
    rows = _csv_rows(path, data) if path.suffix == ".csv" else read_form(_DESCRIBED, data, where=str(path), cure=_CURE)
    found: dict[str, _Described] = {}
    for row in rows:
        if row.file in found:
            raise InvalidInputError(str(path), f"{one_line(row.file)!r} has two descriptions", "Keep one row per file")
        found[row.file] = row
    return found, file_digest(path)[:16]


def _csv_rows(path: Path, data: bytes) -> tuple[_Described, ...]:
    """Parse a CSV table with a header row. Tags are separated by semicolons."""
    try:
        table = csv.DictReader(io.StringIO(data.decode("utf-8-sig")), strict=True, restkey="")
        forms: list[dict[str, object]] = []
        for row in table:
            form: dict[str, object] = {key: value for key, value in row.items() if value}
            tags = str(form.pop("tags", ""))
            forms.append({**form, "tags": [tag.strip() for tag in tags.split(";") if tag.strip()]})
    except (UnicodeDecodeError, csv.Error) as error:
        raise InvalidInputError(str(path), f"it is not a CSV table in UTF-8 ({error})", _CURE) from error
    return read_form(_DESCRIBED, dump_json(forms), where=str(path), cure=_CURE)


def _open(target: str, options: SourceOptions) -> _Folder:
    root = Path(target).absolute()
    if not target or not root.is_dir():
        raise InvalidInputError(
            target or "folder:", "it is not a folder", "Write the path of a folder of mesh files as folder:PATH"
        )
    name = options.name or "_".join(words_of(root.name)) or "folder"
    if "/" in name or not name.isprintable() or name in ("procedural", "objaverse"):
        raise InvalidInputError(
            "name",
            f"{one_line(name)!r} is not a valid source name",
            "Use --name with a printable name that contains no slashes",
        )
    return _Folder(root, name, options)


register(
    SourceKind(
        scheme="folder",
        shown="folder:PATH",
        summary="GLB, glTF, OBJ, STL, URDF and MJCF files of a folder, with an optional assets.json or assets.csv.",
        open=_open,
    )
)
