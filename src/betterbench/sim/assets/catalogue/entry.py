"""Type of a row in the asset catalogue."""

from __future__ import annotations

from dataclasses import dataclass

from betterbench.geometry import Vector
from betterbench.sim.assets.licenses import license_kind


@dataclass(frozen=True, slots=True, kw_only=True)
class CatalogueEntry:
    """One asset in the catalogue.

    Attributes:
        id: Unique name, such as "procedural/mug-red" or "objaverse/UID".
        source: Name of the asset's source, such as "procedural" or "kenney_food".
        name: Common noun for the object, such as "coffee mug".
        content_hash: SHA-256 of the file's content (64 hex digits). For a generated asset, this is the hash of the
            asset. Empty if the file has not been downloaded.
        path: Absolute path of the file. Empty if the asset has no file.
        description: Free text.
        category: Kind of object. Empty if the source does not state it.
        color: Color word. Empty if the color is not known.
        size_m: Extents in the unit of the file. The unit is assumed to be a meter, although few collections use meters.
            None if the extents are unknown.
        faces: Number of triangles. None if unknown.
        license: Name of the license. Empty if unknown.
        author: Author of the asset.
        variants: Number of variants of a generated object, or 1 for an object in a file.
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
        """Text that the text encoder converts to a vector: the name, the description and the tags."""
        said = ". ".join(part.rstrip(".") for part in (self.name, self.description, ", ".join(self.tags)) if part)
        return said[:400]

    @property
    def largest_m(self) -> float | None:
        """Largest extent [m], or None if unknown."""
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
