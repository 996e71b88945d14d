"""Rows of the catalogue."""

from __future__ import annotations

from dataclasses import dataclass

from betterbench.geometry import Vector
from betterbench.sim.assets.licenses import license_kind


@dataclass(frozen=True, slots=True, kw_only=True)
class CatalogueEntry:
    """Catalogue row: one asset from a source.

    Attributes:
        id: Unique name ("procedural/mug-red", "objaverse/UID").
        source: Source name ("procedural", "kenney_food").
        name: Common noun for the object ("coffee mug").
        content_hash: SHA-256 of the file's bytes (64 hex digits); for a generated asset, the asset hash; empty for a
            file that has not been downloaded.
        path: Absolute path of the file, empty for an asset without a file.
        description: Free text.
        category: Object kind, empty if the source does not give it.
        color: Color word, empty if it is not known.
        size_m: Extents in the unit of the file, interpreted as meters, although few collections use meters; None if
            unknown.
        faces: Number of triangles, None if unknown.
        license: License name, empty if unknown.
        author: Asset author.
        variants: Number of looks that the source generates; 1 for a file.
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
        """Sentence that the text encoder maps to a vector."""
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
