"""Download of benchmark data from the Hugging Face hub."""

from __future__ import annotations

import http.client
import os
import urllib.error
import urllib.request
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import IO, Any
from urllib.parse import quote

from betterbench.errors import InvalidInputError, one_line
from betterbench.jobs import OnCount, job_folder
from betterbench.jobs.durable import on_disk
from betterbench.json_form import file_digest
from betterbench.vlm.benchmarks.benchmark import Benchmark, DataFile

HUB_VARIABLE = "HF_ENDPOINT"
"""Environment variable with an alternative address of the hub. The hub's own client uses the same variable."""
_HUB = "https://huggingface.co"
_PIECE = 1 << 20
_TIMEOUT_S = 60.0
_MOST_BYTES = 4 << 30


@dataclass(frozen=True, slots=True)
class FetchedFile:
    """A data file on disk, with its size [byte] and its SHA-256."""

    path: str
    size: int
    sha256: str

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict."""
        return asdict(self)


def fetch_data(benchmark: Benchmark, folder: Path, *, on_progress: OnCount | None = None) -> list[FetchedFile]:
    """Download all missing files of a benchmark into a folder.

    Each file is written under a temporary name and renamed when it is complete, so that a file with its final name is
    always complete.

    Args:
        benchmark: The benchmark.
        folder: Folder for the data.
        on_progress: Called with the number of bytes of the current file downloaded so far, and the size of the file (0
            if unknown).

    Raises:
        InvalidInputError: If the hub cannot be reached, or a file does not have the expected hash. The message names
            the file and its path.
        RunConflictError: If another process is downloading into the folder.
    """
    with on_disk(folder), job_folder(folder):
        return [_fetched(benchmark, file, folder, on_progress) for file in benchmark.source.files]


def _fetched(benchmark: Benchmark, file: DataFile, folder: Path, on_progress: OnCount | None) -> FetchedFile:
    path = folder / file.path
    if not path.is_file():
        _download(benchmark, file, path, on_progress)
    digest = file_digest(path)
    if file.sha256 is not None and digest != file.sha256:
        problem = f"has the SHA-256 {digest}, expected {file.sha256}"
        raise InvalidInputError(str(path), problem, "Delete the file and download it again")
    return FetchedFile(file.path, path.stat().st_size, digest)


def _download(benchmark: Benchmark, file: DataFile, path: Path, on_progress: OnCount | None) -> None:
    hub = os.environ.get(HUB_VARIABLE, "").rstrip("/") or _HUB
    url = f"{hub}/datasets/{benchmark.source.repository}/resolve/main/{quote(file.path)}"
    if not url.startswith(("http://", "https://")):
        raise InvalidInputError(
            HUB_VARIABLE, f"{one_line(hub, most=80)!r} is not an HTTP address", "Set it to an HTTP address"
        )
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f"{path.name}.part")
    try:
        with urllib.request.urlopen(url, timeout=_TIMEOUT_S) as reply, part.open("wb") as target:  # noqa: S310
            for written in _copied(reply, target):
                if on_progress is not None:
                    on_progress(written, int(reply.headers.get("Content-Length") or 0))
            target.flush()
            os.fsync(target.fileno())
            expected = reply.headers.get("Content-Length")
        if expected is not None and part.stat().st_size != int(expected):
            raise http.client.IncompleteRead(b"", int(expected) - part.stat().st_size)
        part.replace(path)
    except (OSError, http.client.HTTPException, urllib.error.URLError) as error:
        part.unlink(missing_ok=True)
        size = "" if file.megabytes is None else f" ({file.megabytes:g} MB)"
        problem = f"cannot be downloaded from {benchmark.source.repository} on the hub ({one_line(error, most=120)})"
        cure = f"Put the file{size} there by hand. {benchmark.source.license}; {benchmark.source.terms}"
        raise InvalidInputError(str(path), problem, cure) from error


def _copied(reply: IO[bytes], target: IO[bytes]) -> Iterator[int]:
    written = 0
    while piece := reply.read(_PIECE):
        target.write(piece)
        written += len(piece)
        if written > _MOST_BYTES:
            raise OSError(f"the file is larger than {_MOST_BYTES} bytes")
        yield written
