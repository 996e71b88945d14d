"""Expansion of queries with synonyms, kinds of objects and descriptions from the built-in word lists."""

from __future__ import annotations

import functools
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

from betterbench.sim.assets.catalogue.lists import entries_by_name, list_lines
from betterbench.sim.assets.catalogue.terms import terms

_COLOR_WORDS = """
red blue green yellow orange purple white black brown gray silver gold golden pink cream beige turquoise
"""
COLORS = frozenset(_COLOR_WORDS.split())
"""Color words. A color word alone does not name an object."""

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
"""Words that show, before or after "can", that "can" is a verb: "that can hold", "what can I use", "can be"."""
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
_GENERIC_NAMES = """
contraption device equipment gadget implement instrument item object one piece something stuff thing tool utensil
"""
_GENERIC = frozenset(_GENERIC_NAMES.split())
"""Nouns that do not name an object if they are followed by the object's use: "thing to eat soup with"."""
_STARTS_A_USE = frozenset(["for", "to", "that", "which", "you", "i", "we", "people", "used"])
"""Words that connect a general noun with the use of the object: "to" in "thing to eat soup with"."""
_BY_PREPOSITION = {
    "with": "tool",
    "using": "tool",
    "from": "vessel",
    "in": "vessel",
    "into": "vessel",
    "inside": "vessel",
    "on": "surface",
    "onto": "surface",
}
_BY_NOUN = {
    "tool": "tool",
    "utensil": "tool",
    "implement": "tool",
    "instrument": "tool",
    "container": "vessel",
    "vessel": "vessel",
    "receptacle": "vessel",
    "surface": "surface",
}
_PLACES = frozenset(
    ["around", "at", "behind", "beside", "between", "near", "next", "on", "onto", "over", "under", "inside", "outside"]
)
"""Words that begin a phrase for the place of an object: "next to the bowl"."""
_THIRD_PERSON = """
carries cleans comes crushes fits goes grinds grows helps holds joins keeps lets lies makes moves opens plays protects
removes serves sits stores tells washes
"""
_VERBS = frozenset(_THIRD_PERSON.split())
"""Verbs that begin a phrase for the use of an object: "holds a boiled egg"."""
_IT = frozenset(["it", "them", "this", "these"])
_JOINS = frozenset(["with", "that", "which", "has", "having"])
"""Words after which "it" refers to the object that was already named: "a mug with an apple on it"."""
_REFERS = _IT | {"which", "that"}
_LONGEST_PHRASE = 5
_INFLECTED = re.compile("(ed|ing|ly|ish|less)$")
"""Endings of words that are not in the lists although they are spelled correctly."""
_SHORTEST_NAME, _SHORTEST_WORD = 5, 4
"""Minimum length of a name for which misspellings are recognized, and minimum length of a misspelled word."""
_BEFORE_THE_NOUN = 0.4
"""Weight of a variety or brand name before another noun."""
_COLOR_WEIGHT, _OTHER_WEIGHT, _HEAD_WEIGHT = 0.35, 0.55, 1.0
_SYNONYM, _KIND = 0.95, 0.8

Expander = Callable[[str], Sequence[str]]
"""Function that returns alternative descriptions of the same object, for example written by a language model. Each
description is searched for in the same way as the query."""


@dataclass(frozen=True, slots=True)
class Concept:
    """A concept in a search query, such as the object, its color or its material.

    Attributes:
        weight: Weight of the concept in the word score.
        alternatives: Phrases that express the concept, each a tuple of terms with a weight in (0, 1]. The first phrase
            is the one in the query.
    """

    weight: float
    alternatives: tuple[tuple[tuple[str, ...], float], ...]


@dataclass(frozen=True, slots=True)
class Query:
    """Parsed search query with its possible meanings.

    Attributes:
        text: The query, without words such as "find me" and without words for things that the object should not have.
        concepts: Concepts for the search by words.
        readings: Sentences for the search by meaning. The first sentence is the query.
        asked: The query and the alternative descriptions that the expander returned. They are compared with the
            descriptions of the kinds of objects.
        head: Part of the query that names the object: "a bowl" in "a bowl for fruit".
        words: Terms of the query, without uninformative words.
        colors: Colors that the query names.
        beside: Words that do not name the object itself, such as "steak" in "a plate for steak".
        kinds: Kinds that a variety or brand in the query belongs to, such as apple for "granny smith". Each has a
            weight in (0, 1].
        is_use: Whether the query only says what the object is used for ("it opens wine"). The nouns in such a query do
            not name the object.
        role: Role of the object in its use: "tool", "vessel" or "surface". Empty if the role is not known.
        lacks: Words for what the object should not have, such as "label" in "a jar without a label".
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
    is_use: bool = False
    role: str = ""
    lacks: tuple[str, ...] = ()


@functools.cache
def word_list() -> dict[tuple[str, ...], tuple[tuple[tuple[str, ...], float], ...]]:
    """Return the synonyms of each listed phrase, and the narrower phrases that it includes, with their weights.

    A line ``a = b > c, d`` of the word list means that a and b are synonyms. It also means that a query for a or b
    finds c and d, but a query for c or d does not find a or b.
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
    """Return the kinds that each listed variety or brand belongs to, such as apple for "granny smith".

    The keys are the varieties and brands, each as a tuple of terms.
    """
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


_REQUEST = re.compile(
    r"""^\W*(?:please\s+)?(?:
    (?:can|could|would|will)\s+you\s+(?:please\s+)?(?:find|show|get|give|bring|fetch|hand|pass)(?:\s+(?:me|us))?
    |(?:i|we)\s+(?:(?:really\s+)?(?:need|want)|would\s+like|am\s+looking\s+for|are\s+looking\s+for
      |am\s+searching\s+for)(?:\s+to\s+(?:find|see|have|get))?
    |(?:i'm|we're)\s+(?:looking|searching)\s+for|i'd\s+like(?:\s+to\s+(?:find|see|have|get))?
    |(?:do\s+you\s+have|have\s+you\s+got|is\s+there|are\s+there)
    |(?:find|show|get|give|bring|fetch|hand|pass)\s+(?:me|us)|(?:looking|search|searching)\s+for
    )\s+(?=\w)""",
    re.IGNORECASE | re.VERBOSE,
)


def _without_request(text: str) -> str:
    """Remove the words of a request from a query: "Can you find me a skillet?" becomes "a skillet"."""
    kept = _REQUEST.sub("", text)
    return kept if any(word not in SAYS_LITTLE for word in terms(kept)) else text


def _affirmed(text: str) -> tuple[str, tuple[str, ...]]:
    """Split a description into what the object is and has, and what it lacks.

    "A jar without a label" gives "a jar" and the word "label".
    """
    kept = " ".join(_NEGATED.sub(" ", text).split())
    if not any(word not in SAYS_LITTLE for word in terms(kept)):
        return text, ()
    lacked = (word for found in _NEGATED.findall(text) for word in terms(found))
    return kept, tuple(word for word in lacked if word not in SAYS_LITTLE | {"no", "having"})


@functools.cache
def _listed_words() -> frozenset[str]:
    """Return all words that occur in the word lists. All of these words are considered correctly spelled."""
    files = ("kinds.txt", "uses.txt", "words.txt", "varieties.txt", "hypernyms.txt")
    return frozenset(word for file in files for line in list_lines(file) for word in terms(line)) | SAYS_LITTLE


@functools.cache
def _by_spelling() -> dict[str, frozenset[str]]:
    """Index the listed names of objects by their spellings, including misspellings with one missing letter."""
    names = set[str]()
    for file in ("words.txt", "kinds.txt", "hypernyms.txt"):
        lines = (line.partition("~")[0].partition(">")[0] for line in list_lines(file) if not line[0].isspace())
        names.update(word for line in lines for word in terms(line))
    found: dict[str, set[str]] = {}
    for name in names:
        if len(name) >= _SHORTEST_NAME and name.isalpha():
            for spelling in _spellings(name):
                found.setdefault(spelling, set()).add(name)
    return {spelling: frozenset(words) for spelling, words in found.items()}


def _spellings(word: str) -> list[str]:
    return [word, *(word[:at] + word[at + 1 :] for at in range(len(word)))]


def _misspelled(text: str, is_word: Callable[[str], bool]) -> dict[str, str]:
    """Find misspelled words in a query, and return the object name that each one stands for: "cutlery" for "cutery".

    An unknown word counts as misspelled if exactly one name with the same first letter is nearly the same. The two may
    differ by one added, missing or different letter, or by two exchanged letters. Inflected words such as "toasted" and
    "rubbery" are never corrected, because the lists do not contain all inflected forms.
    """
    known, found = _listed_words(), {}
    for written in text.lower().split():
        for word in terms(written)[:1]:
            plain = "".join(filter(str.isalpha, written))
            if word in known or len(word) < _SHORTEST_WORD or not word.isalpha() or _INFLECTED.search(word):
                break
            if is_word(word) or is_word(plain):
                break
            near = {name for spelling in _spellings(word) for name in _by_spelling().get(spelling, ())}
            fits = sorted(name for name in near if name[0] == word[0] and _differ_by_one(word, name))
            if len(fits) == 1 and word != f"{fits[0]}y":
                found[word] = fits[0]
    return found


def _differ_by_one(word: str, name: str) -> bool:
    """Return whether two words differ by one letter, or by the order of two neighboring letters."""
    if len(word) != len(name):
        return True  # the caller only compares words that become equal if one letter is left out
    at = next(at for at, (a, b) in enumerate(zip(word, name, strict=True)) if a != b)
    swapped = word[at + 1 : at + 2] + word[at]
    # a replaced letter only counts in longer words, because short words are similar to many others
    return (word[at + 1 :] == name[at + 1 :] and len(word) > _SHORTEST_NAME) or (
        name[at : at + 2] == swapped and word[at + 2 :] == name[at + 2 :]
    )


def understood(text: str, *, expander: Expander | None = None, is_word: Callable[[str], bool] | None = None) -> Query:
    """Parse a query into concepts, colors, kinds and other parts.

    Args:
        text: Description of the object in plain words.
        expander: Function that returns alternative descriptions of the object. None if only the query is used.
        is_word: Function that returns whether a word is spelled correctly. If None, misspelled words are not corrected.
    """
    written, lacks = _affirmed(_without_request(text))
    corrected = {} if is_word is None else _misspelled(written, is_word)
    text = " ".join(corrected.get(word, word) for word in terms(written)) if corrected else written
    spelled = {right: wrong for wrong, right in corrected.items()}
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
            first: tuple[tuple[tuple[str, ...], float], ...] = (((own or phrase), 1.0),)
            if spelled.keys() & set(phrase):
                first += ((tuple(spelled.get(word, word) for word in own or phrase), 1.0),)
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
    if corrected:
        further.append(written)
    asked = tuple(dict.fromkeys([text, *further]))
    said = tuple(word for word in words if word not in SAYS_LITTLE)
    names_nothing = _names_nothing(text)
    kinds = _kinds_of_varieties(words, head, names_nothing=names_nothing)
    every = tuple(dict.fromkeys([*readings, *further]))
    return Query(
        text,
        tuple(concepts),
        every,
        asked,
        _head_part(text),
        said,
        colors,
        _beside(words, head, names_nothing=names_nothing),
        kinds,
        is_use=names_nothing,
        role=role_of(words) if names_nothing else "",
        lacks=lacks,
    )


def _kinds_of_varieties(words: Sequence[str], head: int, *, names_nothing: bool) -> dict[str, float]:
    """Return the kinds that the varieties and brands in the query belong to, each with a weight.

    The weight is 1 if the variety is itself the noun that names the object ("a green granny smith"). It is smaller if
    the variety stands before another noun, which may name a different object ("a cheddar sandwich").
    """
    if head < 0 or names_nothing:
        return {}
    known, found = variety_list(), dict[str, float]()
    for start in range(head + 1):
        for end in range(start + 1, min(start + _LONGEST_PHRASE, len(words)) + 1):
            for kind in known.get(tuple(words[start:end]), ()):
                found[kind] = max(1.0 if end > head else _BEFORE_THE_NOUN, found.get(kind, 0.0))
    return found


def is_use(words: Sequence[str]) -> bool:
    """Return whether a query describes an object only by its use, such as "it opens wine" or "you eat soup from it"."""
    names = len(words) > 1 and words[0] in ("it", "this", "that", "what") and words[1] in ("is", "s")
    refers = bool(words) and words[-1] in ("it", "them", "this") and not _JOINS.intersection(words[:-1])
    return bool(words) and not names and (words[0] in _ASKS or refers)


def _names_nothing(text: str) -> bool:
    """Return whether a query does not name any object, such as "it opens wine" or "thing to eat soup with"."""
    words = [word for word in terms(text) if word not in ("a", "an", "any", "some", "the")]
    if is_use(words):
        return True
    if len(words) < 2:
        return False
    first = text.lower().split()[0]
    if words[0] in _GENERIC and len(words) > 2 and words[1] in _STARTS_A_USE:
        return True
    if words[0] in ("to", "for") or words[0] in _PLACES or first in _VERBS:
        return True
    at = next((at for at, pair in enumerate(pairwise(words)) if pair[0] in _BY_PREPOSITION and pair[1] in _IT), -1)
    return at > 0 and not _JOINS.intersection(words[:at])


def role_of(words: Sequence[str]) -> str:
    """Return the role of an object in a use: "tool" for "eat soup with it", "vessel" for "eat soup from it".

    The role is determined from the preposition before "it" or at the end of the query. If there is no such preposition,
    it is determined from the noun before the use ("a tool for cutting"). If there is no such noun either, the role is
    empty.
    """
    for at, word in enumerate(words):
        last = at + 1 == len(words) and word != "inside"  # as in "green outside and red inside"
        if word in _BY_PREPOSITION and (last or (at + 1 < len(words) and words[at + 1] in _REFERS)):
            return _BY_PREPOSITION[word]
    said = [word for word in words if word not in ("a", "an", "any", "some", "the")]
    return _BY_NOUN.get(said[0], "") if len(said) > 2 and said[1] in _STARTS_A_USE else ""


def _beside(words: Sequence[str], head: int, *, names_nothing: bool) -> tuple[str, ...]:
    """Return the words that do not name the object itself: "steak" in "a plate for steak".

    If the query does not name an object at all ("you serve a steak on it"), all its words are returned.
    """
    if names_nothing:
        return tuple(words)
    after = next((at for at in range(head + 1, len(words)) if words[at] in AFTER_THE_HEAD - {"of", "like"}), len(words))
    return tuple(words[after:]) if head >= 0 else ()


def _without_verb(words: Sequence[str]) -> list[str]:
    """Remove the word "can" if it is a verb, as in "can you find". The noun, as in "a trash can", is kept."""
    kept = []
    for before, word, after in zip(["", *words], words, [*words[1:], ""], strict=False):
        if word != "can" or (before not in _ASKS and after not in _ASKS | {"be"}):
            kept.append(word)
    return kept


def _head_part(text: str) -> str:
    """Return the part of the query before the first use or attribute of the object: "a bowl" for "a bowl for fruit".

    The word "of" does not begin a use or an attribute ("a slice of cheese").
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
    """Return the index of the noun that names the object, or -1 if the query contains no such noun."""
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
