"""Journals of the decisions that people make in a review: changes, verdicts, and undos of earlier decisions.

A decision is one JSON line of an append-only file (:mod:`betterbench.jobs.line_journal`). The reviewed item is called
the subject of the decision, and each decision contains the content hash of its subject. The decisions about a subject
form the history of the subject. Each package that uses this module defines its own kinds of changes.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any, ClassVar, Generic, Literal, Protocol, TypeVar

from pydantic import Field, TypeAdapter

from betterbench.errors import RecordError
from betterbench.jobs.line_journal import LINK, LineJournal, complete_lines, link_after, linked_forms
from betterbench.json_form import dump_json, read_form, strict_form

LONGEST_TEXT = 500
"""Maximum number of characters of a reason."""
CURE = "Restore the file from a copy, or rename it and make the decisions again"
"""Remedy to suggest for a damaged journal."""

Author = Annotated[str, Field(min_length=1, max_length=80)]
"""Name of the person who made the decision."""
Time = Annotated[str, Field(pattern=r"^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d(\.\d+)?(Z|\+00:00)$")]
"""Time of a decision: UTC, ISO 8601."""
_Text = Annotated[str, Field(max_length=LONGEST_TEXT)]


@strict_form
@dataclass(frozen=True, slots=True)
class Verdict:
    """Verdict of a reviewer: accept an item unchanged, accept it after fixing it, or reject it and give a reason."""

    verdict: Literal["accept", "fix", "reject"]
    reason: _Text = ""
    kind: Literal["verdict"] = "verdict"

    def __post_init__(self) -> None:
        """Require a reason for a rejection."""
        if self.verdict == "reject" and not self.reason.strip():
            raise ValueError("a rejection must have a reason")


@strict_form
@dataclass(frozen=True, slots=True)
class Undo:
    """Undo of the last active decision on a subject. The decision is identified by its line number."""

    line: Annotated[int, Field(ge=1)]
    kind: Literal["undo"] = "undo"


class DecisionLine(Protocol):
    """One line of the journal: a decision that a person made."""

    @property
    def author(self) -> str:
        """Name of the person who made the decision."""

    @property
    def time(self) -> str:
        """Time of the decision (UTC, ISO 8601)."""

    @property
    def content(self) -> str:
        """Content hash of the subject."""

    @property
    def decision(self) -> Any:  # noqa: ANN401 - a change, whose kind depends on the subject, a Verdict or an Undo
        """Change, :class:`Verdict` or :class:`Undo`."""

    @property
    def subject(self) -> str:
        """Name of the subject, for display."""

    def misfit(self, changes: int) -> str:
        """Return the reason this decision is not allowed after the given number of changes, or "" if it is allowed."""


LineT = TypeVar("LineT", bound=DecisionLine)


@dataclass(frozen=True, slots=True)
class History(Generic[LineT]):
    """Decisions about one subject, without undone decisions.

    Attributes:
        reviews: Decisions that were not undone, with their line numbers.
    """

    reviews: tuple[tuple[int, LineT], ...] = ()

    @property
    def changes(self) -> tuple[Any, ...]:
        """All changes that were not undone, in order."""
        return tuple(r.decision for _, r in self.reviews if not isinstance(r.decision, Verdict | Undo))

    @property
    def last(self) -> tuple[int, LineT] | None:
        """The last active decision with its line number, or None if there is none."""
        return self.reviews[-1] if self.reviews else None

    @property
    def verdict(self) -> Verdict | None:
        """Current verdict, or None if there is none or a later change has invalidated it."""
        found = None if self.last is None else self.last[1].decision
        return found if isinstance(found, Verdict) else None

    def after(self, line: int, review: LineT, where: str) -> History[LineT]:
        """Return the history after one more decision.

        Raises:
            RecordError: If an undo does not refer to the last active decision, or if a verdict is not allowed after the
                changes made so far.
        """
        decision = review.decision
        if isinstance(decision, Undo):
            if self.last is None or self.last[0] != decision.line:
                stands = "there is none" if self.last is None else f"it is line {self.last[0]}"
                problem = f"it undoes line {decision.line}, which is not the last active decision on {review.subject}"
                raise RecordError(f"{where}: {problem} ({stands}). {CURE}.")
            return History(self.reviews[:-1])
        problem = review.misfit(len(self.changes))
        if problem:
            raise RecordError(f"{where}: {problem}. {CURE}.")
        return History((*self.reviews, (line, review)))


def histories(reviews: Iterable[LineT], where: str) -> dict[str, History[LineT]]:
    """Return the history of every subject, by the subject's content hash.

    Raises:
        RecordError: If a decision contradicts the earlier decisions.
    """
    found: dict[str, History[LineT]] = {}
    for number, review in enumerate(reviews, start=1):
        before = found.get(review.content, History())
        found[review.content] = before.after(number, review, f"{where}: line {number}")
    return found


class DecisionJournal(LineJournal, Generic[LineT]):
    """Journal of decisions. Only one process at a time can append to it. Subclasses define the format of the lines.

    An incomplete last line is removed when the journal is opened.

    Raises:
        RunConflictError: If another process is writing to the file.
        RecordError: If the file was edited by hand or has a different format.
    """

    adapter: ClassVar[TypeAdapter[Any]]
    """Validator of a line."""

    def __init__(self, path: Path) -> None:
        """Open the journal. Create the file if it does not exist."""
        self._where, self._link, self._reviews = str(path), "", list[LineT]()
        self._histories: dict[str, History[LineT]] = {}
        super().__init__(path, alone=True)

    def _take_in(self, lines: list[bytes]) -> None:
        for review, link in _parsed(self.adapter, self._path, lines):
            self._reviews.append(review)
            self._link = link
        self._histories = histories(self._reviews, self._where)

    def history(self, content: str) -> History[LineT]:
        """Return the history of the subject with the given content hash."""
        return self._histories.get(content, History())

    @property
    def reviews(self) -> tuple[LineT, ...]:
        """All decisions in the journal, including undone decisions."""
        return tuple(self._reviews)

    def check(self, review: LineT) -> None:
        """Check the fields of a decision before it is applied.

        Raises:
            InvalidInputError: If a field of the decision is not valid.
        """
        read_form(self.adapter, dump_json(self.form(review)), where="decision", cure="Use a valid value")

    def append(self, review: LineT) -> History[LineT]:
        """Append a decision, sync it to disk, and return the history of its subject.

        Raises:
            InvalidInputError: If a field of the decision is not valid.
            RecordError: If the decision contradicts earlier decisions.
        """
        self.check(review)
        form = self.form(review)
        number = len(self._reviews) + 1
        new = self.history(review.content).after(number, review, f"{self._where}: line {number}")
        link = link_after(self._link, form)
        self._append_line({**form, LINK: link})
        self._link = link
        self._reviews.append(review)
        self._histories[review.content] = new
        return new

    @staticmethod
    def form(review: Any) -> dict[str, Any]:  # noqa: ANN401 - a dataclass of the subclass
        """Return the JSON object that represents a line of the journal."""
        return asdict(review)


def now() -> str:
    """Return the current time in the format of the decisions (UTC, ISO 8601)."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def read_decisions(adapter: TypeAdapter[LineT], path: Path) -> tuple[LineT, ...]:
    """Read the decisions in a file. An incomplete last line is ignored.

    Raises:
        RecordError: If the file is missing, was edited by hand, or has a different format.
    """
    if not path.exists():
        raise RecordError(f"{path} does not exist. Choose a file that `better review` has written.")
    lines, _ = complete_lines(path)
    return tuple(review for review, _ in _parsed(adapter, path, lines))


def _parsed(adapter: TypeAdapter[LineT], path: Path, lines: list[bytes]) -> Iterator[tuple[LineT, str]]:
    for number, (form, link) in enumerate(linked_forms(path, lines, cure=CURE), start=1):
        where = f"{path}: line {number}"
        yield read_form(adapter, form, where=where, cure=CURE, raises=RecordError, sealed=True), link
