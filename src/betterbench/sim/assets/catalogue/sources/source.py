"""Interface of asset sources, and the registry of all kinds of sources."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.sim.assets.catalogue.entry import CatalogueEntry


@dataclass(frozen=True, slots=True)
class SourceItem:
    """An asset in a source. Its catalogue row is only read when it is needed.

    Attributes:
        id: Id of the asset's row.
        fingerprint: String that changes whenever the row must be read again.
        read: Function that returns the row. It raises a BetterError if the asset cannot be used.
    """

    id: str
    fingerprint: str
    read: Callable[[], CatalogueEntry]


class AssetSource(Protocol):
    """A source of assets, i.e. a collection of assets that can be listed."""

    @property
    def name(self) -> str:
        """Name of the source in the catalogue."""

    @property
    def address(self) -> str:
        """Address for opening the same source again."""

    def items(self, *, on_skip: Callable[[str, str], None]) -> Iterator[SourceItem]:
        """Yield the assets in a fixed order. For each skipped asset, call ``on_skip`` with its name and the reason."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SourceOptions:
    """Options for a source, given by the user.

    Attributes:
        name: Name of the source in the catalogue. If empty, the source determines it.
        license: License of assets that do not state a license.
        author: Author of assets that do not state an author.
    """

    name: str = ""
    license: str = ""
    author: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class SourceKind:
    """Kind of asset source.

    Attributes:
        scheme: Part before the colon in the addresses of such sources.
        shown: Form of these addresses for display ("folder:PATH").
        summary: One sentence that describes the assets in such sources.
        open: Function that opens the source. It takes the text after the colon in the address, which may be empty, and
            raises a BetterError if the source cannot be opened.
    """

    scheme: str
    shown: str
    summary: str
    open: Callable[[str, SourceOptions], AssetSource]


SOURCES: dict[str, SourceKind] = {}
"""All kinds of sources by scheme."""


def register(kind: SourceKind) -> SourceKind:
    """Register a kind of source and return it.

    Raises:
        ValueError: If a different kind of source already has this scheme.
    """
    if SOURCES.setdefault(kind.scheme, kind) is not kind:
        raise ValueError(
            f"a kind of source with the scheme {kind.scheme!r} is already registered; choose a different scheme"
        )
    return kind


def open_source(address: str, options: SourceOptions | None = None) -> AssetSource:
    """Open the asset source at an address such as "folder:PATH". A folder can also be given by its path alone.

    Raises:
        UnknownNameError: If no kind of source has the scheme of the address.
        InvalidInputError: If the source cannot be read.
        MissingDependencyError: If a package that the source needs is not installed.
    """
    scheme, colon, target = address.partition(":")
    chosen = options or SourceOptions()
    if scheme in SOURCES:
        return SOURCES[scheme].open(target, chosen)
    if Path(address).is_dir():
        return SOURCES["folder"].open(address, chosen)
    if not colon and ("/" in address or address.startswith(".")):
        raise InvalidInputError(address, "the folder does not exist", "Pass the path of a folder of mesh files")
    raise UnknownNameError("source of assets", scheme, SOURCES)
