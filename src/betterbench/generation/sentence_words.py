"""Words of instructions: tokens, colors, numbers, head nouns of phrases, and words that may name an object."""

from __future__ import annotations

import re
from collections.abc import Iterator

from betterbench.generation.scenario import DescribedObject
from betterbench.sim.assets.catalogue.expansion import COLORS
from betterbench.sim.assets.catalogue.terms import singular, terms

_DETERMINERS_WORDS = """
a an the both all two three four five six some each every this these my your our his her
"""
DETERMINERS = frozenset(_DETERMINERS_WORDS.split())
"""Words that begin a noun phrase."""
_COUNTS_WORDS = """
five six seven eight nine ten dozen couple several some few many every each
"""
COUNTS = frozenset(_COUNTS_WORDS.split())
"""Number words that are inexact, or that exceed the number of objects in any scene."""
_STOPS_WORDS = """
in into inside onto on to of for from with without at by beside next near around behind under over between left and
or so that as away up out down off back together neatly carefully gently close too , . : ( ) % is are go belong
"""
STOPS = frozenset(_STOPS_WORDS.split())
"""Words that end a noun phrase."""
_ADJECTIVES_WORDS = """
small large big little tall short round square flat full empty clean dirty fresh used loose open closed new old
plain wooden plastic metal paper glass ceramic steel remaining other named same right left upper lower top bottom
"""
ADJECTIVES = frozenset(_ADJECTIVES_WORDS.split())
"""Adjectives that may be the last word of a phrase although they are not nouns."""

_RESULTS_WORDS = """
sandwich burger cheeseburger hamburger tower taco cake club slider
"""
RESULTS = frozenset(_RESULTS_WORDS.split())
"""Nouns for the result of stacking layers."""

_PLURAL_ONLY = frozenset({"fries", "scissor", "headphone", "napkin"})
"""Nouns whose plural may mean a single object, such as "napkins" for a stack of napkins."""


def raw_tokens(text: str) -> list[str]:
    """Return the words of a sentence in lower case, and its punctuation marks."""
    return re.findall(r"[^\W_]+|[,.:()%]", re.sub(r"n['’]t\b", "nt", text.lower()))


def sentence_tokens(text: str) -> list[str]:
    """Return the words of a sentence in lower case and in the singular, and its punctuation marks."""
    return [t if t in ",.:()%" else singular(t) for t in raw_tokens(text)]


def is_plural_form(word: str) -> bool:
    """Return whether a noun is a plural for several objects, such as "mugs" and "mice" but not "fries"."""
    one = singular(word)
    return word != one and (word.endswith("s") or word in ("mice", "dice")) and one not in _PLURAL_ONLY


NUMBERS = {"two": 2, "both": 2, "2": 2, "three": 3, "3": 3, "four": 4, "4": 4}
"""Value of each number word that may state the number of objects in a scene."""


def number_before(raw: list[str], at: int) -> str:
    """Return the number word that belongs to the noun at a position, or an empty string if there is none."""
    for word in reversed(raw[max(0, at - 4) : at]):
        if word in NUMBERS:
            return word
        if word in STOPS:
            break
    return ""


def words_of_object(described: DescribedObject) -> frozenset[str]:
    """Return the words that may name an object.

    The words are taken from the object's query, name and tags, and from its description before the word "with".
    """
    appearance = re.split(r"\bwith\b", described.description)[0]
    name = described.instance_name.replace("_", " ")
    return frozenset(terms(" ".join((described.asset_query, name, appearance, *described.tags))))


def color_before(tokens: list[str], at: int) -> str:
    """Return the color among the adjectives before a noun, or an empty string if there is none."""
    for word in reversed(tokens[max(0, at - 3) : at]):
        if word in COLORS:
            return word
        if word in STOPS or word in DETERMINERS:
            break
    return ""


def phrase_heads(tokens: list[str]) -> Iterator[str]:
    """Yield the last word of each phrase that begins with an article, a number or a similar word."""
    for at, word in enumerate(tokens):
        if word not in DETERMINERS:
            continue
        head = ""
        for follower in tokens[at + 1 :]:
            if follower in STOPS or follower in DETERMINERS:
                break
            head = follower
        if head and head not in ADJECTIVES:
            yield head
