"""Description of a static benchmark."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Literal

from betterbench.errors import InvalidInputError
from betterbench.vlm.items import ItemSet
from betterbench.vqa.coordinates import Coordinates


@dataclass(frozen=True, slots=True)
class Headline:
    """Rule for the headline number of a benchmark.

    Attributes:
        rule: "micro" for the mean over all items, "macro" for the unweighted mean over groups.
        over: Kind of group for a macro mean.
        among: Names of the groups in a macro mean; other groups are reported separately.
    """

    rule: Literal["micro", "macro"] = "micro"
    over: str = ""
    among: tuple[str, ...] = ()

    @property
    def words(self) -> str:
        """The rule in words."""
        if self.rule == "micro":
            return "micro: mean over all items"
        return f"macro: mean of {' and '.join(self.among) or f'all groups of {self.over}'}"


@dataclass(frozen=True, slots=True)
class DataFile:
    """A file of published data.

    Attributes:
        path: Path in the repository of the hub.
        megabytes: Size, as published; None if unknown.
        sha256: SHA-256, if known.
    """

    path: str
    megabytes: float | None = None
    sha256: str | None = None


@dataclass(frozen=True, slots=True)
class DataSource:
    """Origin and terms of a benchmark's data.

    Attributes:
        repository: Data set on the hub, as OWNER/NAME; empty if the data needs no download.
        files: Files to download.
        license: License of the questions.
        terms: Terms of images and videos, and what cannot be downloaded.
        layout: Required files and their places, one sentence per form of the data.
    """

    repository: str
    files: tuple[DataFile, ...]
    license: str
    terms: str
    layout: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Benchmark:
    """A static benchmark.

    Attributes:
        title: Name in tables.
        read: Reads the data in a folder, in any published form.
        source: Origin and terms of the data.
        headline: Rule for the headline number.
        groups: Kinds of groups in the order of tables.
        coordinates: Default convention of our own prompt; None for a benchmark without points and boxes.
        published: Number of items of the published data; None for data without a fixed number.
        published_groups: A kind of group, and the number of published items by name of the group.
        columns: Kind of group that the paper's Table 3 has as columns; empty for a benchmark with one number.
    """

    name: str
    title: str
    read: Callable[[Path], ItemSet]
    source: DataSource
    headline: Headline
    groups: tuple[str, ...]
    coordinates: Coordinates | None = None
    published: int | None = None
    published_groups: tuple[str, Mapping[str, int]] = ("", MappingProxyType({}))
    columns: str = ""

    def load(self, folder: Path) -> ItemSet:
        """Read the data in a folder.

        Raises:
            InvalidInputError: If the folder contains no data of this benchmark, or a row is invalid.
        """
        if not folder.exists():
            raise InvalidInputError("--data", f"{folder} does not exist", f"Run better vlm fetch {self.name}")
        return self.read(folder)


def missing(name: str, folder: Path, layout: tuple[str, ...]) -> InvalidInputError:
    """Return the error about a folder without data of a benchmark."""
    return InvalidInputError("--data", f"{folder} holds no data of {name}", f"Expected {'; or '.join(layout)}")
