"""Base class for the state of a review: a queue of items, the current item, the edit in progress, verdicts and undo."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Generic, Protocol, TypeVar

from pydantic import ValidationError

from betterbench.errors import BetterError, one_line
from betterbench.geometry import Pose
from betterbench.jobs.decisions import DecisionJournal, DecisionLine, History, Undo, Verdict


class Named(Protocol):
    """Item in the queue of a review, which has a name."""

    @property
    def name(self) -> str:
        """Name of the item in messages."""


ItemT = TypeVar("ItemT", bound=Named)
LineT = TypeVar("LineT", bound=DecisionLine)
EditT = TypeVar("EditT")


@dataclass(slots=True)
class Desk(Generic[ItemT, LineT, EditT]):
    """State of one review. Subclasses implement the opening and editing of items, and the writing of decisions.

    Attributes:
        queue: Items to review.
        journal: File that the decisions are written to.
        author: Name of the reviewer.
        index: Index of the current item in the queue.
        mode: Element that the gizmo moves, such as the object or a grasp. The gizmo is the handle that the reviewer
            drags in the 3D view.
        selected: Index of the selected part of the item, such as one of several grasps.
        edit: Change that has not been saved yet, or None.
        message: Result of the last command, in one sentence.
        is_problem: Whether ``message`` reports a problem.
    """

    ITEM: ClassVar[str] = "item"
    """Noun for an item of the queue, for messages."""
    SUBJECT: ClassVar[str] = "item"
    """Noun for the subject of a decision, for messages."""

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
        """The current item of the queue."""
        return self.queue[self.index]

    @property
    def history(self) -> History[LineT]:
        """Decisions made so far about the current item."""
        raise NotImplementedError

    def verdicts(self) -> list[Verdict | None]:
        """Return the current verdict on each item of the queue, or None for items without a verdict."""
        raise NotImplementedError

    def keep(self) -> bool:
        """Save the edit in progress as a change. If this fails, store the reason in ``message`` and return False."""
        raise NotImplementedError

    def drag(self, pose: Pose) -> None:
        """Move the element that the gizmo controls, such as a grasp, to the given pose."""
        raise NotImplementedError

    def _open(self) -> None:
        """Prepare the current item for its review."""
        raise NotImplementedError

    def _write(self, decision: Any) -> None:  # noqa: ANN401 - a change, whose kind depends on the item, or a verdict
        """Write a decision about the current item to the journal."""
        raise NotImplementedError

    def _undone(self, review: LineT) -> None:
        """Update the state of the review after a decision about the current item was undone."""
        raise NotImplementedError

    # -------------------------------------------------------------------------------------------------------- moving

    def open_first(self) -> None:
        """Go to the first item without a verdict. If every item has a verdict, go to the first item."""
        open_ones = [k for k, verdict in enumerate(self.verdicts()) if verdict is None]
        self._go(open_ones[0] if open_ones else 0)

    def step(self, by: int) -> None:
        """Go forward or backward in the queue by a number of items. The edit in progress is saved first."""
        if self.keep():
            self._go((self.index + by) % len(self.queue))

    def _go(self, index: int) -> None:
        self.index, self.selected, self.edit = index, 0, None
        self._say("")
        self._open()

    def choose(self, mode: str) -> None:
        """Choose which element the gizmo moves. The edit in progress is saved first."""
        if mode != self.mode and self.keep():
            self.mode, self.selected = mode, 0

    def select_next(self) -> None:
        """Select the next part of the item, such as the next grasp. The edit in progress is saved first."""
        if self.keep():
            self.selected += 1

    def drop_edit(self) -> None:
        """Discard the edit in progress."""
        self.edit = None
        self._say("The edit was dropped.")

    # ------------------------------------------------------------------------------------------------------ decisions

    def accept(self) -> None:
        """Accept the current item, and go to the next one."""
        raise NotImplementedError

    def reject(self, reason: str) -> bool:
        """Reject the current item with a reason, and go to the next one. Return whether this succeeded."""
        if not reason.strip():
            self._say("Write the reason for the rejection first.", problem=True)
            return False
        return self.keep() and self._judge(Verdict("reject", one_line(reason)))

    def _judge(self, verdict: Verdict) -> bool:
        """Write a verdict on the current item, and go to the next item. Return whether the verdict was written."""
        name = self.at_hand.name
        if not self._tried(lambda: self._write(verdict)):
            return False
        self._go((self.index + 1) % len(self.queue))
        self._say(f"{name}: {verdict.verdict}{f', {verdict.reason}' if verdict.reason else ''}.")
        return True

    def undo(self) -> None:
        """Discard the edit in progress. If there is none, undo the last decision about the current item."""
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
        """Call a function, and return whether it succeeded.

        If it raises an error, the error is shown as the message.
        """
        try:
            write()
        except (BetterError, ValidationError) as error:
            self._say(one_line(error), problem=True)
            return False
        return True

    def complain(self, problem: str) -> None:
        """Show a problem that was reported by the browser page."""
        self._say(problem, problem=True)

    def _say(self, text: str, *, problem: bool = False) -> None:
        self.message, self.is_problem = text, problem
