"""Sources and licenses of the assets that appear in the trials of runs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol

from betterbench.records.run import RunFolder

LIBRARY_CREDIT = "betterbench procedural library, Apache-2.0"
"""Credit line for all objects of the procedural library, as in the project's license file."""


class CreditedObject(Protocol):
    """Scene object with the source and license of its asset. Both are empty for the procedural library."""

    @property
    def asset(self) -> str:
        """Identity of the asset ("my_mug-red#0")."""

    @property
    def source(self) -> str:
        """Source and author of the asset."""

    @property
    def license(self) -> str:
        """Name of the asset's license."""


@dataclass(frozen=True, slots=True, order=True)
class AssetCredit:
    """Source and license of one asset.

    Attributes:
        asset: Name and color of the asset ("my_mug-red").
        source: Source and author of the asset.
        license: Name of the asset's license.
    """

    asset: str
    source: str
    license: str

    @property
    def text(self) -> str:
        """Credit line for the asset."""
        return f"{self.asset}: {self.source}; license {self.license}"


def credits_of(objects: Iterable[CreditedObject]) -> tuple[AssetCredit, ...]:
    """Return the credits of all assets that are not from the procedural library, sorted and without duplicates."""
    found = {
        AssetCredit(each.asset.partition("#")[0], each.source, each.license or "unknown")
        for each in objects
        if each.source
    }
    return tuple(sorted(found))


def credit_lines(objects: Sequence[CreditedObject]) -> tuple[str, ...]:
    """Return one credit line for each asset with a source, and one for all objects of the procedural library."""
    lines = [credit.text for credit in credits_of(objects)]
    return (*lines, LIBRARY_CREDIT) if any(not each.source for each in objects) else tuple(lines)


def credits_of_runs(runs: Sequence[RunFolder]) -> tuple[str, ...]:
    """Return the credit lines for all assets in the finished trials of runs in betterbench's own scenes.

    Raises:
        RecordError: If a record cannot be read.
    """
    found: dict[tuple[str, str, str], CreditedObject] = {}
    for run in runs:
        if not run.world.measured:  # the objects belong to another benchmark's assets
            continue
        for entry in run.entries():
            if entry.status == "done":
                for each in run.read_brief(entry.key, entry=entry).metadata.scene.objects:
                    found.setdefault((each.asset.partition("#")[0], each.source, each.license), each)
    return credit_lines(list(found.values()))
