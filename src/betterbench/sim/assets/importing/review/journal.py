"""Review file with one JSON line per decision, and the history of decisions about each object.

This module defines the lines of a review of imported objects. The general mechanism is in
:mod:`betterbench.jobs.decisions`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar

from pydantic import Field, TypeAdapter

from betterbench.errors import InvalidInputError, one_line
from betterbench.geometry import Vector
from betterbench.jobs.decisions import Author, DecisionJournal, Time, Verdict, histories, read_decisions
from betterbench.jobs.decisions import History as DecisionHistory
from betterbench.json_form import Digest, strict_form
from betterbench.sim.assets.importing.importer import Imported
from betterbench.sim.assets.importing.review.applying import SAME_SHARE, apply, size_of
from betterbench.sim.assets.importing.review.changes import Decision
from betterbench.sim.assets.names import shown_name

SHOWN = 16
"""Number of digits of a content hash shown in messages."""


@strict_form
@dataclass(frozen=True, slots=True)
class Review:
    """A person's decision about one object. Each decision is one line of the review file.

    Attributes:
        author: Name of the person.
        time: Time of the decision (UTC, ISO 8601).
        content: Content hash of the mesh file (:func:`~betterbench.sim.assets.importing.review.content_hash`).
        asset: Name under which the object is shown.
        size_m: Extents of the object that the person saw before the decision [m].
        decision: A change, a verdict, or an undo.
    """

    author: Author
    time: Time
    content: Digest
    asset: Annotated[str, Field(min_length=1, max_length=120)]
    size_m: Vector
    decision: Decision

    @property
    def subject(self) -> str:
        """Name under which the object is shown."""
        return self.asset

    def misfit(self, changes: int) -> str:
        """Check that a verdict matches the number of changes to the object: "accept" for none, "fix" for some.

        Returns:
            The reason why the verdict does not match, or "" if it does.
        """
        decision = self.decision
        if not isinstance(decision, Verdict) or decision.verdict == "reject":
            return ""
        fits = "fix" if changes else "accept"
        if decision.verdict == fits:
            return ""
        return f"{decision.verdict!r} with {changes} changes of {self.asset}, expected {fits!r}"


_REVIEW = TypeAdapter(Review)

History = DecisionHistory[Review]
"""Decisions about one object that have not been undone."""


class ReviewJournal(DecisionJournal[Review]):
    """Review file for objects. The process that opens the file appends its decisions to it.

    An unfinished last line is cut off when the file is opened.

    Raises:
        RunConflictError: If another process is writing to the file.
        RecordError: If the file was changed by hand, or is not a review file.
    """

    adapter: ClassVar[TypeAdapter[Any]] = _REVIEW

    @staticmethod
    def form(review: Review) -> dict[str, Any]:
        """Return the JSON form of a line in the review file."""
        form = DecisionJournal.form(review)
        form["size_m"] = [round(float(v), 6) for v in review.size_m]
        return form


def asset_name(mesh: Path) -> str:
    """Return the name of an object in reviews: its file name, preceded by its folder if the file name is generic."""
    return one_line(shown_name(mesh), most=100)


def read_reviews(path: Path) -> tuple[Review, ...]:
    """Return all decisions in a review file. An unfinished last line is ignored.

    Raises:
        RecordError: If the file is missing, was changed by hand, or is not a review file.
    """
    return read_decisions(_REVIEW, path)


def history_of(path: Path, content: str, asset: str) -> History:
    """Return the history of one object in a review file.

    Args:
        path: The review file.
        content: Content hash of the object's mesh file.
        asset: Name of the object.

    Raises:
        RecordError: If the review file cannot be read (see :func:`read_reviews`).
        InvalidInputError: If the review file has no decision about this content. If there is a decision about an object
            with the same name, the message shows the content hash that was reviewed.
    """
    reviews = read_reviews(path)
    found = histories(reviews, str(path)).get(content)
    if found is not None:
        return found
    same = [review.content for review in reviews if review.asset == asset]
    cure = f"Review it with `better review MESH` or `better review assets --asset-dir DIR`, and --out {path.name}"
    if same:
        problem = f"it was reviewed with the content {same[-1][:SHOWN]}, but the file now has {content[:SHOWN]}"
        raise InvalidInputError(asset, problem, f"Restore the reviewed file. {cure}")
    raise InvalidInputError(asset, f"{path.name} has no decision about its content {content[:SHOWN]}", cure)


def accepted(imported: Imported, history: History, *, asset: str, content: str) -> Imported:
    """Apply the accepted changes to an object.

    Args:
        imported: The object as it was imported.
        history: History of the object in the review file.
        asset: Name of the object, for messages.
        content: Content hash of the object's mesh file.

    Raises:
        InvalidInputError: If the object was rejected, has no verdict, or was reviewed with a different size or content.
    """
    verdict = history.verdict
    if verdict is None or history.last is None:
        problem = f"it has {len(history.changes)} changes and no verdict"
        raise InvalidInputError(asset, problem, "Accept or reject it with `better review`")
    for _, review in history.reviews:
        if review.content != content:
            problem = f"a decision is about the content {review.content[:SHOWN]}, but the file has {content[:SHOWN]}"
            raise InvalidInputError(asset, problem, "Restore the file that was reviewed, or review the current file")
    last = history.last[1]
    if verdict.verdict == "reject":
        problem = f"{last.author} rejected it on {last.time[:10]}: {verdict.reason}"
        raise InvalidInputError(asset, problem, "Use a different object, or review this object again")
    made = apply(imported, history.changes, where=asset)
    size = size_of(made.draft)
    if any(abs(a - b) > SAME_SHARE * max(size) for a, b in zip(size, last.size_m, strict=True)):
        problem = f"it was accepted with a size of {_centimeters(last.size_m)}, but is {_centimeters(size)} here"
        raise InvalidInputError(asset, problem, "Import it with the same options as in the review (name, size_m, up)")
    return made


def _centimeters(size: Sequence[float]) -> str:
    return " × ".join(f"{100 * v:.1f}" for v in size) + " cm"
