"""The kind of object in each catalogue row, and vectors of the texts that describe the kinds."""

from __future__ import annotations

import functools
import math
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from betterbench.jobs.durable import DurableFile
from betterbench.sim.assets.catalogue.expansion import SAYS_LITTLE, Query, role_of
from betterbench.sim.assets.catalogue.hypernyms import kind_named, members_named
from betterbench.sim.assets.catalogue.kinds import kinds_named, listed_kinds, number_of
from betterbench.sim.assets.catalogue.terms import terms
from betterbench.sim.assets.catalogue.vectors import damaged, stored_array, text_digest

HEAD_SHARE = 0.2
"""Weight of a query's head ("a bowl" in "a bowl for fruit") in the similarity to a kind. The whole query has the
remaining weight."""
WORDS_SHARE = 0.2
"""Weight of the fraction of query words that occur in the texts of a kind. The weighted fraction is added to the mean
cosine."""
VARIETY_SHARE = 0.6
"""Increase in the similarity of a kind if the query contains a variety or brand of it, as a fraction of the difference
to the maximum similarity."""
HYPERNYM_LOSS = 0.25
"""Penalty for kinds that the broader word in the query, such as "cutlery", does not include."""
ROLE_SHARE = 0.25
"""Weight of the fraction of query words that occur in a statement about the same role of the object ("eat soup with
it")."""
LACKED_LOSS = 0.05
"""Penalty for a kind that a broader word includes, but whose texts mention something that the object should not
have."""
USE_LOSS = 0.12
"""Penalty for a kind that a query mentions although the query does not name the object: soup in "thing to eat soup
with"."""
NAME_SHARE = 0.15
"""Increase in the similarity of the kind that the query names, as a fraction of the difference to the maximum
similarity."""
BESIDE_LOSS = 0.05
"""Penalty for a kind that the query only mentions because the object is used with it: steak in "a plate for steak"."""
_COUNTED = 2
"""Number of nearest texts of a kind whose cosines are averaged. The average worked better than the largest cosine."""
_ENDING, _LONG = re.compile(r"(ing|ed|er|e|y)$"), 4
_ROWS, _TEXTS = "kinds.npy", "kind_texts.npy"


def _line(dimension: int) -> np.dtype:
    return np.dtype([("digest", "u1", 16), ("kind", "<i2"), ("scale", "<f4"), ("vector", "i1", dimension)])


def write_kinds(
    folder: Path, rows: Sequence[int], kinds: Sequence[int], digests: np.ndarray, vectors: tuple[np.ndarray, np.ndarray]
) -> None:
    """Write the files that store the kinds of the objects in a catalogue.

    Args:
        folder: Folder of the catalogue.
        rows: Index of the kind of each row, in the order of the rows. It is -1 if a row has no kind.
        kinds: Index of the kind that each text belongs to, (m,).
        digests: Digests of the texts, (m, 16) uint8.
        vectors: Vectors of the texts, (m, dimension) int8, and their scales, (m,) float32.
    """
    table = np.zeros(len(kinds), _line(vectors[0].shape[1]))
    table["digest"], table["kind"] = digests, kinds
    table["vector"], table["scale"] = vectors
    for name, array in ((_ROWS, np.asarray(rows, np.int16)), (_TEXTS, table)):
        with DurableFile(folder / name) as out:
            np.save(out.file, array, allow_pickle=False)
            out.finish()


class KindIndex:
    """Index for searching a catalogue by kinds of objects.

    Attributes:
        rows: Index of the kind of each catalogue row, (n,) int16. -1 for rows without a kind.
        table: Structured array (m,) with the digest, kind, scale and vector of each text that describes a kind.

    Raises:
        RecordError: If a file is missing or damaged, or does not belong to the catalogue.
    """

    def __init__(self, folder: Path, *, count: int, dimension: int) -> None:
        self.rows = stored_array(folder / _ROWS)
        self.table = stored_array(folder / _TEXTS)
        for array, kind, name in ((self.rows, np.dtype("<i2"), _ROWS), (self.table, _line(dimension), _TEXTS)):
            if array.dtype != kind or array.ndim != 1:
                raise damaged(folder / name, f"does not contain a one-dimensional array of type {kind}")
        if len(self.rows) != count:
            raise damaged(folder / _ROWS, f"has {len(self.rows)} rows, but the catalogue has {count}")
        listed = np.unique(self.table["kind"])
        if not np.isin(np.unique(self.rows), [-1, *listed]).all() or (listed < 0).any():
            raise damaged(folder / _ROWS, "refers to kinds that have no texts")
        order = np.argsort(self.table["kind"], kind="stable")
        self._vectors = self.table["vector"][order].astype(np.float32) * self.table["scale"][order, None]
        self._kinds, starts, self._totals = np.unique(self.table["kind"][order], return_index=True, return_counts=True)
        # One row per kind contains the indices of its texts. Short rows are padded with the number of texts, an index
        # for which a cosine of -2 is appended later.
        places = starts[:, None] + np.arange(max(_COUNTED, self._totals.max(initial=0)))
        self._texts = np.where(places < (starts + self._totals)[:, None], places, len(order))
        self._size = int(listed[-1]) + 1 if len(listed) else 0
        texts = _texts_of(self.table)
        self._words = _stems_of(self._kinds, self.table["kind"], texts)
        self._uses = _uses_of(self._kinds, self.table["kind"], texts)
        found = Counter(stem for stems in self._words for stem in stems)
        self._rarity = {stem: math.log(1.0 + len(self._words) / total) for stem, total in found.items()}

    def likeness(
        self, asked: np.ndarray, head: np.ndarray, query: Query, members: Sequence[int] | None = None
    ) -> np.ndarray:
        """Return the similarity of a query to each kind, as a (kinds,) float32 array.

        Kinds without rows in the catalogue get -1.

        Args:
            asked: Unit vectors of the query and of alternative descriptions, (m, dimension). For each kind, only the
                most similar of these vectors counts.
            head: Unit vector of the part of the query that names the object, (dimension,).
            query: The parsed query.
            members: Result of :meth:`members` for this query. If None, it is computed.
        """
        if members is None:
            members = self.members(query)
        found = np.full(self._size, -1.0, np.float32)
        if len(self._kinds):
            *near, near_head = self._nearest(np.vstack([asked, head]))
            found[self._kinds] = (1.0 - HEAD_SHARE) * np.max(near, axis=0) + HEAD_SHARE * near_head
            found[self._kinds] += WORDS_SHARE * self._shared(query.words)
            if query.role:
                found[self._kinds] += ROLE_SHARE * self._used(query.role, query.words)
            for kind in self._held(kinds_named(query.beside)):
                found[kind] -= USE_LOSS if query.is_use else BESIDE_LOSS
            if members:
                found[self._kinds] -= np.where(np.isin(self._kinds, members), 0.0, HYPERNYM_LOSS)
                found[self._kinds] -= LACKED_LOSS * self._mentions(query.lacks)
            elif not query.is_use:
                for kind in self._held(kind_named(query.text)):
                    found[kind] += NAME_SHARE * (1.0 + WORDS_SHARE - found[kind])
            for name, weight in query.kinds.items():
                for kind in self._held({number_of(name)}):
                    found[kind] += VARIETY_SHARE * weight * (1.0 + WORDS_SHARE - found[kind])
        return found

    def members(self, query: Query) -> list[int]:
        """Return the kinds that a broader word in a query includes, such as forks and knives for "cutlery".

        Kinds without rows in the catalogue are left out.
        """
        return self._held(members_named(query.text))

    def _held(self, kinds: Iterable[int]) -> list[int]:
        """Return the given kinds that have rows in the catalogue, in ascending order."""
        return sorted(set(kinds) & set(self._kinds.tolist()))

    def _shared(self, words: Sequence[str]) -> np.ndarray:
        """Return the fraction of the query's words that occur in the texts of each kind, as a (kinds,) array.

        Rare words have a larger weight than frequent words.
        """
        rarity = {stem: self._rarity[stem] for stem in map(_stem, words) if stem in self._rarity}
        total = max(sum(rarity.values()), 1e-9)
        return np.array([sum(rarity[stem] for stem in rarity if stem in own) / total for own in self._words])

    def _used(self, role: str, words: Sequence[str]) -> np.ndarray:
        """Return how well the uses of each kind match the words of the query, as a (kinds,) array.

        Each kind has statements about its uses, each with a role ("tool", "vessel" or "surface"). The value for a kind
        is the largest weighted fraction of the query's words that occur in one of its statements with the given role.
        """
        rarity = {stem: self._rarity[stem] for stem in map(_stem, words) if stem in self._rarity}
        total = max(sum(rarity.values()), 1e-9)
        found = np.zeros(len(self._kinds))
        shared: dict[tuple[int, int], float] = {}
        for stem, weight in rarity.items():
            for place in self._uses.get((role, stem), ()):
                shared[place] = shared.get(place, 0.0) + weight
        for (kind, _), weight in shared.items():
            found[kind] = max(found[kind], weight / total)
        return found

    def _mentions(self, words: Sequence[str]) -> np.ndarray:
        """Return whether the texts of each kind contain any of the given words, as a (kinds,) array."""
        stems = frozenset(map(_stem, words))
        return np.array([bool(stems & own) for own in self._words])

    def _nearest(self, vectors: np.ndarray) -> np.ndarray:
        """Compare vectors (m, dimension) with the texts of each kind.

        Returns:
            (m, kinds) array. Each element is the mean cosine between a vector and the nearest texts of a kind.
        """
        cosines = np.pad(vectors @ self._vectors.T, ((0, 0), (0, 1)), constant_values=-2.0)[:, self._texts]
        nearest = -np.partition(-cosines, _COUNTED - 1, axis=2)[:, :, :_COUNTED]
        counted = np.minimum(self._totals, _COUNTED)
        return np.asarray(np.where(nearest >= -1.5, nearest, 0.0).sum(axis=2) / counted)

    def places(self, kind: int) -> np.ndarray:
        """Return the indices of all rows of a kind, in ascending order."""
        order, starts = self._order
        return order[starts[kind + 1] : starts[kind + 2]]

    @functools.cached_property
    def _order(self) -> tuple[np.ndarray, np.ndarray]:
        """Indices of all rows sorted by kind, and the position at which each kind begins. Kind -1 comes first."""
        order = np.argsort(self.rows, kind="stable")
        return order, np.searchsorted(self.rows[order], np.arange(-1, self._size + 1))


def _texts_of(table: np.ndarray) -> list[str]:
    """Look up the text for each row of a table, using the digest in that row.

    The text is empty if the list of kinds no longer contains it.
    """
    known = {text_digest(text): text for kind in listed_kinds() for text in kind.texts}
    return [known.get(digest.tobytes(), "") for digest in table["digest"]]


def _stems_of(kinds: np.ndarray, owners: np.ndarray, texts: Sequence[str]) -> list[frozenset[str]]:
    """Return the word stems that occur in the texts of each kind."""
    words = {int(kind): set[str]() for kind in kinds}
    for kind, text in zip(owners.tolist(), texts, strict=True):
        words[kind] |= {_stem(term) for term in terms(text) if term not in SAYS_LITTLE}
    return [frozenset(words[int(kind)]) for kind in kinds]


def _uses_of(
    kinds: np.ndarray, owners: np.ndarray, texts: Sequence[str]
) -> dict[tuple[str, str], list[tuple[int, int]]]:
    """Index the statements about uses of kinds ("you eat soup from it") by the object's role and by word stem.

    Returns:
        For each role and word stem, the statements that have this role and contain this stem. Each statement is given
        by the index of its kind and the index of its text.
    """
    found: dict[tuple[str, str], list[tuple[int, int]]] = {}
    for place, (kind, text) in enumerate(zip(np.searchsorted(kinds, owners).tolist(), texts, strict=True)):
        words = terms(text)
        role = role_of(words)
        if role:
            for stem in {_stem(word) for word in words if word not in SAYS_LITTLE}:
                found.setdefault((role, stem), []).append((kind, place))
    return found


def _stem(word: str) -> str:
    """Remove verb endings from a word, so that "squeezed" and "squeeze" become equal."""
    return _ENDING.sub("", word) if len(word) > _LONG else word
