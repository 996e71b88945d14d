"""Usual size, mass and use of each kind of object. They determine the scale, mass and pose of imported meshes."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from importlib import resources

from betterbench.sim.assets.names import words_of

TALL_SHARE = 0.95
"""Minimum height of a standing object of a tall kind, as a fraction of its longest side."""
FLAT_SHARE = 1.10
"""Maximum height of a lying object of a flat kind, as a multiple of its shorter horizontal side."""


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of object, such as a mug or a fork.

    Attributes:
        low_m: Length of the longest side of a small object of this kind [m].
        high_m: Length of the longest side of a large object of this kind [m].
        mass_kg: Mass of a medium-sized object of this kind.
        is_open: Whether an object of this kind is hollow and open at the top when in use.
        is_tall: Whether such an object stands with its longest side vertical.
        is_flat: Whether such an object lies on its broadest side.
        is_round: Whether such objects are often round about the vertical axis, and never about a horizontal axis.
        names: All names of the kind. The words of a name are separated by spaces.
    """

    name: str
    low_m: float
    high_m: float
    mass_kg: float
    is_open: bool
    is_tall: bool
    is_flat: bool
    is_round: bool
    names: tuple[str, ...]

    @property
    def stands(self) -> bool:
        """Whether objects of this kind stand on a base with their axis vertical."""
        return self.is_open or self.is_tall or self.is_round

    @property
    def middle_m(self) -> float:
        """Longest side of a medium-sized object of this kind [m]."""
        return float((self.low_m * self.high_m) ** 0.5)

    def mass_at(self, longest_m: float) -> float:
        """Return the usual mass [kg] of an object with the given longest side [m].

        The mass grows with the cube of the size. For flat objects it grows with the square, since a larger plate or
        fork is hardly thicker.
        """
        return float(self.mass_kg * (longest_m / self.middle_m) ** (2 if self.is_flat else 3))


@functools.cache
def kinds() -> tuple[Kind, ...]:
    """Return all known kinds of objects."""
    text = resources.files(__package__).joinpath("data/kinds.txt").read_text(encoding="utf-8")
    return tuple(_kind(line) for line in text.splitlines() if line and not line.startswith("#"))


def _kind(line: str) -> Kind:
    head, _, others = line.partition(":")
    *words, low, high, mass, use = head.split()
    name = " ".join(words)
    uses = use.split(",")
    return Kind(
        name=name,
        low_m=0.01 * float(low),
        high_m=0.01 * float(high),
        mass_kg=0.001 * float(mass),
        is_open="open" in uses,
        is_tall="tall" in uses,
        is_flat="flat" in uses,
        is_round="round" in uses,
        names=tuple(dict.fromkeys((name, *(other.strip() for other in others.split(",") if other.strip())))),
    )


def kind_of(text: str) -> Kind | None:
    """Return the kind of object that a name or description mentions, or None if it mentions no known kind.

    If several kinds are mentioned, the one with the longest name is returned. Among names of equal length, the last one
    counts, because in English the noun comes last ("coffee mug").
    """
    words = words_of(text)
    best: tuple[int, int, Kind] | None = None
    for at, word in enumerate(words):
        for parts, kind in _kinds_by_first_word().get(word, ()):
            given = words[at : at + len(parts)]
            if len(given) == len(parts) and all(one in _forms(own) for one, own in zip(given, parts, strict=True)):
                rank = (len(parts), at)
                if best is None or rank > best[:2]:
                    best = (*rank, kind)
    return None if best is None else best[2]


@functools.cache
def _kinds_by_first_word() -> dict[str, list[tuple[tuple[str, ...], Kind]]]:
    """Index all names of all kinds by the singular and plural forms of their first word.

    Returns:
        For each form of a first word, the names that begin with this word. Each name is split into words and paired
        with its kind.
    """
    found: dict[str, list[tuple[tuple[str, ...], Kind]]] = {}
    for kind in kinds():
        for name in kind.names:
            parts = tuple(name.split())
            for form in _forms(parts[0]):
                found.setdefault(form, []).append((parts, kind))
    return found


def _forms(word: str) -> tuple[str, str, str]:
    """Return a word and its possible plurals."""
    return word, f"{word}s", f"{word}es"
