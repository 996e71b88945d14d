"""Kinds of catalogue rows, and vectors of the descriptions of the kinds."""

from __future__ import annotations

import functools
import math
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from betterbench.errors import RecordError
from betterbench.jobs.durable import DurableFile
from betterbench.sim.assets.catalogue.expansion import SAYS_LITTLE, Query, role_of
from betterbench.sim.assets.catalogue.hypernyms import kind_named, members_named
from betterbench.sim.assets.catalogue.kinds import kinds_named, listed_kinds, number_of
from betterbench.sim.assets.catalogue.terms import terms
from betterbench.sim.assets.catalogue.vectors import text_digest

HEAD_SHARE = 0.2
"""Weight of a query's head in the similarity to a kind; the whole query has the remaining weight."""
WORDS_SHARE = 0.2
"""Weight of the fraction of query words that occur in the texts of a kind, which is added to the mean cosine."""
VARIETY_SHARE = 0.6
"""Increase in similarity of a kind whose variety or brand is in the query, as a fraction of the distance to the
maximum."""
HYPERNYM_LOSS = 0.25
"""Penalty for everything that is not a member of the broader word that names the object ("cutlery")."""
ROLE_SHARE = 0.25
"""Weight of the fraction of the query's words in a statement about the same role of the object ("eat soup with it")."""
LACKED_LOSS = 0.05
"""Penalty for a member of a broader word whose texts mention what the object does not have."""
USE_LOSS = 0.12
"""Penalty for a kind that is mentioned in a query that names no object ("thing to eat soup with")."""
NAME_SHARE = 0.15
"""Increase in similarity of the kind that the query names, as a fraction of the distance to the maximum."""
BESIDE_LOSS = 0.05
"""Penalty for a kind that the query mentions only as used with the object: steak in "you serve a steak on it"."""
_COUNTED = 2
"""Number of nearest texts of a kind whose cosines are averaged, which worked better than the largest cosine."""
_ENDING, _LONG = re.compile(r"(ing|ed|er|e|y)$"), 4
_ROWS, _TEXTS = "kinds.npy", "kind_texts.npy"


def _line(dimension: int) -> np.dtype:
    return np.dtype([("digest", "u1", 16), ("kind", "<i2"), ("scale", "<f4"), ("vector", "i1", dimension)])


def write_kinds(
    folder: Path, rows: Sequence[int], kinds: Sequence[int], digests: np.ndarray, vectors: tuple[np.ndarray, np.ndarray]
) -> None:
    """Write the kind files of a catalogue.

    Args:
        folder: Catalogue folder.
        rows: Kind number of each row, -1 for none, in row order.
        kinds: Number of the kind of each text, (m,).
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
    """Index of the kinds of a catalogue's rows, open for searching.

    Attributes:
        rows: Kind number of each row, -1 for none, (n,) int16.
        table: Digest, kind, scale and vector of each text, (m,).

    Raises:
        RecordError: If a file is missing, damaged or does not belong to the catalogue.
    """

    def __init__(self, folder: Path, *, count: int, dimension: int) -> None:
        self.rows = _load(folder / _ROWS)
        self.table = _load(folder / _TEXTS)
        for array, kind, name in ((self.rows, np.dtype("<i2"), _ROWS), (self.table, _line(dimension), _TEXTS)):
            if array.dtype != kind or array.ndim != 1:
                raise _damaged(folder / name, f"does not contain a one-dimensional array of type {kind}")
        if len(self.rows) != count:
            raise _damaged(folder / _ROWS, f"has {len(self.rows)} rows, but the catalogue has {count}")
        listed = np.unique(self.table["kind"])
        if not np.isin(np.unique(self.rows), [-1, *listed]).all() or (listed < 0).any():
            raise _damaged(folder / _ROWS, "refers to kinds that have no texts")
        order = np.argsort(self.table["kind"], kind="stable")
        self._vectors = self.table["vector"][order].astype(np.float32) * self.table["scale"][order, None]
        self._kinds, starts, self._totals = np.unique(self.table["kind"][order], return_index=True, return_counts=True)
        # one row per kind with the indices of its texts, padded with the number of texts, for which a cosine of -2 is
        # appended
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
        """Return the similarity of a query to each kind, (kinds,) float32; -1 for a kind without rows.

        Args:
            asked: Unit vectors of the query and of further descriptions, (m, dimension); the nearest vector is used.
            head: Unit vector of the head of the query, (dimension,).
            query: The query, with its words, varieties and the other objects that it names.
            members: Result of ``members`` for the query, if the caller has it.
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
        """Return the kinds with rows that a query includes by a broader word for the object."""
        return self._held(members_named(query.text))

    def _held(self, kinds: Iterable[int]) -> list[int]:
        """Return the kinds that have rows."""
        return sorted(set(kinds) & set(self._kinds.tolist()))

    def _shared(self, words: Sequence[str]) -> np.ndarray:
        """Return the fraction of a query's words in the texts of each kind, (kinds,); rare words weigh more."""
        rarity = {stem: self._rarity[stem] for stem in map(_stem, words) if stem in self._rarity}
        total = max(sum(rarity.values()), 1e-9)
        return np.array([sum(rarity[stem] for stem in rarity if stem in own) / total for own in self._words])

    def _used(self, role: str, words: Sequence[str]) -> np.ndarray:
        """Return the largest fraction of words in a statement of each kind about a role, (kinds,)."""
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
        """Return whether the texts of each kind contain any of some words, (kinds,)."""
        stems = frozenset(map(_stem, words))
        return np.array([bool(stems & own) for own in self._words])

    def _nearest(self, vectors: np.ndarray) -> np.ndarray:
        """Return the mean cosine of the nearest texts of each kind with each vector (m, dimension): (m, kinds)."""
        cosines = np.pad(vectors @ self._vectors.T, ((0, 0), (0, 1)), constant_values=-2.0)[:, self._texts]
        nearest = -np.partition(-cosines, _COUNTED - 1, axis=2)[:, :, :_COUNTED]
        counted = np.minimum(self._totals, _COUNTED)
        return np.asarray(np.where(nearest >= -1.5, nearest, 0.0).sum(axis=2) / counted)

    def places(self, kind: int) -> np.ndarray:
        """Return the indices of the rows of a kind, ascending."""
        order, starts = self._order
        return order[starts[kind + 1] : starts[kind + 2]]

    @functools.cached_property
    def _order(self) -> tuple[np.ndarray, np.ndarray]:
        """Indices of the rows sorted by kind, and the start of each kind; kind -1 is the first."""
        order = np.argsort(self.rows, kind="stable")
        return order, np.searchsorted(self.rows[order], np.arange(-1, self._size + 1))


def _texts_of(table: np.ndarray) -> list[str]:
    """Return the listed text of each line of a table; empty if the list no longer has it."""
    known = {text_digest(text): text for kind in listed_kinds() for text in kind.texts}
    return [known.get(digest.tobytes(), "") for digest in table["digest"]]


def _stems_of(kinds: np.ndarray, owners: np.ndarray, texts: Sequence[str]) -> list[frozenset[str]]:
    """Return the word stems of each kind, from its texts."""
    words = {int(kind): set[str]() for kind in kinds}
    for kind, text in zip(owners.tolist(), texts, strict=True):
        words[kind] |= {_stem(term) for term in terms(text) if term not in SAYS_LITTLE}
    return [frozenset(words[int(kind)]) for kind in kinds]


def _uses_of(
    kinds: np.ndarray, owners: np.ndarray, texts: Sequence[str]
) -> dict[tuple[str, str], list[tuple[int, int]]]:
    """Return, for each role and word stem, the statements that contain them: index of the kind and of the text."""
    found: dict[tuple[str, str], list[tuple[int, int]]] = {}
    for place, (kind, text) in enumerate(zip(np.searchsorted(kinds, owners).tolist(), texts, strict=True)):
        words = terms(text)
        role = role_of(words)
        if role:
            for stem in {_stem(word) for word in words if word not in SAYS_LITTLE}:
                found.setdefault((role, stem), []).append((kind, place))
    return found


def _stem(word: str) -> str:
    """Return a word without verb endings, so that "squeezed" and "squeeze" are equal."""
    return _ENDING.sub("", word) if len(word) > _LONG else word


def _load(path: Path) -> np.ndarray:
    try:
        array = np.load(path, allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise _damaged(path, f"cannot be read ({error})") from error
    if not isinstance(array, np.ndarray):
        raise _damaged(path, "is not an array")
    return array


def _damaged(path: Path, problem: str) -> RecordError:
    return RecordError(f"{path}: {problem}. Remove the folder and index the sources again.")
