"""Query expansion with synonyms, object kinds and descriptions, from the built-in word list."""

from __future__ import annotations

import functools
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from betterbench.sim.assets.catalogue.lists import entries_by_name, list_lines
from betterbench.sim.assets.catalogue.terms import terms

_COLOR_WORDS = """
red blue green yellow orange purple white black brown gray silver gold golden pink cream beige turquoise
"""
COLORS = frozenset(_COLOR_WORDS.split())
"""Words for colors; a color alone does not name an object."""

_LITTLE = """
a an the of for with without to in on at and or some any is are it its that this from by into my your our i me we you
one two three few which who what be used use something object thing item want need find get show please made kind
type piece sort model 3d put holding containing contains asset mesh like as has have place tool
"""
SAYS_LITTLE = frozenset(_LITTLE.split())
"""Query words that are ignored."""
_BEFORE_THE_VERB = """
anything everything he how i it nothing one she something that they thing things this we what which who you
"""
_ASKS = frozenset(_BEFORE_THE_VERB.split())
"""Words before or after "can" that show that "can" is a verb: "that can hold", "what can I use", "can be"."""
_ENDS_THE_HEAD = "of with for in on without that to from which used made holding containing like"
AFTER_THE_HEAD = frozenset(_ENDS_THE_HEAD.split())
"""Words that end the head noun phrase of a description, such as "with" in "a blue mug with a handle"."""
_COUNTED = """
bar bunch bowl bottle box carton can cup glass jar leaf loaf pack packet pair piece pile plate roll set slice sheet
stack stick tube
"""
_MEASURES = frozenset(_COUNTED.split())
"""Head nouns that may be measure words: in "a slice of tomato", both nouns are searched."""
_MANY = "appliance container device gadget implement instrument machine tool utensil vessel"
_CLASSES = frozenset(_MANY.split())
"""Nouns that are too general to name a kind of object."""
_LONGEST_PHRASE = 5
_BEFORE_THE_NOUN = 0.4
"""Weight of a variety or brand name before another noun."""
_COLOR_WEIGHT, _OTHER_WEIGHT, _HEAD_WEIGHT = 0.35, 0.55, 1.0
_SYNONYM, _KIND = 0.95, 0.8

Expander = Callable[[str], Sequence[str]]
"""Function that returns alternative descriptions of the same object, for example from a language model. Each is
searched like the query."""


@dataclass(frozen=True, slots=True)
class Concept:
    """Concept in a query.

    Attributes:
        weight: Weight of the concept in the word score.
        alternatives: Phrases for the concept, as terms, with a weight in (0, 1]; the first phrase is from the query.
    """

    weight: float
    alternatives: tuple[tuple[tuple[str, ...], float], ...]


@dataclass(frozen=True, slots=True)
class Query:
    """Search query with its possible meanings.

    Attributes:
        text: The original query.
        concepts: Concepts for the search by words.
        readings: Sentences for the search by meaning; the first is the query.
        asked: The query and the descriptions by the expander. They are compared with the descriptions of kinds.
        head: Part of the query that names the object: "a bowl" in "a bowl for fruit".
        words: Terms of the query, without ignored words.
        colors: Colors that the query names.
        beside: Words that do not name the object itself, such as objects with which it is used.
        kinds: Kinds that a variety or brand in the query belongs to, by name, with a weight in (0, 1].
    """

    text: str
    concepts: tuple[Concept, ...]
    readings: tuple[str, ...]
    asked: tuple[str, ...]
    head: str
    words: tuple[str, ...]
    colors: tuple[str, ...]
    beside: tuple[str, ...]
    kinds: Mapping[str, float]


@functools.cache
def word_list() -> dict[tuple[str, ...], tuple[tuple[tuple[str, ...], float], ...]]:
    """Return, for each listed phrase, its synonyms and subordinate phrases with their weights.

    In a line ``a = b > c, d``, a and b are synonyms, and a query for either also finds c and d, but not the reverse.
    """
    found: dict[tuple[str, ...], dict[tuple[str, ...], float]] = {}

    def add(phrase: str, other: str, weight: float) -> None:
        means = found.setdefault(tuple(terms(phrase)), {})
        means[tuple(terms(other))] = max(weight, means.get(tuple(terms(other)), 0.0))

    for line in list_lines("words.txt"):
        asked, _, shown = line.partition(">")
        same = [phrase for phrase in asked.split("=") if phrase.strip()]
        for phrase in same:
            # the catalogue may contain the words after ">" instead of a synonym of the query
            for place, kind in enumerate(filter(None, shown.split(","))):
                add(phrase, kind, _SYNONYM if place == 0 else _KIND)
            for other in same:
                if terms(phrase) != terms(other):
                    add(phrase, other, _SYNONYM)
    for kind, varieties in entries_by_name("varieties.txt", ","):
        for variety in varieties:
            add(variety, kind, _SYNONYM)
    return {phrase: tuple(means.items()) for phrase, means in found.items()}


@functools.cache
def variety_list() -> dict[tuple[str, ...], tuple[str, ...]]:
    """Return, for each listed variety or brand as terms, the names of its kinds."""
    found: dict[tuple[str, ...], list[str]] = {}
    for kind, varieties in entries_by_name("varieties.txt", ","):
        for variety in varieties:
            found.setdefault(tuple(terms(variety)), []).append(kind)
    return {variety: tuple(kinds) for variety, kinds in found.items()}


_NEGATED = re.compile(
    r"\b(?:without|with no|having no|that has no|no)\s+(?:(?:any|a|an|the|its)\s+)?[\w'-]+"
    r"(?:\s+(?!(?:and|but|by|for|from|in|of|on|or|that|to|used|which|with)\b)[\w'-]+)?",
    re.IGNORECASE,
)


def _affirmed(text: str) -> str:
    """Return a description without its negated parts: "a jar" for "a jar without a label"."""
    kept = " ".join(_NEGATED.sub(" ", text).split())
    return kept if any(word not in SAYS_LITTLE for word in terms(kept)) else text


def understood(text: str, *, expander: Expander | None = None) -> Query:
    """Parse a query into concepts; an expander may add alternative readings."""
    text = _affirmed(text)
    words = _without_verb(terms(text))
    known = word_list()
    head = _head(words)
    concepts: list[Concept] = []
    readings = [text]
    at = 0
    while at < len(words):
        length = next((n for n in range(_LONGEST_PHRASE, 0, -1) if _is_phrase(words, at, n, known)), 1)
        phrase = tuple(words[at : at + length])
        means = known.get(phrase, ())
        if means or phrase[0] not in SAYS_LITTLE:
            own = tuple(word for word in phrase if word not in SAYS_LITTLE)
            first = (((own or phrase), 1.0),)
            concepts.append(Concept(_weight(phrase, at, length, head), (*first, *means)))
        if means and length > 1:
            names = [" ".join(other) for other, _ in means[:4]]
            before, after = words[:at], words[at + length :]
            readings += [" ".join([*before, name, *after]) for name in names]
        elif means and at <= head < at + length:
            readings += [" ".join(other) for other, weight in means[:3] if weight >= _SYNONYM]
        at += length
    further = [] if expander is None else [" ".join(said.split())[:400] for said in expander(text)]
    colors = tuple(word for word in words if word in COLORS)
    asked = tuple(dict.fromkeys([text, *further]))
    said = tuple(word for word in words if word not in SAYS_LITTLE)
    kinds = _kinds_of_varieties(words, head)
    every = tuple(dict.fromkeys([*readings, *further]))
    return Query(text, tuple(concepts), every, asked, _head_part(text), said, colors, _beside(words, head), kinds)


def _kinds_of_varieties(words: Sequence[str], head: int) -> dict[str, float]:
    """Return the kinds that belong to varieties and brands in the object-naming part of the query.

    A variety used as the noun has the full weight ("a green granny smith"). Before another noun it has less weight,
    because the noun may name another object ("a cheddar sandwich").
    """
    if head < 0 or is_use(words):
        return {}
    known, found = variety_list(), dict[str, float]()
    for start in range(head + 1):
        for end in range(start + 1, min(start + _LONGEST_PHRASE, len(words)) + 1):
            for kind in known.get(tuple(words[start:end]), ()):
                found[kind] = max(1.0 if end > head else _BEFORE_THE_NOUN, found.get(kind, 0.0))
    return found


def is_use(words: Sequence[str]) -> bool:
    """Return whether a query describes an object only by its use: "it opens wine", "you eat soup from it"."""
    names = len(words) > 1 and words[0] in ("it", "this", "that", "what") and words[1] in ("is", "s")
    return bool(words) and not names and (words[0] in _ASKS or words[-1] in ("it", "them", "this"))


def _beside(words: Sequence[str], head: int) -> tuple[str, ...]:
    """Return words that do not name the object: "steak" in "a plate for steak", all of "you serve a steak on it"."""
    if is_use(words):
        return tuple(words)
    after = next((at for at in range(head + 1, len(words)) if words[at] in AFTER_THE_HEAD - {"of", "like"}), len(words))
    return tuple(words[after:]) if head >= 0 else ()


def _without_verb(words: Sequence[str]) -> list[str]:
    """Remove the verb "can" from words. The noun is kept, as in "a trash can"."""
    kept = []
    for before, word, after in zip(["", *words], words, [*words[1:], ""], strict=False):
        if word != "can" or (before not in _ASKS and after not in _ASKS | {"be"}):
            kept.append(word)
    return kept


def _head_part(text: str) -> str:
    """Return the text before the first use or attribute of the object.

    The word "of" does not start one ("a slice of cheese").
    """
    words = text.split()
    named = False
    for place, word in enumerate(words):
        said = terms(word)
        if named and word.lower() in AFTER_THE_HEAD and word.lower() != "of":
            return " ".join(words[:place])
        named = named or any(one not in SAYS_LITTLE and one not in _CLASSES for one in said)
    return text


def _is_phrase(
    words: Sequence[str],
    at: int,
    length: int,
    known: dict[tuple[str, ...], tuple[tuple[tuple[str, ...], float], ...]],
) -> bool:
    return at + length <= len(words) and tuple(words[at : at + length]) in known


def _head(words: Sequence[str]) -> int:
    """Return the index of the noun that names the object, or -1."""
    head = -1
    for place, word in enumerate(words):
        if word in AFTER_THE_HEAD and head >= 0:
            if word == "of" and words[head] in _MEASURES:
                continue
            break
        if word not in SAYS_LITTLE and word not in COLORS:
            head = place
    return head


def _weight(phrase: Sequence[str], at: int, length: int, head: int) -> float:
    if at <= head < at + length:
        return _HEAD_WEIGHT
    if len(phrase) == 1 and phrase[0] in COLORS:
        return _COLOR_WEIGHT
    return _OTHER_WEIGHT
