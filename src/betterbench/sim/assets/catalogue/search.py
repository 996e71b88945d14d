"""Search in the asset catalogue by words, by meaning and with filters."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np

from betterbench.errors import InvalidInputError, RecordError, UnknownNameError
from betterbench.sim.assets.catalogue.encoders.encoder import KnowsWords, TextEncoder
from betterbench.sim.assets.catalogue.entry import CatalogueEntry
from betterbench.sim.assets.catalogue.expansion import Concept, Expander, Query, understood
from betterbench.sim.assets.catalogue.indexing import LICENSE_KINDS
from betterbench.sim.assets.catalogue.kind_vectors import HYPERNYM_LOSS, WORDS_SHARE, KindIndex
from betterbench.sim.assets.catalogue.store import Store, WordMatch
from betterbench.sim.assets.catalogue.vectors import VectorIndex
from betterbench.sim.assets.licenses import LicenseFilter, license_kind

LONGEST_QUERY = 1_000
"""Maximum length of a query [characters]."""
DEPTH = 60
"""Number of rows that the search by words and the search by meaning each contribute to the combined ranking."""
_RANK = 8.0
"""Constant c in the score of the word search, (c + 1) / (c + rank)."""
_BEST_KINDS = 3
"""Number of most similar kinds whose rows are searched."""
_PER_MEMBER = 20
"""Number of rows that are searched for each further kind that the query's broader word, such as "cutlery", includes."""
_KIND_SHARE, _OWN_SHARE, _WORDS_SHARE = 1.0, 0.1, 0.15
"""Weights of the similarity to the kind, the cosine with the row's own text, and the word score."""
_UNRELATED = 0.2
"""Typical weighted sum of a row that is unrelated to the query. This sum is mapped to the score 0."""
_COSTLY = 5_000
"""Maximum number of matching rows that are ranked. If there are more, frequent words only count in rows that also match
rarer words."""
_FETCHED = 200
"""Number of rows whose words are compared with the query in detail."""
_PARTIAL = 2
"""Exponent of the fraction of query words in a row. A row with half of the query words has a quarter of the weight."""
_FIELDS = (1.0, 0.75, 0.45)
"""Weights of a word in the name, in the tags and in the description."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Filters:
    """Filters of a search.

    Attributes:
        license: "free" for licenses that allow commercial use and changes, "any" for all licenses.
        source: Name of a source. Empty if all sources are searched.
        max_faces: Maximum number of triangles. Assets with an unknown number of triangles do not pass.
        max_size_m: Maximum length of the longest side [m]. Assets of unknown size do not pass.
        min_size_m: Minimum length of the longest side [m]. Assets of unknown size do not pass.
    """

    license: LicenseFilter = "free"
    source: str = ""
    max_faces: int | None = None
    max_size_m: float | None = None
    min_size_m: float | None = None

    def admits(self, match: WordMatch) -> bool:
        """Return whether a row passes the filters."""
        size = match.largest_m
        return not (
            (self.license == "free" and license_kind(match.license) != "free")
            or (self.source and match.source != self.source)
            or (self.max_faces is not None and (match.faces is None or match.faces > self.max_faces))
            or (self.max_size_m is not None and (size is None or size > self.max_size_m))
            or (self.min_size_m is not None and (size is None or size < self.min_size_m))
        )


@dataclass(frozen=True, slots=True)
class Hit:
    """A search result.

    Attributes:
        entry: Row of the catalogue.
        score: Combined score for words and meaning in [0, 1]. The maximum of 1 is reached if the asset's row contains
            every word of the query, is first in the search by words, and has the same kind and the same text as the
            query.
        word_rank: Rank in the search by words, from 1. None if no word matched.
        meaning_rank: Rank in the search by meaning, from 1. None if there was no search by meaning.
        cosine: Cosine between the vectors of the asset and the query. None if there was no search by meaning.
    """

    entry: CatalogueEntry
    score: float
    word_rank: int | None
    meaning_rank: int | None
    cosine: float | None

    def to_json(self) -> dict[str, object]:
        """Return the hit as a JSON object."""
        return {
            **self.entry.to_json(),
            "score": round(self.score, 4),
            "word_rank": self.word_rank,
            "meaning_rank": self.meaning_rank,
            "cosine": None if self.cosine is None else round(self.cosine, 4),
        }


class Catalogue:
    """An asset catalogue that is open for searching. Used as a context manager, it closes its files at the end.

    Args:
        folder: Folder of the catalogue.
        encoder: Function that loads an encoder by its name. It is called for the first semantic search. If None, the
            catalogue is only searched by words.

    Raises:
        InvalidInputError: If there is no catalogue in the folder, or its indexing has not finished.
        RecordError: If a file of the catalogue is damaged or was written by another program.
    """

    def __init__(self, folder: Path, *, encoder: Callable[[str], TextEncoder] | None = None) -> None:
        self._store = Store(folder)
        self._open_encoder = encoder
        self._encoder: TextEncoder | None = None
        self._index: VectorIndex | None = None
        self._kinds: KindIndex | None = None
        try:
            sealed = _sealed(self._store, folder)
            self.encoder_name = self._store.fact("encoder")
            self.count = self._store.count()
            self._numbers = {name: number for name, (number, _) in self._store.sources().items()}
            if sealed == "vectors" and encoder is not None:
                form = {"count": self.count, "dimension": _dimension(self._store)}
                self._index, self._kinds = VectorIndex(folder, **form), KindIndex(folder, **form)
        except BaseException:
            self._store.__exit__()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._store.__exit__()
        if self._index is not None:
            self._index.close()

    @property
    def has_vectors(self) -> bool:
        """Whether the catalogue can be searched by meaning."""
        return self._index is not None

    @property
    def vectors(self) -> VectorIndex:
        """The vectors of the catalogue. Raises ValueError if it has none."""
        if self._index is None:
            raise ValueError("the catalogue has no vectors")
        return self._index

    @property
    def sources(self) -> tuple[str, ...]:
        """Names of all sources, in the order in which they were first indexed."""
        return tuple(self._numbers)

    def entry(self, asset_id: str) -> CatalogueEntry:
        """Return the row of an asset, given its id.

        For the id of a variant, return the row that represents all variants.

        Raises:
            UnknownNameError: If the catalogue has no such asset.
        """
        found = self._store.row_of(asset_id) or self._store.row_of(asset_id.partition("#")[0])
        if found is None:
            raise UnknownNameError("asset", asset_id, self._store.ids_like(asset_id.rpartition("/")[2][:40], 8))
        return found

    def entries(self, source: str) -> list[CatalogueEntry]:
        """Return all assets from a source, in the order of their rows.

        Raises:
            UnknownNameError: If the catalogue does not have this source.
        """
        if source not in self._numbers:
            raise UnknownNameError("source", source, self._numbers)
        return [entry for _, _, entry in self._store.entries() if entry.source == source]

    def licenses(self) -> list[tuple[str, str, int]]:
        """Return the number of assets for each source and license, as tuples (source, license, number)."""
        return self._store.licenses()

    def search(
        self,
        query: str,
        *,
        limit: int = 10,
        filters: Filters | None = None,
        expander: Expander | None = None,
        words: bool = True,
        meaning: bool = True,
    ) -> list[Hit]:
        """Return the assets that match a query most closely, starting with the best match.

        Repeating a query gives the same result.

        Args:
            query: Description of the object in plain words.
            limit: Maximum number of assets to return.
            filters: Filters of the search. If None, only free licenses are allowed.
            expander: Function that returns further descriptions to search for, for example from a language model.
            words: Whether to search by words.
            meaning: Whether to search by meaning. This is only possible if the catalogue has vectors.

        Raises:
            InvalidInputError: If the query is empty or too long.
            UnknownNameError: If a filter names a source that the catalogue does not have.
            MissingDependencyError: If the encoder is not installed.
        """
        if not query.strip() or len(query) > LONGEST_QUERY:
            raise InvalidInputError(
                "query", f"it has {len(query.strip())} characters", f"Use a query of 1 to {LONGEST_QUERY} characters"
            )
        admitted = filters or Filters()
        if admitted.source and admitted.source not in self._numbers:
            raise UnknownNameError("source", admitted.source, self._numbers)
        asked = understood(query, expander=expander, is_word=lambda word: self._is_word(word, meaning=meaning))
        depth = max(DEPTH, limit)
        by_words = self._by_words(asked, admitted, depth) if words else []
        if not meaning or self._index is None:
            return self._hits(_word_scores(by_words), {}, by_words, limit)
        by_meaning = self._by_meaning(asked, admitted, depth, dict(by_words))
        return self._hits(_fused(by_words, by_meaning), by_meaning, by_words, limit)

    def _hits(
        self,
        scores: Mapping[int, float],
        by_meaning: Mapping[int, _Near],
        by_words: Sequence[tuple[int, float]],
        limit: int,
    ) -> list[Hit]:
        """Return the rows with the best scores, sorted by descending score.

        Rows with equal scores are sorted by row number.
        """
        ordered = sorted(scores, key=lambda row: (-scores[row], row))[:limit]
        entries = self._store.rows(ordered)
        word_ranks = {row: rank for rank, (row, _) in enumerate(by_words, start=1)}
        near = {row: (rank, by_meaning[row].cosine) for rank, row in enumerate(by_meaning, start=1)}
        return [
            Hit(entries[row], scores[row], word_ranks.get(row), *near.get(row, (None, None)))
            for row in ordered
            if row in entries
        ]

    # -------------------------------------------------------------------------------------------------------- words

    def _by_words(self, query: Query, filters: Filters, depth: int) -> list[tuple[int, float]]:
        """Return the rows that contain words of the query, starting with the best match.

        Each row is paired with the fraction of the query's words that it contains.
        """
        every = {word for concept in query.concepts for phrase, _ in concept.alternatives for word in phrase}
        frequencies = self._store.frequencies(sorted(every))
        expression, ranked = _expression(frequencies)
        if not expression:
            return []
        fetched = _FETCHED
        while True:
            found = self._store.matching(expression, fetched, ranked=ranked)
            passing = [match for match in found if filters.admits(match)]
            if len(passing) >= depth or len(found) < fetched or fetched >= 16 * _FETCHED:
                break
            fetched *= 4
        weighed = _weighed(query.concepts, frequencies, self.count)
        scored = [(match.row, *_word_score(weighed, match.fields)) for match in passing]
        scored.sort(key=lambda found: (-found[1], found[0]))
        return [(row, covered) for row, score, covered in scored if score > 0.0][:depth]

    # ------------------------------------------------------------------------------------------------------ meaning

    def _by_meaning(self, query: Query, filters: Filters, depth: int, also: Mapping[int, float]) -> dict[int, _Near]:
        """Return the rows that are most similar to the query in meaning, in order of decreasing similarity.

        The result contains the rows whose own text is nearest to the query, rows of the most similar kinds, and the
        rows given in ``also``.

        Args:
            query: The query.
            filters: Filters of the search.
            depth: Number of rows to find by their own text, and number of rows to find in each of the most similar
                kinds.
            also: Further row numbers (of rows that pass the filters), each with the fraction of the query's words that
                the row contains.
        """
        if self._index is None or self._kinds is None:
            return {}
        index, kinds, encoder = self._index, self._kinds, self._opened()
        *vectors, head = encoder.encode([*query.readings, query.head])
        readings = np.array(vectors)
        asked = readings[[query.readings.index(text) for text in query.asked]]
        members = kinds.members(query)
        likeness = kinds.likeness(asked, head, query, members)
        mask = self._mask(index, filters)
        found = [index.nearest(readings, mask, depth)[0], np.searchsorted(index.columns.rows, sorted(also))]
        order = np.argsort(-likeness, kind="stable").tolist()
        for kind in order[:_BEST_KINDS]:
            found.append(index.nearest(asked, mask, depth, among=kinds.places(kind))[0])
        for kind in set(members).difference(order[:_BEST_KINDS]):
            found.append(_some(kinds.places(kind), mask))
        places = np.unique(np.concatenate(found).astype(np.int64))
        cosines = index.cosines(readings, places)
        own = kinds.rows[places]
        # A row without a kind is compared by its own text, because its name resembles a short description of a kind.
        shares = np.array([also.get(row, 0.0) for row in index.columns.rows[places].tolist()])
        near = cosines + WORDS_SHARE * shares - (HYPERNYM_LOSS if members else 0.0)
        if len(likeness):
            near = np.where(own >= 0, likeness[own], near)
        ranked = np.lexsort((places, -(_KIND_SHARE * near + _OWN_SHARE * cosines)))
        return {int(index.columns.rows[places[i]]): _Near(float(near[i]), float(cosines[i])) for i in ranked.tolist()}

    def _opened(self) -> TextEncoder:
        """Return the text encoder of the catalogue. It is loaded at the first call."""
        if self._encoder is None:
            if self._open_encoder is None:
                raise ValueError("the catalogue was opened without an encoder")
            self._encoder = self._open_encoder(self.encoder_name)
        return self._encoder

    def _is_word(self, word: str, *, meaning: bool) -> bool:
        """Return whether a word of a query occurs in the catalogue or in the vocabulary of the encoder."""
        if self._store.frequencies([word]):
            return True
        if not meaning or self._index is None:
            return False
        encoder = self._opened()
        return not isinstance(encoder, KnowsWords) or encoder.has_word(word)

    def _mask(self, index: VectorIndex, filters: Filters) -> np.ndarray | None:
        """Return an (n,) bool mask of the catalogue rows that pass the filters, or None if all rows pass."""
        columns, parts = index.columns, []
        if filters.license == "free":
            parts.append(columns.licenses == LICENSE_KINDS.index("free"))
        if filters.source:
            parts.append(columns.sources == self._numbers[filters.source])
        if filters.max_faces is not None:
            # as an unsigned integer, an unknown number of triangles (-1) exceeds every limit
            parts.append(columns.faces.view(np.uint32) <= min(filters.max_faces, 2**31 - 1))
        if filters.max_size_m is not None:
            parts.append(columns.sizes <= filters.max_size_m)
        if filters.min_size_m is not None:
            parts.append(columns.sizes >= filters.min_size_m)
        return functools.reduce(np.logical_and, parts) if parts else None


def _some(places: np.ndarray, mask: np.ndarray | None) -> np.ndarray:
    """Return the indices of at most ``_PER_MEMBER`` rows that pass the filters, evenly spaced among all such rows."""
    # if there are many rows, testing some of them is enough to find rows that pass
    places = places[:: max(1, len(places) // (16 * _PER_MEMBER))]
    passing = places if mask is None else places[mask[places]]
    return passing[:: max(1, -(-len(passing) // _PER_MEMBER))]


@dataclass(frozen=True, slots=True)
class _Near:
    """Similarity of a row to a query.

    Attributes:
        kind: Similarity of the row's kind to the query, in [-1, 1.2].
        cosine: Cosine between the vectors of the row's text and the query.
    """

    kind: float
    cosine: float


def _word_scores(by_words: Sequence[tuple[int, float]]) -> dict[int, float]:
    """Return a score in (0, 1] for each row that contains words of the query.

    The score depends on the rank of the row in the word search, and on the fraction of the query that the row contains.
    A row that contains only some words of the query therefore has a low score, even if it has a high rank.
    """
    return {
        row: (_RANK + 1.0) * share**_PARTIAL / (_RANK + rank) for rank, (row, share) in enumerate(by_words, start=1)
    }


def _fused(by_words: Sequence[tuple[int, float]], by_meaning: Mapping[int, _Near]) -> dict[int, float]:
    """Combine the scores for words and for meaning into one score in [0, 1] per row."""
    words = _word_scores(by_words)
    largest = _KIND_SHARE * (1.0 + WORDS_SHARE) + _OWN_SHARE + _WORDS_SHARE

    def score(row: int, near: _Near) -> float:
        total = _KIND_SHARE * near.kind + _OWN_SHARE * near.cosine + _WORDS_SHARE * words.get(row, 0.0)
        return min(1.0, max(0.0, (total - _UNRELATED) / (largest - _UNRELATED)))

    return {row: score(row, near) for row, near in by_meaning.items()}


def _sealed(store: Store, folder: Path) -> str:
    """Return how a catalogue was indexed: "words" or "vectors".

    Raises InvalidInputError if the indexing has not finished.
    """
    sealed = store.fact("sealed")
    if sealed not in ("words", "vectors"):
        problem = "its indexing is still running or was interrupted"
        raise InvalidInputError(str(folder), problem, "Run `better assets index` again")
    return sealed


def _dimension(store: Store) -> int:
    try:
        return int(store.fact("dimension"))
    except ValueError as error:
        raise RecordError(f"{store.path} is damaged. Index the sources again.") from error


def _expression(frequencies: dict[str, int]) -> tuple[str, bool]:
    """Return the FTS5 expression for some terms, and whether it has few enough matches to rank them."""
    ordered = sorted(frequencies, key=lambda word: (frequencies[word], word))
    chosen: list[str] = []
    total = 0
    for word in ordered:
        total += frequencies[word]
        if chosen and total > _COSTLY:
            break
        chosen.append(word)
    if not chosen:
        return "", False
    if frequencies[chosen[0]] <= _COSTLY:
        return " OR ".join(f'"{word}"' for word in chosen), True
    return " AND ".join(f'"{word}"' for word in ordered[:2]) if len(ordered) > 1 else f'"{chosen[0]}"', False


@dataclass(frozen=True, slots=True)
class _Weighed:
    """A concept of the query, reduced to the phrases that occur in the catalogue.

    Attributes:
        weight: Weight of the concept.
        phrases: Words, weight and rarity of each phrase.
    """

    weight: float
    phrases: tuple[tuple[tuple[str, ...], float, float], ...]


def _weighed(concepts: Sequence[Concept], frequencies: Mapping[str, int], count: int) -> list[_Weighed]:
    """For each concept, keep the phrases whose words all occur in the catalogue, and compute how rare each phrase is.

    ``count`` is the number of rows in the catalogue.
    """

    def rarity(phrase: Sequence[str]) -> float:
        return math.log(1.0 + count / max(min(frequencies[word] for word in phrase), 1))

    return [
        _Weighed(
            concept.weight,
            tuple(
                (phrase, weight, rarity(phrase))
                for phrase, weight in concept.alternatives
                if all(word in frequencies for word in phrase)
            ),
        )
        for concept in concepts
    ]


def _word_score(concepts: Sequence[_Weighed], fields: Sequence[str]) -> tuple[float, float]:
    """Return a score for the words in a row, and the fraction of the query that the row contains.

    For each concept, only the best match between one of its phrases and one of the row's fields counts.
    """
    words = [field.split() for field in fields]
    sets = [set(field) for field in words]
    length = max(len(words[0]), 1)
    total = covered = 0.0
    for concept in concepts:
        best = present = 0.0
        for phrase, weight, rarity in concept.phrases:
            for share, own in zip(_FIELDS, sets, strict=True):
                if own.issuperset(phrase):
                    # a name with few other words is more likely the object itself: "apple" before "apple pie"
                    focus = 1.0 if share < 1.0 else 0.7 + 0.3 * len(phrase) / length
                    best = max(best, weight * share * rarity * focus)
                    present = max(present, weight)
                    break
        total += concept.weight * best
        covered += concept.weight * present
    return total, covered / sum(concept.weight for concept in concepts)
