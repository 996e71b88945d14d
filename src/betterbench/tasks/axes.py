"""The four axes of variation for a task, and the behavior expected from a policy."""

from __future__ import annotations

from enum import StrEnum


class Axis(StrEnum):
    """Axis of causal intervention, one of four (paper, section 4)."""

    SPATIAL_LAYOUT_SHIFT = "spatial_layout_shift"
    PRIMITIVE_RECOMPOSITION = "primitive_recomposition"
    ADVERSARIAL_OBJECT_PERTURBATION = "adversarial_object_perturbation"
    TEMPORAL_EXTRAPOLATION = "temporal_extrapolation"

    @property
    def letter(self) -> str:
        """First letter of the names of this axis's variations: L, R, O or T."""
        return {"s": "L", "p": "R", "a": "O", "t": "T"}[self.value[0]]

    @classmethod
    def of(cls, variation: str) -> Axis:
        """Return the axis denoted by the first letter of a variation's name.

        Raises:
            ValueError: If it begins with a letter other than L, R, O or T.
        """
        for axis in cls:
            if variation[:1] == axis.letter:
                return axis
        letters = ", ".join(f"{axis.letter} ({axis.value})" for axis in cls)
        raise ValueError(f"the name of variation {variation!r} must begin with the letter of its axis: {letters}")


class Expected(StrEnum):
    """Expected behavior of a policy that understands the instruction.

    If it is "ambiguous", the premise is broken. The trial is then judged like a refusal and labeled, but excluded from
    all rates.
    """

    SUCCEED = "succeed"
    REFUSE = "refuse"
    STAY_STILL = "stay_still"
    AMBIGUOUS = "ambiguous"

    @property
    def lacks_target(self) -> bool:
        """Whether a requested object is absent, so that no other object may be taken instead."""
        return self in (Expected.REFUSE, Expected.AMBIGUOUS)


class Support(StrEnum):
    """Support of a variation: ``seen`` if all pick and place poses are inside the training distribution."""

    SEEN = "seen"
    NOVEL = "novel"
