"""Kinds of objects with descriptions of definition, appearance and use, from the list ``kinds.txt``.

The name of a mesh contains little information. A query such as "it opens wine bottles" is therefore compared with the
descriptions of a kind, and the result applies to every row of this kind.
"""

from __future__ import annotations

import functools
import importlib.resources
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from betterbench.sim.assets.catalogue.entry import CatalogueEntry
from betterbench.sim.assets.catalogue.expansion import AFTER_THE_HEAD, COLORS
from betterbench.sim.assets.catalogue.terms import terms


@dataclass(frozen=True, slots=True)
class Kind:
    """One kind of object.

    Attributes:
        names: Names; a row whose name contains one of them belongs to the kind.
        descriptions: Descriptions in plain words.
    """

    names: tuple[str, ...]
    descriptions: tuple[str, ...]

    @property
    def texts(self) -> tuple[str, ...]:
        """Texts that are compared with a query: the names and the descriptions."""
        return (*self.names, *self.descriptions)


@functools.cache
def listed_kinds() -> tuple[Kind, ...]:
    """Return the kinds of the built-in list."""
    text = importlib.resources.files(__package__).joinpath("kinds.txt").read_text(encoding="utf-8")
    blocks: list[tuple[str, list[str]]] = []
    for line in text.splitlines():
        if not line.strip() or line.startswith("#"):
            continue
        if line[0].isspace():
            blocks[-1][1].append(line.strip())
        else:
            blocks.append((line, []))
    return tuple(Kind(tuple(name.strip() for name in names.split("=")), tuple(said)) for names, said in blocks)


@functools.cache
def _numbers() -> dict[tuple[str, ...], int]:
    """Return the number of the kind for each name, as terms; a name belongs to the first kind that has it."""
    found: dict[tuple[str, ...], int] = {}
    for number, kind in enumerate(listed_kinds()):
        for name in kind.names:
            found.setdefault(tuple(terms(name)), number)
    return found


@functools.cache
def _longest() -> int:
    return max(map(len, _numbers()))


def kind_of(entry: CatalogueEntry) -> int:
    """Return the number of an asset's kind in the list, -1 if its category and name contain no name of a kind.

    The longest name is used, and of equally long names the last: an apple pie is a pie. Names before "of" or "with"
    take precedence, and colors come last: an orange mug is a mug, and so is a mug with an apple on it.
    """
    words = terms(f"{entry.category} {entry.name}")
    best = max(_named(words), default=None)
    return -1 if best is None else best[-1]


def _named(words: Sequence[str]) -> Iterator[tuple[bool, bool, int, int, int]]:
    """Yield, for each name of a kind, a sort key (in the head, not only a color, length, end) and the kind's number."""
    head = next((at for at, word in enumerate(words) if at and word in AFTER_THE_HEAD), len(words))
    known, longest = _numbers(), _longest()
    for start in range(len(words)):
        for end in range(start + 1, min(start + longest, len(words)) + 1):
            number = known.get(tuple(words[start:end]))
            if number is not None:
                is_color = end - start == 1 and words[start] in COLORS
                yield start < head, not is_color, end - start, end, number
