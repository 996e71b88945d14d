"""Subgoals: an instruction's steps as relations between objects."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Reference:
    """Reference of an instruction to an object, by description or by start slot.

    Attributes:
        kind: Kind of the object ("burger", "red mug"), or None.
        slot: Start slot of the object ("far"), or None. Exactly one of the two is given.
    """

    kind: str | None = None
    slot: str | None = None

    def __post_init__(self) -> None:
        """Check that exactly one of the two is given."""
        if (self.kind is None) == (self.slot is None):
            msg = "a reference names either a kind or a slot"
            raise ValueError(msg)


@dataclass(frozen=True, slots=True)
class Subgoal:
    """Step of an instruction: a relation to establish between an object and a target.

    Attributes:
        name: Step name ("pack_burger") in records, reports and questions.
        relation: Relation name ("inside", "on_ring").
        reference: Reference to the object.
        target: Scene name of the target container or fixture.
        word: The word of the instruction that identifies the object ("red", "top", "burger").
        count: Number of objects matching the reference that must be at the target. It is 2 for the second of two equal
            steps.
        place: Region of the target, if it has several ("left", "hole_2", layer "3").
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
    """A text for a policy, with its steps in order.

    Attributes:
        ordered: Whether the order is part of the goal.
    """

    text: str
    subgoals: tuple[Subgoal, ...]
    ordered: bool = False
