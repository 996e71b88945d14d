"""The procedural library as an asset source.

The catalogue has one row for each category and color. A row represents all variants of the object.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from betterbench.errors import InvalidInputError
from betterbench.sim.assets.authoring.registry import build, categories, colors, looks
from betterbench.sim.assets.catalogue.entry import CatalogueEntry
from betterbench.sim.assets.catalogue.sources.source import SourceItem, SourceKind, SourceOptions, register
from betterbench.version import __version__

NAME = "procedural"
AUTHOR = "betterbench"


def asset_address(entry_id: str) -> tuple[str, str, int]:
    """Parse the id of a catalogue row or of one variant, and return the category, the color and the variant number.

    For example, "procedural/mug-red" is the id of a row, and "procedural/mug-red#3" is the id of a variant. If the id
    is that of a row, the variant number is 0.

    Raises:
        InvalidInputError: If the id has a different form.
    """
    rest, _, look = entry_id.removeprefix(f"{NAME}/").partition("#")
    category, _, color = rest.rpartition("-")
    if not entry_id.startswith(f"{NAME}/") or not category or not (look or "0").isdecimal():
        raise InvalidInputError(
            "id", f"{entry_id!r} is not an asset of the procedural library", "Write an id such as procedural/mug-red#3"
        )
    return category, color, int(look or "0")


@dataclass(frozen=True, slots=True)
class _Procedural:
    """Asset source that contains the objects of all registered generators."""

    name: str = NAME
    address: str = NAME

    def items(self, *, on_skip: Callable[[str, str], None]) -> Iterator[SourceItem]:
        del on_skip
        for category in categories():
            for color in colors(category):
                yield SourceItem(f"{NAME}/{category}-{color}", f"betterbench {__version__}", _reader(category, color))


def _reader(category: str, color: str) -> Callable[[], CatalogueEntry]:
    def read() -> CatalogueEntry:
        asset = build(category, look=looks(category)[0], color=color)
        return CatalogueEntry(
            id=f"{NAME}/{category}-{color}",
            source=NAME,
            name=category.replace("_", " "),
            content_hash=asset.content_hash(),
            description=asset.description,
            tags=asset.tags,
            category=category,
            color=color,
            size_m=asset.size_m,
            faces=asset.face_count,
            license=asset.license,
            author=AUTHOR,
            variants=len(looks(category)),
        )

    return read


def _open(target: str, options: SourceOptions) -> _Procedural:
    if target or options.license or options.author or options.name:
        raise InvalidInputError(
            NAME, "it does not take a target, license, author or name", f"Use only the address {NAME}"
        )
    return _Procedural()


register(
    SourceKind(
        scheme=NAME,
        shown=NAME,
        summary="Objects of the built-in generators, each in several looks; Apache-2.0.",
        open=_open,
    )
)
