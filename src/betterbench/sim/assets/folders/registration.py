"""Registration of the assets in a folder as categories that tasks can name."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np

from betterbench.errors import InvalidInputError
from betterbench.json_form import read_bounded
from betterbench.sim.assets.authoring.draft import Draft
from betterbench.sim.assets.authoring.registry import Generator, generator, read_folders_with
from betterbench.sim.assets.folders.manifest import CURE, FolderAsset, read_manifest
from betterbench.tasks.user_files import TaskFile, loading_folder

MAX_FILE_BYTES = 64 << 20
"""Maximum size of an asset's file [byte]."""


def asset_folder(folder: Path | str) -> tuple[str, ...]:
    """Register all assets in a folder written by ``better assets import``, and return their names.

    In a task file, a relative path is relative to the folder of the task file. The option ``--asset-dir`` of the
    command line has the same effect as this function.

    Raises:
        InvalidInputError: If the folder has no imported assets, or one of their names is already taken.
    """
    place = ((loading_folder() or Path.cwd()) / Path(folder).expanduser()).absolute()
    return _register(TaskFile.read_folder(place))


def _register(file: TaskFile) -> tuple[str, ...]:
    """Register the assets that the manifest of a folder lists."""
    folder = Path(file.path).parent
    assets = read_manifest(file.source, file.path).assets
    for name, asset in assets.items():
        path = folder / asset.file
        if not path.is_file():
            raise InvalidInputError(str(path), "the file does not exist, but the manifest lists it", CURE)
        generator(name, colors=(asset.color,), looks=1, unseen_looks=1)(_generator(path, asset))
    return tuple(assets)


def _generator(path: Path, asset: FolderAsset) -> Generator:
    def make(_rng: np.random.Generator, _color: str) -> Draft:
        from betterbench.sim.assets.importing.stored import from_bytes  # noqa: PLC0415 - it loads mesh libraries

        data = read_bounded(path, max_bytes=MAX_FILE_BYTES, cure=CURE)
        if hashlib.sha256(data).hexdigest() != asset.sha256:
            raise InvalidInputError(str(path), "it is not the file that the manifest lists", CURE)
        return from_bytes(data, str(path)).draft

    make.__qualname__ = f"the asset {path}"  # the name distinguishes assets from two folders with the same name
    return make


def _register_loaded(file: TaskFile) -> None:
    _register(file)


read_folders_with(_register_loaded)
