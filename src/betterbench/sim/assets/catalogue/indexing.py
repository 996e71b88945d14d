"""Indexing job for the asset catalogue. An interrupted job can be resumed.

The job writes the rows of all sources, and a vector for the text of each row.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol, Self

import numpy as np

from betterbench.errors import BetterError, RecordError, one_line
from betterbench.jobs.durable import on_disk, remove_parts
from betterbench.jobs.lock import LOCK_NAME, RunLock
from betterbench.jobs.places import open_in_place
from betterbench.sim.assets.catalogue.encoders.encoder import TextEncoder
from betterbench.sim.assets.catalogue.entry import CatalogueEntry
from betterbench.sim.assets.catalogue.kind_vectors import KindIndex, write_kinds
from betterbench.sim.assets.catalogue.kinds import kind_of, listed_kinds
from betterbench.sim.assets.catalogue.sources.source import AssetSource
from betterbench.sim.assets.catalogue.store import FILE, Store
from betterbench.sim.assets.catalogue.vectors import (
    VectorIndex,
    columns_of,
    quantized,
    text_digest,
    write_vectors,
)
from betterbench.sim.assets.licenses import license_kind

LICENSE_KINDS = ("free", "restricted", "unknown")
"""Kinds of licenses. The columns store the index of a kind in this tuple."""

JOURNAL = "encoded.bin"
"""Name of the file in which a running job stores the vectors that it has computed so far."""
_BATCH = 256
"""Batch size for writing rows and for encoding texts."""
MOST_NAMED = 20
"""Maximum number of skipped assets that are listed by name. Further skipped assets are only counted."""


class OnProgress(Protocol):
    """Callback that reports the progress of the indexing job."""

    def __call__(self, stage: str, done: int, total: int) -> None:
        """Report the name of the current stage, the number of processed items and the total number (0 if unknown)."""


@dataclass(slots=True)
class IndexReport:
    """Outcome of an indexing job.

    Attributes:
        added: Number of new rows.
        updated: Number of rows whose asset had changed.
        kept: Number of unchanged rows.
        removed: Number of rows that were removed because their asset no longer exists.
        encoded: Number of texts for which a vector was computed.
        skipped: Number of assets that could not be read.
        named: Names of the first skipped assets, each with the reason.
        total: Total number of rows in the catalogue.
    """

    added: int = 0
    updated: int = 0
    kept: int = 0
    removed: int = 0
    encoded: int = 0
    skipped: int = 0
    named: list[tuple[str, str]] = field(default_factory=list)
    total: int = 0

    def skip(self, name: str, reason: str) -> None:
        """Count an asset that could not be read."""
        self.skipped += 1
        if len(self.named) < MOST_NAMED:
            self.named.append((one_line(name, most=120), one_line(reason)))


def index_sources(
    folder: Path, sources: Sequence[AssetSource], *, encoder: TextEncoder | None = None, on_progress: OnProgress
) -> IndexReport:
    """Update the rows of the given sources. The rows of all other sources stay unchanged.

    Args:
        folder: Folder of the catalogue. It is created if it does not exist.
        sources: Sources to read.
        encoder: Text encoder for semantic search. If None, the catalogue can only be searched by words.
        on_progress: Callback that receives the progress of the job.

    Raises:
        RunConflictError: If another process is indexing into the folder.
        RecordError: If the folder contains a damaged catalogue, or files of another program.
        InvalidInputError: If a source cannot be read.
    """
    report = IndexReport()
    with RunLock(folder / LOCK_NAME), on_disk(folder / FILE):
        remove_parts(folder)
        with Store(folder, writes=True) as store:
            known = _known_vectors(folder, store, encoder)
            store.note(sealed="")
            for source in sources:
                _read_source(store, source, report, on_progress)
            store.count_terms()
            report.total = store.count()
            if encoder is not None:
                with known:
                    _encode(store, known, encoder, report, on_progress)
                    _seal(folder, store, known, encoder)
                known.remove()
                store.note(sealed="vectors", encoder=encoder.name, dimension=str(encoder.dimension))
            else:
                known.close()
                store.note(sealed="words", encoder="", dimension="0")
            store.note(rows=str(report.total))
    return report


def _read_source(store: Store, source: AssetSource, report: IndexReport, on_progress: OnProgress) -> None:
    """Write the new rows and the changed rows of a source, and remove the rows whose asset no longer exists."""
    number = store.add_source(source.name, source.address)
    before, seen = store.fingerprints(number), set[str]()
    rows: list[tuple[str, CatalogueEntry]] = []
    for item in source.items(on_skip=report.skip):
        seen.add(item.id)
        if before.get(item.id) == item.fingerprint:
            report.kept += 1
            continue
        try:
            rows.append((item.fingerprint, item.read()))
        except (BetterError, OSError) as error:
            report.skip(item.id, str(error))
            seen.discard(item.id)
            continue
        report.added += item.id not in before
        report.updated += item.id in before
        if len(rows) == _BATCH:
            store.write(number, rows)
            rows = []
            on_progress(source.name, len(seen), 0)
    store.write(number, rows)
    on_progress(source.name, len(seen), len(seen))
    gone = sorted(set(before) - seen)
    store.remove(gone)
    report.removed += len(gone)


class _Vectors:
    """Vectors from the previous catalogue and from this job, each looked up by the digest of its text.

    New vectors are immediately appended to a file. A job that is killed can therefore resume without computing them
    again.
    """

    def __init__(self, folder: Path, dimension: int) -> None:
        self._path, self._dimension = folder / JOURNAL, dimension
        self._line = np.dtype([("digest", "u1", 16), ("scale", "<f4"), ("vector", "i1", dimension)])
        self._places: dict[bytes, tuple[int, int]] = {}
        self._tables: list[np.ndarray] = []
        self._index: VectorIndex | None = None
        self._handle: int | None = None

    def take_index(self, index: VectorIndex) -> None:
        """Add all vectors of an existing catalogue to the known vectors."""
        self._index = index
        for place, digest in enumerate(np.asarray(index.digests)):
            self._places.setdefault(digest.tobytes(), (-1, place))

    def take_table(self, lines: np.ndarray) -> None:
        """Add vectors from a structured array (n,) with the fields digest, scale and vector."""
        self._take(lines)

    def open_journal(self) -> None:
        """Load the vectors that a killed job has already computed. An incomplete last entry is dropped."""
        self._handle = open_in_place(self._path)
        whole = os.fstat(self._handle).st_size // self._line.itemsize
        os.ftruncate(self._handle, whole * self._line.itemsize)
        lines = np.frombuffer(os.pread(self._handle, whole * self._line.itemsize, 0), self._line)
        self._take(lines)

    def _take(self, lines: np.ndarray) -> None:
        self._tables.append(lines)
        for place, digest in enumerate(lines["digest"]):
            self._places[digest.tobytes()] = (len(self._tables) - 1, place)

    def __contains__(self, digest: bytes) -> bool:
        return digest in self._places

    def add(self, digests: Sequence[bytes], vectors: np.ndarray) -> None:
        """Append vectors to the file, and make sure that they are written to disk."""
        if self._handle is None:
            raise ValueError("the journal is closed")
        lines = np.zeros(len(digests), self._line)
        lines["digest"] = np.frombuffer(b"".join(digests), np.uint8).reshape(-1, 16)
        lines["vector"], lines["scale"] = quantized(vectors)
        data, written = lines.tobytes(), 0
        end = os.fstat(self._handle).st_size
        while written < len(data):
            written += os.pwrite(self._handle, data[written:], end + written)
        os.fsync(self._handle)
        self._take(lines)

    def of(self, digests: Sequence[bytes]) -> tuple[np.ndarray, np.ndarray]:
        """Return the vectors (n, d) int8 and their scales (n,) of the texts with the given digests."""
        vectors = np.zeros((len(digests), self._dimension), np.int8)
        scales = np.zeros(len(digests), np.float32)
        for i, digest in enumerate(digests):
            table, place = self._places[digest]
            if table >= 0:
                vectors[i], scales[i] = self._tables[table]["vector"][place], self._tables[table]["scale"][place]
            elif self._index is not None:
                (vectors[i],), (scales[i],) = self._index.block(place, place + 1)
        return vectors, scales

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close all files. A second call has no effect."""
        if self._handle is not None:
            os.close(self._handle)
            self._handle = None
        if self._index is not None:
            self._index.close()

    def remove(self) -> None:
        """Remove the file of new vectors, after the vectors have been written to the catalogue."""
        self._path.unlink(missing_ok=True)


def _known_vectors(folder: Path, store: Store, encoder: TextEncoder | None) -> _Vectors:
    """Return the vectors of the previous catalogue that can be reused, i.e. those from the same encoder."""
    known = _Vectors(folder, 0 if encoder is None else encoder.dimension)
    if encoder is None:
        return known
    if store.fact("encoder") == encoder.name and store.fact("sealed") in ("vectors", ""):
        with contextlib.suppress(RecordError):  # missing or damaged vectors are computed again
            form = {"count": int(store.fact("rows") or 0), "dimension": encoder.dimension}
            known.take_index(VectorIndex(folder, **form))
            known.take_table(KindIndex(folder, **form).table)
    if store.fact("journal") != encoder.name:
        (folder / JOURNAL).unlink(missing_ok=True)
        store.note(journal=encoder.name)
    known.open_journal()
    return known


def _encode(store: Store, known: _Vectors, encoder: TextEncoder, report: IndexReport, on_progress: OnProgress) -> None:
    """Compute the vectors of all texts that do not have one yet."""
    waiting: dict[bytes, str] = {}

    def flush() -> None:
        if waiting:
            known.add(list(waiting), encoder.encode(list(waiting.values())))
            report.encoded += len(waiting)
            waiting.clear()

    for done, (_, _, entry) in enumerate(_all_rows(store), start=1):
        digest = text_digest(entry.text)
        if digest not in known:
            waiting[digest] = entry.text
        if len(waiting) == _BATCH:
            flush()
            on_progress("meaning", done, report.total)
    flush()
    on_progress("meaning", report.total, report.total)


def _all_rows(store: Store) -> Iterator[tuple[int, int, CatalogueEntry]]:
    after = 0
    while page := store.entries(after=after, limit=4096):
        yield from page
        after = page[-1][0]


def _seal(folder: Path, store: Store, known: _Vectors, encoder: TextEncoder) -> None:
    """Write the vectors of all rows in row order, and the columns used for filtering."""
    values, digests, kinds = [], [], []
    for row, source, entry in _all_rows(store):
        kind = LICENSE_KINDS.index(license_kind(entry.license))
        size = entry.largest_m
        faces = -1 if entry.faces is None else min(entry.faces, 2**31 - 1)
        values.append((row, kind, source, faces, float("nan") if size is None else size))
        digests.append(text_digest(entry.text))
        kinds.append(kind_of(entry))
    _seal_kinds(folder, known, encoder, kinds)

    def blocks() -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        for start in range(0, len(digests), 4096):
            part = digests[start : start + 4096]
            yield *known.of(part), np.frombuffer(b"".join(part), np.uint8).reshape(-1, 16)

    write_vectors(folder, columns_of(values), blocks(), encoder.dimension)


def _seal_kinds(folder: Path, known: _Vectors, encoder: TextEncoder, rows: Sequence[int]) -> None:
    """Write the kind of each row and the vectors of the texts that describe the kinds. Missing vectors are computed."""
    listed = listed_kinds()
    texts = [(kind, text) for kind in sorted(set(rows) - {-1}) for text in listed[kind].texts]
    digests = [text_digest(text) for _, text in texts]
    new = {digest: text for digest, (_, text) in zip(digests, texts, strict=True) if digest not in known}
    for start in range(0, len(new), _BATCH):
        part = list(new)[start : start + _BATCH]
        known.add(part, encoder.encode([new[digest] for digest in part]))
    marks = np.frombuffer(b"".join(digests), np.uint8).reshape(-1, 16)
    write_kinds(folder, rows, [kind for kind, _ in texts], marks, known.of(digests))


Skip = Callable[[str, str], None]
