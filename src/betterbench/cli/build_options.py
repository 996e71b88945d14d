"""Options of subcommands that build and certify tasks: ``better build``, ``better generate`` with ``--build``."""

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
    """Options of a build.

    Attributes:
        name: Name of the suite; a digest of its tasks is appended.
        seeds: Trials to certify per variation; the maximum for better eval --trials.
        demonstrations: Expert demonstrations to measure per task.
        power: Trials of each faulty policy per variation, to measure whether the variation exposes a fault; 0 for none.
        workers: Number of worker processes; default: one per CPU core.
        catalogue: Catalogue made by better assets index, from which objects missing in the library are imported.
    """

    name: str = "generated"
    seeds: int = 3
    demonstrations: int = 24
    power: int = 0
    workers: int | None = None
    catalogue: Path | None = None

    @property
    def processes(self) -> int:
        """Number of worker processes."""
        return self.workers or os.cpu_count() or 1

    @property
    def settings(self) -> Settings:
        """Settings of the build, which determine its results."""
        from betterbench.generation.building.result import Settings

        return Settings(self.seeds, self.demonstrations)


ChosenBuild = Annotated[BuildOptions, tyro.conf.arg(name="")]

USUAL_BUILD = BuildOptions()
