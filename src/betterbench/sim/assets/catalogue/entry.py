"""Rows of the catalogue, and the terms of their licenses."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

from betterbench.geometry import Vector

LicenseKind = Literal["free", "restricted", "unknown"]
"""Use that a license allows: commercial use and changes (free), less than that (restricted), or not known."""

LicenseFilter = Literal["free", "any"]
"""Licenses that a search admits."""

_SPOKEN = (
    (r"non ?commercial", "nc"),
    (r"no ?deriv(ative)?s?", "nd"),
    (r"share ?alike", "sa"),
    (r"attribution", "by"),
    (r"creative commons", "cc"),
)
"""Long form of a condition of Creative Commons in small letters, and its letters."""

_CONDITIONS = ("by", "nc", "sa", "nd")
_FREE = re.compile(r"(apache|mit|bsd|isc|zlib|odc by|public domain|unlicense)\b.*")
LONGEST_LICENSE = 80
"""Most characters of the name of a license."""


def _plain(text: str) -> str:
    """Return the words of a license in small letters, its conditions by their letters."""
    plain = " ".join(re.sub(r"[^a-z0-9.]+", " ", text.lower()).split())
    for pattern, letters in _SPOKEN:
        plain = re.sub(rf"\b{pattern}\b", letters, plain)
    return plain


def license_name(text: str) -> str:
    """Return the usual name of a license: "by-nc" gives "CC-BY-NC-4.0". Names that are not known stay as they are.

    Without a version, a license of Creative Commons is taken for version 4.0, which Objaverse means.
    """
    said = " ".join(text.split())[:LONGEST_LICENSE]
    plain = _plain(said)
    if re.match(r"(cc ?0|cc zero|zero)\b", plain):
        return "CC0-1.0"
    words = plain.split()
    if "by" in words and (words[0] == "cc" or set(words) <= set(_CONDITIONS)):
        version = re.search(r"\d\.\d", plain)
        letters = [letter.upper() for letter in _CONDITIONS if letter in words]
        return "-".join(["CC", *letters, version[0] if version else "4.0"])
    return said


def license_kind(name: str) -> LicenseKind:
    """Return the kind of a license by the name that :func:`license_name` gives."""
    plain = _plain(name)
    if {"nc", "nd"} & set(plain.split()):
        return "restricted"
    known = re.match(r"cc ?0|cc by\b", plain) or _FREE.fullmatch(plain)
    return "free" if known else "unknown"


@dataclass(frozen=True, slots=True, kw_only=True)
class CatalogueEntry:
    """One asset of a source, as a row of the catalogue.

    Attributes:
        id: Name that no other row has ("procedural/mug-red", "objaverse/UID").
        source: Name of the source ("procedural", "kenney_food").
        name: Noun by which people would call it ("coffee mug").
        content_hash: SHA-256 of the bytes of its file (64 hex digits); of a generated asset, the hash of the asset;
            empty for a file that has not been downloaded.
        path: Absolute path of its file, empty for an asset without a file.
        description: Free text.
        category: Kind of object, empty if the source does not say it.
        color: Color word, empty if it is not known.
        size_m: Extents as the file has them, read as meters; None if unknown. Few collections keep to meters.
        faces: Number of triangles, None if unknown.
        license: Name of the license, empty if unknown.
        author: Person or group to name.
        variants: Number of looks that the source makes of it; 1 for a file.
    """

    id: str
    source: str
    name: str
    content_hash: str = ""
    path: str = ""
    description: str = ""
    tags: tuple[str, ...] = ()
    category: str = ""
    color: str = ""
    size_m: Vector | None = None
    faces: int | None = None
    license: str = ""
    author: str = ""
    variants: int = 1

    @property
    def text(self) -> str:
        """Sentence from which the encoder of meaning makes a vector."""
        said = ". ".join(part.rstrip(".") for part in (self.name, self.description, ", ".join(self.tags)) if part)
        return said[:400]

    @property
    def largest_m(self) -> float | None:
        """Largest extent [m], None if unknown."""
        return None if self.size_m is None else max(self.size_m)

    def to_json(self) -> dict[str, object]:
        """Return the row as a JSON object."""
        return {
            "id": self.id,
            "source": self.source,
            "name": self.name,
            "category": self.category,
            "color": self.color,
            "description": self.description,
            "tags": list(self.tags),
            "size_m": None if self.size_m is None else [round(float(side), 6) for side in self.size_m],
            "faces": self.faces,
            "license": self.license,
            "license_kind": license_kind(self.license),
            "author": self.author,
            "variants": self.variants,
            "path": self.path,
            "content_hash": self.content_hash,
        }
