"""Measure the search in a catalogue of 800,000 synthetic rows by words, by vectors, and by both with filters.

The search is measured in a separate process (``python benchmarks/catalogue_search.py FOLDER QUERIES``), so that the
measured memory does not include that of indexing.
"""

from __future__ import annotations

import json
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from betterbench.errors import MissingDependencyError
from betterbench.sim.assets.catalogue.encoders import open_encoder
from betterbench.sim.assets.catalogue.entry import CatalogueEntry
from betterbench.sim.assets.catalogue.indexing import index_sources
from betterbench.sim.assets.catalogue.kinds import listed_kinds
from betterbench.sim.assets.catalogue.search import Catalogue, Filters
from betterbench.sim.assets.catalogue.sources import SourceItem
from figures import Figure

ROWS, QUICK_ROWS = 800_000, 40_000
QUERIES = 60
_TOPICS = 2_000
_LICENSES = ("CC-BY-4.0", "CC-BY-4.0", "CC-BY-4.0", "CC-BY-NC-4.0", "CC0-1.0", "")
_FILTERS = Filters(max_faces=80_000)
_BROADER = ("food", "container", "kitchenware", "tool", "vegetable", "drink", "electronics", "cutlery")
"""Broader words of the queries with one; "container" includes 47 kinds, "cutlery" four."""
_KINDLESS = 0.5
"""Share of the rows, and of the queries, that name no kind of object."""
_SPREAD = 0.6
"""Distance of a vector from the center of its topic, relative to that center."""


def _word(number: int) -> str:
    """Return a pronounceable word that is different for each number."""
    letters = ("ba", "ko", "mi", "tu", "re", "sa", "lo", "pi", "ve", "du", "na", "go")
    said = ""
    while True:
        said += letters[number % len(letters)]
        number //= len(letters)
        if not number:
            return f"{said}x"


class SyntheticEncoder:
    """A fast encoder whose vectors are near the center of a topic; the second word of a text determines the topic."""

    name, dimension = "synthetic", 384

    def __init__(self) -> None:
        self._centers = np.random.default_rng(7).normal(size=(_TOPICS, self.dimension)).astype(np.float32)
        self._topics = {_word(topic): topic for topic in range(_TOPICS)}

    def encode(self, texts: Sequence[str]) -> np.ndarray:
        """Return unit vectors, (n, 384) float32."""
        seed = int.from_bytes(texts[0].encode()[-8:].ljust(8), "big")
        noise = np.random.default_rng(seed).normal(size=(len(texts), self.dimension)).astype(np.float32)
        topics = [self._topics.get(text.split()[1].strip("."), 0) if " " in text else 0 for text in texts]
        vectors = self._centers[topics] + _SPREAD * noise
        return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))


@dataclass(frozen=True, slots=True)
class SyntheticSource:
    """Rows whose word frequencies are as uneven as in a natural language."""

    count: int
    name: str = "synthetic"
    address: str = "folder:/synthetic"

    def items(self, *, on_skip: Callable[[str, str], None]) -> Iterator[SourceItem]:
        """Yield the rows."""
        del on_skip
        rng, kinds = np.random.default_rng(3), _KindNames(5)
        for start in range(0, self.count, 4096):
            words = np.minimum(rng.zipf(1.25, size=(4096, 10)), 60_000)
            topics, faces = rng.integers(_TOPICS, size=4096), rng.integers(100, 120_000, size=4096)
            for i in range(min(4096, self.count - start)):
                said = [_word(int(n)) for n in words[i]]
                entry = _entry(start + i, int(topics[i]), said, int(faces[i]), kinds.draw())
                yield SourceItem(entry.id, "1", lambda entry=entry: entry)


class _KindNames:
    """Names of listed kinds with decreasing frequency: the frequency of the k-th is proportional to 1 / (k + 5)."""

    def __init__(self, seed: int) -> None:
        self._names = [kind.names[0] for kind in listed_kinds()]
        weights = 1.0 / (np.arange(len(self._names)) + 6.0)
        self._shares = np.cumsum(weights / weights.sum())
        self._rng = np.random.default_rng(seed)

    def draw(self) -> str:
        """Return a name with a leading blank, or an empty text."""
        kindless, place = self._rng.random(2)
        return "" if kindless < _KINDLESS else f" {self._names[int(np.searchsorted(self._shares, place))]}"


def _entry(number: int, topic: int, words: Sequence[str], faces: int, kind: str) -> CatalogueEntry:
    return CatalogueEntry(
        id=f"synthetic/{number}",
        source="synthetic",
        name=f"{words[0]} {_word(topic)}{kind}",
        description=" ".join(words[1:8]) + f" {number}",
        tags=tuple(words[8:]),
        faces=faces,
        license=_LICENSES[number % len(_LICENSES)],
    )


def catalogue_row(*, quick: bool) -> Iterator[Figure]:
    """Measure indexing, search and memory of a catalogue as large as Objaverse."""
    count = QUICK_ROWS if quick else ROWS
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        began = time.perf_counter()
        index_sources(folder, [SyntheticSource(count)], encoder=SyntheticEncoder(), on_progress=lambda *_: None)
        built = time.perf_counter() - began
        megabytes = sum(file.stat().st_size for file in folder.iterdir()) / 1e6
        yield Figure("assets", f"index of {count:,} rows", (built,), "s", note=f"{megabytes:.0f} MB on disk")
        command = [sys.executable, __file__, scratch, str(10 if quick else QUERIES)]
        found = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    both = f"words + vectors + filters, {count:,} rows"
    yield Figure("assets", both, tuple(found["both"]), "ms", "<=", None if quick else 30.0)
    # On a busy machine, only this number is meaningful: the CPU time of all threads.
    yield Figure("assets", "the same, CPU time", tuple(found["both_cpu"]), "ms", "<=", None if quick else 25.0)
    broader = tuple(found["broader"])
    yield Figure("assets", "the same, with broader words", broader, "ms", "<=", None if quick else 30.0)
    yield Figure("assets", "the same, CPU time", tuple(found["broader_cpu"]), "ms")
    yield Figure("assets", "words alone, with filters", tuple(found["words"]), "ms")
    yield Figure("assets", "vectors alone, with filters", tuple(found["vectors"]), "ms")
    yield Figure("assets", "every vector compared", tuple(found["exact"]), "ms")
    yield Figure("assets", "of its ten nearest, found by sketches", tuple(found["shared"]), "x", ">=", 0.95)
    yield Figure("assets", "memory of a process that searches", (found["memory_mb"],), "MB", "<=", 600.0)
    yield _encoding_figure()


def _encoding_figure() -> Figure:
    """Return the time that the default encoder takes for a query; the synthetic encoder takes almost none."""
    text = "encoding of a query by minilm, which comes on top"
    try:
        encoder = open_encoder()
    except MissingDependencyError as error:
        return Figure("assets", text, (), "ms", note=str(error))
    times = []
    for number in range(12):
        began = time.perf_counter()
        encoder.encode([f"a shiny red apple number {number}"])
        times.append(1e3 * (time.perf_counter() - began))
    return Figure("assets", text, tuple(times[2:]), "ms")


def _peak_memory_mb() -> float:
    """Return the peak memory of this program [MB].

    ru_maxrss is used only if this number does not exist, because on Linux a child inherits it from its parent, which
    has built the index.
    """
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
    except OSError:
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM:")) / 1e3


def measure(folder: Path, queries: int) -> dict[str, object]:
    """Search a catalogue and return times [ms] per kind of search, CPU times of one, and the memory of this process."""
    encoder = SyntheticEncoder()
    rng = np.random.default_rng(11)
    times: dict[str, list[float]] = {
        name: [] for name in ("both", "both_cpu", "broader", "broader_cpu", "words", "vectors", "exact")
    }
    shared: list[float] = []
    with Catalogue(folder, encoder=lambda _: encoder) as catalogue:
        asked, broader, kinds = [], [], _KindNames(13)
        for number in range(queries + 3):
            words = [_word(int(n)) for n in np.minimum(rng.zipf(1.25, size=3), 60_000)]
            text = f"{words[0]} {_word(int(rng.integers(_TOPICS)))} {words[1]} {words[2]}"
            asked.append(text + kinds.draw())
            broader.append(f"{text} {_BROADER[number % len(_BROADER)]}")
        ways = {
            "both": (asked, True, True),
            "broader": (broader, True, True),
            "words": (asked, True, False),
            "vectors": (asked, False, True),
        }
        for number in range(queries + 3):
            for name, (texts, by_words, by_meaning) in ways.items():
                began, worked = time.perf_counter(), time.process_time()
                catalogue.search(texts[number], filters=_FILTERS, words=by_words, meaning=by_meaning)
                if number >= 3:  # the first ones read the files
                    times[name].append(1e3 * (time.perf_counter() - began))
                    if f"{name}_cpu" in times:
                        times[f"{name}_cpu"].append(1e3 * (time.process_time() - worked))
        memory = _peak_memory_mb()
        index = catalogue.vectors
        for query in asked[3:13]:
            vector = encoder.encode([query])
            began = time.perf_counter()
            nearest, _ = index.nearest(vector, None, 10, exact=True)
            times["exact"].append(1e3 * (time.perf_counter() - began))
            found, _ = index.nearest(vector, None, 10)
            shared.append(len(set(nearest.tolist()) & set(found.tolist())) / 10.0)
    return {**times, "shared": [statistics.mean(shared)], "memory_mb": memory}


if __name__ == "__main__":
    print(json.dumps(measure(Path(sys.argv[1]), int(sys.argv[2]))))
