"""Comparison of a robomimic file with its source records, group by group."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from betterbench.demonstrations.export.comparing import ReadPictures, intact, require_equal, require_match
from betterbench.demonstrations.export.expected import ExpectedDataset
from betterbench.demonstrations.export.part import Part
from betterbench.demonstrations.export.robomimic import (
    data_attributes,
    demo_attributes,
    demo_name,
    frame_arrays,
    masks,
    observation_name,
    open_stored,
)
from betterbench.json_form import parse_json

_JSON_ATTRIBUTES = ("better", "env_args")


class RobomimicCheck:
    """Check of a robomimic file. Images, and filter keys that users added, are not compared.

    Use it as a context manager.
    """

    def __init__(self, path: Path, expected: ExpectedDataset) -> None:
        self._path, self._expected = path, expected
        self._file = open_stored(path)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()

    def episode(self, number: int, part: Part) -> ReadPictures:
        """Compare an episode with the expected episode, which must be the last episode that was added.

        Return a reader for its images.
        """
        name, layout = f"data/{demo_name(number)}", self._expected.layout
        where = f"{self._path}: {name}"
        group = self._file[name]
        require_match(_attributes(group), _plain(demo_attributes(self._expected.dataset.episodes[number])), where)
        arrays = frame_arrays(part, layout)
        images = {f"obs/{observation_name(c)}": (i.height, i.width, 3) for c, i in layout.all_images.items()}
        shapes = {name: _shape(values.shape, values.dtype) for name, values in arrays.items()}
        shapes |= {name: _shape((len(part), *shape), np.dtype(np.uint8)) for name, shape in images.items()}
        require_equal(_shapes(group), shapes, where)
        for column, wanted in arrays.items():
            there = group[column][:]
            if not np.array_equal(there, wanted):
                require_equal({column: _plain(there)}, {column: _plain(wanted)}, where)

        def read(column: str, rows: Sequence[int]) -> dict[int, np.ndarray]:
            return {row: group[f"obs/{observation_name(column)}"][row] for row in rows}

        return read

    def finish(self) -> None:
        """Compare the parts of the file that do not belong to a single episode, such as the masks.

        Call this method after the last episode.
        """
        with intact(f"{self._path}: data"):
            data, where = self._file["data"], f"{self._path}: data"
            names = [demo_name(number) for number in range(len(self._expected.dataset.episodes))]
            require_equal(dict.fromkeys(data, "there"), dict.fromkeys(names, "there"), where)
            require_match(_attributes(data), _plain(data_attributes(self._expected.dataset)), where)
        with intact(f"{self._path}: mask"):
            there = {
                name: _plain(self._file["mask"][name][:]) for name in ("train", "valid") if name in self._file["mask"]
            }
            train = len(there.get("train", ()))
            said = f"mask/train has {train} demonstrations"
            wanted = masks(self._expected.divided(train, str(self._path), said))
            require_equal(there, wanted, f"{self._path}: mask")


def _attributes(group: Any) -> dict[str, Any]:  # noqa: ANN401 - a group of h5py
    found: dict[str, Any] = _plain(dict(group.attrs))
    return found


def _plain(value: Any) -> Any:  # noqa: ANN401 - what h5py returns
    """Convert a value that h5py returned to JSON types, and parse attributes that contain JSON."""
    if isinstance(value, dict):
        return {n: parse_json(v) if n in _JSON_ATTRIBUTES else _plain(v) for n, v in value.items()}
    if isinstance(value, (np.ndarray, np.generic)):
        return _plain(value.tolist())
    if isinstance(value, list):
        return [_plain(item) for item in value]
    return value.decode(errors="replace") if isinstance(value, bytes) else value


def _shapes(group: Any) -> dict[str, str]:  # noqa: ANN401 - a group of h5py
    """Return the shape and data type of each array in a demonstration."""
    found: dict[str, str] = {}
    for name in group:
        below = group[name]
        arrays = {f"{name}/{inner}": below[inner] for inner in below} if name == "obs" else {name: below}
        found |= {n: _shape(getattr(a, "shape", ()), getattr(a, "dtype", "group")) for n, a in arrays.items()}
    return found


def _shape(shape: Sequence[int], dtype: object) -> str:
    return f"{' x '.join(map(str, shape))} {dtype}"
