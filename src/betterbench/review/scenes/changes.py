"""Review decisions about a task's scenes: moved slots and placement frames, verdicts, and undo.

Changes belong to a task, because its conditions share slots and assets; a verdict belongs to one condition.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, TypeAdapter

from betterbench.interface.state import Region
from betterbench.jobs.decisions import (
    Author,
    DecisionJournal,
    Digest,
    History,
    Time,
    Undo,
    Verdict,
    histories,
    read_decisions,
)
from betterbench.json_form import strict_form

_Name = Annotated[str, Field(min_length=1, max_length=120)]
_Meters = Annotated[float, Field(ge=-2.0, le=2.0)]
_Radians = Annotated[float, Field(ge=-6.3, le=6.3)]


@strict_form
@dataclass(frozen=True, slots=True)
class SlotPlace:
    """Center [m] and heading [rad] of a slot, in the world frame."""

    x: _Meters
    y: _Meters
    yaw: _Radians


@strict_form
@dataclass(frozen=True, slots=True)
class SlotChange:
    """Move of a slot."""

    slot: _Name
    before: SlotPlace
    after: SlotPlace
    kind: Literal["slot"] = "slot"


@strict_form
@dataclass(frozen=True, slots=True)
class FrameChange:
    """Move of an asset's placement frame, in the object frame."""

    asset: _Name
    before: Region
    after: Region
    kind: Literal["frame"] = "frame"


SceneChange = SlotChange | FrameChange
"""Change of a task's scenes."""
SceneDecision = Annotated[SlotChange | FrameChange | Verdict | Undo, Field(discriminator="kind")]
"""Decision: a change, a verdict or an undo."""


@strict_form
@dataclass(frozen=True, slots=True)
class SceneReview:
    """Decision of one person about a task's scenes, stored as one line of the file.

    Attributes:
        author: Name of the person.
        time: Time of the decision, UTC, ISO 8601.
        content: Hash of the task without changes (:func:`~betterbench.review.scenes.forms.task_content`).
        task: Name of the task.
        condition: Name of the reviewed condition.
        scene: Hash of the reviewed scene before the decision (:func:`~betterbench.review.scenes.forms.scene_content`).
        decision: The decision.
    """

    author: Author
    time: Time
    content: Digest
    task: _Name
    condition: _Name
    scene: Digest
    decision: SceneDecision

    @property
    def subject(self) -> str:
        """Displayed name of the scene."""
        return f"{self.task}/{self.condition}"

    def misfit(self, changes: int) -> str:
        """Return the reason why a verdict does not match the number of changes, or ""."""
        if isinstance(self.decision, Verdict) and self.decision.verdict == "fix" and not changes:
            return f"'fix' without a change of {self.subject}, expected 'accept'"
        return ""


_LINE = TypeAdapter(SceneReview)
SceneHistory = History[SceneReview]
"""History of one task: its active decisions."""


class SceneJournal(DecisionJournal[SceneReview]):
    """Scene review file, open for appending by one process."""

    adapter: ClassVar[TypeAdapter[Any]] = _LINE


def read_scene_reviews(path: Path) -> tuple[SceneReview, ...]:
    """Read the decisions in a file, ignoring an unfinished last line.

    Raises:
        RecordError: If the file is missing, was edited by hand, or is not a scene review.
    """
    return read_decisions(_LINE, path)


def verdict_on(history: SceneHistory, condition: str, scene: str) -> Verdict | None:
    """Return the last verdict on a condition, or None if its scene has changed since.

    Args:
        history: Decisions about the task.
        condition: Name of the condition.
        scene: Hash of the scene with all active changes.
    """
    found: Verdict | None = None
    for _, review in history.reviews:
        if review.condition == condition and isinstance(review.decision, Verdict):
            found = review.decision if review.scene == scene else None
    return found


def last_verdicts(reviews: Sequence[SceneReview], where: str) -> dict[tuple[str, str], tuple[str, str]]:
    """Return the name of each judged scene and its last valid verdict, by task content and condition."""
    found: dict[tuple[str, str], tuple[str, str]] = {}
    for content, history in histories(reviews, where).items():
        for _, review in history.reviews:
            if isinstance(review.decision, Verdict):
                found[content, review.condition] = (review.subject, review.decision.verdict)
    return found


def said(change: SceneChange) -> str:
    """Describe a change in a short phrase."""
    if isinstance(change, FrameChange):
        return f"frame {change.after.name} of {change.asset} moved"
    a, b = change.before, change.after
    moved = f"{1000 * (b.x - a.x):+.0f} mm, {1000 * (b.y - a.y):+.0f} mm"
    turned = f", {57.29577951 * (b.yaw - a.yaw):+.0f}°" if abs(b.yaw - a.yaw) > 1e-6 else ""
    return f"slot {change.slot} moved by {moved}{turned}"
