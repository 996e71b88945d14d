"""Objaverse as an asset source: published models, each with its own license and author.

``objaverse:FOLDER`` reads the files that the package ``objaverse`` stores on disk (``metadata/*.json.gz``,
``lvis-annotations.json.gz``, ``object-paths.json.gz``, ``glbs/``) and does not need a network. If the address is only
``objaverse``, the package first downloads the annotations.
"""

from __future__ import annotations

import gzip
import importlib
import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from betterbench.errors import InvalidInputError, described
from betterbench.installation import missing_packages
from betterbench.json_form import file_digest, parse_json
from betterbench.ordinary_file import open_ordinary
from betterbench.sim.assets.catalogue.entry import CatalogueEntry
from betterbench.sim.assets.catalogue.sources.source import SourceItem, SourceKind, SourceOptions, register
from betterbench.sim.assets.licenses import license_name

NAME = "objaverse"
MAX_JSON_BYTES = 512 << 20
"""Maximum size of an unpacked annotation file [byte]. The published files have about 30 MB, except
``object-paths.json.gz``, which has 80 MB."""
_CURE = "Download it again with the package objaverse"
_LONGEST = 600
"""Maximum length of a stored description [characters]."""
_MOST_TAGS = 24
_UID = frozenset("0123456789abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ-_")


@dataclass(frozen=True, slots=True)
class _Objaverse:
    """Objaverse models that are described by the annotations in a folder."""

    root: Path
    name: str = NAME

    @property
    def address(self) -> str:
        """Address of the folder, ``objaverse:FOLDER``."""
        return f"{NAME}:{self.root}"

    def items(self, *, on_skip: Callable[[str, str], None]) -> Iterator[SourceItem]:
        """Yield one item for each annotated model. If an annotation file cannot be read, its models are skipped."""
        categories = _categories(self.root, on_skip)
        places = _object(self.root / "object-paths.json.gz", on_skip)
        for shard in sorted((self.root / "metadata").glob("*.json.gz")):
            status = shard.stat()
            stamp = f"{status.st_size} {status.st_mtime_ns}"
            for uid, annotation in _object(shard, on_skip).items():
                if not uid or not set(uid) <= _UID or not isinstance(annotation, dict):
                    on_skip(f"{shard.name}: {uid}", "the annotation is not an object with a plain uid")
                    continue
                file = self._local_file(places.get(uid))
                mark = f"{stamp} {categories.get(uid, '')} {'' if file is None else file.stat().st_size}"
                yield SourceItem(f"{NAME}/{uid}", mark, _reader(uid, annotation, categories.get(uid, ""), file))

    def _local_file(self, told: object) -> Path | None:
        """Return the path of a model's mesh in the folder, or None if the mesh has not been downloaded."""
        if not isinstance(told, str) or "\0" in told:
            return None
        file = self.root / told
        if ".." in Path(told).parts or Path(told).is_absolute() or not file.is_file():
            return None
        return file


def _reader(uid: str, annotation: Mapping[str, Any], category: str, file: Path | None) -> Callable[[], CatalogueEntry]:
    def read() -> CatalogueEntry:
        user = annotation.get("user")
        author = _text(user.get("displayName") or user.get("username")) if isinstance(user, dict) else _text(user)
        faces = annotation.get("faceCount")
        tags = [*_names(annotation.get("tags")), *_names(annotation.get("categories"))]
        return CatalogueEntry(
            id=f"{NAME}/{uid}",
            source=NAME,
            name=_text(annotation.get("name"))[:200] or category or uid,
            content_hash="" if file is None else file_digest(file),
            path="" if file is None else str(file),
            description=_text(annotation.get("description"))[:_LONGEST],
            tags=tuple(dict.fromkeys(tags))[:_MOST_TAGS],
            category=category,
            faces=faces if isinstance(faces, int) and not isinstance(faces, bool) and 0 <= faces < 2**31 else None,
            license=license_name(_text(annotation.get("license"))),
            author=author[:200],
        )

    return read


def _text(value: object) -> str:
    return " ".join(value.split()) if isinstance(value, str) else ""


def _names(value: object) -> list[str]:
    """Return the names in a JSON list. Each element is either a name or a JSON object that contains a name."""
    listed = value if isinstance(value, list) else []
    found = (_text(one.get("name") if isinstance(one, dict) else one) for one in listed)
    return [name[:80] for name in found if name]


def _categories(root: Path, on_skip: Callable[[str, str], None]) -> dict[str, str]:
    """Return the LVIS category of each model, with spaces instead of underscores ("pop (soda)" for ``pop_(soda)``)."""
    found: dict[str, str] = {}
    for category, uids in _object(root / "lvis-annotations.json.gz", on_skip).items():
        if isinstance(uids, list):
            found.update({uid: category.replace("_", " ") for uid in uids if isinstance(uid, str)})
    return found


def _object(path: Path, on_skip: Callable[[str, str], None]) -> dict[str, Any]:
    """Return the JSON object in a gzip file.

    The result is empty if the file is missing or damaged. If it is damaged, ``on_skip`` is called with the reason.
    """
    if not path.exists():
        return {}
    try:
        with open_ordinary(path) as packed, gzip.open(packed) as stream:
            text = stream.read(MAX_JSON_BYTES + 1)
        form = parse_json(text) if len(text) <= MAX_JSON_BYTES else None
    except (OSError, EOFError, zlib.error, ValueError) as error:
        on_skip(path.name, f"is damaged ({getattr(error, 'strerror', None) or error})")
        return {}
    if not isinstance(form, dict):
        on_skip(path.name, f"is not a JSON object, or has more than {MAX_JSON_BYTES} bytes when unpacked")
        return {}
    return form


def _open(target: str, options: SourceOptions) -> _Objaverse:
    if options.license or options.author or options.name:
        raise InvalidInputError(
            NAME, "each model has its own license and author", "Leave out --license, --author and --name"
        )
    if not target:
        return _Objaverse(_downloaded())
    root = Path(target).absolute()
    if not (root / "metadata").is_dir():
        raise InvalidInputError(
            target, "it has no folder metadata", f"Pass the folder hf-objaverse-v1 of the package {NAME}. {_CURE}"
        )
    return _Objaverse(root)


def _downloaded() -> Path:
    """Download the annotations with the package objaverse, and return the folder where it stores them."""
    try:
        package = importlib.import_module(NAME)
    except ImportError as error:
        problem = "The source objaverse needs the package objaverse, which is not installed"
        raise missing_packages(problem, NAME, otherwise="or read its files from a folder: objaverse:FOLDER") from error
    try:
        package.load_annotations()
        package.load_lvis_annotations()
        root = Path(package._VERSIONED_PATH)
    except Exception as error:  # the package may raise any error
        problem = f"its annotations could not be downloaded ({described(error)})"
        raise InvalidInputError(
            NAME, problem, "Check the network connection, or read the files from a folder: objaverse:FOLDER"
        ) from error
    return root


register(
    SourceKind(
        scheme=NAME,
        shown="objaverse[:FOLDER]",
        summary="Models of Objaverse with their annotations, downloaded by the package objaverse or read from its "
        "folder.",
        open=_open,
    )
)
