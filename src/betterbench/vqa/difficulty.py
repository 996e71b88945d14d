"""Difficulty of a question, given by the number of its tags that make it harder."""

from __future__ import annotations

from collections.abc import Collection

from betterbench.vqa.question import Difficulty

HARDER = frozenset(
    (
        "small",
        "partly hidden",
        "out of place",
        "look-alike",
        "of this task",
        "robot frame",
        "over time",
        "several steps",
    )
)
"""Tags that each increase the difficulty by one level."""


def difficulty_of(tags: Collection[str]) -> Difficulty:
    """Return the difficulty of a question with the given tags.

    It is "easy" if no tag increases the difficulty, "medium" if one does, and "hard" if several do.
    """
    count = len(HARDER & set(tags))
    return Difficulty.EASY if count == 0 else Difficulty.MEDIUM if count == 1 else Difficulty.HARD
