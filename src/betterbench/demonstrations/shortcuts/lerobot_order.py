"""Order of the frames in a LeRobot data set. Files may be unsorted, and an episode may span several files."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from betterbench.demonstrations.shortcuts.lerobot_files import (
    column_names,
    numbers_in,
    read_columns,
    require_finite_column,
)
from betterbench.errors import RecordError

_KEYS = ("frame_index", "timestamp")
"""Columns that may contain the order of the frames in an episode. The first existing column is used."""
_MOST_INDEX = 2**53

ScalarT = TypeVar("ScalarT", bound=np.generic)

_Floats = npt.NDArray[np.float64]
_Ints = npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class FileOrder:
    """Order of the rows of a file when they are sorted by episode and frame.

    Attributes:
        episodes: (rows,) episode index of each sorted row.
        frames: (rows,) value of the ``key`` column in each sorted row; zeros if there is no key column.
        key: Column that contains the order of the frames in an episode; "" if there is none, so that the order in the
            file is kept.
        rows: (rows,) index in the file of each sorted row; None if the file is already sorted.
    """

    episodes: _Ints
    frames: _Floats
    key: str
    rows: _Ints | None

    @classmethod
    def of(cls, file: Path) -> FileOrder:
        """Determine the order of the rows in a file. Raises RecordError if the columns cannot be read."""
        names = column_names(file)
        keys = [key for key in _KEYS if key in names]
        columns = read_columns(file, dict.fromkeys(("episode_index", *keys), 1))
        numbers = numbers_in(file, "episode_index", columns["episode_index"], 1)
        require_finite_column(file, "episode_index", numbers)
        episodes = np.clip(numbers, -_MOST_INDEX, _MOST_INDEX).astype(np.int64)
        frames, key = np.zeros(len(episodes)), ""
        for name in keys:
            values = numbers_in(file, name, columns[name], 1)
            if np.isfinite(values).any():
                frames, key = values, name
                break
        later, apart = np.diff(frames), np.diff(episodes)
        if bool(((apart > 0) | ((apart == 0) & ~(later < 0.0))).all()):
            return cls(episodes, frames, key, None)
        rows = np.lexsort((frames, episodes)).astype(np.int64)
        return cls(episodes[rows], frames[rows], key, rows)

    def sort(self, values: npt.NDArray[ScalarT]) -> npt.NDArray[ScalarT]:
        """Sort an array (rows, ...) that has one entry per row of the file."""
        return values if self.rows is None else np.asarray(values[self.rows])


@dataclass(frozen=True, slots=True)
class EpisodePart:
    """Range of sorted rows [start, stop) of a file that belong to one episode.

    Attributes:
        file: The data file.
        start: First row.
        stop: Row after the last row.
        key: Column that contains the order of the frames; "" if there is none.
        first: Value of the ``key`` column in the first row.
        last: Value of the ``key`` column in the last row.
        finite: Whether all values of the ``key`` column in these rows are finite.
    """

    file: Path
    start: int
    stop: int
    key: str
    first: float
    last: float
    finite: bool

    @classmethod
    def of(cls, file: Path, order: FileOrder, start: int, stop: int) -> EpisodePart:
        """Create the part of an episode that lies in one file. Raises RecordError if a frame occurs twice."""
        frames = order.frames[start:stop]
        same = np.flatnonzero(np.diff(frames) == 0.0) if order.key == "frame_index" else np.zeros(0, dtype=np.int64)
        if same.size:
            frame = f"(frame_index {frames[same[0]]:.0f})"
            raise RecordError(f"{file}: episode {order.episodes[start]} occurs twice in the data {frame}. {_CURE}.")
        return cls(file, start, stop, order.key, float(frames[0]), float(frames[-1]), bool(np.isfinite(frames).all()))

    def __len__(self) -> int:
        """Return the number of rows."""
        return self.stop - self.start


_CURE = "Fetch the files again, or remove the duplicate rows"


def joined(episode: int, parts: Sequence[EpisodePart]) -> list[int]:
    """Return the temporal order of the parts of an episode, as indices of ``parts``.

    Raises RecordError if two parts overlap in time.
    """
    order = sorted(range(len(parts)), key=lambda i: (parts[i].first, i))
    for a, b in itertools.pairwise(order):
        before, after = parts[a], parts[b]
        if not (before.finite and after.finite):
            continue  # episodes with non-finite frame indices are omitted later
        if not before.key or before.key != after.key or not before.last < after.first:
            raise RecordError(f"{parts[max(a, b)].file}: episode {episode} occurs twice in the data. {_CURE}.")
    return order
