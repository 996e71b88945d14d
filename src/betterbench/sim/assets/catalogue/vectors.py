"""Vectors of a catalogue in memory-mapped files, with one byte per component.

Each row has a vector (int8 components and a scale), a sketch (one bit per component), and columns for filters. A search
first compares the sketches of all rows, and then the vectors of the best rows.
"""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from betterbench.errors import RecordError, one_line
from betterbench.jobs.durable import DurableFile
from betterbench.ordinary_file import open_ordinary

EXACT_ROWS = 20_000
"""Maximum number of catalogue rows for which a search compares every vector."""
RERANKED = 2_000
"""Number of rows whose vectors are compared in a search of the whole catalogue. These are the rows with the most
similar sketches."""
RERANKED_AMONG = 500
"""The same number for a search of only some rows, such as the 18,000 rows of a frequent kind."""
_SPREAD = 1 << 16
"""Number of rows per batch when files are written, and when sketches are compared."""
_EXCLUDED = np.uint16(1 << 15)
"""Number of differing bits that is assigned to rows that do not pass the filters, so that they rank last."""

FILES = ("vectors", "scales", "sketches", "rows", "digests", "licenses", "sources", "faces", "sizes")
"""Names of the files, without their ending .npy."""


@dataclass(frozen=True, slots=True)
class Columns:
    """Columns that are used to filter search results, with one value per row. NaN and -1 mean that a value is unknown.

    Attributes:
        rows: Row numbers in the catalogue, ascending, (n,) int64.
        licenses: Index of the kind of license, (n,) uint8.
        sources: Index of the source, (n,) uint8.
        faces: Number of triangles, (n,) int32.
        sizes: Largest extent [m], (n,) float32.
    """

    rows: np.ndarray
    licenses: np.ndarray
    sources: np.ndarray
    faces: np.ndarray
    sizes: np.ndarray


def text_digest(text: str) -> bytes:
    """Return the 16-byte digest under which the vector of a text is stored."""
    return hashlib.sha256(text.encode("utf-8", "replace")).digest()[:16]


def quantized(vectors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Quantize unit vectors (n, d) to int8.

    Returns:
        The int8 vectors (n, d) and the scale of each vector, (n,) float32.
    """
    largest = np.abs(vectors).max(axis=1, initial=0.0)
    scales = (np.where(largest > 0.0, largest, 1.0) / 127.0).astype(np.float32)
    return np.rint(vectors / scales[:, None]).astype(np.int8), scales


def _sketches(vectors: np.ndarray, center: np.ndarray) -> np.ndarray:
    """Return a sketch of each vector, as a (words, n) uint64 array. A sketch has one bit per component.

    A bit is set if the component is larger than the mean of this component over all vectors.
    """
    bits = np.packbits(vectors > center, axis=1)
    padded = np.zeros((len(bits), -(-bits.shape[1] // 8) * 8), np.uint8)
    padded[:, : bits.shape[1]] = bits
    return np.ascontiguousarray(padded.view(np.uint64).T)


def write_vectors(
    folder: Path, columns: Columns, blocks: Iterable[tuple[np.ndarray, np.ndarray, np.ndarray]], dimension: int
) -> None:
    """Write the vector files of a catalogue.

    Args:
        folder: Folder of the catalogue.
        columns: Columns for filters.
        blocks: Blocks of rows in order, each with vectors (n, dimension) int8, scales (n,) float32 and text digests (n,
            16) uint8.
        dimension: Number of components of a vector.
    """
    count = len(columns.rows)
    scales, digests = np.zeros(count, np.float32), np.zeros((count, 16), np.uint8)
    total, done = np.zeros(dimension), 0
    with DurableFile(folder / "vectors.npy") as out:
        np.lib.format.write_array_header_1_0(
            out.file, {"descr": "|i1", "fortran_order": False, "shape": (count, dimension)}
        )
        for vectors, scale, digest in blocks:
            part = slice(done, done + len(vectors))
            scales[part], digests[part] = scale, digest
            total += (vectors * scale[:, None]).sum(axis=0, dtype=float)
            out.file.write(vectors.tobytes())
            done += len(vectors)
        if done != count:
            raise ValueError(f"{done} vectors were given for {count} rows")
        out.finish()
    stored = np.load(folder / "vectors.npy", mmap_mode="r")
    center = (total / max(count, 1)).astype(np.float32)
    words = -(-dimension // 64)
    sketches = np.zeros((words, count), np.uint64)
    for start in range(0, count, _SPREAD):
        part = slice(start, start + _SPREAD)
        sketches[:, part] = _sketches(stored[part] * scales[part, None], center)
    for name, array in (
        ("scales", scales),
        ("sketches", sketches),
        ("digests", digests),
        ("center", center),
        ("rows", columns.rows.astype(np.int64)),
        ("licenses", columns.licenses.astype(np.uint8)),
        ("sources", columns.sources.astype(np.uint8)),
        ("faces", columns.faces.astype(np.int32)),
        ("sizes", columns.sizes.astype(np.float32)),
    ):
        with DurableFile(folder / f"{name}.npy") as out:
            np.save(out.file, array, allow_pickle=False)
            out.finish()


class VectorIndex:
    """The vectors of a catalogue, open for searching.

    Raises:
        RecordError: If a file is missing or damaged, or does not belong to the same catalogue as the other files.
    """

    def __init__(self, folder: Path, *, count: int, dimension: int) -> None:
        def load(name: str, shape: tuple[int, ...], kind: str, *, mapped: bool = False) -> np.ndarray:
            path = folder / f"{name}.npy"
            array = stored_array(path, mapped=mapped)
            if array.shape != shape or array.dtype != np.dtype(kind):
                raise damaged(path, f"does not contain an array of shape {shape} and type {kind}")
            return array

        self._vectors = load("vectors", (count, dimension), "int8", mapped=True)
        self._scales = load("scales", (count,), "float32")
        self._sketches = load("sketches", (-(-dimension // 64), count), "uint64")
        self._center = load("center", (dimension,), "float32")
        self.digests = load("digests", (count, 16), "uint8", mapped=True)
        self.columns = Columns(
            load("rows", (count,), "int64"),
            load("licenses", (count,), "uint8"),
            load("sources", (count,), "uint8"),
            load("faces", (count,), "int32"),
            load("sizes", (count,), "float32"),
        )
        self._threads: ThreadPoolExecutor | None = None
        self._starting = threading.Lock()

    @property
    def count(self) -> int:
        """Number of rows."""
        return len(self._scales)

    def block(self, start: int, stop: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the int8 vectors and their scales for a range of row indices."""
        return self._vectors[start:stop], self._scales[start:stop]

    def nearest(
        self,
        queries: np.ndarray,
        allowed: np.ndarray | None,
        limit: int,
        *,
        among: np.ndarray | None = None,
        exact: bool = False,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the indices and the cosines of the rows that are nearest to any of the query vectors, nearest first.

        Args:
            queries: Unit vectors (m, dimension) float32.
            allowed: (n,) bool mask of the rows that pass the filters, or None if all rows pass.
            limit: Maximum number of rows to return.
            among: Ascending indices of the rows to search, or None to search all rows.
            exact: Whether to compare every vector, regardless of the number of rows.
        """
        if among is not None:
            passing = among if allowed is None else among[allowed[among]]
            wanted = max(RERANKED_AMONG, limit)
            few = exact or len(passing) <= wanted
            places = passing if few else self._candidates_among(queries, passing, wanted)
        elif exact or self.count <= EXACT_ROWS:
            places = np.arange(self.count) if allowed is None else np.flatnonzero(allowed)
        else:
            places = self._candidates(queries, allowed, max(RERANKED, limit))
        cosines = self.cosines(queries, places)
        if len(places) > limit:
            kept = np.argpartition(-cosines, limit - 1)
            least = cosines[kept[limit - 1]]
            near = np.flatnonzero(cosines >= least)
            places, cosines = places[near], cosines[near]
        order = np.lexsort((places, -cosines))[:limit]
        return places[order], cosines[order]

    def cosines(self, queries: np.ndarray, places: np.ndarray) -> np.ndarray:
        """Return, for each row in ``places``, the largest cosine between its vector and any of the unit vectors."""
        return np.concatenate([self._cosines(queries, part) for part in _parts(places)] or [np.zeros(0, np.float32)])

    def _cosines(self, queries: np.ndarray, places: np.ndarray) -> np.ndarray:
        near = (self._vectors[places].astype(np.float32) @ queries.T).max(axis=1)
        return np.asarray(near * self._scales[places])

    def _candidates(self, queries: np.ndarray, allowed: np.ndarray | None, wanted: int) -> np.ndarray:
        """Return the indices of the rows with the sketches that are most similar to those of the query vectors.

        At least ``wanted`` indices are returned for each query vector, unless fewer rows pass the filters.
        """
        sketches = _sketches(queries, self._center)
        differing = np.empty((len(queries), self.count), np.uint16)
        # arithmetic with the mask takes 0.2 ms for 800,000 rows; assignment through the mask would take 4 ms
        excluded = None if allowed is None else (~allowed).astype(np.uint16) * _EXCLUDED
        middle = self.count // 2

        def count_bits(part: slice) -> None:
            for start in range(part.start, part.stop, _SPREAD):
                piece = slice(start, min(start + _SPREAD, part.stop))
                differing[:, piece] = 0 if excluded is None else excluded[piece]
                for query, sketch in enumerate(sketches.T):
                    for word, bits in zip(self._sketches, sketch, strict=True):
                        differing[query, piece] += np.bitwise_count(word[piece] ^ bits)

        list(self._pool().map(count_bits, (slice(0, middle), slice(middle, self.count))))
        chosen = np.zeros(self.count, bool)
        for total in differing:
            reached = np.partition(total, wanted - 1)[wanted - 1]
            chosen |= total <= min(reached, _EXCLUDED - 1)
        return np.flatnonzero(chosen)

    def _candidates_among(self, queries: np.ndarray, places: np.ndarray, wanted: int) -> np.ndarray:
        """Return at least ``wanted`` of the given row indices.

        The sketches of these rows are the most similar to the sketch of any query vector.
        """
        sketches = self._sketches[:, places]
        differing = np.full(len(places), 65535, np.uint16)
        for sketch in _sketches(queries, self._center).T:
            total = np.bitwise_count(sketches ^ sketch[:, None]).sum(axis=0, dtype=np.uint16)
            np.minimum(differing, total, out=differing)
        return np.asarray(places[differing <= np.partition(differing, wanted - 1)[wanted - 1]])

    def _pool(self) -> ThreadPoolExecutor:
        with self._starting:
            if self._threads is None:
                self._threads = ThreadPoolExecutor(2, thread_name_prefix="catalogue")
            return self._threads

    def close(self) -> None:
        """Stop the worker threads."""
        if self._threads is not None:
            self._threads.shutdown()


def _parts(places: np.ndarray) -> Iterator[np.ndarray]:
    for start in range(0, len(places), _SPREAD):
        yield places[start : start + _SPREAD]


def stored_array(path: Path, *, mapped: bool = False) -> np.ndarray:
    """Read the array in a NumPy file. If ``mapped`` is True, its values are read from the file when they are needed.

    Raises:
        RecordError: If the file is missing, not a regular file, or damaged.
    """
    try:
        open_ordinary(path).close()  # NumPy would wait for a pipe
        # A mapping rejects a header that states a larger array than the file contains, before memory is reserved.
        array: np.ndarray = np.lib.format.open_memmap(path, mode="r")
    except Exception as error:  # NumPy raises any exception for a damaged header
        raise damaged(path, f"cannot be read ({one_line(error)})") from error
    return array if mapped else np.array(array)


def damaged(path: Path, problem: str) -> RecordError:
    """Create the error for a damaged file of an index."""
    return RecordError(f"{path} {problem}. Move the folder away and index the sources again.")


def columns_of(values: Sequence[tuple[int, int, int, int, float]]) -> Columns:
    """Convert rows, given as (row number, license kind, source number, triangles, size), to columns."""
    table = np.array(values, dtype=float).reshape(-1, 5)
    return Columns(
        table[:, 0].astype(np.int64),
        table[:, 1].astype(np.uint8),
        table[:, 2].astype(np.uint8),
        table[:, 3].astype(np.int32),
        table[:, 4].astype(np.float32),
    )
