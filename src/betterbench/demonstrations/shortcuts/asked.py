"""Tested and untested questions of an audit."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class AskedQuestion:
    """Tested or untested question of an audit.

    Attributes:
        question: Question name.
        title: Question in words.
        n: Number of compared demonstrations, or of observations in them.
        compared: Features that are compared with the outcome, such as "8 words"; "" for a single test.
        untested: Reason why it could not be tested; "" if it was tested.
    """

    question: str
    title: str
    n: int
    compared: str = ""
    untested: str = ""


def tested_text(questions: Iterable[AskedQuestion]) -> str:
    """List the tested questions as text, "nothing" if there are none."""
    done = [q for q in questions if not q.untested]
    return "; ".join(f"{q.title} ({q.compared})" if q.compared else q.title for q in done) or "nothing"


def untested_text(questions: Iterable[AskedQuestion]) -> str:
    """List the untested questions by reason as text, "" if there are none."""
    reasons: dict[str, list[str]] = {}
    for q in questions:
        if q.untested:
            reasons.setdefault(q.untested, []).append(q.title)
    return "; ".join(f"{', '.join(titles)} ({reason})" for reason, titles in reasons.items())
