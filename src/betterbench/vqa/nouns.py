"""Nouns in questions, with countable phrases for uncountable nouns ("slice of cheese") and lists of similar nouns."""

from __future__ import annotations

import re

from betterbench.tasks.words import plural, with_article

_PORTIONS = {
    "fries": ("box of fries", "boxes of fries"),
    "cheese": ("slice of cheese", "slices of cheese"),
    "lettuce": ("leaf of lettuce", "leaves of lettuce"),
    "tape": ("roll of tape", "rolls of tape"),
    "mouse": ("computer mouse", "computer mice"),
}
"""Names that are uncountable or ambiguous, each with the singular and the plural form used in sentences."""

_LOOKS = frozenset(
    [
        "red",
        "blue",
        "white",
        "black",
        "gray",
        "green",
        "yellow",
        "round",
        "full",
        "upper",
        "lower",
        "left",
        "right",
        "top",
        "bottom",
        "crumpled",
    ]
)
"""Words in a name that describe the appearance or location of an object and not its kind."""

_MISTAKABLE: tuple[frozenset[str], ...] = tuple(
    frozenset(words.split())
    for words in (
        "cup mug tumbler drink",
        "can drink tumbler",
        "box lunchbox fries",
        "laptop keyboard",
        "burger bun patty cheese lettuce",
        "sponge soap cheese",
        "drawer cabinet",
        "salt pepper paprika shaker jar bottle",
        "napkin paper",
        "orange lemon apple ball",
        "fork spoon cutlery",
        "bowl plate dish",
        "block box",
    )
)
"""Words for objects that may be mistaken for each other, or that may be parts of each other."""


def indefinite(kind: str) -> str:
    """Return a kind of object with the indefinite article, such as "an apple" or "a slice of cheese"."""
    return with_article(_PORTIONS.get(kind, (kind, ""))[0])


def definite(kind: str) -> str:
    """Return a kind of object with the definite article, such as "the apple" or "the slice of cheese"."""
    return f"the {_PORTIONS.get(kind, (kind, ''))[0]}"


def plural_of(kind: str) -> str:
    """Return the plural of a kind of object, such as "apples", "boxes of fries" or "computer mice"."""
    return _PORTIONS[kind][1] if kind in _PORTIONS else plural(kind)


def mistakable(a: str, b: str) -> bool:
    """Return whether an object of kind ``b`` could also be called ``a``, or could be seen as a part of an ``a``."""
    mine, other = _words(a), _words(b)
    if mine & other or any(x.endswith(y) or y.endswith(x) for x in mine for y in other):
        return True
    return any(mine & alike and other & alike for alike in _MISTAKABLE)


def _words(kind: str) -> frozenset[str]:
    return frozenset(re.split(r"[\s-]+", kind.lower())) - _LOOKS
