"""Names of objects in instructions: nouns, preceded by a color if the noun alone is ambiguous."""

from __future__ import annotations

import functools
from collections.abc import Sequence

from betterbench.errors import InvalidInputError
from betterbench.generation.building.choice import Choice
from betterbench.sim.assets.catalogue.entry import CatalogueEntry
from betterbench.sim.assets.catalogue.expansion import COLORS, understood
from betterbench.sim.assets.catalogue.terms import terms

SYNONYMS = 2
"""Number of leading tags of an asset that are always accepted as names of the asset."""


def kinds_of(chosen: Sequence[Choice]) -> list[str]:
    """Return a noun phrase for each object, including the color if the noun alone would be ambiguous."""
    nouns = _nouns(chosen)
    kinds = []
    for i, choice in enumerate(chosen):
        alike = [j for j, other in enumerate(chosen) if j != i and other.entry.category == choice.entry.category]
        noun = min((nouns[j] for j in (i, *alike) if answers_to(nouns[j], choice.entry)), key=len)
        color = choice.entry.color
        confused = [
            j
            for j, other in enumerate(chosen)
            if j != i and (answers_to(noun, other.entry) or answers_to(nouns[j], choice.entry))
        ]
        for j in confused:
            if color == chosen[j].entry.color:
                problem = (
                    f"{nouns[min(i, j)]!r} and {nouns[max(i, j)]!r} are both {color}, so their names may be confused"
                )
                raise InvalidInputError("instantiation", problem, "Describe objects of other kinds or colors")
        kinds.append(f"{color} {noun}" if confused and color else noun)
    return kinds


def _nouns(chosen: Sequence[Choice]) -> list[str]:
    """Return the noun of each object.

    If a noun names the asset precisely ("fries box"), it is replaced by the common noun ("fries"), unless the common
    noun also fits another object.
    """
    nouns = []
    for i, choice in enumerate(chosen):
        noun, everyday = _noun(choice), noun_of(choice.entry)
        spelled = set(terms(noun)) == set(terms(choice.entry.name))
        others = [
            other.entry for j, other in enumerate(chosen) if j != i and other.entry.category != choice.entry.category
        ]
        unclear = any(answers_to(everyday, entry) for entry in others)
        nouns.append(everyday if spelled and not unclear else noun)
    return nouns


def answers_to(noun: str, entry: CatalogueEntry) -> bool:
    """Return whether a noun can refer to an asset."""
    names = [set(terms(entry.name)), *(set(terms(tag)) for tag in entry.tags if tag not in COLORS)]
    return all(any(phrase <= name for phrase in phrases for name in names) for phrases in _phrases_of(noun))


@functools.lru_cache(1024)
def _phrases_of(noun: str) -> tuple[tuple[frozenset[str], ...], ...]:
    """Return the alternative phrases for each concept in a noun.

    Results are cached, because a noun is compared with every asset.
    """
    said = [[phrase for phrase, _ in concept.alternatives] for concept in understood(noun).concepts]
    # The result is empty for "can", because the search ignores it as a verb.
    if not said:
        said = [[tuple(terms(noun))]]
    elif len(said) == 1:  # the search omits "can" in "trash can" for the same reason
        said[0][0] = tuple(terms(noun))
    return tuple(tuple(map(frozenset, phrases)) for phrases in said)


def _noun(choice: Choice) -> str:
    """Return the noun of an object: the words of its query without colors.

    If these words do not fit the asset, return the asset's own noun. If the instance name contains only some words of
    the query, return these words: "pepper jar" for the query "pepper spice jar".
    """
    entry, described = choice.entry, choice.described
    asked = [word for word in described.asset_query.lower().split() if word not in COLORS]
    named = [word for word in described.instance_name.split("_") if word not in COLORS and not word.isdigit()]
    left = iter(asked)
    known = set(terms(f"{entry.name} {' '.join(entry.tags)}"))
    for words in (named if all(word in left for word in named) else [], asked):
        if words and words[-1:] == asked[-1:] and set(terms(" ".join(words))) <= known and all(map(str.isalpha, words)):
            return " ".join(words)
    return noun_of(entry)


def noun_of(entry: CatalogueEntry) -> str:
    """Return the noun that instructions use for an asset.

    The noun is the tag with the same words as the name of the asset. If there is no such tag, the first tag is
    returned.
    """
    named = set(terms(entry.name))
    return next((tag for tag in entry.tags if set(terms(tag)) == named), entry.tags[0] if entry.tags else entry.name)


def names_of(kind: str, entry: CatalogueEntry | None) -> set[tuple[str, ...]]:
    """Return the nouns that can refer to an object: its kind and the first tags of its asset.

    Each noun is a tuple of normalized words without colors.
    """
    nouns = [kind, *(() if entry is None else entry.tags[:SYNONYMS])]
    found = (tuple(terms(noun)) for noun in nouns)
    return {tuple(word for word in words if word not in COLORS) or words for words in found}
