"""The name of a trial: task, condition and seed."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, order=True)
class TrialId:
    """What makes a trial. Everything else about it follows from these three.

    Attributes:
        task: Task id ("fast_food").
        condition: Name of a training condition ("train1") or of a variation ("L3").
        seed: Seed.
    """

    task: str
    condition: str
    seed: int

    def __str__(self) -> str:
        """Return the form that plans, journals and file names share: "fast_food/L3/0"."""
        return f"{self.task}/{self.condition}/{self.seed}"
