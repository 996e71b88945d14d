"""Writer of LeRobot data sets of version 3.0. Some functions are shared with the writer of version 2.1.

Source of the format: huggingface/lerobot, ``src/lerobot/datasets`` of 0.4.4 and 0.6.1 (``utils.py``,
``lerobot_dataset.py``, ``dataset_metadata.py``, ``language.py``).
"""

from __future__ import annotations

import io
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from betterbench.demonstrations.export.episodes import Dataset, splits, starts
from betterbench.demonstrations.export.language import EVENTS, PERSISTENT, language_columns
from betterbench.demonstrations.export.layout import VectorColumn
from betterbench.demonstrations.export.numbers import Stats, image_stats, vector_stats
from betterbench.demonstrations.export.part import Part
from betterbench.demonstrations.export.video import CODEC, PIXEL_FORMAT, join
from betterbench.jobs import write_durably
from betterbench.quoting import json_text
from betterbench.sim.robots import robot

CHUNK_FILES = 1000
"""Maximum number of files in each folder ``chunk-NNN``."""

MOST_FILE_BYTES = 100 * 1024 * 1024
"""Maximum size of a frame file before compression, and of a video file [byte]. An episode is never split."""

SUBTASK = "subtask_index"

EPISODES_FILE = "meta/episodes/chunk-000/file-000.parquet"
"""File with the list of episodes in version 3.0."""

COUNTERS = ("timestamp", "frame_index", "episode_index", "index", "task_index", SUBTASK)


def features(dataset: Dataset) -> dict[str, dict[str, Any]]:
    """Return the description of each column in ``meta/info.json``."""
    found: dict[str, dict[str, Any]] = {}
    for name, image in dataset.layout.all_images.items():
        shape = [image.height, image.width, 3]
        found[name] = {
            "dtype": "video" if dataset.form == "video" else "image",
            "shape": shape,
            "names": ["height", "width", "channels"],
        }
        if dataset.form == "video":
            found[name]["info"] = {
                "video.height": image.height,
                "video.width": image.width,
                "video.codec": CODEC,
                "video.pix_fmt": PIXEL_FORMAT,
                "video.is_depth_map": False,
                "video.fps": dataset.rate_hz,
                "video.channels": 3,
                "has_audio": False,
            }
    for column in (*dataset.layout.states, dataset.layout.action):
        found[column.name] = {"dtype": column.dtype, "shape": [column.size], "names": list(column.components)}
    for name in COUNTERS:
        found[name] = {"dtype": "float32" if name == "timestamp" else "int64", "shape": [1], "names": None}
    if dataset.language:
        found |= {name: {"dtype": "language", "shape": [1], "names": None} for name in (PERSISTENT, EVENTS)}
    return found


def frame_table(dataset: Dataset, number: int, part: Part, *, first: int) -> pa.Table:
    """Return the frames of an episode as a table with LeRobot's columns.

    Args:
        dataset: The data set.
        number: Index of the episode.
        part: Content of the episode.
        first: Index of the episode's first frame in the data set.
    """
    rows = len(part)
    columns: dict[str, pa.Array] = {}
    for name, files in part.pngs.items():
        paths = [f"episode-{number:06d}-frame-{row:06d}.png" for row in range(rows)]
        columns[name] = pa.StructArray.from_arrays([pa.array(files, pa.binary()), pa.array(paths)], ["bytes", "path"])
    for column in (*dataset.layout.states, dataset.layout.action):
        columns[column.name] = _vector(part.vectors[column.name], column)
    columns |= {name: pa.array(values) for name, values in counters(dataset, number, part, first=first).items()}
    if dataset.language:
        columns |= language_columns(dataset, number, part)
    ordered = [name for name in features(dataset) if name in columns]
    table = pa.table({name: columns[name] for name in ordered})
    return table.replace_schema_metadata({b"huggingface": json.dumps(_hub_features(dataset)).encode()})


def counters(dataset: Dataset, number: int, part: Part, *, first: int) -> dict[str, np.ndarray]:
    """Return the time and index columns of an episode.

    The columns are ``timestamp`` [s], ``frame_index`` (in the episode), ``episode_index``, ``index`` (in the data set),
    ``task_index`` (index of the instruction) and the index of the subgoal.
    """
    rows, subgoals = len(part), {name: i for i, name in enumerate(dataset.subgoals)}
    task = dataset.instructions.index(str(dataset.episodes[number].about["instruction"]))
    return {
        "timestamp": (np.arange(rows) / dataset.rate_hz).astype(np.float32),
        "frame_index": np.arange(rows, dtype=np.int64),
        "episode_index": np.full(rows, number, np.int64),
        "index": np.arange(first, first + rows, dtype=np.int64),
        "task_index": np.full(rows, task, np.int64),
        SUBTASK: np.array([subgoals[name] for name in part.subgoals], np.int64),
    }


def episode_stats(dataset: Dataset, part: Part, counted: Mapping[str, np.ndarray]) -> dict[str, Stats]:
    """Return the statistics of each column in one episode."""
    found = {name: image_stats(part.levels[name], part.sampled) for name in dataset.layout.all_images}
    return found | {name: vector_stats(values) for name, values in {**part.vectors, **counted}.items()}


class Totals:
    """Accumulator for the statistics of a complete data set. Episodes are added one at a time."""

    def __init__(self) -> None:
        self._vectors: dict[str, list[np.ndarray]] = {}
        self._levels: dict[str, np.ndarray] = {}
        self._sampled = 0

    def add(self, part: Part, counted: Mapping[str, np.ndarray]) -> None:
        """Add an episode."""
        for name, values in {**part.vectors, **counted}.items():
            self._vectors.setdefault(name, []).append(values)
        for name, levels in part.levels.items():
            self._levels[name] = levels + self._levels[name] if name in self._levels else levels
        self._sampled += part.sampled

    def stats(self) -> dict[str, Stats]:
        """Return the statistics of each column. Quantiles are computed over all frames, not averaged over episodes."""
        found = {name: image_stats(levels, self._sampled) for name, levels in self._levels.items()}
        return found | {name: vector_stats(np.concatenate(values)) for name, values in self._vectors.items()}


def write_v30(folder: Path, dataset: Dataset) -> dict[str, Stats]:
    """Write a data set of version 3.0 into an empty folder, and return the statistics of its columns.

    Raises RecordError if the content of an episode is damaged, and OSError if a file cannot be written.
    """
    first, totals, rows = starts(dataset.episodes), Totals(), list[dict[str, Any]]()
    frames = _FrameFiles(folder)
    videos = {name: _VideoFiles(folder, name, dataset.rate_hz) for name in dataset.layout.all_images}
    for number, part in enumerate(dataset.parts()):
        counted = counters(dataset, number, part, first=first[number])
        totals.add(part, counted)
        row = episode_row(dataset, number, first[number])
        row |= frames.add(frame_table(dataset, number, part, first=first[number]))
        for name, video in part.videos.items():
            row |= videos[name].add(video, len(part))
        row |= stats_fields(episode_stats(dataset, part, counted))
        rows.append(row)
    frames.close()
    for files in videos.values() if dataset.form == "video" else ():
        files.close()
    buffer = io.BytesIO()
    pq.write_table(pa.Table.from_pylist(rows), buffer, compression="snappy")
    write_durably(folder / EPISODES_FILE, buffer.getvalue())
    for file, table in index_tables(dataset).items():
        buffer = io.BytesIO()
        pq.write_table(table, buffer)
        write_durably(folder / file, buffer.getvalue())
    whole = totals.stats()
    write_durably(folder / "meta/stats.json", json_bytes(whole))
    write_durably(folder / "meta/info.json", json_bytes(info_v30(dataset)))
    return whole


def json_bytes(form: object) -> bytes:
    """Serialize a value as indented JSON."""
    return (json_text(form, indent=4, allow_nan=False) + "\n").encode()


def info_v30(dataset: Dataset) -> dict[str, Any]:
    """Return the content of ``meta/info.json``."""
    return {
        "codebase_version": "v3.0",
        "robot_type": robot(dataset.layout.robot).dataset_type,
        "total_episodes": len(dataset.episodes),
        "total_frames": dataset.frames,
        "total_tasks": len(dataset.instructions),
        "chunks_size": CHUNK_FILES,
        "data_files_size_in_mb": MOST_FILE_BYTES // 1024**2,
        "video_files_size_in_mb": MOST_FILE_BYTES // 1024**2,
        "fps": dataset.rate_hz,
        "splits": splits(dataset),
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "video_path": "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
        if dataset.form == "video"
        else None,
        "features": features(dataset),
    }


def episode_row(dataset: Dataset, number: int, first: int) -> dict[str, Any]:
    """Return the row of an episode in ``meta/episodes``, without file locations and statistics.

    The names of fields that LeRobot does not define begin with ``better/``.
    """
    episode = dataset.episodes[number]
    about = episode.about
    return {
        "episode_index": number,
        "tasks": [about["instruction"]],
        "length": len(episode),
        "dataset_from_index": first,
        "dataset_to_index": first + len(episode),
        "meta/episodes/chunk_index": 0,
        "meta/episodes/file_index": 0,
        **{f"better/{name}": about[name] for name in ("task", "condition", "seed", "policy", "scene")},
        **({"better/pairs": ", ".join(about["pairs"])} if "pairs" in about else {}),
        "better/record": episode.record,
    }


def stats_fields(stats: Mapping[str, Stats]) -> dict[str, Any]:
    """Return the statistics of an episode as fields of ``meta/episodes``."""
    return {f"stats/{name}/{what}": value for name, found in stats.items() for what, value in found.items()}


def file_fields(kind: str, number: int) -> dict[str, int]:
    """Return the fields of ``meta/episodes`` that identify the file in which an episode is stored.

    Args:
        kind: "data" or "videos/COLUMN".
        number: Index of the file.
    """
    return {f"{kind}/chunk_index": number // CHUNK_FILES, f"{kind}/file_index": number % CHUNK_FILES}


def time_fields(kind: str, begun: int, ended: int, rate_hz: int) -> dict[str, float]:
    """Return the fields of ``meta/episodes`` with the start and end time of an episode in its video.

    Args:
        kind: "videos/COLUMN".
        begun: Index of the first frame in the video.
        ended: Index after the last frame.
        rate_hz: Frame rate [Hz].
    """
    return {f"{kind}/from_timestamp": begun / rate_hz, f"{kind}/to_timestamp": ended / rate_hz}


def file_name(kind: str, number: int) -> str:
    """Return the name of a frame file (``kind`` "data") or a video file (``kind`` "videos/COLUMN"), by its index."""
    ending = "parquet" if kind == "data" else "mp4"
    return f"{kind}/chunk-{number // CHUNK_FILES:03d}/file-{number % CHUNK_FILES:03d}.{ending}"


class _Files:
    """Base class of writers that distribute the episodes over numbered files of one kind (frames or videos)."""

    def __init__(self, kind: str) -> None:
        self._kind = kind
        self._number = 0
        self._bytes = 0


class _FrameFiles(_Files):
    """Writer of the frame files. Each episode becomes one row group of a Parquet file."""

    def __init__(self, folder: Path) -> None:
        super().__init__("data")
        self._folder = folder
        self._tables: list[pa.Table] = []

    def add(self, table: pa.Table) -> dict[str, int]:
        """Add an episode, and return the fields that describe its location."""
        if self._tables and self._bytes + table.nbytes > MOST_FILE_BYTES:
            self.close()
            self._number += 1
        self._tables.append(table)
        self._bytes += table.nbytes
        return file_fields(self._kind, self._number)

    def close(self) -> None:
        """Write the collected episodes to a file."""
        buffer = io.BytesIO()
        with pq.ParquetWriter(buffer, self._tables[0].schema, compression="snappy") as writer:
            for table in self._tables:
                writer.write_table(table, row_group_size=max(1, table.num_rows))
        write_durably(self._folder / file_name(self._kind, self._number), buffer.getvalue())
        self._tables, self._bytes = [], 0


class _VideoFiles(_Files):
    """Writer of the video files of one image column. Each file contains several consecutive episodes."""

    def __init__(self, folder: Path, column: str, rate_hz: int) -> None:
        super().__init__(f"videos/{column}")
        self._folder, self._rate_hz = folder, rate_hz
        self._videos: list[bytes] = []
        self._pictures = 0

    def add(self, video: bytes, pictures: int) -> dict[str, Any]:
        """Add an episode. Return the fields with its video file and its start and end time in the video [s]."""
        if self._videos and self._bytes + len(video) > MOST_FILE_BYTES:
            self.close()
            self._number += 1
        begun = self._pictures
        self._videos.append(video)
        self._bytes += len(video)
        self._pictures += pictures
        times = time_fields(self._kind, begun, self._pictures, self._rate_hz)
        return file_fields(self._kind, self._number) | times

    def close(self) -> None:
        """Write the collected episodes to a file."""
        place = self._folder / file_name(self._kind, self._number)
        write_durably(place, join(self._videos, rate_hz=self._rate_hz))
        self._videos, self._bytes, self._pictures = [], 0, 0


def _vector(values: np.ndarray, column: VectorColumn) -> pa.Array:
    flat = pa.array(np.ascontiguousarray(values).reshape(-1))
    return flat if column.size == 1 else pa.FixedSizeListArray.from_arrays(flat, column.size)


def _hub_features(dataset: Dataset) -> dict[str, Any]:
    """Return the column types in the format of the ``datasets`` library, which earlier versions of LeRobot read."""
    found: dict[str, Any] = {}
    for name, feature in features(dataset).items():
        if feature["dtype"] in ("video", "language"):
            continue
        value = {"dtype": feature["dtype"], "_type": "Value"}
        if feature["dtype"] == "image":
            found[name] = {"_type": "Image"}
        elif feature["shape"] == [1]:
            found[name] = value
        else:
            found[name] = {"feature": value, "length": feature["shape"][0], "_type": "Sequence"}
    return {"info": {"features": found}} if not dataset.language else {}


def index_tables(dataset: Dataset) -> dict[str, pa.Table]:
    """Return the tables in ``meta`` that list the instructions and the subgoals by index."""
    words = {"task": dataset.instructions, "subtask": dataset.subgoals}
    return {f"meta/{name}s.parquet": _indexed(name, said) for name, said in words.items()}


def _indexed(name: str, words: Sequence[str]) -> pa.Table:
    """Return a table of the given strings and their indices.

    The strings form the pandas index of the table, as in LeRobot's files.
    """
    table = pa.table({f"{name}_index": pa.array(range(len(words)), pa.int64()), name: pa.array(words, pa.string())})
    kinds = {f"{name}_index": ("int64", "int64"), name: ("unicode", "object")}
    described = {
        "index_columns": [name],
        "column_indexes": [],
        "columns": [
            {"name": n, "field_name": n, "pandas_type": kind, "numpy_type": numpy, "metadata": None}
            for n, (kind, numpy) in kinds.items()
        ],
        "creator": {"library": "betterbench", "version": "1"},
        "pandas_version": "2.0.0",
    }
    return table.replace_schema_metadata({b"pandas": json.dumps(described).encode()})
