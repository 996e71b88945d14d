"""Tested and untested questions of an audit, with the reason for each untested one."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class AskedQuestion:
    """One question of an audit, whether tested or not.

    Attributes:
        question: Question name.
        title: Text of the question.
        n: Number of demonstrations, or observations in them, that the question compares.
        compared: Features that the test compares with the outcome, such as "8 words"; "" for a single test.
        untested: Reason why it could not be tested, "" if it was tested.
    """

    question: str
    title: str
    n: int
    compared: str = ""
    untested: str = ""


def tested_text(questions: Iterable[AskedQuestion]) -> str:
    """Return the tested questions as a string, "nothing" if there are none."""
    done = [q for q in questions if not q.untested]
    return "; ".join(f"{q.title} ({q.compared})" if q.compared else q.title for q in done) or "nothing"


def untested_text(questions: Iterable[AskedQuestion]) -> str:
    """Return the untested questions, grouped by reason, as a string, or "" if there are none."""
    reasons: dict[str, list[str]] = {}
    for q in questions:
        if q.untested:
            reasons.setdefault(q.untested, []).append(q.title)
    return "; ".join(f"{', '.join(titles)} ({reason})" for reason, titles in reasons.items())
