"""Difficulty of questions, which depends on the number of tags that make a question harder."""

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
    """Return "easy", "medium" or "hard" if none, one or more than one of the tags increase the difficulty."""
    count = len(HARDER & set(tags))
    return Difficulty.EASY if count == 0 else Difficulty.MEDIUM if count == 1 else Difficulty.HARD
