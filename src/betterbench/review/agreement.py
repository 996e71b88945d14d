"""Agreement between two reviewers, computed from the objects or scenes that both reviewers have judged."""

from __future__ import annotations

import json
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from betterbench.errors import InvalidInputError, RecordError
from betterbench.jobs.decisions import histories
from betterbench.jobs.line_journal import complete_lines
from betterbench.review.scenes.changes import last_verdicts, read_scene_reviews
from betterbench.sim.assets.importing.review import read_reviews
from betterbench.statistics import AgreementTable

VERDICTS = ("accept", "fix", "reject")


@dataclass(frozen=True, slots=True)
class ReviewAgreement:
    """Agreement between two reviews.

    Attributes:
        all: Agreement table over the three verdicts accept, fix and reject.
        usable: Agreement table over two verdicts: usable (accept or fix) and reject.
        only_first: Number of objects or scenes that only the first reviewer judged. The tables do not count them.
        only_second: Number of objects or scenes that only the second reviewer judged. The tables do not count them.
        apart: Name and both verdicts of each object or scene on which the reviewers disagree, in the order of the first
            review.
        what: Kind of the reviewed items: "objects" or "scenes".
    """

    all: AgreementTable
    usable: AgreementTable
    only_first: int
    only_second: int
    apart: tuple[tuple[str, str, str], ...]
    what: str = "objects"

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
    """Compute the agreement between two files written by ``better review``. Both must be reviews of the same kind.

    Raises:
        RecordError: If a file is missing or was changed by hand.
        InvalidInputError: If no object or scene has a verdict in both files, or one file is a review of objects and the
            other a review of scenes.
    """
    kinds = [is_scene_review(path) for path in (first, second)]
    what = "scenes" if kinds[0] else "objects"
    if kinds[0] != kinds[1]:
        problem = f"{first} is a review of {what}, but {second} is not"
        raise InvalidInputError(f"{first}, {second}", problem, "Use two reviews of objects, or two reviews of scenes")
    a, b = (_verdicts(path, of_scenes=kinds[0]) for path in (first, second))
    both = [content for content in a if content in b]
    if not both:
        problem = f"{len(a)} and {len(b)} {what} have a verdict, but the files have none in common"
        raise InvalidInputError(f"{first}, {second}", problem, "Have both reviewers judge the same items")
    pairs = [(a[content][1], b[content][1]) for content in both]
    used = [tuple("reject" if v == "reject" else "use" for v in pair) for pair in pairs]
    return ReviewAgreement(
        AgreementTable.of_pairs(pairs, VERDICTS),
        AgreementTable.of_pairs([(x, y) for x, y in used], ("use", "reject")),
        len(a) - len(both),
        len(b) - len(both),
        tuple((a[content][0], x, y) for content, (x, y) in zip(both, pairs, strict=True) if x != y),
        what,
    )


def is_scene_review(path: Path) -> bool:
    """Return whether a file is a review of scenes rather than of objects. The first line of the file states this.

    Raises:
        RecordError: If the file is missing.
    """
    if not path.exists():
        raise RecordError(f"{path} does not exist. Pass a file written by `better review`.")
    lines, _ = complete_lines(path)
    with suppress(ValueError):
        first = json.loads(lines[0]) if lines else {}
        return isinstance(first, dict) and "scene" in first
    return False


def _verdicts(path: Path, *, of_scenes: bool) -> dict[tuple[str, str], tuple[str, str]]:
    """Return the name and the verdict of each reviewed object or scene, keyed by content hash and condition.

    The condition (training or variation) is empty for objects.
    """
    if of_scenes:
        return last_verdicts(read_scene_reviews(path), str(path))
    reviews = read_reviews(path)
    names = {review.content: review.asset for review in reviews}
    found = histories(reviews, str(path))
    return {(content, ""): (names[content], h.verdict.verdict) for content, h in found.items() if h.verdict is not None}


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
