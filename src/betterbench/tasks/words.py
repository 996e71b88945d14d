"""Grammar of nouns for objects: articles, plurals, mass nouns, and verb agreement."""

from __future__ import annotations

MASS_NOUNS = frozenset({"bread", "butter", "cheese", "ham", "jam", "lettuce", "paper", "salt", "soap", "tape"})
"""Nouns that have no plural in everyday instructions."""
_IRREGULAR = {"knife": "knives", "leaf": "leaves", "loaf": "loaves", "mouse": "mice", "shelf": "shelves"}
_OES = frozenset({"potato", "tomato"})


def with_article(phrase: str) -> str:
    """Return a phrase with the article "a" or "an" before it."""
    return f"{'an' if phrase[0] in 'aeiou' else 'a'} {phrase}"


def is_countable(kind: str) -> bool:
    """Return whether a kind of object is countable, so that "both" and "another" can be used with it.

    An apple is countable, but fries and lettuce are not.
    """
    return not is_plural(kind) and kind.rsplit(maxsplit=1)[-1] not in MASS_NOUNS


def plural(kind: str) -> str:
    """Return the plural of a countable kind of object, such as "red apples", "tape rolls" or "knives"."""
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


def is_plural(kind: str) -> bool:
    """Return whether the noun for a kind of object is a plural.

    "Fries" is a plural, but "glass" and "cactus" are not.
    """
    return kind.endswith("s") and not kind.endswith(("ss", "us", "is"))


def agreeing(kind: str, one: str, many: str) -> str:
    """Return the verb form that agrees with a kind of object: ``one`` for "burger" and ``many`` for "fries"."""
    return many if is_plural(kind) else one


def place_words(kind: str, region: str) -> str:
    """Describe a region of a target, such as "the laptop (upper right)" or "the box"."""
    name = f"layer {region}" if region.isdigit() else region.replace("_", " ")
    return f"the {kind} ({name})" if name else f"the {kind}"
