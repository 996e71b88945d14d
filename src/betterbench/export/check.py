"""Comparing a data set with the records that it claims to come from."""

from __future__ import annotations

import io
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from PIL import Image

from betterbench.errors import BetterError, InvalidInputError, RecordError
from betterbench.export.frames import frame_numbers, shown_images
from betterbench.export.job import SOURCE_FILE
from betterbench.export.layout import DatasetLayout, layout_of
from betterbench.export.lerobot import CHUNK_FILES, COUNTERS
from betterbench.export.lerobot_check import LeRobotCheck
from betterbench.export.pictures import Pictures
from betterbench.export.robomimic import observation_name, open_hdf5, read_origin
from betterbench.export.video import read_pictures
from betterbench.json_form import parse_json
from betterbench.recording import Record, RunFolder
from betterbench.tasks import TrialId

MOST_MEAN_ERROR = 4.0
"""Largest mean error of a picture after the video codec, in levels of 255; see ``docs/export.md`` for what is usual."""

_CURE = "Export it again into another place"

_Place = Mapping[str, Any] | None
"""In which files an episode lies and where in them, as ``meta`` of version 3.0 says; None of 2.1: file names say it."""


@dataclass(frozen=True, slots=True)
class ExportCheck:
    """What was compared: states and actions, and three pictures of each episode and camera, drawn again.

    Of LeRobot's data sets also what :class:`~betterbench.export.lerobot_check.LeRobotCheck` compares.

    Attributes:
        worst_error: Largest mean error of a picture, in levels of 255; 0 for images without loss.
    """

    episodes: int
    frames: int
    pictures: int
    worst_error: float


@dataclass(frozen=True, slots=True)
class _Stored:
    """What a data set holds of one episode.

    Attributes:
        images: Pictures by column and row.
        counters: Columns of LeRobot that count, (N, 1); none of other formats.
    """

    vectors: Mapping[str, np.ndarray]
    images: Callable[[str, Sequence[int]], Mapping[int, np.ndarray]]
    counters: Mapping[str, np.ndarray] = field(default_factory=dict)


def check_export(
    runs: Sequence[RunFolder], path: Path, *, on_progress: Callable[[int, int], None] | None = None
) -> ExportCheck:
    """Compare a data set with the records of its runs.

    ``on_progress`` is called with the number of episodes done and planned.

    Raises:
        InvalidInputError: If a file of the data set is missing, cannot be read or holds something else than the record.
        RecordError: If no run has the record of an episode, or it is damaged.
    """
    source = _source(path)
    layout = layout_of(source["layout"]["adapter"]["name"], source["layout"]["observation"]["name"])
    lossless = source["images"] == "png"
    pictures, worst, episodes = 0, 0.0, source["episodes"]
    beside: LeRobotCheck | None = None
    if path.is_file():
        stored = _stored_robomimic(path, layout, episodes)
    else:
        places, beside = _meta(path, len(episodes))
        stored = _stored_lerobot(path, layout, places)
    with Pictures(layout.cameras, source["quality"]) as drawn:
        for number, (about, there) in enumerate(zip(episodes, stored, strict=True)):
            where = f"{path}: episode {number}"
            run, record = _record(runs, about)
            numbers = frame_numbers(record, layout)
            for name, values in numbers.vectors.items():
                if not np.array_equal(there.vectors[name], values):
                    raise InvalidInputError(where, f"its {name} is not what the record says", _CURE)
            if beside is not None:
                with _intact(where):
                    beside.add(number, record, numbers, there.counters)
            rows = sorted({0, record.n_steps // 2, record.n_steps - 1})
            kept: dict[int, dict[str, np.ndarray]] = {}
            if layout.images:
                shown = shown_images(record, layout, drawn.of(run, record, rows), rows)
                kept = dict(zip(rows, shown, strict=True))
            for column in layout.images:
                with _intact(f"{where}: its {column.name}"):
                    found = there.images(column.name, rows)
                for row in rows:
                    error = _error(found.get(row), kept[row][column.name])
                    if error > (0.0 if lossless else MOST_MEAN_ERROR):
                        problem = f"its {column.name} differs at frame {row} by {error:.2f} of 255 levels in the mean"
                        raise InvalidInputError(where, problem, _CURE)
                    worst, pictures = max(worst, error), pictures + 1
            if on_progress is not None:
                on_progress(number + 1, len(episodes))
    if beside is not None:
        beside.finish()
    return ExportCheck(len(episodes), sum(int(about["rows"]) for about in episodes), pictures, worst)


def _source(path: Path) -> dict[str, Any]:
    """Return what a data set says about its origin."""
    try:
        source = read_origin(path) if path.is_file() else parse_json((path / SOURCE_FILE).read_bytes())
        layout = source["layout"]
        named = [layout["adapter"]["name"], layout["observation"]["name"], source["quality"], source["images"]]
        named += [about[key] for about in source["episodes"] for key in ("task", "condition", "record")]
        counted = [int(about[key]) for about in source["episodes"] for key in ("seed", "rows")]
        if not all(isinstance(name, str) for name in named) or min(counted, default=0) < 0:
            raise ValueError("it names no layout, or no episodes")  # noqa: TRY301 - told below
    except BetterError:
        raise
    except (OSError, ValueError, KeyError, TypeError) as error:
        said = str(error).splitlines()[0] if str(error) else type(error).__name__
        problem = f"is no data set of better export ({said})"
        raise InvalidInputError(str(path), problem, "Name its folder or file") from error
    form: dict[str, Any] = source
    return form


@contextmanager
def _intact(where: str) -> Iterator[None]:
    """Turn whatever goes wrong where a part of a data set is read into an InvalidInputError."""
    try:
        yield
    except BetterError:
        raise
    except (OSError, ValueError, LookupError, TypeError, ArithmeticError, pa.ArrowException) as error:
        said = " ".join(str(error).split())[:200] or type(error).__name__
        raise InvalidInputError(where, f"is damaged ({said})", _CURE) from error


def _record(runs: Sequence[RunFolder], about: Mapping[str, Any]) -> tuple[RunFolder, Record]:
    """Return the record that an episode was made of, and its run."""
    trial = TrialId(about["task"], about["condition"], about["seed"])
    for run in runs:
        entry = run.entry(trial)
        if entry is not None and entry.status == "done" and run.record_digest(entry) == about["record"]:
            return run, run.read_record(trial.task, trial.condition, trial.seed)
    raise RecordError(
        f"{trial}: no run that is named has the record of this episode (SHA-256 {about['record'][:12]}...). "
        "Name all runs that were exported."
    )


def _error(there: np.ndarray | None, wanted: np.ndarray) -> float:
    """Return the mean error of a picture in levels; infinite if it is missing or of another size."""
    if there is None or there.shape != wanted.shape:
        return float("inf")
    return float(np.abs(there.astype(np.int16) - wanted.astype(np.int16)).mean())


def _stored_lerobot(path: Path, layout: DatasetLayout, places: Sequence[_Place]) -> Iterator[_Stored]:
    """Yield the episodes of a folder of version 2.1 or 3.0."""
    for number, place in enumerate(places):
        with _intact(f"{path}: episode {number}"):
            table = _table(path, number, place, layout)
            vectors = {c.name: _column(table, c.name, c.size) for c in (*layout.states, layout.action)}
            counters = {name: _column(table, name, 1) for name in COUNTERS}
        yield _Stored(vectors, _pictures_of(path, number, place, table), counters)


def _meta(path: Path, episodes: int) -> tuple[Sequence[_Place], LeRobotCheck]:
    """Return where the episodes of a LeRobot data set lie, and what compares the rest of it.

    Raises:
        InvalidInputError: If a file in ``meta`` is damaged or lists another number of episodes.
    """
    meta = path / "meta"
    with _intact(str(meta)):
        info, stats = (parse_json(_read(meta / f"{name}.json")) for name in ("info", "stats"))
        if info["codebase_version"] == "v3.0":
            tasks, subtasks = (_parquet(meta / f"{name}.parquet").to_pylist() for name in ("tasks", "subtasks"))
            listed = _parquet(meta / "episodes/chunk-000/file-000.parquet").to_pylist()
        else:
            tasks, subtasks, listed = (_lines(meta / f"{name}.jsonl") for name in ("tasks", "subtasks", "episodes"))
        texts = {
            f"{kind}_index": {int(row[f"{kind}_index"]): str(row[kind]) for row in rows}
            for kind, rows in (("task", tasks), ("subtask", subtasks))
        }
    if len(listed) != episodes:
        raise InvalidInputError(str(meta), f"lists {len(listed)} episodes, and there are {episodes}", _CURE)
    places = listed if info["codebase_version"] == "v3.0" else [None] * episodes
    return places, LeRobotCheck(path, info, texts, stats, listed)


def _lines(file: Path) -> list[Any]:
    return [parse_json(line) for line in _read(file).splitlines() if line.strip()]


def _table(path: Path, number: int, place: _Place, layout: DatasetLayout) -> pa.Table:
    """Return vectors, and images without loss, of an episode."""
    needed = {*COUNTERS, layout.action.name, *layout.all_images, *(c.name for c in layout.states)}
    if place is None:
        name = f"data/chunk-{number // CHUNK_FILES:03d}/episode_{number:06d}.parquet"
        return _parquet(path / name, needed)
    name = f"data/chunk-{place['data/chunk_index']:03d}/file-{place['data/file_index']:03d}.parquet"
    table = _parquet(path / name, needed)
    return table.filter(pa.array(table.column("episode_index").to_numpy() == number))


def _pictures_of(
    path: Path, number: int, place: _Place, table: pa.Table
) -> Callable[[str, Sequence[int]], dict[int, np.ndarray]]:
    """Return what reads some pictures of an episode."""

    def read(column: str, rows: Sequence[int]) -> dict[int, np.ndarray]:
        if column in table.column_names:
            files = table.column(column).combine_chunks().field("bytes")
            return {row: np.asarray(Image.open(io.BytesIO(files[row].as_py()))) for row in rows}
        if place is None:
            name, first = f"videos/chunk-{number // CHUNK_FILES:03d}/{column}/episode_{number:06d}.mp4", 0
        else:
            chunk, file = (place[f"videos/{column}/{what}_index"] for what in ("chunk", "file"))
            name = f"videos/{column}/chunk-{chunk:03d}/file-{file:03d}.mp4"
            rate = len(table) / (place[f"videos/{column}/to_timestamp"] - place[f"videos/{column}/from_timestamp"])
            first = round(place[f"videos/{column}/from_timestamp"] * rate)
        return {row: picture for row in rows if (picture := _at(str(path / name), first + row)) is not None}

    return read


def _at(video: str, number: int) -> np.ndarray | None:
    """Return one picture of a video, or None if it ends before."""
    found = next(read_pictures(video, first=number), None)
    return found[1] if found is not None and found[0] == number else None


def _stored_robomimic(path: Path, layout: DatasetLayout, episodes: Sequence[Mapping[str, Any]]) -> Iterator[_Stored]:
    """Yield the demonstrations of an HDF5 file."""
    with open_hdf5(path, "r") as file:
        for number in range(len(episodes)):
            with _intact(f"{path}: data/demo_{number}"):
                group = file[f"data/demo_{number}"]
                vectors = {c.name: group["obs"][observation_name(c.name)][:] for c in layout.states}
                vectors[layout.action.name] = group["actions"][:].astype(layout.action.dtype)
                seen = {c.name: group["obs"][observation_name(c.name)] for c in layout.images}
            yield _Stored(vectors, partial(_rows_of, seen))


def _rows_of(seen: Mapping[str, Any], column: str, rows: Sequence[int]) -> dict[int, np.ndarray]:
    return {row: seen[column][row] for row in rows}


def _column(table: pa.Table, name: str, size: int) -> np.ndarray:
    chunk = table.column(name).combine_chunks()
    flat = chunk.flatten() if pa.types.is_fixed_size_list(chunk.type) else chunk
    return np.asarray(flat.to_numpy(zero_copy_only=False)).reshape(-1, size)


def _parquet(path: Path, needed: Collection[str] = ()) -> pa.Table:
    """Read a Parquet file, of its columns those that are needed; raise InvalidInputError if it cannot be read."""
    try:
        with pq.ParquetFile(io.BytesIO(_read(path))) as file:
            columns = [name for name in file.schema_arrow.names if name in needed] if needed else None
            return file.read(columns, use_threads=False)
    except pa.ArrowException as error:
        said = str(error).splitlines()[0][:200]
        raise InvalidInputError(str(path), f"is damaged ({said})", _CURE) from error


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise InvalidInputError(str(path), f"cannot be read ({error.strerror})", _CURE) from error
