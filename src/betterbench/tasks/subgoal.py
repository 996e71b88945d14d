"""Subgoals: the steps of an instruction, as relations between objects."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Reference:
    """Reference of an instruction to an object, either by a description or by the slot where the object starts.

    Attributes:
        kind: Kind of the object ("burger", "red mug"), or None.
        slot: Slot where the object starts ("far"), or None. Exactly one of ``kind`` and ``slot`` is given.
    """

    kind: str | None = None
    slot: str | None = None

    def __post_init__(self) -> None:
        """Check that either the kind or the slot is given, but not both."""
        if (self.kind is None) == (self.slot is None):
            msg = "a reference must name either a kind or a slot"
            raise ValueError(msg)


@dataclass(frozen=True, slots=True)
class Subgoal:
    """Step of an instruction: a relation that must be established between an object and a target.

    Attributes:
        name: Name of the step ("pack_burger") in records, reports and questions.
        relation: Name of the relation ("inside", "on_ring").
        reference: Reference to the object.
        target: Name of the target container or fixture in the scene.
        word: Word of the instruction that identifies the object ("red", "top", "burger").
        count: Number of objects matching the reference that must be at the target. If an instruction contains the same
            step twice, this is 2 for the second one.
        region: Region of the target, if the target has several ("left", "hole_2", layer "3").
    """

    name: str
    relation: str
    reference: Reference
    target: str
    word: str
    count: int = 1
    region: str = ""


@dataclass(frozen=True, slots=True)
class Instruction:
    """Text of an instruction for a policy, with its steps in order.

    Attributes:
        text: The text.
        subgoals: Steps of the instruction, in order.
        ordered: Whether the order of the steps is part of the goal.
    """

    text: str
    subgoals: tuple[Subgoal, ...]
    ordered: bool = False
