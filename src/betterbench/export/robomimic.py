"""robomimic's HDF5 files: images without loss, states and actions of every demonstration in one file.

Source of the format: robomimic 0.3, ``docs/datasets/overview.md`` and ``robomimic/utils/dataset.py``.
"""

from __future__ import annotations

import io
import json
import os
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from PIL import Image

from betterbench.errors import MissingDependencyError
from betterbench.export.episodes import Dataset, starts
from betterbench.export.layout import IMAGES, DatasetLayout
from betterbench.export.lerobot import Totals, counters
from betterbench.export.numbers import Stats
from betterbench.export.part import Part
from betterbench.json_form import parse_json

GYM_TYPE = 2
"""robomimic's number for environments of Gym (``robomimic/envs/env_base.py``)."""

_GZIP = 1

_SOURCE = "better"
"""Name of the text beside ``data`` that tells the origin; an attribute holds no more than 64 kB."""


def write_robomimic(path: Path, dataset: Dataset) -> dict[str, Stats]:
    """Write the file, and return the statistics of its columns; a picture is one chunk, packed by gzip.

    Raises:
        MissingDependencyError: If h5py is not installed.
        OSError: If it cannot be written.
    """
    with open_hdf5(path, "w") as file:
        data = file.create_group("data")
        names = [f"demo_{number}" for number in range(len(dataset.episodes))]
        totals, first = Totals(), starts(dataset.episodes)
        for number, part in enumerate(dataset.parts()):
            name, episode = names[number], dataset.episodes[number]
            totals.add(part, counters(dataset, number, part, first=first[number]))
            group = data.create_group(name)
            group.attrs["num_samples"] = len(part)
            group.attrs["instruction"] = str(episode.about["instruction"])
            group.attrs["better"] = json.dumps({**episode.about, "record": episode.record}, sort_keys=True)
            _write_frames(group, part, dataset.layout)
        data.attrs["total"] = dataset.frames
        data.attrs["env_args"] = json.dumps(_environment(dataset), sort_keys=True)
        file[_SOURCE] = json.dumps(dataset.source, sort_keys=True)
        mask = file.create_group("mask")
        mask["train"] = np.array(names[: dataset.train], dtype="S")
        if dataset.train < len(names):
            mask["valid"] = np.array(names[dataset.train :], dtype="S")
    with path.open("rb") as written:
        os.fsync(written.fileno())
    return totals.stats()


def observation_name(column: str) -> str:
    """Return under which name in ``obs`` a column stands: without LeRobot's and our own prefixes."""
    return column.removeprefix(IMAGES).removeprefix("observation.").removeprefix("better.")


def open_hdf5(path: Path, mode: str) -> Any:  # noqa: ANN401 - a file of h5py
    """Open an HDF5 file; raise MissingDependencyError if h5py is not installed, OSError if it cannot be opened."""
    return _h5py().File(path, mode, libver="v110" if mode == "w" else None)


def require_h5py() -> None:
    """Raise MissingDependencyError if h5py is not installed."""
    _h5py()


def read_origin(path: Path) -> dict[str, Any]:
    """Return what a file says about its origin; raise OSError, ValueError or KeyError if it is none of ours."""
    with open_hdf5(path, "r") as file:
        form: dict[str, Any] = parse_json(file[_SOURCE][()])
        return form


def _h5py() -> ModuleType:
    try:
        import h5py  # noqa: PLC0415 - an extra
    except ImportError as error:
        raise MissingDependencyError(
            "--to robomimic needs h5py, which is not installed. Run: pip install 'betterbench[robomimic]'"
        ) from error
    module: ModuleType = h5py
    return module


def _write_frames(group: Any, part: Part, layout: DatasetLayout) -> None:  # noqa: ANN401 - a group of h5py
    rows = len(part)
    group.create_dataset("actions", data=part.vectors[layout.action.name].astype(np.float64))
    done = np.zeros(rows)
    done[-1] = 1.0
    group.create_dataset("dones", data=done.astype(np.int64))
    group.create_dataset("rewards", data=done)
    group.create_dataset("subgoal", data=np.array([name.encode() for name in part.subgoals], dtype="S"))
    seen = group.create_group("obs")
    for column in layout.states:
        seen.create_dataset(observation_name(column.name), data=part.vectors[column.name])
    for name, files in part.pngs.items():
        shape = (layout.all_images[name].height, layout.all_images[name].width, 3)
        packed = {"chunks": (1, *shape), "compression": "gzip", "compression_opts": _GZIP}
        images = seen.create_dataset(observation_name(name), (rows, *shape), np.uint8, **packed)
        for row, data in enumerate(files):
            images[row] = np.asarray(Image.open(io.BytesIO(data)))


def _environment(dataset: Dataset) -> dict[str, Any]:
    """Return what robomimic is told about the environment: a Gymnasium id if all demonstrations are of one task."""
    tasks = sorted({str(episode.about["task"]) for episode in dataset.episodes})
    single = "".join(word.capitalize() for word in tasks[0].split("_"))
    return {
        "env_name": f"BeTTER/{single}-v0" if len(tasks) == 1 else "BeTTER",
        "env_version": str(dataset.episodes[0].about["suite_version"]),
        "type": GYM_TYPE,
        "env_kwargs": {"tasks": tasks, "observation": dataset.layout.observation.name},
    }
