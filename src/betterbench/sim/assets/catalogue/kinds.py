"""Kinds of objects, with descriptions of their appearance and use from ``kinds.txt`` and ``uses.txt``.

The name of a mesh says little about the object. A query such as "it opens wine bottles" is therefore compared with the
descriptions of kinds, and the result applies to all rows of a kind.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from betterbench.sim.assets.catalogue.entry import CatalogueEntry
from betterbench.sim.assets.catalogue.expansion import AFTER_THE_HEAD, COLORS
from betterbench.sim.assets.catalogue.lists import entries_by_name, list_lines
from betterbench.sim.assets.catalogue.terms import terms


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of object.

    Attributes:
        names: Names of the kind. A row whose name contains one of them belongs to the kind.
        descriptions: Descriptions in plain words, and short statements about its uses and parts.
    """

    names: tuple[str, ...]
    descriptions: tuple[str, ...]

    @property
    def texts(self) -> tuple[str, ...]:
        """Texts of the kind that are compared with a query: its names and its descriptions."""
        return (*self.names, *self.descriptions)


@functools.cache
def listed_kinds() -> tuple[Kind, ...]:
    """Return all kinds of objects in the built-in list."""
    blocks: list[tuple[list[str], list[str]]] = []
    for line in list_lines("kinds.txt"):
        if line[0].isspace():
            blocks[-1][1].append(line.strip())
        else:
            blocks.append(([name.strip() for name in line.split("=")], []))
    known = {name for names, _ in blocks for name in names}
    uses: dict[str, list[str]] = {}
    for name, said in entries_by_name("uses.txt", ";"):
        if name not in known:
            raise ValueError(f"uses.txt names the kind {name!r}, which is not in kinds.txt")
        uses.setdefault(name, []).extend(said)
    return tuple(Kind(tuple(names), (*said, *(u for n in names for u in uses.get(n, ())))) for names, said in blocks)


@functools.cache
def _numbers() -> dict[tuple[str, ...], int]:
    """Return the index of the kind for each name. A name that several kinds share belongs to the first of them."""
    found: dict[tuple[str, ...], int] = {}
    for number, kind in enumerate(listed_kinds()):
        for name in kind.names:
            found.setdefault(tuple(terms(name)), number)
    return found


def number_of(name: str) -> int:
    """Return the index of the kind with the given name. Raises KeyError if there is no such kind."""
    return _numbers()[tuple(terms(name))]


@functools.cache
def _longest() -> int:
    return max(map(len, _numbers()))


def kind_of(entry: CatalogueEntry) -> int:
    """Return the index of an asset's kind, or -1 if neither its category nor its name contains the name of a kind.

    If several names of kinds occur, the longest one is used and, among equally long names, the last one: an apple pie
    is a pie. Names before "of" or "with" take precedence: a mug with an apple on it is a mug. Colors have the lowest
    priority: an orange mug is a mug.
    """
    words = terms(f"{entry.category} {entry.name}")
    best = max(_named(words), default=None)
    return -1 if best is None else best[-1]


def kinds_named(words: Sequence[str]) -> frozenset[int]:
    """Return the indices of the kinds that are named in a list of words.

    A name is ignored if it is part of a longer name that also occurs.
    """
    spans = [(end - length, end, kind) for _, _, length, end, kind in _named(words)]
    return frozenset(
        kind
        for start, end, kind in spans
        if not any(a <= start and end <= b and (a, b) != (start, end) for a, b, _ in spans)
    )


def named_last(words: Sequence[str], *, longer_than: int = 0) -> frozenset[int]:
    """Return a set with the index of the kind named at the end of the words. The longest matching name is used.

    The set is empty if the words do not end with the name of a kind.
    """
    known = _numbers()
    spans = (tuple(words[start:]) for start in range(max(0, len(words) - _longest()), len(words) - longer_than))
    return frozenset([next((known[span] for span in spans if span in known), -1)]) - {-1}


def _named(words: Sequence[str]) -> Iterator[tuple[bool, bool, int, int, int]]:
    """Yield a sort key for each name of a kind that occurs in a list of words.

    The elements of the key are: whether the name precedes all attributes, whether the name is more than a color, its
    number of words, its end position, and the index of the kind.
    """
    head = next((at for at, word in enumerate(words) if at and word in AFTER_THE_HEAD), len(words))
    known, longest = _numbers(), _longest()
    for start in range(len(words)):
        for end in range(start + 1, min(start + longest, len(words)) + 1):
            number = known.get(tuple(words[start:end]))
            if number is not None:
                is_color = end - start == 1 and words[start] in COLORS
                yield start < head, not is_color, end - start, end, number
