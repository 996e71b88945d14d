"""Metadata of demonstrations: the demonstrator, and the rows that belong to each skill and subgoal."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Annotated, Any, Literal, get_args

from pydantic import Field

from betterbench.errors import InvalidInputError
from betterbench.json_form import strict_form

DemonstratorKind = Literal["expert", "amplified", "teleoperated"]
"""Kind of demonstrator: a privileged expert, a method that adapts other demonstrations, or a person."""

SkillKind = Literal["pick", "place", "slide", "miss"]
"""Kind of skill: pick an object, place it, slide it along its rails, or miss (close and open the empty gripper)."""

_Row = Annotated[int, Field(ge=0)]


@strict_form
@dataclass(frozen=True, slots=True)
class Demonstrator:
    """Source of a demonstration: an expert, a method or a person, with its motion style and its action noise.

    Attributes:
        kind: Kind of demonstrator.
        name: Name of the expert, the method or the person.
        manner: Parameters of the motion style. Their names include the unit ("speed", "approach_height_m").
        sources: Demonstrations that were combined into this demonstration, as "TASK/CONDITION/SEED" in order of use.
        action_noise: Standard deviation of the noise on the executed actions, in action units. With noise, the column
            ``action`` contains the intended action, which a policy should learn, and the column ``applied`` contains
            the executed action. Without noise, the two columns differ only by clipping.
    """

    kind: DemonstratorKind
    name: str
    manner: Mapping[str, float] = field(default_factory=dict)
    sources: tuple[str, ...] = ()
    action_noise: Annotated[float, Field(ge=0.0)] = 0.0

    def __post_init__(self) -> None:
        """Raise InvalidInputError if the kind is unknown."""
        if self.kind not in get_args(DemonstratorKind):
            known = ", ".join(get_args(DemonstratorKind))
            raise InvalidInputError("demonstrator.kind", f"{self.kind!r} is unknown", f"Use one of {known}")

    def to_json(self) -> dict[str, Any]:
        """Return the demonstrator in JSON form."""
        return {**asdict(self), "manner": dict(self.manner)}


@strict_form
@dataclass(frozen=True, slots=True)
class SkillWindow:
    """Rows of a record in which the gripper is near an object to pick, place or slide it.

    Attributes:
        kind: Kind of skill.
        object: Name of the object. For a "miss", in which the gripper closed without grasping or moving an object:
            name of the object that is picked next, or "" if no object is picked afterward.
        target: Target of the placement, or "" if the placement does not achieve a subgoal.
        relation: Relation to the target, or "" if there is no target.
        region: Region of the target, or "" if the target has only one.
        start: First row.
        change: Row after the action that begins to close the gripper, or to open it for a placement.
        stop: Row after the last row of the window.
    """

    kind: SkillKind
    object: str
    target: str
    relation: str
    region: str
    start: _Row
    change: _Row
    stop: _Row

    def __post_init__(self) -> None:
        """Raise InvalidInputError if the window is empty or the row ``change`` is outside it."""
        if not self.start <= self.change < self.stop:
            problem = f"rows {self.start}, {self.change}, {self.stop} are not in order"
            raise InvalidInputError(f"skill {self.kind}", problem, "Choose rows such that start ≤ change < stop")


@strict_form
@dataclass(frozen=True, slots=True)
class SubgoalSegment:
    """Rows [start, stop) of a record in which the robot works toward one subgoal.

    The segments of a record are contiguous.

    Attributes:
        subgoal: Name of the subgoal that is achieved at the end of these rows, or "" for rows after the last subgoal.
        object: Name of the object that was placed or slid.
        target: Name of the target.
        relation: Relation of the subgoal.
        region: Region of the target, or "" if the target has only one.
        start: First row.
        stop: Row after the last row of the segment.
        skills: Skill windows within these rows, in chronological order. Between two windows, the arm is in transit.
    """

    subgoal: str
    object: str
    target: str
    relation: str
    region: str
    start: _Row
    stop: _Row
    skills: tuple[SkillWindow, ...] = ()

    def __post_init__(self) -> None:
        """Raise InvalidInputError if the segment is empty."""
        if not self.start < self.stop:
            raise InvalidInputError(
                "segment", f"rows {self.start} to {self.stop} are empty", "Choose rows such that start < stop"
            )

    def to_json(self) -> dict[str, Any]:
        """Return the segment in JSON form."""
        form = asdict(self)
        form["skills"] = [asdict(skill) for skill in self.skills]
        return form
