"""Broader words, such as "cutlery" or "container", and the kinds of objects that they include."""

from __future__ import annotations

import functools
import re
from collections.abc import Sequence

from betterbench.sim.assets.catalogue.expansion import AFTER_THE_HEAD, COLORS, SAYS_LITTLE, is_use, word_list
from betterbench.sim.assets.catalogue.kinds import named_last, number_of
from betterbench.sim.assets.catalogue.lists import list_lines
from betterbench.sim.assets.catalogue.terms import terms

_GENERAL = frozenset(
    ["article", "equipment", "food", "good", "item", "object", "piece", "product", "stuff", "supply", "thing", "ware"]
)
"""Nouns that may follow a broader word without changing it: "bakery item", "an article of stationery"."""
_MANY = frozenset(
    [
        "assortment",
        "bunch",
        "choice",
        "collection",
        "example",
        "handful",
        "kind",
        "lot",
        "pair",
        "part",
        "piece",
        "selection",
        "set",
        "sort",
        "type",
    ]
)
"""Nouns before "of" that do not name an object: "a set of cutlery"."""
_ANYTHING = frozenset(["anything", "it", "object", "one", "place", "something", "thing", "tool", "what"])
"""Nouns that do not name a kind of object and are followed by a use: "a place to throw garbage"."""
_ENDS = (AFTER_THE_HEAD - {"of"}) | frozenset(
    [
        "a",
        "an",
        "and",
        "beside",
        "between",
        "by",
        "has",
        "have",
        "he",
        "i",
        "is",
        "it",
        "lying",
        "next",
        "one",
        "or",
        "placed",
        "she",
        "standing",
        "the",
        "they",
        "under",
        "we",
        "when",
        "where",
        "who",
        "you",
        "your",
    ]
)
"""Words that end the noun phrase of a description."""
_ENDS_WITH_COMMA = re.compile(r"[,;:.(]")


@functools.cache
def hypernym_list() -> dict[tuple[str, ...], frozenset[int]]:
    """Return, for each listed broader word or phrase as terms, the numbers of its kinds."""
    found: dict[tuple[str, ...], frozenset[int]] = {}
    for line in list_lines("hypernyms.txt"):
        broader, _, members = line.partition(">")
        try:
            numbers = frozenset(number_of(name) for name in members.split(","))
        except KeyError as error:
            problem = f"hypernyms.txt names the kind {' '.join(error.args[0])!r}, which kinds.txt does not have"
            raise ValueError(problem) from None
        for phrase in broader.split("="):
            found[tuple(terms(phrase))] = numbers
    return found


@functools.cache
def _longest() -> int:
    return max(map(len, hypernym_list()))


def members_named(text: str) -> frozenset[int]:
    """Return the kinds included in the broader word by which a description names the object, or none.

    The word is the last noun before the first use or attribute: "vegetables" in "fresh vegetables for a soup", but not
    in "a vegetable knife". If the words before it and the word are the name of a kind ("egg holder"), this kind is also
    included.
    """
    words = terms(text)
    start = next((at for at, word in enumerate(words) if word not in SAYS_LITTLE or word in _GENERAL | _ANYTHING), 0)
    known = hypernym_list()
    for length in range(_longest(), 1, -1):
        # a phrase such as "tool for eating" contains a word that ends a noun phrase
        phrase = tuple(words[start : start + length])
        if len(phrase) == length and phrase in known and _ENDS.intersection(phrase):
            return known[phrase]
    if is_use(words):
        return frozenset()
    before = terms(_ENDS_WITH_COMMA.split(text, maxsplit=1)[0])
    for said in (before, words) if before != words else (words,):
        found = _members(_noun_phrase(said))
        if found:
            return found
    return frozenset()


def _noun_phrase(words: Sequence[str]) -> list[str]:
    """Return the words up to the noun that names the object: "fresh vegetable" in "fresh vegetables to cook"."""
    phrase: list[str] = []
    for word in words:
        if word == "of":
            if not phrase or phrase[-1] not in _GENERAL | _MANY:
                break
            phrase.clear()
        elif word in _ENDS and phrase:
            break
        elif word not in _ENDS and (phrase or word not in SAYS_LITTLE or word in _GENERAL | _MANY | _ANYTHING):
            phrase.append(word)
    return phrase


def _members(phrase: Sequence[str]) -> frozenset[int]:
    """Return the kinds that the broader word at the end of a noun phrase includes."""
    known = hypernym_list()
    words = list(phrase)
    while words:
        for start in range(max(0, len(words) - _longest()), len(words)):
            found = known.get(tuple(words[start:]))
            if found:
                return found | _narrower(words, len(words) - start)
        if words[-1] not in _GENERAL | COLORS:
            break
        words.pop()
    return frozenset()


def _narrower(words: Sequence[str], length: int) -> frozenset[int]:
    """Return the kinds of a longer phrase at the end of words: "egg holder" for "holder", "canned meat" for "meat"."""
    listed = word_list()
    for start in range(len(words) - length):
        means = listed.get(tuple(words[start:]), ())
        found = named_last(words[start:], longer_than=length).union(*(named_last(phrase) for phrase, _ in means))
        if found:
            return found
    return frozenset()
