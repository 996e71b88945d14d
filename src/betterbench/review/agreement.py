"""Agreement of two reviewers on the objects that both judged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from betterbench.errors import InvalidInputError
from betterbench.sim.assets.importing.review import Review, read_reviews
from betterbench.sim.assets.importing.review.journal import histories
from betterbench.statistics import AgreementTable

VERDICTS = ("accept", "fix", "reject")


@dataclass(frozen=True, slots=True)
class ReviewAgreement:
    """Agreement of two reviews.

    Attributes:
        all: Table over accept, fix and reject.
        usable: Table over use (accept or fix) and reject. only_first, only_second: Numbers of objects that only one
            reviewer judged; they are not in the tables.
        apart: Names and verdicts of the objects on which the reviewers disagree, in first-review order.
    """

    all: AgreementTable
    usable: AgreementTable
    only_first: int
    only_second: int
    apart: tuple[tuple[str, str, str], ...]

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict."""
        return {
            "accept_fix_reject": _form(self.all),
            "use_reject": _form(self.usable),
            "only_first": self.only_first,
            "only_second": self.only_second,
            "apart": [{"asset": name, "first": a, "second": b} for name, a, b in self.apart],
        }


def agreement(first: Path, second: Path) -> ReviewAgreement:
    """Return the agreement between two files written by ``better review``.

    Raises:
        RecordError: If a file is missing or was changed by hand.
        InvalidInputError: If the files have no judged object in common.
    """
    a, b = (_verdicts(read_reviews(path), str(path)) for path in (first, second))
    both = [content for content in a if content in b]
    if not both:
        problem = f"{len(a)} and {len(b)} objects have a verdict, and none is in both"
        raise InvalidInputError(f"{first}, {second}", problem, "Let both review the same files")
    pairs = [(a[content][1], b[content][1]) for content in both]
    used = [tuple("reject" if v == "reject" else "use" for v in pair) for pair in pairs]
    return ReviewAgreement(
        AgreementTable.of_pairs(pairs, VERDICTS),
        AgreementTable.of_pairs([(x, y) for x, y in used], ("use", "reject")),
        len(a) - len(both),
        len(b) - len(both),
        tuple((a[content][0], x, y) for content, (x, y) in zip(both, pairs, strict=True) if x != y),
    )


def _verdicts(reviews: Sequence[Review], where: str) -> dict[str, tuple[str, str]]:
    """Return the name and the verdict of each judged object, by content hash."""
    names = {review.content: review.asset for review in reviews}
    found = histories(reviews, where)
    return {content: (names[content], h.verdict.verdict) for content, h in found.items() if h.verdict is not None}


def _form(table: AgreementTable) -> dict[str, Any]:
    interval = table.interval()
    return {
        "categories": table.categories,
        "counts": table.counts,
        "n": table.n,
        "observed": table.observed,
        "expected": table.expected,
        "kappa": table.kappa,
        "low": None if interval is None else interval.low,
        "high": None if interval is None else interval.high,
    }
