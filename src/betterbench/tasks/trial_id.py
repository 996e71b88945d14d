"""Identifiers of trials: task, condition and seed."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, order=True)
class TrialId:
    """Identifier of a trial.

    Attributes:
        task: Name of the task ("fast_food").
        condition: Name of the training condition ("train1") or of the variation ("L3").
        seed: Seed of the trial.
    """

    task: str
    condition: str
    seed: int

    def __str__(self) -> str:
        """Return the identifier in the form used in plans, journals and file names, such as "fast_food/L3/0"."""
        return f"{self.task}/{self.condition}/{self.seed}"
