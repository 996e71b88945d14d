"""Convert catalogue rows to requests for the job that imports assets."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from betterbench.errors import InvalidInputError, one_line
from betterbench.sim.assets.catalogue.entry import CatalogueEntry
from betterbench.sim.assets.folders.job import ImportRequest
from betterbench.sim.assets.importing.importer import Wishes
from betterbench.sim.assets.licenses import license_name


def request_of_row(entry: CatalogueEntry, given: ImportRequest | None = None) -> ImportRequest:
    """Return a request to import the asset of a catalogue row.

    Args:
        entry: The row.
        given: Options of the import. They override the name, license, author and color in the row.

    Raises:
        InvalidInputError: If the row belongs to the procedural library, or its mesh is not on this machine.
    """
    if entry.source == "procedural":
        name = entry.id.removeprefix("procedural/").rpartition("-")[0]
        raise InvalidInputError(entry.id, "it is already in the library", f"Use the category {name} in your task")
    if not entry.path:
        cure = "Download it first, with objaverse.load_objects, then index the source again"
        raise InvalidInputError(entry.id, "its mesh is not on this machine", cure)
    path = Path(entry.path)
    made = replace(given, path=path) if given is not None else ImportRequest(path=path)
    asked = made.wishes
    unlicensed = asked.license == Wishes().license
    wishes = replace(
        asked,
        name=asked.name or " ".join(part for part in (entry.category, entry.name) if part) or None,
        license=license_name(entry.license or "unknown") if unlicensed else asked.license,
        author=asked.author or entry.author or None,
        source=one_line(entry.id, most=200),
    )
    return replace(made, wishes=wishes, color=made.color or entry.color or None)
