"""The four axes of variation of a task, and the behavior expected from a policy."""

from __future__ import annotations

from enum import StrEnum


class Axis(StrEnum):
    """Axis of causal intervention (paper, section 4). There are four axes."""

    SPATIAL_LAYOUT_SHIFT = "spatial_layout_shift"
    PRIMITIVE_RECOMPOSITION = "primitive_recomposition"
    ADVERSARIAL_OBJECT_PERTURBATION = "adversarial_object_perturbation"
    TEMPORAL_EXTRAPOLATION = "temporal_extrapolation"

    @property
    def letter(self) -> str:
        """First letter of the names of the variations on this axis: L, R, O or T."""
        return {"s": "L", "p": "R", "a": "O", "t": "T"}[self.value[0]]

    @classmethod
    def of(cls, variation: str) -> Axis:
        """Return the axis of a variation, given by the first letter of its name.

        Raises:
            ValueError: If the name does not begin with L, R, O or T.
        """
        for axis in cls:
            if variation[:1] == axis.letter:
                return axis
        letters = ", ".join(f"{axis.letter} ({axis.value})" for axis in cls)
        raise ValueError(f"the name of variation {variation!r} must begin with the letter of its axis: {letters}")


class Expected(StrEnum):
    """Behavior that is expected from a policy that understands the instruction.

    "Ambiguous" means that a premise of the instruction is false. A trial with this value is judged like a refusal and
    gets a label, but is not part of any rate.
    """

    SUCCEED = "succeed"
    REFUSE = "refuse"
    STAY_STILL = "stay_still"
    AMBIGUOUS = "ambiguous"

    @property
    def lacks_target(self) -> bool:
        """Whether the policy should notice that a requested object is absent, and take no other object instead."""
        return self in (Expected.REFUSE, Expected.AMBIGUOUS)


class Support(StrEnum):
    """Whether all pick and place poses of a variation occur in training (``seen``), or some do not (``novel``)."""

    SEEN = "seen"
    NOVEL = "novel"
