"""The file of a review, with one appended JSON line per decision, and the history of each object in it.

Each line contains a hash link to the previous line, which reveals lines that were changed, removed or moved by hand
(:mod:`betterbench.jobs.line_journal`).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, TypeAdapter

from betterbench.errors import InvalidInputError, RecordError, one_line
from betterbench.geometry import Vector
from betterbench.jobs.line_journal import LINK, LineJournal, complete_lines, link_after, linked_forms
from betterbench.json_form import dump_json, read_form, strict_form
from betterbench.sim.assets.importing.importer import Imported
from betterbench.sim.assets.importing.review.applying import SAME_SHARE, apply, size_of
from betterbench.sim.assets.importing.review.changes import Change, Decision, Undo, Verdict
from betterbench.sim.assets.names import shown_name

SHOWN = 16
"""Number of digits of a content hash shown in messages."""
_CURE = "Restore the file from a copy, or review into a new file"


@strict_form
@dataclass(frozen=True, slots=True)
class Review:
    """One decision of a person about one object: a line of the file.

    Attributes:
        author: Name of the person.
        time: Time of the decision, UTC, ISO 8601.
        content: Content hash of the mesh file (:func:`~betterbench.sim.assets.importing.review.content_hash`).
        asset: Displayed name of the object.
        size_m: Extents of the object that the person saw before the decision [m].
        decision: The decision.
    """

    author: Annotated[str, Field(min_length=1, max_length=80)]
    time: Annotated[str, Field(pattern=r"^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d(\.\d+)?(Z|\+00:00)$")]
    content: Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
    asset: Annotated[str, Field(min_length=1, max_length=120)]
    size_m: Vector
    decision: Decision


_REVIEW = TypeAdapter(Review)


@dataclass(frozen=True, slots=True)
class History:
    """Active decisions about one object.

    Attributes:
        reviews: The decisions that were not undone, with the numbers of their lines.
    """

    reviews: tuple[tuple[int, Review], ...] = ()

    @property
    def changes(self) -> tuple[Change, ...]:
        """The changes, in order."""
        return tuple(r.decision for _, r in self.reviews if not isinstance(r.decision, Verdict | Undo))

    @property
    def last(self) -> tuple[int, Review] | None:
        """The last decision and its line number, None if there is none."""
        return self.reviews[-1] if self.reviews else None

    @property
    def verdict(self) -> Verdict | None:
        """The verdict, None if there is none or a change was made after it."""
        found = None if self.last is None else self.last[1].decision
        return found if isinstance(found, Verdict) else None

    def after(self, line: int, review: Review, where: str) -> History:
        """Return the history with one more decision.

        Raises:
            RecordError: If an undo does not name the last active decision, or a verdict does not fit the changes.
        """
        decision = review.decision
        if isinstance(decision, Undo):
            if self.last is None or self.last[0] != decision.line:
                stands = "there is none" if self.last is None else f"it is line {self.last[0]}"
                problem = f"it undoes line {decision.line} and not the last standing decision on {review.asset}"
                raise RecordError(f"{where}: {problem} ({stands}). {_CURE}.")
            return History(self.reviews[:-1])
        if isinstance(decision, Verdict) and decision.verdict != "reject":
            fits: Literal["accept", "fix"] = "fix" if self.changes else "accept"
            if decision.verdict != fits:
                problem = f"{decision.verdict!r} with {len(self.changes)} changes of {review.asset}, expected {fits!r}"
                raise RecordError(f"{where}: {problem}. {_CURE}.")
        return History((*self.reviews, (line, review)))


def histories(reviews: Iterable[Review], where: str) -> dict[str, History]:
    """Return the history of every object, by content hash.

    Raises RecordError if a decision does not fit those before it.
    """
    found: dict[str, History] = {}
    for number, review in enumerate(reviews, start=1):
        before = found.get(review.content, History())
        found[review.content] = before.after(number, review, f"{where}: line {number}")
    return found


class ReviewJournal(LineJournal):
    """The file of a review, open for appending by one process.

    Raises:
        RunConflictError: If another process writes to the file.
        RecordError: If the file was changed by hand, or is not a review file. An unfinished last line is cut off.
    """

    def __init__(self, path: Path) -> None:
        """Open or create a file."""
        self._where, self._link, self._reviews = str(path), "", list[Review]()
        self._histories: dict[str, History] = {}
        super().__init__(path, alone=True)

    def _take_in(self, lines: list[bytes]) -> None:
        for review, link in _parsed(self._path, lines):
            self._reviews.append(review)
            self._link = link
        self._histories = histories(self._reviews, self._where)

    def history(self, content: str) -> History:
        """Return the history of an object."""
        return self._histories.get(content, History())

    @property
    def reviews(self) -> tuple[Review, ...]:
        """All decisions."""
        return tuple(self._reviews)

    def append(self, review: Review) -> History:
        """Append a decision, and return the history of its object after the line is on disk.

        Raises:
            InvalidInputError: If a field of the decision is not valid.
            RecordError: If the decision does not fit those before it.
        """
        form = _form(review)
        read_form(_REVIEW, dump_json(form), where="decision", cure="Give another value")
        number = len(self._reviews) + 1
        new = self.history(review.content).after(number, review, f"{self._where}: line {number}")
        link = link_after(self._link, form)
        self._append_line({**form, LINK: link})
        self._link = link
        self._reviews.append(review)
        self._histories[review.content] = new
        return new


def asset_name(mesh: Path) -> str:
    """Return the name of an object in reviews: the file name, with the folder if the file name is generic."""
    return one_line(shown_name(mesh), most=100)


def now() -> str:
    """Return the current time for a decision (UTC, ISO 8601)."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def read_reviews(path: Path) -> tuple[Review, ...]:
    """Return the decisions of a file; an unfinished last line is ignored.

    Raises:
        RecordError: If the file is missing, was changed by hand, or is not the file of a review.
    """
    if not path.exists():
        raise RecordError(f"{path}: does not exist. Name a file that better review has written.")
    lines, _ = complete_lines(path)
    return tuple(review for review, _ in _parsed(path, lines))


def history_of(path: Path, content: str, asset: str) -> History:
    """Return the history of an object in a file.

    Args:
        path: The file.
        content: Content hash of the object's mesh file.
        asset: Name of the object.

    Raises:
        RecordError: As for :func:`read_reviews`.
        InvalidInputError: If the file has no decision about this content; the message names the reviewed content of an
            object with the same name.
    """
    reviews = read_reviews(path)
    found = histories(reviews, str(path)).get(content)
    if found is not None:
        return found
    same = [review.content for review in reviews if review.asset == asset]
    cure = f"Review it: better review MESH --out {path.name}"
    if same:
        problem = f"it was reviewed with the content {same[-1][:SHOWN]}, and the file has {content[:SHOWN]} now"
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
            problem = f"a decision is about the content {review.content[:SHOWN]}, and the file has {content[:SHOWN]}"
            raise InvalidInputError(asset, problem, "Restore the reviewed file, or review this one")
    last = history.last[1]
    if verdict.verdict == "reject":
        problem = f"{last.author} rejected it on {last.time[:10]}: {verdict.reason}"
        raise InvalidInputError(asset, problem, "Use another object, or review this one again")
    made = apply(imported, history.changes, where=asset)
    size = size_of(made.draft)
    if any(abs(a - b) > SAME_SHARE * max(size) for a, b in zip(size, last.size_m, strict=True)):
        problem = f"it was accepted with a size of {_centimeters(last.size_m)}, and here it is {_centimeters(size)}"
        raise InvalidInputError(asset, problem, "Import it with the options of the review (name, size_m, up)")
    return made


def _centimeters(size: Sequence[float]) -> str:
    return " × ".join(f"{100 * v:.1f}" for v in size) + " cm"


def _form(review: Review) -> dict[str, Any]:
    form = asdict(review)
    form["size_m"] = [round(float(v), 6) for v in review.size_m]
    return form


def _parsed(path: Path, lines: list[bytes]) -> Iterable[tuple[Review, str]]:
    for number, (form, link) in enumerate(linked_forms(path, lines, cure=_CURE), start=1):
        where = f"{path}: line {number}"
        yield read_form(_REVIEW, form, where=where, cure=_CURE, raises=RecordError, sealed=True), link
