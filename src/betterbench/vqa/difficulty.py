"""Difficulty of a question, by the number of its tags that make it harder."""

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
"""Tags that each make a question harder by one."""


def difficulty_of(tags: Collection[str]) -> Difficulty:
    """Return easy for none of the tags that make a question harder, medium for one, hard for more."""
    count = len(HARDER & set(tags))
    return Difficulty.EASY if count == 0 else Difficulty.MEDIUM if count == 1 else Difficulty.HARD
