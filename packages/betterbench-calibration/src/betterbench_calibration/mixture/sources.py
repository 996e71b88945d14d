"""Sources for a mixture: LeRobot data sets (2.0, 2.1 and 3.0), sets from ``better vqa``, and question files.

An item of a LeRobot data set is a frame. Its index is the same as in ``LeRobotDataset``. Frames of validation episodes
are not drawn. An item of a question set is a line.
"""

from __future__ import annotations

import bisect
import hashlib
import itertools
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Protocol

import pyarrow as pa
import pyarrow.parquet as pq
from pydantic import Field, TypeAdapter

from betterbench.errors import InvalidInputError, one_line
from betterbench.json_form import open_form, open_seal, parse_json, read_bounded, read_form, read_object, strict_form
from betterbench.ordinary_file import open_ordinary
from betterbench_calibration.mixture.shares import MixturePart, WeightedGroup, Within, shares_of

_MAX_META_BYTES = 1 << 30
_MAX_QUESTION_BYTES = 1 << 34
_MOST_EPISODES, _MOST_FRAMES = 10_000_000, 1 << 40
_AGAIN = "Export the data set again"
_COLUMNS = ("episode_index", "length")
_CURE = "Correct the mixture file. docs/mixture.md shows an example"

ShortText = Annotated[str, Field(min_length=1, max_length=4096)]


class ItemSource(Protocol):
    """Data set with numbered items, from which a mixture draws."""

    @property
    def path(self) -> Path:
        """Path of the folder or file."""

    @property
    def kind(self) -> str:
        """Kind of the source, in one or two words."""

    def __len__(self) -> int:
        """Return the number of items."""

    def place(self, number: int) -> dict[str, int]:
        """Return the location of an item: ``episode``, ``frame`` and ``index``, or ``byte`` (offset of a question)."""

    def item(self, number: int) -> dict[str, Any]:
        """Return an item: a question as written, or the location of a frame."""


@dataclass(frozen=True, slots=True)
class LeRobotSource:
    """Training frames of a LeRobot data set.

    Attributes:
        path: Folder of the data set.
        version: Version of the LeRobot format ("v3.0").
        first: Index of the first training episode.
        starts: Index of the first frame of each training episode in the complete data set, followed by the end of the
            last episode.
    """

    path: Path
    version: str
    first: int
    starts: tuple[int, ...]

    @property
    def kind(self) -> str:
        """Name of the format, with its version."""
        return f"LeRobot {self.version}"

    def __len__(self) -> int:
        """Return the number of frames."""
        return self.starts[-1] - self.starts[0]

    def item(self, number: int) -> dict[str, Any]:
        """Return the location of a frame. The training code must read the frame itself."""
        return self.place(number)

    def place(self, number: int) -> dict[str, int]:
        """Return the location of a frame."""
        index = self.starts[0] + number
        episode = bisect.bisect_right(self.starts, index) - 1
        return {"episode": self.first + episode, "frame": index - self.starts[episode], "index": index}


@dataclass(frozen=True, slots=True)
class QuestionSource:
    """Lines of a question file. ``places`` contains the byte offset and the length of each line."""

    path: Path
    places: tuple[tuple[int, int], ...]

    @property
    def kind(self) -> str:
        """Kind of the source."""
        return "questions"

    def __len__(self) -> int:
        """Return the number of questions."""
        return len(self.places)

    def place(self, number: int) -> dict[str, int]:
        """Return the byte offset of a question's line."""
        return {"byte": self.places[number][0]}

    def item(self, number: int) -> dict[str, Any]:
        """Return a question as written. Raises InvalidInputError if the line is not a JSON object."""
        start, length = self.places[number]
        with open_ordinary(self.path) as file:
            file.seek(start)
            line = file.read(length)
        try:
            found = parse_json(line)
        except ValueError as error:
            raise InvalidInputError(
                f"{self.path}: item {number}", f"is not JSON ({error})", "Repair the file"
            ) from error
        if not isinstance(found, dict):
            raise InvalidInputError(f"{self.path}: item {number}", "is not a JSON object", "Write one object per line")
        return found


def open_source(path: Path) -> ItemSource:
    """Return the source for a folder or file.

    Raises:
        InvalidInputError: If the path is not a LeRobot data set, a question set or a question file; if it is damaged;
            or if it contains questions about test trials. Such questions must not be used for training.
    """
    if (path / "meta/info.json").is_file():
        return _lerobot(path)
    if (path / "questions.jsonl").is_file():
        return _questions(path / "questions.jsonl", _require_for_training(path))
    if path.suffix == ".jsonl" and path.is_file():
        of_set = (path.parent / "summary.json").is_file() and path.name == "questions.jsonl"
        return _questions(path, _require_for_training(path.parent) if of_set else None)
    problem = "is not a LeRobot data set, a set of better vqa or a .jsonl file" if path.exists() else "does not exist"
    raise InvalidInputError(
        str(path), problem, "Name the output of better export or better vqa, or a file of JSON lines"
    )


def _require_for_training(folder: Path) -> str | None:
    """Return the SHA-256 of the questions in a set, or None if the set does not state it.

    Raises InvalidInputError if the questions are not for training.
    """
    file, cure = folder / "summary.json", "Make the set again in a new folder"
    raw = read_bounded(file, max_bytes=_MAX_META_BYTES, cure=cure)
    summary = open_seal(raw, where=str(file), cure=cure, since=("schema_version", 2))
    if summary.get("purpose") != "training":
        told = one_line(summary.get("purpose", "an unknown purpose"), most=80)
        raise InvalidInputError(
            str(folder),
            f"its questions are for {told}",
            "Make the set from demonstrations: run better vqa on a run of better collect",
        )
    sha256 = summary.get("sha256")
    return sha256 if isinstance(sha256, str) else None


def _json(path: Path) -> dict[str, Any]:
    return read_object(path, max_bytes=_MAX_META_BYTES, cure=_AGAIN)


def _lerobot(path: Path) -> LeRobotSource:
    info = _json(path / "meta/info.json")
    version = str(info.get("codebase_version"))
    if version not in ("v2.0", "v2.1", "v3.0"):
        shown = one_line(version, most=40)
        raise InvalidInputError(str(path), f"its version is {shown}", "Give a LeRobot data set of version 2.x or 3.0")
    lengths = _lengths_v3(path) if version == "v3.0" else _lengths_v2(path)
    if len(lengths) != info.get("total_episodes") or sum(lengths) != info.get("total_frames"):
        told = f"{info.get('total_episodes')} episodes and {info.get('total_frames')} frames"
        there = f"{len(lengths)} episodes and {sum(lengths)} frames"
        problem = f"info.json states {one_line(told, most=200)}, but the data set has {there}"
        raise InvalidInputError(str(path), problem, _AGAIN)
    first, end = _training_range(path, info, len(lengths))
    starts = list(itertools.accumulate(lengths, initial=0))
    return LeRobotSource(path, version, first, tuple(starts[first : end + 1]))


def _training_range(path: Path, info: Mapping[str, Any], episodes: int) -> tuple[int, int]:
    """Return the range of training episodes, with exclusive end. By default, all episodes are used for training."""
    splits = info.get("splits")
    told = splits.get("train", f"0:{episodes}") if isinstance(splits, dict) else f"0:{episodes}"
    found = re.fullmatch(r"(\d{1,9}):(\d{1,9})", str(told))
    if found is None or not int(found[1]) < int(found[2]) <= episodes:
        problem = f"{one_line(told, most=80)!r} is not a range of its episodes"
        raise InvalidInputError(f"{path}/meta/info.json: splits", problem, "Correct it")
    return int(found[1]), int(found[2])


@open_form
@dataclass(frozen=True, slots=True)
class _EpisodeForm:
    """Fields that are read from a line of ``meta/episodes.jsonl``."""

    episode_index: Annotated[int, Field(ge=0, lt=_MOST_EPISODES)]
    length: Annotated[int, Field(ge=1, lt=_MOST_FRAMES)]


_EPISODE = TypeAdapter(_EpisodeForm)


def _lengths_v2(path: Path) -> list[int]:
    file = path / "meta/episodes.jsonl"
    data = read_bounded(file, max_bytes=_MAX_META_BYTES, cure=_AGAIN)
    lines = [(number, line) for number, line in enumerate(data.splitlines(), start=1) if line.strip()]
    rows = [read_form(_EPISODE, line, where=f"{file}: line {number}", cure=_AGAIN) for number, line in lines]
    return _counted(file, [(row.episode_index, row.length) for row in rows])


def _lengths_v3(path: Path) -> list[int]:
    rows: list[tuple[Any, Any]] = []
    for file in sorted((path / "meta/episodes").rglob("*.parquet")):
        try:
            with open_ordinary(file) as opened, pq.ParquetFile(opened) as table:
                if len(rows) + table.metadata.num_rows > _MOST_EPISODES:
                    raise ValueError(f"it declares {table.metadata.num_rows} rows")  # noqa: TRY301 - reported below
                if not all(pa.types.is_integer(table.schema_arrow.field(name).type) for name in _COLUMNS):
                    raise ValueError("its lengths are not whole numbers")  # noqa: TRY301
                found = table.read(columns=list(_COLUMNS))
                rows += zip(found["episode_index"].to_pylist(), found["length"].to_pylist(), strict=True)
        except (OSError, KeyError, ValueError, pa.ArrowException) as error:
            raise InvalidInputError(str(file), f"cannot be read ({one_line(error, most=200)})", _AGAIN) from error
    return _counted(path / "meta/episodes", rows)


def _counted(file: Path, rows: Sequence[tuple[Any, Any]]) -> list[int]:
    """Return the lengths of episodes, which must be numbered from 0 without gaps."""
    numbered = all(type(n) is int and type(length) is int and 0 < length < _MOST_FRAMES for n, length in rows)
    ordered = sorted(rows) if numbered else []
    if not numbered or [number for number, _ in ordered] != list(range(len(ordered))):
        raise InvalidInputError(str(file), "its episodes are not numbered without gaps", _AGAIN)
    return [length for _, length in ordered]


def _questions(path: Path, sha256: str | None) -> QuestionSource:
    """Return the lines of a question file. If ``sha256`` is given, the content of the file must match it."""
    if path.stat().st_size > _MAX_QUESTION_BYTES:
        raise InvalidInputError(str(path), f"is larger than {_MAX_QUESTION_BYTES >> 30} GiB", "Divide the file")
    places, at, whole = [], 0, hashlib.sha256()
    with open_ordinary(path) as file:
        for line in file:
            if line.strip():
                places.append((at, len(line)))
            at += len(line)
            whole.update(line)
    if sha256 not in (None, whole.hexdigest()):
        problem = "was changed after the set was made"
        raise InvalidInputError(str(path), problem, "Make the set again in a new folder")
    if not places:
        raise InvalidInputError(str(path), "it has no lines", "Name a file with questions")
    return QuestionSource(path, tuple(places))


_Weight = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]


@strict_form
@dataclass(frozen=True, slots=True)
class FileForm:
    """Entry for a data set in a mixture file. By default, the data set is named after its folder or file."""

    path: ShortText
    name: ShortText | None = None
    weight: _Weight = 1.0


@strict_form
@dataclass(frozen=True, slots=True)
class GroupForm:
    """Entry for a group in a mixture file."""

    name: ShortText
    weight: _Weight
    sets: Annotated[tuple[FileForm, ...], Field(min_length=1)]
    within: Within = "items"


@strict_form
@dataclass(frozen=True, slots=True)
class MixtureForm:
    """Content of a mixture file: the groups, and the seed of the draws."""

    groups: Annotated[tuple[GroupForm, ...], Field(min_length=1)]
    seed: int = 0


MIXTURE_FORM = TypeAdapter(MixtureForm)


@dataclass(frozen=True, slots=True)
class FileMixture:
    """Mixture that was read from a file.

    Attributes:
        parts: Data sets with their shares.
        sources: Source of each data set, by name.
        seed: Seed of the draws.
    """

    parts: tuple[MixturePart, ...]
    sources: Mapping[str, ItemSource]
    seed: int


def mixture_of_files(form: object, *, where: str, folder: Path) -> FileMixture:
    """Return the mixture that a mixture file describes.

    Args:
        form: Content of the file, as JSON or as the value of a YAML document.
        where: Name of the file, used in messages.
        folder: Folder to which paths in the file are relative.

    Raises:
        InvalidInputError: If a field is wrong, or a data set cannot be drawn from.
    """
    read = read_form(MIXTURE_FORM, form, where=where, cure=_CURE)
    groups, sources = [], {}
    for group in read.groups:
        parts = []
        for entry in group.sets:
            source = open_source(folder / entry.path)
            name = entry.name or Path(entry.path).name
            if name in sources:
                raise InvalidInputError(
                    f"{where}: {name}", "two data sets have this name", "Give one of them another name"
                )
            sources[name] = source
            parts.append(MixturePart(name, group.name, len(source), entry.weight))
        groups.append(WeightedGroup(group.name, group.weight, tuple(parts), group.within))
    return FileMixture(shares_of(groups), sources, read.seed)
