"""Scorer of EmbSpatial-Bench that reproduces lmms-eval; the authors published no scorer.

The letter is the first Latin letter of the text in upper or lower case, after spaces and opening brackets. Therefore
"The answer is C" gives T, "Answer: D" gives A, and "cabinet" gives C.
"""

from __future__ import annotations

import re
from fractions import Fraction

from betterbench.vlm.items import Item, ItemSet
from betterbench.vlm.official.upstream import UpstreamScorer

_FIRST_LETTER = re.compile(r"[\s(]*([a-z])", re.IGNORECASE)


def letter_of(text: str) -> str:
    """Return the letter that lmms-eval finds, or an empty string."""
    found = _FIRST_LETTER.match(text.strip())
    return found[1].upper() if found else ""


def _score(items: ItemSet, item: Item, text: str, coordinates: str) -> Fraction:  # noqa: ARG001 - one signature
    return Fraction(letter_of(text) == item.gold.text)


EMBSPATIAL_LMMS_EVAL = UpstreamScorer(
    "lmms-eval", "EvolvingLMMs-Lab/lmms-eval@2bb5e98 tasks/embspatial/utils.py", _score
)
"""First letter of the text; micro mean over all items."""
