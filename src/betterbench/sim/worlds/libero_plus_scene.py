"""LIBERO-Plus as a world: variants of a task as conditions, and the folder of the authors' assets."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from betterbench.errors import InvalidInputError
from betterbench.sim.worlds.registry import world_named
from betterbench.sim.worlds.scene import WorldSettings, WorldTask
from betterbench.tasks.worlds.libero_plus import read_variant

LIBERO_PLUS = "libero_plus"

ASSETS_VARIABLE = "BETTERBENCH_LIBERO_PLUS_ASSETS"
"""Environment variable with the folder of the authors' assets, used without the option."""

SENTENCES = ("clean", "published")

_FOLDERS = ("scenes", "textures", "new_objects")
"""Required folders of the authors' assets."""


@dataclass(frozen=True, slots=True)
class VariantTask(WorldTask):
    """One variant of a task of LIBERO; ``number`` is that of its base task.

    Attributes:
        variant: Its name in LIBERO-Plus.
    """

    variant: str

    @property
    def condition(self) -> str:
        """Name of the condition ("camera_0_0_100_2_352")."""
        return read_variant(self.variant).condition

    @property
    def axis(self) -> str:
        """Axis of the variant: the changed part of the task."""
        return read_variant(self.variant).axis

    def asked(self) -> dict[str, Any]:
        """Return the fields by which the simulator identifies the scene."""
        return {**WorldTask.asked(self), "variant": self.variant}


@dataclass(frozen=True, slots=True)
class PlusSettings(WorldSettings):
    """Settings of a worker that runs trials in LIBERO-Plus.

    Attributes:
        sentences: "clean", or "published" for instructions that end with the name of the variant.
        left_out: Number of variants of each axis that are not run because the authors' assets are missing.
    """

    sentences: str = "clean"
    left_out: Mapping[str, int] = field(default_factory=dict)

    @property
    def simulator(self) -> str:
        """Name of the simulator, which is LIBERO's, as for the twins."""
        return "libero"

    def to_json(self) -> dict[str, Any]:
        """Return the JSON form, without the locations of the world and the assets."""
        return {**WorldSettings.to_json(self), "sentences": self.sentences, "left_out": dict(self.left_out)}


def plus_command(assets: Path | None = None) -> tuple[str, ...]:
    """Return the command of the world's process with the folder of the authors' assets, if there is one.

    Args:
        assets: The folder; if None, that of the environment variable, if set.

    Raises:
        InvalidInputError: If the folder does not contain the assets.
        MissingDependencyError: If the world is not installed.
    """
    named = os.environ.get(ASSETS_VARIABLE)
    where = "--libero-plus-assets" if assets is not None else ASSETS_VARIABLE
    folder = assets if assets is not None else Path(named) if named else None
    if folder is not None and (missing := [name for name in _FOLDERS if not (folder / name).is_dir()]):
        raise InvalidInputError(
            where,
            f"{folder} has no folder {', '.join(missing)}",
            "Name the unzipped folder assets of LIBERO-Plus, which holds scenes, textures and new_objects",
        )
    return (*world_named(LIBERO_PLUS).command(), *([] if folder is None else [str(folder.resolve())]))


def world_command(world: str) -> tuple[str, ...]:
    """Return the command of a world's process, for worlds that need no path of the user."""
    return plus_command() if world == LIBERO_PLUS else world_named(world).command()
