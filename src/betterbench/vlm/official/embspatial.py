"""Scorer of EmbSpatial-Bench that reproduces lmms-eval, since the authors have not published a scorer.

If the reply begins with a Latin letter (after spaces and opening brackets), this letter is the answer, in upper case.
Therefore "The answer is C" gives T, "Answer: D" gives A, and "cabinet" gives C.
"""

from __future__ import annotations

import re
from fractions import Fraction

from betterbench.vlm.items import Item, ItemSet
from betterbench.vlm.official.upstream import UpstreamScorer

_FIRST_LETTER = re.compile(r"[\s(]*([a-z])", re.IGNORECASE)


def letter_of(text: str) -> str:
    """Return the letter that lmms-eval extracts from a reply, or an empty string if it finds none."""
    found = _FIRST_LETTER.match(text.strip())
    return found[1].upper() if found else ""


def _score(items: ItemSet, item: Item, text: str, coordinates: str) -> Fraction:  # noqa: ARG001 - one signature
    return Fraction(letter_of(text) == item.gold.text)


EMBSPATIAL_LMMS_EVAL = UpstreamScorer(
    "lmms-eval", "EvolvingLMMs-Lab/lmms-eval@2bb5e98 tasks/embspatial/utils.py", _score
)
"""lmms-eval, which takes the first letter of the reply. Its score is the micro mean over all items."""
