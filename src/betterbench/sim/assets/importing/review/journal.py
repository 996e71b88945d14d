"""Review file, with one appended JSON line per decision, and the history of each object in it.

This module defines the lines about imported objects. :mod:`betterbench.jobs.decisions` has the mechanism.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar

from pydantic import Field, TypeAdapter

from betterbench.errors import InvalidInputError, one_line
from betterbench.geometry import Vector
from betterbench.jobs.decisions import Author, DecisionJournal, Digest, Time, Verdict, histories, read_decisions
from betterbench.jobs.decisions import History as DecisionHistory
from betterbench.json_form import strict_form
from betterbench.sim.assets.importing.importer import Imported
from betterbench.sim.assets.importing.review.applying import SAME_SHARE, apply, size_of
from betterbench.sim.assets.importing.review.changes import Decision
from betterbench.sim.assets.names import shown_name

SHOWN = 16
"""Number of digits of a content hash shown in messages."""


@strict_form
@dataclass(frozen=True, slots=True)
class Review:
    """Human decision about one object: one line of the file.

    Attributes:
        author: Name of the person.
        time: Time of the decision, UTC, ISO 8601.
        content: Content hash of the mesh file (:func:`~betterbench.sim.assets.importing.review.content_hash`).
        asset: Displayed name of the object.
        size_m: Extents of the object that the person saw before the decision [m].
        decision: The decision.
    """

    author: Author
    time: Time
    content: Digest
    asset: Annotated[str, Field(min_length=1, max_length=120)]
    size_m: Vector
    decision: Decision

    @property
    def subject(self) -> str:
        """Displayed name of the object."""
        return self.asset

    def misfit(self, changes: int) -> str:
        """Return the reason why a verdict does not match the number of changes, or ""."""
        decision = self.decision
        if not isinstance(decision, Verdict) or decision.verdict == "reject":
            return ""
        fits = "fix" if changes else "accept"
        if decision.verdict == fits:
            return ""
        return f"{decision.verdict!r} with {changes} changes of {self.asset}, expected {fits!r}"


_REVIEW = TypeAdapter(Review)

History = DecisionHistory[Review]
"""Active decisions about one object."""


class ReviewJournal(DecisionJournal[Review]):
    """The file of a review of objects, open for appending by one process.

    Raises:
        RunConflictError: If another process writes to the file.
        RecordError: If the file was changed by hand, or is not a review file. An unfinished last line is cut off.
    """

    adapter: ClassVar[TypeAdapter[Any]] = _REVIEW

    @staticmethod
    def form(review: Review) -> dict[str, Any]:
        """Return a line as JSON."""
        form = DecisionJournal.form(review)
        form["size_m"] = [round(float(v), 6) for v in review.size_m]
        return form


def asset_name(mesh: Path) -> str:
    """Return the name of an object in reviews: the file name, with the folder if the file name is generic."""
    return one_line(shown_name(mesh), most=100)


def read_reviews(path: Path) -> tuple[Review, ...]:
    """Return the decisions of a file. An unfinished last line is ignored.

    Raises:
        RecordError: If the file is missing, was changed by hand, or is not the file of a review.
    """
    return read_decisions(_REVIEW, path)


def history_of(path: Path, content: str, asset: str) -> History:
    """Return the history of an object in a file.

    Args:
        path: The file.
        content: Content hash of the object's mesh file.
        asset: Name of the object.

    Raises:
        RecordError: As for :func:`read_reviews`.
        InvalidInputError: If the file has no decision about this content. The message names the reviewed content of an
            object with the same name.
    """
    reviews = read_reviews(path)
    found = histories(reviews, str(path)).get(content)
    if found is not None:
        return found
    same = [review.content for review in reviews if review.asset == asset]
    cure = f"Review it: better review MESH --out {path.name}"
    if same:
        problem = f"it was reviewed with the content {same[-1][:SHOWN]}, but the file now has {content[:SHOWN]}"
        raise InvalidInputError(asset, problem, f"Restore the reviewed file. {cure}")
    raise InvalidInputError(asset, f"{path.name} has no decision about its content {content[:SHOWN]}", cure)


def accepted(imported: Imported, history: History, *, asset: str, content: str) -> Imported:
    """Return an object with its accepted changes.

    Args:
        imported: The object as it was imported.
        history: History of the object.
        asset: Name of the object, for messages.
        content: Content hash of the object's mesh file.

    Raises:
        InvalidInputError: If the object was rejected, has no verdict, or was reviewed with another size or content.
    """
    verdict = history.verdict
    if verdict is None or history.last is None:
        problem = f"it has {len(history.changes)} changes and no verdict"
        raise InvalidInputError(asset, problem, "Accept or reject it with better review")
    for _, review in history.reviews:
        if review.content != content:
            problem = f"a decision is about the content {review.content[:SHOWN]}, but the file has {content[:SHOWN]}"
            raise InvalidInputError(asset, problem, "Restore the reviewed file, or review this one")
    last = history.last[1]
    if verdict.verdict == "reject":
        problem = f"{last.author} rejected it on {last.time[:10]}: {verdict.reason}"
        raise InvalidInputError(asset, problem, "Use another object, or review this one again")
    made = apply(imported, history.changes, where=asset)
    size = size_of(made.draft)
    if any(abs(a - b) > SAME_SHARE * max(size) for a, b in zip(size, last.size_m, strict=True)):
        problem = f"it was accepted with a size of {_centimeters(last.size_m)}, but is {_centimeters(size)} here"
        raise InvalidInputError(asset, problem, "Import it with the options of the review (name, size_m, up)")
    return made


def _centimeters(size: Sequence[float]) -> str:
    return " × ".join(f"{100 * v:.1f}" for v in size) + " cm"
