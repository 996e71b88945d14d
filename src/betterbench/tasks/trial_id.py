"""Identifiers of trials: task, condition and seed."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, order=True)
class TrialId:
    """Identifier of a trial, with a task ("fast_food"), a condition ("train1") or variation ("L3"), and a seed."""

    task: str
    condition: str
    seed: int

    def __str__(self) -> str:
        """Return the text form in plans, journals and file names, such as "fast_food/L3/0"."""
        return f"{self.task}/{self.condition}/{self.seed}"
