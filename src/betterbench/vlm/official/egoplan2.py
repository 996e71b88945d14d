"""Scorers of EgoPlan-Bench2 that reproduce the authors' ``eval.py`` and lmms-eval.

Both programs delete stock phrases from the reply, and then take the first remaining capital A, B, C or D. For example,
"Based on the video, the answer is C" gives B. Missing commas in the programs' lists of phrases join four phrases into
two that never occur in a reply.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from fractions import Fraction

from betterbench.vlm.items import Item, ItemSet
from betterbench.vlm.official.upstream import UpstreamScorer

_BEFORE = ("The best answer is", "The correct answer is", "The answer is", "The answer")
_JOINED = ("The best option isThe correct option is", "Best answer:Best option:")
_AFTER = ("Answer:", "Option:", "The correct answer", "The correct option")


def letter_of(text: str, phrases: tuple[str, ...] = (*_BEFORE, *_JOINED, *_AFTER)) -> str:
    """Return the letter that an upstream program extracts from a reply, given the program's list of stock phrases.

    Returns an empty string if the program finds no letter.
    """
    rest = text.strip()
    for phrase in phrases:
        rest = rest.replace(phrase, "")
    found = re.search("[ABCD]", rest)
    return found[0] if found else ""


def _with(phrases: tuple[str, ...]) -> Callable[[ItemSet, Item, str, str], Fraction]:
    return lambda _items, item, text, _coordinates: Fraction(letter_of(text, phrases) == item.gold.text)


EGOPLAN2_EVAL = UpstreamScorer(
    "EgoPlan-Bench2 eval.py", "qiulu66/EgoPlan-Bench2@5be8155 eval.py", _with((*_BEFORE, *_JOINED, *_AFTER))
)
"""The authors' program. Its score is the micro mean over all items."""
EGOPLAN2_LMMS_EVAL = UpstreamScorer(
    "lmms-eval", "EvolvingLMMs-Lab/lmms-eval@6c3e853 tasks/egoplan2/utils.py", _with((*_BEFORE, *_JOINED))
)
"""lmms-eval. It works like the authors' program, but its list of phrases is shorter."""
