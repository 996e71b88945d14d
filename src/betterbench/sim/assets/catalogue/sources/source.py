"""Interface for asset sources, and the registry of all source kinds."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.sim.assets.catalogue.entry import CatalogueEntry


@dataclass(frozen=True, slots=True)
class SourceItem:
    """Asset of a source whose row has not been read yet.

    Attributes:
        id: Id of the row.
        fingerprint: Text that changes if the row must be read again.
        read: Returns the row; raises a BetterError if the asset cannot be used.
    """

    id: str
    fingerprint: str
    read: Callable[[], CatalogueEntry]


class AssetSource(Protocol):
    """Source: a collection of assets that can be listed."""

    @property
    def name(self) -> str:
        """Source name in the catalogue."""

    @property
    def address(self) -> str:
        """Address with which the same source can be opened again."""

    def items(self, *, on_skip: Callable[[str, str], None]) -> Iterator[SourceItem]:
        """Yield the assets in a fixed order; call ``on_skip`` with the name and the reason for each skipped asset."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SourceOptions:
    """Options for a source, given by the user.

    Attributes:
        name: Source name in the catalogue; by default, the name of the source.
        license: License of assets without one.
        author: Author of assets without one.
    """

    name: str = ""
    license: str = ""
    author: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class SourceKind:
    """Kind of source.

    Attributes:
        scheme: First part of its addresses, before the colon and the target.
        shown: Displayed form of its addresses ("folder:PATH").
        summary: One sentence about its assets.
        open: Opens the source for a target (may be empty); raises a BetterError on failure.
    """

    scheme: str
    shown: str
    summary: str
    open: Callable[[str, SourceOptions], AssetSource]


SOURCES: dict[str, SourceKind] = {}
"""All kinds of sources by scheme."""


def register(kind: SourceKind) -> SourceKind:
    """Register a kind of source, and return it.

    Raises:
        ValueError: If another kind already has this scheme.
    """
    if SOURCES.setdefault(kind.scheme, kind) is not kind:
        raise ValueError(f"another kind of sources is called {kind.scheme!r}; give this one another scheme")
    return kind


def open_source(address: str, options: SourceOptions | None = None) -> AssetSource:
    """Open the source at an address; for a folder, the path of an existing folder is enough.

    Raises:
        UnknownNameError: If no kind has such addresses.
        InvalidInputError: If the source cannot be read.
        MissingDependencyError: If its package is not installed.
    """
    scheme, colon, target = address.partition(":")
    chosen = options or SourceOptions()
    if scheme in SOURCES:
        return SOURCES[scheme].open(target, chosen)
    if Path(address).is_dir():
        return SOURCES["folder"].open(address, chosen)
    if not colon and ("/" in address or address.startswith(".")):
        raise InvalidInputError(address, "the folder does not exist", "Give a folder of mesh files")
    raise UnknownNameError("source of assets", scheme, SOURCES)
