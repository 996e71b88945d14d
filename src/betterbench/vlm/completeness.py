"""Check whether a data set is complete, by comparing its number of items with the published number."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from betterbench.vlm.benchmarks.benchmark import Benchmark
from betterbench.vlm.items import ItemSet


@dataclass(frozen=True, slots=True)
class Completeness:
    """Number of items in a data set, compared with the published number.

    Attributes:
        title: Title of the benchmark, for messages.
        n: Number of items in the data set.
        expected: Published number of items, or None if it is unknown or not fixed.
        groups: Number of items in the data set and published number for each group, keyed by the name of the group.
            Groups without a published number are left out.
    """

    title: str
    n: int
    expected: int | None
    groups: Mapping[str, tuple[int, int]]

    @property
    def is_complete(self) -> bool:
        """Whether the data set has as many items as the published data, in total and in each group."""
        return self.expected in (None, self.n) and all(n == expected for n, expected in self.groups.values())

    @property
    def sentence(self) -> str:
        """Sentence that describes the missing items. Empty if the data set is complete."""
        if self.is_complete:
            return ""
        differing = [f"{name} {n:,} of {of:,}" for name, (n, of) in self.groups.items() if n != of]
        groups = f" ({', '.join(differing)})" if differing else ""
        return (
            f"The data has {self.n:,} of the {self.expected or 0:,} items of {self.title}{groups}, so its scores are "
            f"not comparable with published scores."
        )

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict."""
        groups = {name: {"n": n, "expected": of} for name, (n, of) in self.groups.items()}
        return {**asdict(self), "groups": groups, "is_complete": self.is_complete}


def completeness_of(benchmark: Benchmark, items: ItemSet) -> Completeness:
    """Compare the number of items in a data set with the published number."""
    kind, published = benchmark.published_groups
    counted = Counter(_plain(item.groups.get(kind, "")) for item in items.items)
    groups = {name: (counted[_plain(name)], of) for name, of in published.items()}
    return Completeness(benchmark.title, len(items.items), benchmark.published, groups)


def _plain(name: str) -> str:
    """Return the first word of a group's name in lower case.

    Copies of the data spell names as "Daily life" or "daily_life".
    """
    return name.replace("_", " ").strip().lower().partition(" ")[0]
