"""Base class of reviews: a queue, the current item, an edit in progress, verdicts and undo."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Generic, Protocol, TypeVar

from pydantic import ValidationError

from betterbench.errors import BetterError, one_line
from betterbench.geometry import Pose
from betterbench.jobs.decisions import DecisionJournal, DecisionLine, History, Undo, Verdict


class Named(Protocol):
    """Queue item with a name."""

    @property
    def name(self) -> str:
        """Name in messages."""


ItemT = TypeVar("ItemT", bound=Named)
LineT = TypeVar("LineT", bound=DecisionLine)
EditT = TypeVar("EditT")


@dataclass(slots=True)
class Desk(Generic[ItemT, LineT, EditT]):
    """State of one review. Subclasses store edits, write decisions and open items.

    Attributes:
        queue: Items to review.
        journal: File with the decisions.
        author: Name of the reviewer.
        index: Index of the current item.
        mode: Kind of target that the gizmo moves.
        selected: Index of the selected part of the item.
        edit: Unsaved change, or None.
        message: Result of the last command, in one sentence.
        is_problem: Whether ``message`` reports an error.
    """

    ITEM: ClassVar[str] = "item"
    """Noun for a queue item in messages."""
    SUBJECT: ClassVar[str] = "item"
    """Noun for the subject of a decision in messages."""

    queue: Sequence[ItemT]
    journal: DecisionJournal[LineT]
    author: str
    index: int = 0
    mode: str = ""
    selected: int = 0
    edit: EditT | None = None
    message: str = ""
    is_problem: bool = False

    @property
    def at_hand(self) -> ItemT:
        """The current item."""
        return self.queue[self.index]

    @property
    def history(self) -> History[LineT]:
        """Decisions about the current item."""
        raise NotImplementedError

    def verdicts(self) -> list[Verdict | None]:
        """Return the current verdict on each queue item."""
        raise NotImplementedError

    def keep(self) -> bool:
        """Save the edit in progress as a change; return False on failure, with the reason in ``message``."""
        raise NotImplementedError

    def drag(self, pose: Pose) -> None:
        """Move the gizmo's target to a pose."""
        raise NotImplementedError

    def _open(self) -> None:
        """Prepare the current item."""
        raise NotImplementedError

    def _write(self, decision: Any) -> None:  # noqa: ANN401 - a change, whose kind depends on the item, or a verdict
        """Write a decision about the current item to the journal."""
        raise NotImplementedError

    def _undone(self, review: LineT) -> None:
        """Update the state after a decision about the current item was undone."""
        raise NotImplementedError

    # -------------------------------------------------------------------------------------------------------- moving

    def open_first(self) -> None:
        """Show the first item without a verdict."""
        open_ones = [k for k, verdict in enumerate(self.verdicts()) if verdict is None]
        self._go(open_ones[0] if open_ones else 0)

    def step(self, by: int) -> None:
        """Go to another queue item; an edit in progress is saved first."""
        if self.keep():
            self._go((self.index + by) % len(self.queue))

    def _go(self, index: int) -> None:
        self.index, self.selected, self.edit = index, 0, None
        self._say("")
        self._open()

    def choose(self, mode: str) -> None:
        """Choose the gizmo's target; an edit in progress is saved first."""
        if mode != self.mode and self.keep():
            self.mode, self.selected = mode, 0

    def select_next(self) -> None:
        """Select the next part of the item; an edit in progress is saved first."""
        if self.keep():
            self.selected += 1

    def drop_edit(self) -> None:
        """Discard the edit in progress."""
        self.edit = None
        self._say("The edit was dropped.")

    # ------------------------------------------------------------------------------------------------------ decisions

    def accept(self) -> None:
        """Accept the item, and show the next one."""
        raise NotImplementedError

    def reject(self, reason: str) -> bool:
        """Reject the item with a reason and show the next one; return whether this succeeded."""
        if not reason.strip():
            self._say("Write the reason for the rejection first.", problem=True)
            return False
        return self.keep() and self._judge(Verdict("reject", one_line(reason)))

    def _judge(self, verdict: Verdict) -> bool:
        """Write a verdict, and show the next item; return whether it was written."""
        name = self.at_hand.name
        if not self._tried(lambda: self._write(verdict)):
            return False
        self._go((self.index + 1) % len(self.queue))
        self._say(f"{name}: {verdict.verdict}{f', {verdict.reason}' if verdict.reason else ''}.")
        return True

    def undo(self) -> None:
        """Discard the edit in progress or, without an edit, undo the last active decision."""
        if self.edit is not None:
            self.drop_edit()
            return
        last = self.history.last
        if last is None:
            self._say(f"There is nothing to undo for this {self.SUBJECT}.", problem=True)
            return
        line, review = last
        if self._tried(lambda: self._write(Undo(line))):
            self._undone(review)

    def _tried(self, write: Callable[[], None]) -> bool:
        """Call a function and return whether it succeeded; an error becomes the message."""
        try:
            write()
        except (BetterError, ValidationError) as error:
            self._say(one_line(error), problem=True)
            return False
        return True

    def complain(self, problem: str) -> None:
        """Show a problem reported by the page."""
        self._say(problem, problem=True)

    def _say(self, text: str, *, problem: bool = False) -> None:
        self.message, self.is_problem = text, problem
