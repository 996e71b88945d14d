"""Subgoals: the steps of an instruction, as relations between the objects that it names."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Reference:
    """Reference of an instruction to an object: by its description, or by its place at the start.

    Attributes:
        kind: Kind of object that is meant ("burger", "red mug"), or None.
        slot: Slot whose occupant is meant ("far"), or None. Exactly one of the two is given.
    """

    kind: str | None = None
    slot: str | None = None

    def __post_init__(self) -> None:
        """Check that exactly one way of picking out is given."""
        if (self.kind is None) == (self.slot is None):
            msg = "a reference names either a kind or a slot"
            raise ValueError(msg)


@dataclass(frozen=True, slots=True)
class Subgoal:
    """Step of an instruction: a relation that has to hold between an object and a target.

    Attributes:
        name: Name of the step ("pack_burger") in records, reports and questions.
        relation: Name of the relation that has to hold ("inside", "on_ring").
        reference: Reference to the object.
        target: Scene name of the container or fixture it has to be related to.
        word: The word of the instruction that picks out the object ("red", "top", "burger").
        count: Number of objects of that reference that must be there for this step to be done; the second of two equal
            steps has 2.
        place: Region of the target, where it offers several ("left", "hole_2", layer "3").
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
    """A text that a policy is given, together with the steps that it asks for, in their order.

    Attributes:
        ordered: True if the order is part of the goal.
    """

    text: str
    subgoals: tuple[Subgoal, ...]
    ordered: bool = False
