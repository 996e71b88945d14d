"""Decisions in a review of scenes: moved slots and placement frames, verdicts, and undo.

A change belongs to a task, because the conditions of a task share slots and assets. A verdict belongs to one condition.
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
    History,
    Time,
    Undo,
    Verdict,
    histories,
    read_decisions,
)
from betterbench.json_form import Digest, strict_form

_Name = Annotated[str, Field(min_length=1, max_length=120)]
_Meters = Annotated[float, Field(ge=-2.0, le=2.0)]
_Radians = Annotated[float, Field(ge=-6.3, le=6.3)]


@strict_form
@dataclass(frozen=True, slots=True)
class SlotPlace:
    """Center [m] and heading [rad] of a slot (the start position of an object), in the world frame."""

    x: _Meters
    y: _Meters
    yaw: _Radians


@strict_form
@dataclass(frozen=True, slots=True)
class SlotChange:
    """Change of a slot (the start position of an object) in a review."""

    slot: _Name
    before: SlotPlace
    after: SlotPlace
    kind: Literal["slot"] = "slot"


@strict_form
@dataclass(frozen=True, slots=True)
class FrameChange:
    """Change of an asset's placement frame in a review.

    The frames before and after the change are relative to the object frame.
    """

    asset: _Name
    before: Region
    after: Region
    kind: Literal["frame"] = "frame"


SceneChange = SlotChange | FrameChange
"""Change to the scenes of a task."""
SceneDecision = Annotated[SlotChange | FrameChange | Verdict | Undo, Field(discriminator="kind")]
"""Decision in a review of scenes: a change, a verdict or an undo."""


@strict_form
@dataclass(frozen=True, slots=True)
class SceneReview:
    """A person's decision about the scenes of a task. Each decision is one line of the review file.

    Attributes:
        author: Name of the person.
        time: Time of the decision (UTC, ISO 8601).
        content: Hash of the task before any changes (:func:`~betterbench.review.scenes.forms.task_content`).
        task: Name of the task.
        condition: Name of the condition (training or variation) whose scene was reviewed.
        scene: Hash of the scene before the decision (:func:`~betterbench.review.scenes.forms.scene_content`).
        decision: A change, a verdict, or an undo.
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
        """Name of the scene on the page."""
        return f"{self.task}/{self.condition}"

    def misfit(self, changes: int) -> str:
        """Check that a "fix" verdict comes with at least one change to the scene's task.

        Return the problem, or "" if there is none.
        """
        if isinstance(self.decision, Verdict) and self.decision.verdict == "fix" and not changes:
            return f"'fix' without a change of {self.subject}, expected 'accept'"
        return ""


_LINE = TypeAdapter(SceneReview)
SceneHistory = History[SceneReview]
"""History of one task, i.e. all decisions about it that were not undone."""


class SceneJournal(DecisionJournal[SceneReview]):
    """Review file for scenes. The process that opens the file appends its decisions to it."""

    adapter: ClassVar[TypeAdapter[Any]] = _LINE


def read_scene_reviews(path: Path) -> tuple[SceneReview, ...]:
    """Read all decisions in a review file about scenes. An unfinished last line is ignored.

    Raises:
        RecordError: If the file is missing, was changed by hand, or is not a review of scenes.
    """
    return read_decisions(_LINE, path)


def verdict_on(history: SceneHistory, condition: str, scene: str) -> Verdict | None:
    """Return the last verdict on a condition.

    None if there is no verdict, or if the scene has changed since the verdict.

    Args:
        history: Decisions about the task.
        condition: Name of the condition.
        scene: Hash of the scene with all changes applied.
    """
    found: Verdict | None = None
    for _, review in history.reviews:
        if review.condition == condition and isinstance(review.decision, Verdict):
            found = review.decision if review.scene == scene else None
    return found


def last_verdicts(reviews: Sequence[SceneReview], where: str) -> dict[tuple[str, str], tuple[str, str]]:
    """Return the name and the last verdict of each judged scene, keyed by task hash and condition."""
    found: dict[tuple[str, str], tuple[str, str]] = {}
    for content, history in histories(reviews, where).items():
        for _, review in history.reviews:
            if isinstance(review.decision, Verdict):
                found[content, review.condition] = (review.subject, review.decision.verdict)
    return found


def said(change: SceneChange) -> str:
    """Describe a change to a scene in a short phrase."""
    if isinstance(change, FrameChange):
        return f"frame {change.after.name} of {change.asset} moved"
    a, b = change.before, change.after
    moved = f"{1000 * (b.x - a.x):+.0f} mm, {1000 * (b.y - a.y):+.0f} mm"
    turned = f", {57.29577951 * (b.yaw - a.yaw):+.0f}°" if abs(b.yaw - a.yaw) > 1e-6 else ""
    return f"slot {change.slot} moved by {moved}{turned}"
