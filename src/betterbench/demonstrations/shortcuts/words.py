"""Split instructions in any script into words.

In scripts with spaces between words, a word is a run of letters, digits and marks. Chinese, Japanese, Thai, Lao, Khmer
and Burmese have no such spaces, and finding words would require a dictionary. Instead, every run of up to
:data:`LONGEST` characters counts as a word. One of these runs is the actual word, or occurs in the same instructions as
the actual word. Runs that always occur together give a single finding. Emoji and other symbols are separate words.
"""

from __future__ import annotations

import functools
import re
import unicodedata
from collections.abc import Iterable, Iterator, Mapping

LONGEST = 4
"""Maximum number of characters in a run that counts as a word in a script without spaces."""

_NO_SPACES = re.compile(
    "[\u0e00-\u0e7f\u0e80-\u0eff\u1000-\u109f\u1780-\u17ff\u3005-\u3007\u3040-\u30ff\u31f0-\u31ff"
    "\u3400-\u4dbf\u4e00-\u9fff\uf900-\ufaff\uff66-\uff9f\U0001b000-\U0001b16f\U00020000-\U0003ffff]"
)
"""Thai, Lao, Burmese, Khmer, kana and Han characters, as Unicode ranges."""
_VARIATION = re.compile("[\ufe00-\ufe0f\u200d\u200b\u2060\ufeff]")
"""Variation selectors, joiners and zero-width spaces.

These characters do not change the meaning of a text and are removed.
"""


def instruction_words(text: str) -> frozenset[str]:
    """Return the words in a text. Differences in case and in Unicode normalization are ignored."""
    return frozenset(word for run, spaced in _runs(text) for word in ((run,) if spaced else _grams(run)))


def is_spaced(word: str) -> bool:
    """Return whether a word belongs to a script that separates words by spaces, unlike Chinese or Japanese."""
    return not _NO_SPACES.search(word)


def shown_as(words: Iterable[str], text: str) -> str:
    """Return a readable text for words that always occur together, in the order in which they appear in an instruction.

    Runs of characters are shown in their shortest form, and overlapping runs are merged.

    Args:
        words: Words that always occur together.
        text: An instruction that contains the words.
    """
    kept = frozenset(words)
    short = max(2, min((len(word) for word in kept if not is_spaced(word)), default=2))
    shown = list[str]()
    for run, spaced in _runs(text):
        if spaced:
            shown += [run] if run in kept else []
            continue
        covered = [False] * len(run)
        for size in range(1, short + 1):
            for start in range(len(run) - size + 1):
                if run[start : start + size] in kept:
                    covered[start : start + size] = [True] * size
        shown += re.findall(r"[^\0]+", "".join(c if at else "\0" for c, at in zip(run, covered, strict=True)))
    return " ".join(dict.fromkeys(shown)) or " ".join(sorted(kept))


def without_joined(where: Mapping[str, int]) -> dict[str, int]:
    """Remove runs of characters that span the border between two words, because they add no information.

    Such a run occurs in exactly the texts that contain both its beginning and its end. The beginning and the end also
    occur separately, in other texts.

    Args:
        where: For each word, a bit mask of the texts that contain the word.
    """

    def joins(word: str) -> bool:
        return any(
            where.get(word[:i], 0) & where.get(word[j:], 0)
            == where[word]
            not in (where.get(word[:i]), where.get(word[j:]))
            for i in range(1, len(word))
            for j in range(1, len(word))
        )

    return {word: texts for word, texts in where.items() if is_spaced(word) or not joins(word)}


def overlapping(first: Iterable[str], second: Iterable[str]) -> bool:
    """Return whether a word in one list contains, or is contained in, a word in the other list.

    The words are runs of characters in a script without spaces.
    """
    runs = [[word for word in words if not is_spaced(word)] for words in (first, second)]
    return any(a in b or b in a for a in runs[0] for b in runs[1])


_PLACES = frozenset(
    [
        "left",
        "right",
        "top",
        "bottom",
        "front",
        "back",
        "rear",
        "near",
        "far",
        "upper",
        "lower",
        "middle",
        "center",
        "centre",
        "central",
        "north",
        "south",
        "east",
        "west",
        "leftmost",
        "rightmost",
        "topmost",
        "bottommost",
        "nearest",
        "closest",
        "farthest",
        "furthest",
        "above",
        "below",
        "behind",
        "links",
        "linke",
        "linken",
        "linker",
        "linkes",
        "rechts",
        "rechte",
        "rechten",
        "rechter",
        "rechtes",
        "oben",
        "unten",
        "vorne",
        "hinten",
        "mitte",
        "obere",
        "oberen",
        "untere",
        "unteren",
        "vordere",
        "vorderen",
        "hintere",
        "hinteren",
        "mittlere",
        "mittleren",
        "gauche",
        "droite",
        "devant",
        "derrière",
        "haut",
        "bas",
        "milieu",
        "izquierda",
        "izquierdo",
        "derecha",
        "derecho",
        "arriba",
        "abajo",
        "delante",
        "detrás",
        "左",
        "右",
        "左边",
        "右边",
        "前",
        "后",
        "後",
        "前面",
        "后面",
        "上面",
        "下面",
        "中间",
        "手前",
        "奥",
        "上",
        "下",
        "中央",
        "ซ้าย",
        "ขวา",
        "หน้า",
        "หลัง",
    ]
)
"""Words that name a place, a direction or a side."""
_BESIDE_PLACES = frozenset(
    [
        "at",
        "on",
        "in",
        "to",
        "toward",
        "towards",
        "from",
        "of",
        "the",
        "a",
        "an",
        "its",
        "your",
        "our",
        "my",
        "this",
        "that",
        "side",
        "hand",
        "most",
    ]
)
"""Words that may accompany words for places but do not name a place themselves."""


def names_a_place(words: Iterable[str]) -> bool:
    """Return whether words that always occur together name a place, such as "left".

    If the words are character runs, it is sufficient that one run names a place, because overlapping runs contain only
    parts of the name.
    """
    kept = frozenset(words)
    return bool(kept & _PLACES) and {w for w in kept if is_spaced(w)} - _BESIDE_PLACES <= _PLACES


def in_order(text: str, wanted: Iterable[str]) -> str:
    """Return the wanted words that occur in a text, in order of occurrence, joined into one string."""
    words = frozenset(wanted)
    unspaced = "|".join(sorted((re.escape(w) for w in words if not is_spaced(w)), key=lambda w: (-len(w), w)))
    found = list[str]()
    for run, spaced in _runs(text):
        found += [run] if run in words else [] if spaced or not unspaced else re.findall(unspaced, run)
    return " ".join(found)


def places_named(text: str) -> str:
    """Return the words in a text that name places, in order of occurrence, joined into one string."""
    return in_order(text, _PLACES)


@functools.lru_cache(maxsize=4096)
def _runs(text: str) -> tuple[tuple[str, bool], ...]:
    """Split a text into runs. Return each run with a boolean that is True if its script separates words by spaces."""
    plain = unicodedata.normalize("NFKC", text)
    # NFKC decomposes the Thai and Lao vowel "am" into two characters; restore the single character.
    whole = plain.replace("\u0e4d\u0e32", "\u0e33").replace("\u0ecd\u0eb2", "\u0eb3")
    return tuple(_found(_VARIATION.sub("", whole).casefold()))


def _found(text: str) -> Iterator[tuple[str, bool]]:
    run, kind = "", ""
    for character in text:
        of = _kind(character, kind)
        if run and (of != kind or of == "symbol"):
            yield run, kind != "unspaced"
            run = ""
        kind = of
        run += character if of else ""
    if run:
        yield run, kind != "unspaced"


def _kind(character: str, before: str) -> str:
    """Return the class of a character: "word", "symbol", "unspaced" (script without spaces), or "" for a separator."""
    if _NO_SPACES.match(character):
        return "unspaced"
    match unicodedata.category(character)[0]:
        case "L" | "N":
            return "word"
        case "M":
            return before
        case "S" if unicodedata.category(character) == "So":
            return "symbol"
    return ""


def _grams(run: str) -> Iterator[str]:
    for size in range(1, LONGEST + 1):
        yield from (run[start : start + size] for start in range(len(run) - size + 1))
