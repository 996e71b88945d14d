"""True labels in the independent family. They are stated before the first action and corrected by only three rules.

A habit states its truth from the condition alone, before it has seen how anything moves. Three rules, and no others,
turn the stated truth into the final truth. They read the family's own event log and never a diagnosis:

1. **The act was never reached.** A habit whose wrong act comes after right acts marks the moment at which the act
    begins (:meth:`Ledger.commit`). If the episode ends before that moment, the trial counts as one of a policy without
    a fault.
2. **A lasting mishap came first.** If a right act fails for good before the wrong act begins, the first evidence in
   time is this mishap, and the label is ``execution_failure``. For example, the object fell to the floor or lies where
   it cannot be picked.
3. **A policy without a fault does not succeed.** If a mishap was never corrected, the label is ``execution_failure``.
   There are four kinds of mishap. The gripper closes without the object, an object leaves the gripper although it was
   not opened, an object is released away from its target, or an object that was not requested is displaced by more than
   5 cm. If every mishap was corrected, or none happened, the time was too short, and the label is ``timeout``.

A trial whose goal is met is a success regardless of the stated label. Code that reads the truth must check this.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from betterbench.tasks import Label

HONEST = ""
"""Provisional label for a policy without a fault, before the episode's outcome is known."""


@dataclass(frozen=True, slots=True)
class StatedTruth:
    """True label of a trial, as stated before its first action.

    Attributes:
        label: Label of the trial if its goal is not met, or :data:`HONEST`.
        first_right: Whether the first grasp attempt is at the right object. It is None if no grasp is attempted.
        debatable: Reason why another careful reader of the suite might give another label, or "".
        left_out: Reason why the trial says nothing about the habit, or "" if it is used in a calibration.
    """

    label: str
    first_right: bool | None
    debatable: str = ""
    left_out: str = ""

    def __post_init__(self) -> None:
        """Raise UnknownNameError for an unknown label."""
        if self.label != HONEST:
            Label(self.label)


@dataclass(slots=True)
class Ledger:
    """A policy's record of its own episode, with the stated label, the wrong act and the mishaps.

    Attributes:
        stated: The truth as it was stated before the first action.
        committed: Whether the wrong act has begun, or the label does not depend on such an act.
        open_mishaps: Mishaps that were not corrected, by the object or subgoal that they concern.
        lasting: The first mishap that cannot be corrected, or "".
    """

    stated: StatedTruth
    committed: bool = False
    open_mishaps: dict[str, str] = field(default_factory=dict)
    lasting: str = ""
    notes: list[str] = field(default_factory=list)

    def commit(self) -> None:
        """Record that the wrong act begins."""
        self.committed = True

    def mishap(self, what: str, text: str, *, for_good: bool = False) -> None:
        """Record a failed manipulation."""
        self.open_mishaps[what] = text
        self.notes.append(f"{what}: {text}")
        if for_good and not self.committed and not self.lasting:
            self.lasting = f"{what}: {text}"

    def made_good(self, what: str) -> None:
        """Record that an earlier failure was recovered."""
        self.open_mishaps.pop(what, None)

    def final(self) -> tuple[str, str]:
        """Return the trial label if its goal was not met, and the rule that corrected it, or ""."""
        if self.lasting:
            return str(Label.EXECUTION_FAILURE), f"rule 2: {self.lasting}"
        if self.stated.label != HONEST and self.committed:
            return self.stated.label, ""
        rule = "rule 3" if self.stated.label == HONEST else "rule 1"
        if self.open_mishaps:
            return str(Label.EXECUTION_FAILURE), f"{rule}: {next(iter(self.open_mishaps.values()))}"
        return str(Label.TIMEOUT), f"{rule}: no mishap is open"
