"""Usual size, mass and use of kinds of objects, by which an imported mesh is scaled, weighed and set upright."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from importlib import resources

from betterbench.sim.assets.names import words_of


@dataclass(frozen=True, slots=True)
class Kind:
    """One kind of objects.

    Attributes:
        low_m: Longest side of the smallest usual one [m].
        high_m: Longest side of the largest usual one [m].
        mass_kg: Mass of one of middle size.
        is_open: True if it is hollow and open at the top as it is used.
        names: All its names, each in words separated by blanks.
    """

    name: str
    low_m: float
    high_m: float
    mass_kg: float
    is_open: bool
    names: tuple[str, ...]

    @property
    def middle_m(self) -> float:
        """Longest side of one of middle size [m]."""
        return float((self.low_m * self.high_m) ** 0.5)

    def mass_at(self, longest_m: float) -> float:
        """Return the mass of one whose longest side is given [kg], by the cube of its size."""
        return float(self.mass_kg * (longest_m / self.middle_m) ** 3)


@functools.cache
def kinds() -> tuple[Kind, ...]:
    """Return all kinds."""
    text = resources.files(__package__).joinpath("data/kinds.txt").read_text(encoding="utf-8")
    return tuple(_kind(line) for line in text.splitlines() if line and not line.startswith("#"))


def _kind(line: str) -> Kind:
    head, _, others = line.partition(":")
    *words, low, high, mass, hollow = head.split()
    name = " ".join(words)
    names = tuple(dict.fromkeys((name, *(other.strip() for other in others.split(",") if other.strip()))))
    return Kind(name, 0.01 * float(low), 0.01 * float(high), 0.001 * float(mass), hollow == "open", names)


def kind_of(text: str) -> Kind | None:
    """Return the kind that a name or a description names, None if it names none.

    The longest name that occurs counts; of two of the same length the last one, since English puts the noun last.
    """
    words = words_of(text)
    best: tuple[int, int, Kind] | None = None
    for kind in kinds():
        for name in kind.names:
            parts = tuple(name.split())
            for at in range(len(words) - len(parts) + 1):
                if all(_same(given, own) for given, own in zip(words[at:], parts, strict=False)):
                    rank = (len(parts), at)
                    if best is None or rank > best[:2]:
                        best = (*rank, kind)
    return None if best is None else best[2]


def _same(given: str, own: str) -> bool:
    """Tell whether two words are the same but for the plural."""
    return given == own or given in (f"{own}s", f"{own}es")
