"""Normalization of words in names, descriptions and queries."""

from __future__ import annotations

import re
import unicodedata

_IRREGULAR = {
    "knives": "knife",
    "loaves": "loaf",
    "leaves": "leaf",
    "halves": "half",
    "shelves": "shelf",
    "mice": "mouse",
    "dice": "die",
    "cookies": "cookie",
    "pies": "pie",
    "smoothies": "smoothie",
    "brownies": "brownie",
    "veggies": "veggie",
    "movies": "movie",
    "dishes": "dish",
    "potatoes": "potato",
    "tomatoes": "tomato",
    "fries": "fries",
    "greens": "greens",
    "headphones": "headphone",
    "colour": "color",
    "coloured": "colored",
    "grey": "gray",
    "doughnut": "donut",
    "aluminium": "aluminum",
}
"""Irregular plurals and spelling variants."""

_KEEP = re.compile(r"(ss|us|is|as|ios)$")
_WORD = re.compile(r"[^\W_]+")
LONGEST_TERM = 40
"""Maximum length of a term [characters]. Longer words are ignored."""


def terms(text: str) -> list[str]:
    """Split a text into words, converted to lower case and the singular, without accents."""
    plain = text.lower()
    if not plain.isascii():
        plain = "".join(c for c in unicodedata.normalize("NFKD", plain) if not unicodedata.combining(c))
    return [singular(word) for word in _WORD.findall(plain) if len(word) <= LONGEST_TERM]


def singular(word: str) -> str:
    """Return the singular of an English noun.

    Words that are not plural nouns may lose their last letter, but the same word always gives the same result.
    """
    if word in _IRREGULAR:
        return _IRREGULAR[word]
    if len(word) < 4 or not word.endswith("s") or _KEEP.search(word):
        return word
    if word.endswith("ies"):
        return f"{word[:-3]}y"
    if word.endswith(("ches", "shes", "sses", "xes", "zes")):
        return word[:-2]
    return word[:-1]
