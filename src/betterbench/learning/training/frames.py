"""Images of demonstrations for policies of the ``pixels`` family. They are rendered once and stored next to the data.

One file contains the frames of one demonstration. Its name depends on the record, the views, the render preset and the
rows. Files are written atomically, so that rendering can be resumed, and their bytes do not depend on the number of
workers. Frames are read one by one from memory-mapped files, so that the operating system can release the memory.
"""

from __future__ import annotations

import hashlib
import mmap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, TypeAdapter

from betterbench.demonstrations.export.pictures import Pictures
from betterbench.errors import InvalidInputError, RecordError
from betterbench.interface import observation_spec
from betterbench.jobs import OnCount, counts, in_threads, job_folder, run_items, write_durably
from betterbench.jobs.durable import on_disk
from betterbench.json_form import SEAL, dump_json, parse_json, read_form, seal_of, sealed_form, strict_form
from betterbench.learning.training.processes import TrainingProcesses
from betterbench.ordinary_file import open_ordinary
from betterbench.policies.learned.eyes import looked_at
from betterbench.policies.learned.recipe import Eyes
from betterbench.records import Record, RunFolder
from betterbench.records.compressed import pack_block, unpack_block

FRAMES_VERSION = 1
"""Version of the frame files. It also changes when records are rendered differently."""
SUFFIX = ".frames"
"""Suffix of the folder with frame files, after the name of the demonstration folder."""

_MAX_HEADER = 1 << 16
_ITSELF, _DIFFERENCE = 0, 1
_INDEX_NUMBERS = (
    3  # start and end of an image in the file, and whether only its difference to the view's first image is stored
)


@dataclass(frozen=True, slots=True, eq=False)
class WantedFrames:
    """Request for the frames of one demonstration.

    Attributes:
        run: Run of the demonstration.
        record: Record of the demonstration.
        digest: SHA-256 of the record file.
        rows: (n,) rows of the record to render.
        folder: Folder for the frame file.
    """

    run: RunFolder
    record: Record
    digest: str
    rows: np.ndarray
    folder: Path

    def file(self, eyes: Eyes) -> Path:
        """Return the path of the frame file for the given views."""
        rows = hashlib.sha256(self.rows.astype("<i8").tobytes()).hexdigest()
        told = {"version": FRAMES_VERSION, "record": self.digest, "eyes": _form(eyes), "rows": rows}
        return self.folder / f"{hashlib.sha256(dump_json(told)).hexdigest()[:32]}.bin"


def drawn_frames(
    wanted: Sequence[WantedFrames], eyes: Eyes, *, workers: int = 1, on_drawn: OnCount | None = None
) -> FrameStore:
    """Return the frames of several demonstrations in order. Files that are missing or damaged are rendered first.

    Raises:
        RecordError: If a stored scene is missing or unreadable.
        RunConflictError: If another process renders into the same folder.
        StorageError: If the disk is full. Files that are already complete are kept.
        MissingDependencyError: If off-screen OpenGL is not available.
    """
    files = [item.file(eyes) for item in wanted]
    there = {file: found for file in files if (found := _EpisodeFrames.open(file)) is not None}
    if len(there) < len(set(files)):
        named = dict(zip(files, wanted, strict=True))
        run_items(
            named,
            is_done=there.__contains__,
            work=lambda missing: _draw({file: named[file] for file in missing}, eyes, workers),
            on_progress=counts(on_drawn),
        )
    return FrameStore([there.get(file) or _opened(file) for file in files])


def _draw(missing: Mapping[Path, WantedFrames], eyes: Eyes, workers: int) -> Iterator[object]:
    """Render the missing files, one folder at a time."""
    cameras = observation_spec(eyes.observation).only(eyes.cameras).cameras

    def draw(pictures: Pictures, file: Path) -> None:
        one = missing[file]
        shown = pictures.of(one.run, one.record, rows=one.rows.tolist())
        frames = np.stack([looked_at(eyes, views) for views in shown])
        with on_disk(file):
            write_durably(file, frames_bytes(frames))

    for folder in sorted({file.parent for file in missing}):
        with job_folder(folder, waits=TrainingProcesses.here().size > 1):
            # Another process of the same training run may have rendered files while this process waited for the lock.
            inside = [file for file in missing if file.parent == folder]
            waiting = [file for file in inside if _EpisodeFrames.open(file) is None]
            yield from range(len(inside) - len(waiting))
            # Demonstrations with the same scene are rendered in a row, since opening a scene takes a long time.
            waiting.sort(key=lambda file: (missing[file].record.metadata.scene_hash, file))
            yield from in_threads(waiting, draw, workers=workers, open_resource=lambda: Pictures(cameras, eyes.quality))


def frames_bytes(frames: np.ndarray) -> bytes:
    """Convert frames, a uint8 array (n, views, size, size, 3), to the bytes of a frame file.

    Each image is compressed separately. If its difference from the first image of the same view (modulo 256) takes less
    space when compressed, the difference is stored instead. This is usually the case for a static camera.
    """
    rows, views = frames.shape[:2]
    index = np.zeros((rows, views, _INDEX_NUMBERS), "<i8")
    blocks, at = list[bytes](), 0
    for row in range(rows):
        for view in range(views):
            block, kind = pack_block(frames[row, view].tobytes()), _ITSELF
            if row:
                other = pack_block((frames[row, view] - frames[0, view]).tobytes())
                if len(other) < len(block):
                    block, kind = other, _DIFFERENCE
            index[row, view] = at, at + len(block), kind
            blocks.append(block)
            at += len(block)
    payload = index.tobytes() + b"".join(blocks)
    told = {"version": FRAMES_VERSION, "shape": list(frames.shape), "sha256": hashlib.sha256(payload).hexdigest()}
    header = dump_json(sealed_form(told))
    return len(header).to_bytes(8, "little") + header + payload


@dataclass(frozen=True, slots=True, eq=False)
class _EpisodeFrames:
    """Frames of one demonstration in a memory-mapped file."""

    path: Path
    shape: tuple[int, ...]
    sha256: str
    index: np.ndarray
    blocks: memoryview
    first: np.ndarray

    @classmethod
    def open(cls, path: Path) -> _EpisodeFrames | None:
        """Open a frame file. Return None if it is missing or damaged."""
        try:
            with open_ordinary(path) as file:
                data = memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))
            length = int.from_bytes(data[:8], "little")
            if length > _MAX_HEADER:
                return None
            form = parse_json(bytes(data[8 : 8 + length]))
            if not isinstance(form, dict) or form.pop(SEAL, None) != seal_of(form):
                return None
            header = read_form(_HEADER, form, where=str(path), cure="Draw them again")
            payload, shape = data[8 + length :], header.shape
            if hashlib.sha256(payload).hexdigest() != header.sha256:
                return None
            size = 8 * _INDEX_NUMBERS * shape[0] * shape[1]
            index = np.frombuffer(payload[:size], "<i8").reshape(shape[0], shape[1], _INDEX_NUMBERS)
            blocks = payload[size:]
            found = [_picture(blocks, index[0, view], None, shape) for view in range(shape[1])]
            return cls(path, shape, header.sha256, index, blocks, np.stack(found))
        except (OSError, ValueError, IndexError, RecordError, InvalidInputError):
            return None

    def into(self, row: int, out: np.ndarray) -> None:
        """Write the images of a row into the array ``out``, (views, size, size, 3)."""
        for view in range(self.shape[1]):
            out[view] = _picture(self.blocks, self.index[row, view], self.first[view], self.shape)


_Rows = Annotated[int, Field(ge=1, lt=1 << 31)]
_Count = Annotated[int, Field(ge=1, le=64)]
_Size = Annotated[int, Field(ge=1, le=4096)]
_Colors = Annotated[int, Field(ge=3, le=3)]


@strict_form
@dataclass(frozen=True, slots=True)
class _Header:
    """Header of a frame file. The shape is (rows, views, size, size, 3)."""

    version: Literal[1]  # FRAMES_VERSION
    shape: tuple[_Rows, _Count, _Size, _Size, _Colors]
    sha256: str

    def __post_init__(self) -> None:
        """Raise InvalidInputError if the images are not square."""
        if self.shape[2] != self.shape[3]:
            raise InvalidInputError(
                "shape", f"the images have {self.shape[2]} x {self.shape[3]} pixels", "Use square images"
            )


_HEADER = TypeAdapter(_Header)


def _opened(file: Path) -> _EpisodeFrames:
    found = _EpisodeFrames.open(file)
    if found is None:
        raise RecordError(f"{file}: the frames are missing or damaged. Run the same command again to render them.")
    return found


def _picture(blocks: memoryview, entry: np.ndarray, first: np.ndarray | None, shape: tuple[int, ...]) -> np.ndarray:
    begin, end, kind = entry.tolist()
    size, _, colors = shape[2:]
    data = np.frombuffer(unpack_block(blocks[begin:end], size * size * colors), np.uint8).reshape(size, size, colors)
    return data if kind == _ITSELF or first is None else data + first


class FrameStore:
    """The frames of several demonstrations, concatenated and readable in any order.

    Attributes:
        sha256: Hash of all frames.
        first: (E + 1,) index of each demonstration's first frame, followed by the total number of frames.
    """

    def __init__(self, episodes: Sequence[_EpisodeFrames]) -> None:
        if len({e.shape[1:] for e in episodes}) > 1:
            raise InvalidInputError(
                "frames", "the files have images of different shapes", "Use only frames that were made for one recipe"
            )
        self._episodes = tuple(episodes)
        self.first = np.cumsum([0, *(e.shape[0] for e in episodes)])
        self.sha256 = hashlib.sha256("".join(f"{e.sha256}\n" for e in episodes).encode()).hexdigest()

    @classmethod
    def open(cls, files: Sequence[Path]) -> FrameStore:
        """Open frame files in the given order. Raises RecordError if a file is missing or damaged."""
        return cls([_opened(file) for file in files])

    def __len__(self) -> int:
        return int(self.first[-1])

    @property
    def bytes(self) -> int:
        """Size of all files [byte]."""
        return sum(episode.path.stat().st_size for episode in self._episodes)

    def read(self, numbers: np.ndarray, shifts: np.ndarray | None = None) -> np.ndarray:
        """Read frames, as a (B, views, size, size, 3) uint8 array.

        Args:
            numbers: (B,) indices of the frames.
            shifts: (B, views, 2) shift of each image down and to the right [pixel]. Pixels at the edge are repeated.
                None for no shift.
        """
        found = np.empty((len(numbers), *self._episodes[0].shape[1:]), np.uint8)
        owners = np.searchsorted(self.first, numbers, side="right") - 1
        for place, (number, owner) in enumerate(zip(numbers.tolist(), owners.tolist(), strict=True)):
            self._episodes[owner].into(number - int(self.first[owner]), found[place])
        if shifts is not None:
            for pictures, moves in zip(found, shifts.tolist(), strict=True):
                for picture, (down, right) in zip(pictures, moves, strict=True):
                    shift(picture, down, right)
        return found


def shift(picture: np.ndarray, down: int, right: int) -> None:
    """Shift an image in place by whole pixels, repeating its edges.

    The image is a contiguous (height, width, colors) array.
    """
    flat = picture.reshape(-1)
    count = (down * picture.shape[1] + right) * picture.shape[2]
    if count > 0:
        flat[count:] = flat[:-count]
    elif count < 0:
        flat[:count] = flat[-count:]
    # Pixels that wrapped around from the row above or below are in the columns that the edge overwrites.
    if right:
        inside, edge = (slice(right), right) if right > 0 else (slice(right, None), right - 1)
        picture[:, inside] = picture[:, edge, None]
    if down:
        inside, edge = (slice(down), down) if down > 0 else (slice(down, None), down - 1)
        picture[inside] = picture[edge]


def _form(eyes: Eyes) -> dict[str, object]:
    views = [{"camera": view.camera, "window": list(view.window)} for view in eyes.windows]
    cameras = [[c.name, c.width, c.height] for c in observation_spec(eyes.observation).only(eyes.cameras).cameras]
    return {"cameras": cameras, "views": views, "size": eyes.size, "quality": eyes.quality}
