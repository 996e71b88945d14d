"""Options shared by the subcommands that build and certify tasks: ``better build`` and ``better generate --build``."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

if TYPE_CHECKING:
    from betterbench.generation.building.result import Settings


@dataclass(frozen=True, slots=True)
class BuildOptions:
    """Options for building and certifying tasks.

    Attributes:
        name: Name of the suite; a digest of its tasks is appended.
        seeds: Number of trials to certify per variation; `better eval --trials` can use at most this number.
        demonstrations: Number of expert demonstrations to measure per task.
        power: Number of trials that each faulty policy runs per variation, to measure whether the variation exposes the
            fault; 0 skips this measurement.
        workers: Number of worker processes; default: one per CPU core.
        catalogue: Catalogue written by `better assets index`. Objects that the library lacks are imported from this
            catalogue.
    """

    name: str = "generated"
    seeds: int = 3
    demonstrations: int = 24
    power: int = 0
    workers: int | None = None
    catalogue: Path | None = None

    @property
    def processes(self) -> int:
        """Number of worker processes: the given number, or one per CPU core."""
        return self.workers or os.cpu_count() or 1

    @property
    def settings(self) -> Settings:
        """Settings that affect the results of the build, without the number of worker processes."""
        from betterbench.generation.building.result import Settings

        return Settings(self.seeds, self.demonstrations)


ChosenBuild = Annotated[BuildOptions, tyro.conf.arg(name="")]

USUAL_BUILD = BuildOptions()
