"""Storage of exported episodes until the data set is assembled. Incomplete episodes are exported again."""

from __future__ import annotations

import hashlib
import io
import json
import shutil
import struct
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from PIL import Image
from pydantic import Field, TypeAdapter

from betterbench.demonstrations.export.frames import frame_numbers, shown_images
from betterbench.demonstrations.export.layout import DatasetLayout
from betterbench.demonstrations.export.numbers import color_counts, sampled_rows
from betterbench.demonstrations.export.video import VideoWriter
from betterbench.errors import InvalidInputError, one_line
from betterbench.jobs import write_durably
from betterbench.json_form import dump_json, open_form, open_seal, read_bounded, read_form, sealed_form, strict_form
from betterbench.ordinary_file import open_ordinary, read_ordinary
from betterbench.records import Record

ImageForm = Literal["video", "png"]

PNG_LEVEL = 3
"""Compression level of PNG images, from 0 to 9."""

_INDEX, _NUMBERS = "part.json", "numbers.parquet"
_SUBGOAL = "subgoal"
_MAX_INDEX_BYTES = 1 << 26


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """Exported episode, independent of the file format of the data set.

    Attributes:
        vectors: Values (N, size) of each vector column.
        subgoals: (N,) name of the current subgoal in each frame.
        videos: Video file of each image column, for the image format "video".
        pngs: N PNG files of each image column, for the image format "png".
        levels: (3, 256) histogram of the sampled images, for each image column.
        sampled: Number of images that were sampled.
        about: Metadata of the episode.
    """

    vectors: Mapping[str, np.ndarray]
    subgoals: tuple[str, ...]
    videos: Mapping[str, bytes]
    pngs: Mapping[str, tuple[bytes, ...]]
    levels: Mapping[str, np.ndarray]
    sampled: int
    about: Mapping[str, Any]

    def __len__(self) -> int:
        return len(self.subgoals)


def write_part(
    folder: Path, record: Record, layout: DatasetLayout, pictures: Iterator[Mapping[str, np.ndarray]], form: ImageForm
) -> None:
    """Export an episode into a folder.

    The index is written last, so a folder with an index contains a complete episode.

    Raises OSError, the errors that the renderer raises, and the errors of
    :func:`~betterbench.demonstrations.export.frames.frame_numbers`.
    """
    shutil.rmtree(folder, ignore_errors=True)
    numbers = frame_numbers(record, layout)
    rate = round(record.metadata.control_rate_hz)
    columns: dict[str, pa.Array] = {name: _fixed_lists(values) for name, values in numbers.vectors.items()}
    columns[_SUBGOAL] = pa.array(numbers.subgoals, pa.string())
    names = [column.name for column in layout.images]
    videos = {name: VideoWriter(rate_hz=rate) for name in names if form == "video"}
    pngs = {name: list[bytes]() for name in names if form == "png"}
    levels = {name: np.zeros((3, 256), np.int64) for name in names}
    sampled = sampled_rows(record.n_steps)
    for row, images in enumerate(shown_images(record, layout, pictures) if names else ()):
        for name in names:
            if form == "video":
                videos[name].add(images[name])
            else:
                pngs[name].append(png(images[name]))
            if row in sampled:
                levels[name] += color_counts(images[name])
    columns |= {name: pa.array(images, pa.binary()) for name, images in pngs.items()}
    files = {f"{names.index(name)}.mp4": video.finish() for name, video in videos.items()}
    files[_NUMBERS] = parquet_bytes(pa.table(columns))
    for name, data in files.items():
        write_durably(folder / name, data)
    index = {
        "files": {name: hashlib.sha256(data).hexdigest() for name, data in files.items()},
        "images": {name: {"levels": levels[name].tolist()} for name in names},
        "sampled": len(sampled),
        "about": about(record, numbers.subgoals),
    }
    write_durably(folder / _INDEX, dump_json(sealed_form(json.loads(dump_json(index)))))


_Levels = Annotated[
    list[Annotated[list[Annotated[int, Field(ge=0)]], Field(min_length=256, max_length=256)]],
    Field(min_length=3, max_length=3),
]


@strict_form
@dataclass(frozen=True, slots=True)
class _Images:
    """Histograms of the color channels, computed from the sampled images of one image column."""

    levels: _Levels


@open_form
@dataclass(frozen=True, slots=True)
class _About:
    """Episode metadata that the export reads from the folder of the episode; see :func:`about`."""

    seed: int
    rows: Annotated[int, Field(ge=1)]
    control_rate_hz: Annotated[float, Field(gt=0.0)]
    instruction: str
    subgoals: list[str]


@strict_form
@dataclass(frozen=True, slots=True)
class PartIndex:
    """Index of an exported episode: files, color histograms and metadata.

    It is stored with a checksum, so that changes to it are detected.

    Attributes:
        files: SHA-256 of the other files of the episode, by file name.
        images: Color histograms by image column.
        sampled: Number of images in the histograms.
        about: Metadata of the episode, as :func:`about` returns it.
    """

    files: dict[str, str]
    images: dict[str, _Images]
    sampled: Annotated[int, Field(ge=0)]
    about: dict[str, Any]

    def __post_init__(self) -> None:
        """Raise InvalidInputError if a file name contains a folder, or the metadata are incomplete."""
        if _NUMBERS not in self.files or any(Path(name).name != name for name in self.files):
            raise InvalidInputError(
                "files", "these are not the file names of an exported episode", "Export the episode again"
            )
        read_form(_ABOUT, self.about, where="about", cure="Export the episode again")


_ABOUT, _PART = TypeAdapter(_About), TypeAdapter(PartIndex)


def read_index(folder: Path) -> PartIndex | None:
    """Read the index of an exported episode. Return None if the episode is incomplete or damaged."""
    file, cure = folder / _INDEX, "Export the episode again"
    try:
        raw = read_bounded(file, max_bytes=_MAX_INDEX_BYTES, cure=cure)
        index = read_form(_PART, open_seal(raw, where=str(file), cure=cure), where=str(file), cure=cure)
        for name, digest in index.files.items():
            with open_ordinary(folder / name) as opened:
                if hashlib.file_digest(opened, "sha256").hexdigest() != digest:
                    return None
    except (OSError, ValueError, InvalidInputError):
        return None
    return index


def read_part(folder: Path, layout: DatasetLayout) -> Part | None:
    """Read an exported episode. Return None if it is incomplete or damaged."""
    index = read_index(folder)
    if index is None:
        return None
    files = {name: read_ordinary(folder / name) for name in index.files}
    table = pq.read_table(io.BytesIO(files[_NUMBERS]), use_threads=False)
    vectors = {}
    for column in (*layout.states, layout.action):
        flat = table.column(column.name).combine_chunks().flatten()
        vectors[column.name] = flat.to_numpy().reshape(-1, column.size)
    videos = {c.name: files[f"{n}.mp4"] for n, c in enumerate(layout.images) if f"{n}.mp4" in files}
    pngs = {c.name: tuple(table.column(c.name).to_pylist()) for c in layout.images if c.name in table.column_names}
    return Part(
        vectors,
        tuple(table.column(_SUBGOAL).to_pylist()),
        videos | {name: videos[other] for name, other in layout.copies.items() if other in videos},
        pngs | {name: pngs[other] for name, other in layout.copies.items() if other in pngs},
        _repeated({name: np.array(found.levels) for name, found in index.images.items()}, layout),
        index.sampled,
        index.about,
    )


def about(record: Record, subgoals: Sequence[str]) -> dict[str, Any]:
    """Return the metadata that a data set stores for an episode."""
    m = record.metadata
    return {
        "task": m.task,
        "task_version": m.task_version,
        "suite_version": m.suite_version,
        "condition": m.condition,
        "variation": m.variation,
        "seed": m.seed,
        "policy": m.policy,
        "instruction": m.instruction,
        "recorded_action_space": m.action_space,
        "control_rate_hz": m.control_rate_hz,
        "looks": m.looks,
        "room": m.room,
        "scene": m.scene_hash,
        "rows": record.n_steps,
        "subgoals": list(dict.fromkeys(subgoals)),
    }


def png(picture: np.ndarray) -> bytes:
    """Encode an image as a PNG file."""
    buffer = io.BytesIO()
    Image.fromarray(picture).save(buffer, "PNG", compress_level=PNG_LEVEL)
    return buffer.getvalue()


def read_png(data: bytes) -> np.ndarray:
    """Decode an untrusted PNG file. Raises ValueError if the file is damaged or not a PNG file."""
    try:
        with Image.open(io.BytesIO(data), formats=["PNG"]) as image:
            return np.asarray(image)
    except (OSError, SyntaxError, struct.error, zlib.error, Image.DecompressionBombError) as error:
        raise ValueError(f"an image is not a PNG file ({one_line(error, most=120)})") from error


def parquet_bytes(table: pa.Table) -> bytes:
    """Serialize a table as a Parquet file with one row group.

    As long as the same package versions are installed, the same table always gives the same bytes.
    """
    buffer = io.BytesIO()
    pq.write_table(table, buffer, row_group_size=max(1, table.num_rows), compression="snappy", write_statistics=False)
    return buffer.getvalue()


def _fixed_lists(values: np.ndarray) -> pa.Array:
    return pa.FixedSizeListArray.from_arrays(pa.array(np.ascontiguousarray(values).reshape(-1)), values.shape[1])


def _repeated(levels: dict[str, np.ndarray], layout: DatasetLayout) -> dict[str, np.ndarray]:
    return levels | {name: levels[other] for name, other in layout.copies.items()}
