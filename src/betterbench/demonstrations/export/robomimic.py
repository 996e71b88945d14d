"""Writer of robomimic's HDF5 files. A file contains the states, actions and lossless images of all demonstrations.

Source of the format: robomimic 0.3, ``docs/datasets/overview.md`` and ``robomimic/utils/dataset.py``.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Container
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from betterbench.demonstrations.export.episodes import Dataset, DatasetEpisode, starts
from betterbench.demonstrations.export.layout import IMAGES, DatasetLayout
from betterbench.demonstrations.export.lerobot import Totals, counters
from betterbench.demonstrations.export.numbers import Stats
from betterbench.demonstrations.export.part import Part, read_png
from betterbench.errors import BetterError, RunConflictError, one_line
from betterbench.installation import missing_extra
from betterbench.json_form import parse_json, say_unsealed
from betterbench.ordinary_file import open_ordinary

GYM_TYPE = 2
"""Number that robomimic assigns to Gym environments (``robomimic/envs/env_base.py``)."""

_GZIP = 1

_MOST_PACKED = 1100
"""Maximum compression ratio of an array in a file. gzip compresses an array of zeros by 1032 to 1."""
_LEAST_STORED = 4096

_SIGNATURE = b"\x89HDF\r\n\x1a\n"

_DIGEST = "better_sha256"
"""Attribute of the file with the digest of all other content."""
_SOURCE = "better"
"""HDF5 data set with the origin, next to ``data``. It is not an attribute, because attributes are limited to 64 kB."""


def write_robomimic(path: Path, dataset: Dataset) -> dict[str, Stats]:
    """Write the HDF5 file, and return the statistics of its columns. Each image is a gzip-compressed chunk.

    Raises:
        MissingDependencyError: If h5py is not installed.
        OSError: If the file cannot be written.
    """
    with open_hdf5(path, "w") as file:
        data = file.create_group("data")
        totals, first = Totals(), starts(dataset.episodes)
        for number, part in enumerate(dataset.parts()):
            totals.add(part, counters(dataset, number, part, first=first[number]))
            group = data.create_group(demo_name(number))
            group.attrs.update(demo_attributes(dataset.episodes[number]))
            _write_frames(group, part, dataset.layout)
        data.attrs.update(data_attributes(dataset))
        file[_SOURCE] = json.dumps(dataset.source, sort_keys=True)
        mask = file.create_group("mask")
        for name, demos in masks(dataset).items():
            mask[name] = np.array(demos, dtype="S")
        file.attrs[_DIGEST] = _content_digest(file)
    with path.open("rb") as written:
        os.fsync(written.fileno())
    return totals.stats()


def require_same_content(path: Path, *, cure: str, raises: type[BetterError] = RunConflictError) -> None:
    """Raise an error if a file has changed since it was written. If the file has no digest, log a warning.

    Args:
        path: The HDF5 file.
        cure: Remedy in the error message.
        raises: Type of the error.
    """
    try:
        with open_stored(path) as file:
            told = file.attrs.get(_DIGEST)
            same = told is None or (isinstance(told, str) and told == _content_digest(file))
    except _StrangeError as error:
        raise raises(f"{path}: {error}. {cure}.") from error
    except Exception as error:  # h5py raises various exceptions for a damaged file
        raise raises(f"{path}: the file is damaged ({type(error).__name__}). {cure}.") from error
    if not same:
        raise raises(f"{path}: the file has changed since it was written. {cure}.")
    if told is None:
        say_unsealed(str(path))


def _content_digest(file: Any) -> str:  # noqa: ANN401 - a file of h5py
    """Return the SHA-256 of the names, attributes, types, shapes and values of all objects in an HDF5 file."""
    whole = hashlib.sha256()

    def attributes(item: Any) -> dict[str, Any]:  # noqa: ANN401 - of h5py
        return {key: np.asarray(value).tolist() for key, value in sorted(item.attrs.items()) if key != _DIGEST}

    def take(name: str, item: Any) -> None:  # noqa: ANN401
        told = attributes(item)
        whole.update(json.dumps([name, told], default=str).encode())
        if hasattr(item, "dtype"):
            value = item[()]
            values = np.asarray(value)
            whole.update(f"{item.dtype} {item.shape}".encode())
            whole.update(value if isinstance(value, bytes) else np.ascontiguousarray(values).tobytes())

    names: list[str] = []
    file.visit(names.append)
    for name in sorted(names):
        take(name, file[name])
    # Attributes of the root group, which betterbench never writes, change the digest.
    if of_file := attributes(file):
        whole.update(json.dumps(["", of_file], default=str).encode())
    return whole.hexdigest()


class _StrangeError(ValueError):
    """Raised if an HDF5 file contains something that betterbench never writes."""


def open_stored(path: Path) -> Any:  # noqa: ANN401 - a file of h5py
    """Open an untrusted HDF5 file for reading. The file must not refer to content outside of the file.

    Without this check, HDF5 would follow links into other files, wait for a named pipe, or fill the memory with data
    that the file declares but does not store.

    Raises:
        MissingDependencyError: If h5py is not installed.
        OSError: If the file cannot be opened.
        ValueError: If an object is a link, occurs twice, or is not stored in the file.
    """
    open_ordinary(path).close()  # HDF5 would wait for a pipe
    file = open_hdf5(path, "r")
    try:
        _require_plain(file)
    except BaseException:
        file.close()
        raise
    return file


def _require_plain(file: Any) -> None:  # noqa: ANN401 - a file of h5py
    """Raise _StrangeError if the file contains an object that :func:`write_robomimic` never writes."""
    h5py = _h5py()
    seen, groups = {_address(file)}, [file]
    while groups:
        group = groups.pop()
        for name in group:
            is_link = not isinstance(group.get(name, getlink=True), h5py.HardLink)
            problem = "is a link" if is_link else _problem_of(item := group[name], seen)
            if problem:
                raise _StrangeError(f"{one_line(f'{group.name}/{name}'.strip('/'), most=80)} {problem}")
            seen.add(_address(item))
            if isinstance(item, h5py.Group):
                groups.append(item)


def _problem_of(item: Any, seen: Container[tuple[int, int]]) -> str:  # noqa: ANN401 - an object of h5py
    """Return the reason why betterbench cannot have written an HDF5 object, or "" if there is no such reason."""
    h5py = _h5py()
    if _address(item) in seen:
        return "is another name of an earlier object"
    if isinstance(item, h5py.Group):
        return ""
    if not isinstance(item, h5py.Dataset):
        return "is neither a group nor an array"
    if item.is_virtual or item.external:
        return "is stored in another file"
    stored = item.id.get_storage_size()
    if item.nbytes > _MOST_PACKED * max(stored, _LEAST_STORED):
        return f"declares {item.nbytes} bytes, of which only {stored} are stored"
    return ""


def _address(item: Any) -> tuple[int, int]:  # noqa: ANN401 - an object of h5py
    """Return the address of an HDF5 object. It identifies the object within its file."""
    about = _h5py().h5o.get_info(item.id)
    return about.fileno, about.addr


def demo_name(number: int) -> str:
    """Return the name of a demonstration in the group ``data``."""
    return f"demo_{number}"


def demo_attributes(episode: DatasetEpisode) -> dict[str, Any]:
    """Return the HDF5 attributes of a demonstration. The attribute ``better`` contains JSON."""
    return {
        "num_samples": len(episode),
        "instruction": str(episode.about["instruction"]),
        "better": json.dumps({**episode.about, "record": episode.record}, sort_keys=True),
    }


def data_attributes(dataset: Dataset) -> dict[str, Any]:
    """Return the HDF5 attributes of the group ``data``. The attribute ``env_args`` contains JSON."""
    return {"total": dataset.frames, "env_args": json.dumps(_environment(dataset), sort_keys=True)}


def masks(dataset: Dataset) -> dict[str, list[str]]:
    """Return the names of the demonstrations for training and, if there are any, for validation."""
    names = [demo_name(number) for number in range(len(dataset.episodes))]
    found = {"train": names[: dataset.train], "valid": names[dataset.train :]}
    return {name: demos for name, demos in found.items() if demos}


def frame_arrays(part: Part, layout: DatasetLayout) -> dict[str, np.ndarray]:
    """Return all arrays of a demonstration except the images, by HDF5 name."""
    done = np.zeros(len(part))
    done[-1] = 1.0
    return {
        "actions": part.vectors[layout.action.name].astype(np.float64),
        "dones": done.astype(np.int64),
        "rewards": done,
        "subgoal": np.array([name.encode() for name in part.subgoals], dtype="S"),
    } | {f"obs/{observation_name(column.name)}": part.vectors[column.name] for column in layout.states}


def observation_name(column: str) -> str:
    """Return the name of a column in the group ``obs``, without the prefixes of LeRobot and betterbench."""
    return column.removeprefix(IMAGES).removeprefix("observation.").removeprefix("better.")


def open_hdf5(path: Path, mode: str) -> Any:  # noqa: ANN401 - a file of h5py
    """Open an HDF5 file.

    Raises:
        MissingDependencyError: If h5py is not installed.
        OSError: If the file cannot be opened.
    """
    return _h5py().File(path, mode, libver="v110" if mode == "w" else None)


def is_hdf5(path: Path) -> bool:
    """Return whether a file starts with the signature of HDF5 files."""
    try:
        with open_ordinary(path) as file:
            return file.read(len(_SIGNATURE)) == _SIGNATURE
    except OSError:
        return False


def require_h5py() -> None:
    """Raise MissingDependencyError if h5py is not installed."""
    _h5py()


def read_origin(path: Path) -> dict[str, Any]:
    """Read the description of a data set's origin from its HDF5 file.

    Raises OSError, ValueError or KeyError if betterbench did not write the file.
    """
    with open_stored(path) as file:
        form: dict[str, Any] = parse_json(file[_SOURCE][()])
        return form


def _h5py() -> ModuleType:
    try:
        import h5py  # noqa: PLC0415 - an extra
    except ImportError as error:
        raise missing_extra("--to robomimic needs h5py, which is not installed", "robomimic") from error
    module: ModuleType = h5py
    return module


def _write_frames(group: Any, part: Part, layout: DatasetLayout) -> None:  # noqa: ANN401 - a group of h5py
    for name, values in frame_arrays(part, layout).items():
        group.create_dataset(name, data=values)
    for name, files in part.pngs.items():
        shape = (layout.all_images[name].height, layout.all_images[name].width, 3)
        packed = {"chunks": (1, *shape), "compression": "gzip", "compression_opts": _GZIP}
        images = group.create_dataset(f"obs/{observation_name(name)}", (len(part), *shape), np.uint8, **packed)
        for row, data in enumerate(files):
            images[row] = read_png(data)


def _environment(dataset: Dataset) -> dict[str, Any]:
    """Return the description of the environment that a robomimic file contains.

    If all demonstrations belong to one task, the name of the environment is the Gymnasium id of this task.
    """
    tasks = sorted({str(episode.about["task"]) for episode in dataset.episodes})
    single = "".join(word.capitalize() for word in tasks[0].split("_"))
    return {
        "env_name": f"BeTTER/{single}-v0" if len(tasks) == 1 else "BeTTER",
        "env_version": str(dataset.episodes[0].about["suite_version"]),
        "type": GYM_TYPE,
        "env_kwargs": {"tasks": tasks, "observation": dataset.layout.observation.name},
    }
