"""Comparison of a LeRobot data set with its source records, file by file."""

from __future__ import annotations

import io
import re
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from betterbench.demonstrations.export import lerobot, lerobot_v21
from betterbench.demonstrations.export.comparing import CURE, ReadPictures, intact, require_equal, require_match
from betterbench.demonstrations.export.episodes import Dataset
from betterbench.demonstrations.export.expected import ExpectedDataset
from betterbench.demonstrations.export.language import EVENTS, PERSISTENT
from betterbench.demonstrations.export.part import Part, read_png
from betterbench.demonstrations.export.video import read_pictures
from betterbench.errors import InvalidInputError, one_line
from betterbench.json_form import parse_json
from betterbench.ordinary_file import read_ordinary
from betterbench.records.parquet import MAX_UNPACKED_BYTES, unpacked_bytes

_RANGE = re.compile(r"0:([0-9]{1,9})")
"""Pattern of the range of training episodes in LeRobot's notation."""


@dataclass(slots=True)
class _Frames:
    """Frame file that is being compared, with the number of rows compared so far."""

    name: str
    table: pa.Table
    used: int = 0


class LeRobotCheck(ABC):
    """Check of a LeRobot data set, except its images, its image statistics, and the questions in its language columns.

    Attributes:
        listed_in: Folders in which trainers read every Parquet file.
    """

    listed_in: Sequence[str]

    def __init__(self, path: Path, expected: ExpectedDataset, info: Any, listed: Sequence[Any]) -> None:  # noqa: ANN401 - JSON
        """Prepare the check of a data set.

        Args:
            path: Folder of the data set.
            expected: Expected content. The episodes are added to it one by one.
            info: Content of ``meta/info.json``.
            listed: Entry in ``meta`` for each episode.
        """
        self.path, self.expected, self.info, self.listed = path, expected, info, listed
        self._frames: _Frames | None = None
        self._names: set[str] = set()

    def episode(self, number: int, part: Part) -> ReadPictures:
        """Compare an episode with the expected episode, and return a reader for the images of the episode.

        The expected episode must be the last episode that was added to ``expected``.
        """
        self.compare_listed(number, part)
        dataset, first = self.expected.dataset, self.expected.first(number)
        wanted = lerobot.frame_table(dataset, number, part, first=first)
        name = self.frames_name(number)
        if self._frames is None or self._frames.name != name:
            self._close()
            self._frames = _Frames(name, self._open(name, wanted))
            self._names.add(name)
        table = self._frames.table.slice(self._frames.used, len(part))
        self._frames.used += len(part)
        _require_same_rows(table, wanted, f"{self.path / name}: episode {number}")
        return self._pictures(number, table)

    def finish(self) -> None:
        """Compare the parts of the data set that do not belong to a single episode.

        Call this method after the last episode.
        """
        self._close()
        known = {self.path / name for name in (*self._names, lerobot.EPISODES_FILE)}
        for kind in self.listed_in:
            for file in sorted((self.path / kind).rglob("*.parquet")):
                if file not in known:
                    raise InvalidInputError(
                        str(file), "this file does not belong to any episode, but trainers would read it", CURE
                    )
        splits = self.info.get("splits")
        train = str(splits.get("train")) if isinstance(splits, dict) else "absent"
        count = _RANGE.fullmatch(train)
        said = f"splits.train is {one_line(train, most=80)}"
        number = int(count[1]) if count else 0
        self.compare_meta(self.expected.divided(number, str(self.path / "meta/info.json"), said))

    @abstractmethod
    def compare_listed(self, number: int, part: Part) -> None:
        """Compare the entry in ``meta`` that describes an episode with the expected entry."""

    @abstractmethod
    def compare_meta(self, dataset: Dataset) -> None:
        """Compare the files in ``meta`` that describe the data set as a whole with their expected content."""

    @abstractmethod
    def frames_name(self, number: int) -> str:
        """Return the name of the file that contains the frames of an episode."""

    @abstractmethod
    def video_place(self, column: str, number: int) -> tuple[str, int]:
        """Return the name of the video file that contains an episode, and the index of its first frame in the file."""

    def same_json(self, file: str, wanted: object) -> None:
        """Compare a JSON file with its expected content."""
        require_match(_json(self.path / file), wanted, str(self.path / file))

    def _open(self, name: str, wanted: pa.Table) -> pa.Table:
        """Read a frame file, leaving out the questions in its language column."""
        with _parquet_file(self.path / name) as file:
            schema = file.schema_arrow
            require_equal(_types(schema), _types(wanted.schema), f"{self.path / name}: columns")
            described = parse_json((schema.metadata or {}).get(b"huggingface", b"null"))
            require_equal(described, parse_json(wanted.schema.metadata[b"huggingface"]), f"{self.path / name}: schema")
            return file.read([column for column in schema.names if column != EVENTS], use_threads=False)

    def _close(self) -> None:
        if self._frames is not None and self._frames.used != len(self._frames.table):
            problem = f"it has {len(self._frames.table)} rows, but {self._frames.used} belong to episodes"
            raise InvalidInputError(str(self.path / self._frames.name), problem, CURE)

    def _pictures(self, number: int, table: pa.Table) -> ReadPictures:
        def read(column: str, rows: Sequence[int]) -> dict[int, np.ndarray]:
            if self.expected.form == "png":
                files = table.column(column).combine_chunks().field("bytes")
                return {row: read_png(files[row].as_py()) for row in rows}
            name, first = self.video_place(column, number)
            return {r: picture for r in rows if (picture := _at(str(self.path / name), first + r)) is not None}

        return read


class CheckOfV30(LeRobotCheck):
    """Check of a data set of version 3.0, in which ``meta/episodes`` lists the file of each episode."""

    listed_in = ("data", "meta/episodes")

    def __init__(self, path: Path, expected: ExpectedDataset, info: Any) -> None:  # noqa: ANN401 - JSON
        super().__init__(path, expected, info, _parquet(path / lerobot.EPISODES_FILE).to_pylist())
        self._files: dict[str, int] = {}
        self._shown: dict[str, int] = {}

    def compare_listed(self, number: int, part: Part) -> None:
        """Compare the row of an episode in ``meta/episodes`` with the expected row: locations, times and statistics."""
        there, dataset = self.listed[number], self.expected.dataset
        wanted = lerobot.episode_row(dataset, number, self.expected.first(number))
        wanted |= lerobot.file_fields("data", self._file("data", there))
        for column in self.expected.layout.all_images if dataset.form == "video" else ():
            kind = f"videos/{column}"
            file = self._file(kind, there)
            begun = self._shown[kind]
            self._shown[kind] = begun + len(part)
            wanted |= lerobot.file_fields(kind, file)
            wanted |= lerobot.time_fields(kind, begun, begun + len(part), dataset.rate_hz)
        wanted |= lerobot.stats_fields(self.expected.episode_stats(part))
        require_match(there, wanted, f"{self.path / lerobot.EPISODES_FILE}: episode {number}")

    def _file(self, kind: str, there: Mapping[str, Any]) -> int:
        """Return the index of the file that contains an episode.

        Each episode is in the same file as the previous episode, unless its row in ``meta/episodes`` names the next
        file.
        """
        before = self._files.get(kind)
        file = before or 0
        if before is not None and lerobot.file_fields(kind, before + 1).items() <= there.items():
            file = before + 1
        if file != before:
            self._files[kind], self._shown[kind] = file, 0
        return file

    def compare_meta(self, dataset: Dataset) -> None:
        """Compare instructions, subgoals, statistics and ``info.json`` with the expected content."""
        for file, wanted in lerobot.index_tables(dataset).items():
            with intact(str(self.path / file)):
                require_match(_index_form(_parquet(self.path / file)), _index_form(wanted), str(self.path / file))
        self.same_json("meta/stats.json", self.expected.stats())
        self.same_json("meta/info.json", lerobot.info_v30(dataset))

    def frames_name(self, number: int) -> str:
        """Return the file name listed in the episode's row in ``meta/episodes``."""
        return lerobot.file_name("data", self._number("data", number))

    def video_place(self, column: str, number: int) -> tuple[str, int]:
        """Return the video file and the index of the first frame, using the episode's row in ``meta/episodes``."""
        kind = f"videos/{column}"
        first = round(self.listed[number][f"{kind}/from_timestamp"] * self.expected.dataset.rate_hz)
        return lerobot.file_name(kind, self._number(kind, number)), first

    def _number(self, kind: str, number: int) -> int:
        row = self.listed[number]
        return int(row[f"{kind}/chunk_index"]) * lerobot.CHUNK_FILES + int(row[f"{kind}/file_index"])


class CheckOfV21(LeRobotCheck):
    """Check of a data set of version 2.1, in which each episode has its own files."""

    listed_in = ("data",)

    def __init__(self, path: Path, expected: ExpectedDataset, info: Any) -> None:  # noqa: ANN401 - JSON
        super().__init__(path, expected, info, _lines(path / lerobot_v21.EPISODES_FILE))
        self._stats = _lines(path / lerobot_v21.EPISODES_STATS_FILE)

    def compare_listed(self, number: int, part: Part) -> None:
        """Compare the lines in ``meta`` that describe an episode with the expected lines."""
        line = lerobot_v21.episode_line(self.expected.dataset, number)
        require_match(self.listed[number], line, f"{self.path / lerobot_v21.EPISODES_FILE}: line {number + 1}")
        file = self.path / lerobot_v21.EPISODES_STATS_FILE
        if number >= len(self._stats):
            raise InvalidInputError(str(file), f"it lists only {len(self._stats)} of the episodes", CURE)
        stats = lerobot_v21.stats_line(number, self.expected.episode_stats(part))
        require_match(self._stats[number], stats, f"{file}: line {number + 1}")

    def compare_meta(self, dataset: Dataset) -> None:
        """Compare the files in ``meta`` that describe the data set as a whole with their expected content.

        These are the files with instructions, subgoals and statistics, ``info.json``, and GR00T's ``modality.json``.
        """
        if len(self._stats) != len(self.listed):
            problem = f"it lists {len(self._stats)} episodes, but there are {len(self.listed)}"
            raise InvalidInputError(str(self.path / lerobot_v21.EPISODES_STATS_FILE), problem, CURE)
        for file, lines in lerobot_v21.index_lines(dataset).items():
            require_match(_lines(self.path / file), lines, str(self.path / file))
        self.same_json("meta/stats.json", lerobot_v21.kept_stats(self.expected.stats()))
        modality = lerobot_v21.modality(dataset.layout)
        if modality is not None:
            self.same_json(lerobot_v21.MODALITY_FILE, modality)
        self.same_json("meta/info.json", lerobot_v21.info_v21(dataset))

    def frames_name(self, number: int) -> str:
        """Return the name that version 2.1 prescribes for the frame file of an episode."""
        return lerobot_v21.frames_file(number)

    def video_place(self, column: str, number: int) -> tuple[str, int]:
        """Return the name that version 2.1 prescribes for the video of an episode. The episode begins at frame 0."""
        return lerobot_v21.video_file(column, number), 0


def lerobot_check(path: Path, expected: ExpectedDataset, episodes: int) -> LeRobotCheck:
    """Return the check for a data set of version 2.1 or 3.0.

    Raises:
        InvalidInputError: If a file in ``meta`` is damaged, or lists a different number of episodes than expected.
    """
    with intact(str(path / "meta")):
        info = _json(path / "meta/info.json")
        version, columns = info["codebase_version"], set(info["features"])
        expected.language = bool({PERSISTENT, EVENTS} & columns)
        check = (CheckOfV30 if version == "v3.0" else CheckOfV21)(path, expected, info)
    if len(check.listed) != episodes or not all(isinstance(row, dict) for row in check.listed):
        raise InvalidInputError(
            str(path / "meta"), f"it lists {len(check.listed)} episodes, but there are {episodes}", CURE
        )
    return check


def _require_same_rows(table: pa.Table, wanted: pa.Table, where: str) -> None:
    """Compare the frames of an episode with the expected frames. For images, only the file names are compared."""
    if len(table) != len(wanted):
        raise InvalidInputError(where, f"it has {len(table)} rows, expected {len(wanted)}", CURE)
    for name in wanted.column_names:
        if name == EVENTS:
            continue
        there, asked = (t.column(name).combine_chunks() for t in (table, wanted))
        if pa.types.is_struct(asked.type):
            there, asked = there.field("path"), asked.field("path")
        if not there.equals(asked):
            require_equal({name: there.to_pylist()}, {name: asked.to_pylist()}, where)


def _types(schema: pa.Schema) -> dict[str, str]:
    """Return the type of each column.

    The items of list columns have different names in different versions of Parquet, so they are given the same name.
    """
    return {column.name: str(column.type).replace("<element: ", "<item: ") for column in schema}


def _index_form(table: pa.Table) -> dict[str, Any]:
    """Return the parts of an index table that are compared: rows, types, and columns of the pandas index."""
    described = parse_json((table.schema.metadata or {}).get(b"pandas", b"{}"))
    return {"rows": table.to_pylist(), "types": _types(table.schema), "index": described.get("index_columns")}


def _at(video: str, number: int) -> np.ndarray | None:
    """Return a frame of a video. Return None if the video is shorter."""
    found = next(read_pictures(video, first=number), None)
    return found[1] if found is not None and found[0] == number else None


def _json(file: Path) -> Any:  # noqa: ANN401 - an untrusted file may contain anything
    with intact(str(file)):
        return parse_json(_read(file))


def _lines(file: Path) -> list[Any]:
    with intact(str(file)):
        return [parse_json(line) for line in _read(file).splitlines() if line.strip()]


def _parquet(path: Path) -> pa.Table:
    with _parquet_file(path) as file:
        return file.read(use_threads=False)


@contextmanager
def _parquet_file(path: Path) -> Iterator[pq.ParquetFile]:
    with intact(str(path)), pq.ParquetFile(io.BytesIO(_read(path))) as file:
        if unpacked_bytes(file) > MAX_UNPACKED_BYTES:
            raise InvalidInputError(str(path), f"it unpacks to more than {MAX_UNPACKED_BYTES} bytes", CURE)
        yield file


def _read(path: Path) -> bytes:
    try:
        return read_ordinary(path)
    except OSError as error:
        raise InvalidInputError(str(path), f"the file cannot be read ({error.strerror})", CURE) from error
