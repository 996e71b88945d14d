"""Broader words, such as "cutlery" or "container", and the kinds of objects that these words include."""

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
"""Nouns that do not change the meaning of a broader word beside them: "bakery item", "an article of stationery"."""
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
        "after",
        "an",
        "and",
        "around",
        "at",
        "before",
        "behind",
        "below",
        "beside",
        "between",
        "by",
        "consisting",
        "has",
        "have",
        "he",
        "i",
        "inside",
        "into",
        "is",
        "it",
        "lying",
        "near",
        "next",
        "one",
        "onto",
        "or",
        "over",
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
_PARTICIPLES = frozenset(
    [
        "broken",
        "coated",
        "covered",
        "cut",
        "decorated",
        "divided",
        "dipped",
        "filled",
        "full",
        "halved",
        "heaped",
        "laid",
        "packed",
        "served",
        "sliced",
        "split",
        "sprinkled",
        "still",
        "topped",
        "wrapped",
    ]
)
"""Words that end the noun phrase if they follow the name of a kind: "hot dog topped with mustard"."""
_DISHES = frozenset(["cuisine", "dish", "food", "meal", "snack", "specialty", "speciality", "stuff", "treat"])
"""Nouns that mean food if a word for a type of food precedes them. A "Mexican dish" is not crockery, but food."""
_ENDS_WITH_COMMA = re.compile(r"[,;:.(]")


@functools.cache
def hypernym_list() -> dict[tuple[str, ...], frozenset[int]]:
    """Return the indices of the kinds that each listed broader word or phrase includes, such as forks for "cutlery".

    The keys are the words and phrases, each as a tuple of terms.
    """
    return _listed(">")


@functools.cache
def attribute_list() -> dict[tuple[str, ...], frozenset[int]]:
    """Return the indices of the kinds that each attribute applies to, such as "breakfast" in "breakfast crockery"."""
    return hypernym_list() | _listed("~")


@functools.cache
def _listed(mark: str) -> dict[tuple[str, ...], frozenset[int]]:
    """Read the lines of ``hypernyms.txt`` in which the given mark separates the phrases from their kinds.

    Returns:
        The indices of the kinds for each phrase. The phrases are tuples of terms.
    """
    found: dict[tuple[str, ...], frozenset[int]] = {}
    for line in list_lines("hypernyms.txt"):
        broader, marked, members = line.partition(mark)
        if not marked:
            continue
        try:
            numbers = frozenset(number_of(name) for name in members.split(","))
        except KeyError as error:
            problem = f"hypernyms.txt names the kind {' '.join(error.args[0])!r}, which is not in kinds.txt"
            raise ValueError(problem) from None
        for phrase in broader.split("="):
            found[tuple(terms(phrase))] = numbers
    return found


@functools.cache
def _longest() -> int:
    return max(map(len, attribute_list()))


def members_named(text: str) -> frozenset[int]:
    """Return the kinds that a description names by a broader word ("cutlery"). Empty if it has no such word.

    The broader word is the last noun before the first use or attribute: "vegetables" in "fresh vegetables for a soup".
    Therefore "a vegetable knife" does not mean vegetables. If the broader word and the words before it are together the
    name of a kind ("egg holder"), that kind is included as well.
    """
    words = terms(text)
    start = next((at for at, word in enumerate(words) if word not in SAYS_LITTLE or word in _GENERAL | _ANYTHING), 0)
    known = hypernym_list()
    for length in range(_longest(), 1, -1):
        # a phrase such as "tool for eating" contains a word that ends a noun phrase
        phrase = tuple(words[start : start + length])
        if len(phrase) == length and phrase in known and _ENDS.intersection(phrase):
            return known[phrase]
    if words[:1] in (["anything"], ["something"]) and tuple(words[1:]) in attribute_list():
        return attribute_list()[tuple(words[1:])]
    if is_use(words):
        return frozenset()
    before = terms(_ENDS_WITH_COMMA.split(text, maxsplit=1)[0])
    for said in (before, words) if before != words else (words,):
        found = _members(_noun_phrase(said))
        if found:
            return found
    return frozenset()


def kind_named(text: str) -> frozenset[int]:
    """Find the kind named at the end of the noun phrase for the object, such as plate in "small plate under a cup".

    Return a set with the index of the kind, or an empty set if there is no such kind.
    """
    words = terms(text)
    if not words or is_use(words):
        return frozenset()
    before = terms(_ENDS_WITH_COMMA.split(text, maxsplit=1)[0])
    phrase = _noun_phrase(before)
    while phrase and phrase[-1] in _GENERAL:
        phrase.pop()
    if not phrase or (phrase[-1] in COLORS and len(phrase) > 1):
        return frozenset()
    return named_last(phrase)


def _noun_phrase(words: Sequence[str]) -> list[str]:
    """Return the words up to the noun that names the object: "fresh vegetable" for "fresh vegetables to cook"."""
    phrase: list[str] = []
    for word in words:
        if word == "shaped":
            phrase = phrase[:-1]  # a "bowl-shaped vessel" is not a bowl
        elif word in ("and", "or") and phrase and (phrase[-1] in COLORS or (phrase[-1],) in _listed("~")):
            continue  # "a glass or plastic vessel"
        elif word == "of":
            if not phrase or phrase[-1] not in _GENERAL | _MANY:
                break
            phrase.clear()
        elif phrase and (word in _ENDS or (word in _PARTICIPLES and _is_named(phrase, word))):
            break
        elif word not in _ENDS and (phrase or word not in SAYS_LITTLE or word in _GENERAL | _MANY | _ANYTHING):
            phrase.append(word)
    return phrase


def _is_named(phrase: Sequence[str], after: str) -> bool:
    """Return whether a phrase ends with the name of a kind, and the next word does not belong to the name.

    For example, "cheese cut" is the name of a kind. Therefore the phrase "cheese" is not a complete name if the next
    word is "cut".
    """
    return bool(named_last(phrase)) and not named_last([*phrase, after])


def _members(phrase: Sequence[str]) -> frozenset[int]:
    """Return the kinds of objects that the broader word at the end of a noun phrase stands for."""
    known = hypernym_list()
    words = list(phrase)
    while words:
        if len(words) < len(phrase):
            known = attribute_list()
        for start in range(max(0, len(words) - _longest()), len(words)):
            found = known.get(tuple(words[start:]))
            if found:
                found = _narrowed(words, start, found)
                return found | _narrower(words, len(words) - start)
        if words[-1] not in _GENERAL | COLORS:
            break
        words.pop()
    return frozenset()


def _narrowed(words: Sequence[str], start: int, found: frozenset[int]) -> frozenset[int]:
    """Filter the kinds of a broader word by the attributes before the word, as in "breakfast crockery".

    An attribute that applies to none of the kinds is ignored, except before a word such as "dish", since a "Mexican
    dish" is Mexican food.
    """
    known = attribute_list()
    end = start
    while end > 0:
        spans = (tuple(words[first:end]) for first in range(max(0, end - _longest()), end))
        span = next((one for one in spans if one in known), ())
        if found & known.get(span, frozenset()):
            found &= known[span]
        elif span and (end, start) == (start, len(words) - 1) and words[-1] in _DISHES:
            found = known[span] & known[("food",)] or known[span]
        end -= max(len(span), 1)
    return found


def _narrower(words: Sequence[str], length: int) -> frozenset[int]:
    """Return the kinds that are named by the broader word together with the words before it.

    For example, "egg holder" names narrower kinds than "holder", and "canned meat" names narrower kinds than "meat".
    """
    listed = word_list()
    for start in range(len(words) - length):
        means = listed.get(tuple(words[start:]), ())
        found = named_last(words[start:], longer_than=length).union(*(named_last(phrase) for phrase, _ in means))
        if found:
            return found
    return frozenset()
