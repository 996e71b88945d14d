"""Metadata of a demonstration: its demonstrator, and the rows of each skill and subgoal."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Annotated, Any, Literal, get_args

from pydantic import Field

from betterbench.errors import InvalidInputError
from betterbench.json_form import strict_form

DemonstratorKind = Literal["expert", "amplified", "teleoperated"]
"""A privileged expert, other demonstrations carried over to a new start, or a person."""

SkillKind = Literal["pick", "place", "slide", "miss"]
"""An object is taken; let go; moved along its rails; or the gripper closes and opens again without anything in it."""

_Row = Annotated[int, Field(ge=0)]


@strict_form
@dataclass(frozen=True, slots=True)
class Demonstrator:
    """Source of a demonstration: an expert, a method or a person, with its motion style and its noise.

    Attributes:
        kind: Sort of demonstrator.
        name: Name of the expert, the method or the person.
        manner: Parameters of its motion style, by name with the unit ("speed", "approach_height_m").
        sources: Demonstrations that this one is made of, "TASK/CONDITION/SEED", in the order in which they were used.
        action_noise: Standard deviation of the noise that was added to the executed actions, in action units. With
            noise, the column ``action`` holds what was meant, which is the label to learn, and ``applied`` what was
            executed; without, the two differ by clipping alone.
    """

    kind: DemonstratorKind
    name: str
    manner: Mapping[str, float] = field(default_factory=dict)
    sources: tuple[str, ...] = ()
    action_noise: Annotated[float, Field(ge=0.0)] = 0.0

    def __post_init__(self) -> None:
        """Refuse kinds that do not exist."""
        if self.kind not in get_args(DemonstratorKind):
            known = ", ".join(get_args(DemonstratorKind))
            raise InvalidInputError("demonstrator.kind", f"{self.kind!r} is unknown", f"Use one of {known}")

    def to_json(self) -> dict[str, Any]:
        """Return the JSON form."""
        return {**asdict(self), "manner": dict(self.manner)}


@strict_form
@dataclass(frozen=True, slots=True)
class SkillWindow:
    """The rows in which the gripper is near one object, to take it, let go of it or move it along its rails.

    Attributes:
        kind: Effect on the object.
        object: Name of the object; for a miss, of the one that was taken next, "" if none was.
        target: Target at which it is put, or "" if that is not the target of a subgoal.
        relation: Relation to the target, "" likewise.
        region: Region of the target, "" where it offers one alone.
        start: First row.
        change: Row after the action that begins to close the gripper, or to open it for a place.
        stop: Row after the last one.
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
        """Refuse windows without rows and changes outside of them."""
        if not self.start <= self.change < self.stop:
            problem = f"rows {self.start}, {self.change}, {self.stop} are not in order"
            raise InvalidInputError(f"skill {self.kind}", problem, "Give start ≤ change < stop")


@strict_form
@dataclass(frozen=True, slots=True)
class SubgoalSegment:
    """The rows [start, stop) that serve one subgoal; the segments of a record follow each other without a gap.

    Attributes:
        subgoal: Name of the subgoal that is done at the end of these rows, "" for rows after the last one.
        object: Name of the object that was brought there or slid home.
        target: Name of the target.
        relation: Relation that the subgoal asks for.
        region: Region of the target, "" where it offers one alone.
        skills: Skill windows within these rows, in the order of time; rows between two windows are transit.
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
        """Refuse segments without rows."""
        if not self.start < self.stop:
            raise InvalidInputError("segment", f"rows {self.start} to {self.stop} are none", "Give start < stop")

    def to_json(self) -> dict[str, Any]:
        """Return the JSON form."""
        form = asdict(self)
        form["skills"] = [asdict(skill) for skill in self.skills]
        return form
