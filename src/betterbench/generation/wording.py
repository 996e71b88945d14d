"""Words of instructions: plurals, lists, and the word that identifies an object."""

from __future__ import annotations

from collections.abc import Sequence

from betterbench.tasks.condition import ObjectSpec
from betterbench.tasks.words import is_plural

MASS_NOUNS = frozenset({"bread", "butter", "cheese", "ham", "jam", "lettuce", "paper", "salt", "soap", "tape"})
"""Nouns without a plural in everyday instructions."""
_IRREGULAR = {"knife": "knives", "leaf": "leaves", "loaf": "loaves", "mouse": "mice", "shelf": "shelves"}
_OES = frozenset({"potato", "tomato"})


def is_countable(kind: str) -> bool:
    """Tell whether "both" and "another" can be said of a kind: of apples, but not of fries or lettuce."""
    return not is_plural(kind) and kind.rsplit(maxsplit=1)[-1] not in MASS_NOUNS


def plural(kind: str) -> str:
    """Return the plural of a countable kind: "red apples", "tape rolls", "knives"."""
    *before, noun = kind.split()
    if noun in _IRREGULAR:
        many = _IRREGULAR[noun]
    elif noun in _OES or noun.endswith(("s", "x", "z", "ch", "sh")):
        many = f"{noun}es"
    elif noun.endswith("y") and noun[-2:-1] not in "aeiou":
        many = f"{noun[:-1]}ies"
    else:
        many = f"{noun}s"
    return " ".join((*before, many))


def listed(parts: Sequence[str]) -> str:
    """Return parts as a list in a sentence: "a", "a and b", "a, b and c"."""
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"


def words_of(objects: Sequence[ObjectSpec]) -> dict[str, str]:
    """Return the word that identifies each kind among all kinds: its noun, its first word, or the whole kind."""
    kinds = tuple(dict.fromkeys(spec.kind for spec in objects))
    found = {}
    for kind in kinds:
        others = [set(other.split()) for other in kinds if other != kind]
        parts = kind.split()
        found[kind] = next((w for w in (parts[-1], parts[0]) if not any(w in other for other in others)), kind)
    return found
