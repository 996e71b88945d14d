"""Description of a static benchmark: its data, its groups of items, and the rule for its headline number."""

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
    """Rule for computing the headline number of a benchmark.

    Attributes:
        rule: "micro" for the mean over all items, "macro" for the unweighted mean over groups.
        over: Kind of group over which a macro mean is taken, such as "split".
        among: Names of the groups that a macro mean includes. All other groups are reported separately. Empty if all
            groups are included.
    """

    rule: Literal["micro", "macro"] = "micro"
    over: str = ""
    among: tuple[str, ...] = ()

    @property
    def words(self) -> str:
        """Description of the rule for the headline number in words."""
        if self.rule == "micro":
            return "micro: mean over all items"
        return f"macro: mean of {' and '.join(self.among) or f'all groups of {self.over}'}"


@dataclass(frozen=True, slots=True)
class DataFile:
    """A file of the published data.

    Attributes:
        path: Path of the file in the hub repository.
        megabytes: Published size [MB], or None if unknown.
        sha256: SHA-256 of the file, or None if unknown.
    """

    path: str
    megabytes: float | None = None
    sha256: str | None = None


@dataclass(frozen=True, slots=True)
class DataSource:
    """Origin of a benchmark's data, and the terms under which the data may be used.

    Attributes:
        repository: Data set on the Hugging Face hub, as OWNER/NAME. Empty if nothing must be downloaded.
        files: Files to download.
        license: License of the questions.
        terms: Terms of the images and videos, and a list of the files that cannot be downloaded.
        layout: Paths of the files that a data folder must contain. There is one string for each published format.
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
        title: Name that is shown in tables.
        read: Function that reads the data in a folder, in any of the published formats.
        source: Origin of the data, and the terms under which it may be used.
        headline: Rule by which the headline number is computed.
        groups: Kinds of groups, in the order in which tables show them.
        coordinates: Default coordinate convention of betterbench's own prompt. None if no answers are points or boxes.
        published: Number of items in the published data, or None if the number is not fixed.
        published_groups: Kind of group, with the published number of items in each group of this kind.
        columns: Kind of group that the paper's Table 3 shows as columns. Empty if the table shows a single number.
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
            InvalidInputError: If the folder does not contain data of this benchmark, or a row is invalid.
        """
        if not folder.exists():
            raise InvalidInputError("--data", f"{folder} does not exist", f"Run `better vlm fetch {self.name}`")
        return self.read(folder)


def missing(name: str, folder: Path, layout: tuple[str, ...]) -> InvalidInputError:
    """Return the error for a folder that does not contain data of a benchmark."""
    return InvalidInputError("--data", f"{folder} contains no data of {name}", f"Expected {'; or '.join(layout)}")
