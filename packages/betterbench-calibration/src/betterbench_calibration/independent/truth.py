"""True labels of trials in the independent family.

The label of a trial is stated before its first action, from the condition alone. After the trial, it can be corrected
by only three rules. They read the family's own event log and never a diagnosis:

1. **The faulty behavior was never reached.** A habit that begins with correct behavior marks the moment at which its
    faulty behavior begins (:meth:`Ledger.commit`). If the episode ends before that moment, the trial counts as a trial
    of a policy without a fault.
2. **A permanent mishap came first.** If a manipulation fails before the faulty behavior begins, and the failure cannot
    be corrected, the label is ``execution_failure``, because this mishap is the earliest evidence. For example, the
    object has fallen to the floor.
3. **A policy without a fault does not succeed.** If a mishap was never corrected, the label is ``execution_failure``.
    There are four kinds of mishap: the gripper closes without the object, an object leaves the gripper although the
    gripper was not opened, an object is released away from its target, or an object that is not requested is displaced
    by more than 5 cm. If there was no mishap, or every mishap was corrected, the time was too short, and the label is
    ``timeout``.

A trial whose goal is reached is a success regardless of the stated label. Code that uses the labels must check this.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from betterbench.tasks import Label

HONEST = ""
"""Provisional label of a policy without a fault, which is used until the outcome of the episode is known."""


@dataclass(frozen=True, slots=True)
class StatedTruth:
    """True label of a trial, as stated before its first action.

    Attributes:
        label: Label of the trial if its goal is not reached, or :data:`HONEST`.
        first_right: Whether the first grasp attempt is at the right object. None if no grasp is attempted.
        debatable: Reason why a careful reader of the suite might assign another label, or "".
        left_out: Reason why the trial gives no evidence about the habit, or "" if a calibration uses the trial.
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
    """Ground truth that a policy collects about its own episode.

    Attributes:
        stated: True label as stated before the first action.
        committed: Whether the faulty behavior has begun.
        open_mishaps: Descriptions of the mishaps that were not corrected, by name of the object or subgoal.
        lasting: Description of the first mishap that cannot be corrected, or "".
        notes: Descriptions of all mishaps, in order.
    """

    stated: StatedTruth
    committed: bool = False
    open_mishaps: dict[str, str] = field(default_factory=dict)
    lasting: str = ""
    notes: list[str] = field(default_factory=list)

    def commit(self) -> None:
        """Record that the faulty behavior begins."""
        self.committed = True

    def mishap(self, what: str, text: str, *, for_good: bool = False) -> None:
        """Record a failed manipulation of ``what``. If ``for_good`` is True, the failure cannot be corrected."""
        self.open_mishaps[what] = text
        self.notes.append(f"{what}: {text}")
        if for_good and not self.committed and not self.lasting:
            self.lasting = f"{what}: {text}"

    def made_good(self, what: str) -> None:
        """Record that an earlier mishap with ``what`` has been corrected."""
        self.open_mishaps.pop(what, None)

    def final(self) -> tuple[str, str]:
        """Return the label of the trial if its goal is not reached, and the rule that corrected the label, or ""."""
        if self.lasting:
            return str(Label.EXECUTION_FAILURE), f"rule 2: {self.lasting}"
        if self.stated.label != HONEST and self.committed:
            return self.stated.label, ""
        rule = "rule 3" if self.stated.label == HONEST else "rule 1"
        if self.open_mishaps:
            return str(Label.EXECUTION_FAILURE), f"{rule}: {next(iter(self.open_mishaps.values()))}"
        return str(Label.TIMEOUT), f"{rule}: no mishap is open"
