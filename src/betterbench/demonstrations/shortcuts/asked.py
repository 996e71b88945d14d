"""Questions that a shortcut audit tested, and questions that it could not test."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class AskedQuestion:
    """Question of a shortcut audit, which was either tested or has a reason why it could not be tested.

    Attributes:
        question: Question name.
        title: The question in words.
        n: Number of compared demonstrations, or of compared observations within demonstrations.
        compared: Number of features that are compared with the outcome, such as "8 words"; "" if the question has a
            single test.
        untested: Reason why the question could not be tested; "" if it was tested.
    """

    question: str
    title: str
    n: int
    compared: str = ""
    untested: str = ""


def tested_text(questions: Iterable[AskedQuestion]) -> str:
    """Return the titles of the tested questions, separated by semicolons, or "nothing" if no question was tested."""
    done = [q for q in questions if not q.untested]
    return "; ".join(f"{q.title} ({q.compared})" if q.compared else q.title for q in done) or "nothing"


def untested_text(questions: Iterable[AskedQuestion]) -> str:
    """Return the titles of the untested questions, grouped by reason. Return "" if every question was tested."""
    reasons: dict[str, list[str]] = {}
    for q in questions:
        if q.untested:
            reasons.setdefault(q.untested, []).append(q.title)
    return "; ".join(f"{', '.join(titles)} ({reason})" for reason, titles in reasons.items())
