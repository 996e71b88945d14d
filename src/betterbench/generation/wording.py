"""Words that identify an object in an instruction."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from betterbench.tasks.condition import ObjectSpec


def words_of(objects: Sequence[ObjectSpec]) -> dict[str, str]:
    """Return a word for each kind of object that distinguishes it from the other kinds.

    The word is the noun, the first word, or the full name of the kind.
    """
    kinds = tuple(dict.fromkeys(spec.kind for spec in objects))
    found = {}
    for kind in kinds:
        others = [set(other.split()) for other in kinds if other != kind]
        parts = kind.split()
        found[kind] = next((w for w in (parts[-1], parts[0]) if not any(w in other for other in others)), kind)
    return found


def words_and_noun(items: Iterable[ObjectSpec]) -> tuple[dict[str, str], str | None]:
    """Return a distinguishing word for each item, by the name of the item, and the noun that all items share.

    For the kinds "red mug" and "blue mug", the words are "red" and "blue" and the noun is "mug". If there is no common
    noun, each word is the complete kind, and the noun is None.
    """
    kinds = {spec.name: spec.kind.split() for spec in items}
    nouns = {words[-1] for words in kinds.values()}
    if len(nouns) == 1 and all(len(words) > 1 for words in kinds.values()):
        return {name: " ".join(words[:-1]) for name, words in kinds.items()}, nouns.pop()
    return {name: " ".join(words) for name, words in kinds.items()}, None
