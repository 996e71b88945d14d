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
        path: Path in the hub repository.
        megabytes: Published size [MB]; None if unknown.
        sha256: SHA-256, if known.
    """

    path: str
    megabytes: float | None = None
    sha256: str | None = None


@dataclass(frozen=True, slots=True)
class DataSource:
    """Source and license terms of a benchmark's data.

    Attributes:
        repository: Data set on the Hugging Face hub, as OWNER/NAME; empty if nothing must be downloaded.
        files: Files to download.
        license: License of the questions.
        terms: Terms of images and videos, and what cannot be downloaded.
        layout: Required files and their paths, one phrase per published format.
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
        read: Function that reads the data in a folder, in any published format.
        source: Origin and terms of the data.
        headline: Rule for the headline number.
        groups: Kinds of groups, in the order in which tables show them.
        coordinates: Default convention of our own prompt; None for a benchmark without points and boxes.
        published: Number of items in the published data; None if it is not fixed.
        published_groups: Kind of group, and the published number of items by group name.
        columns: Kind of group that is shown as columns in the paper's Table 3; empty for a benchmark with a single
            number.
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
    """Return the error for a folder that contains no data of a benchmark."""
    return InvalidInputError("--data", f"{folder} contains no data of {name}", f"Expected {'; or '.join(layout)}")
