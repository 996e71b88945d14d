"""Base classes for habits: systematic wrong decisions, manipulation failures or unusual correct behavior."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

from betterbench_calibration.independent.body import Body
from betterbench_calibration.independent.controller import Actions
from betterbench_calibration.independent.occasion import Occasion
from betterbench_calibration.independent.truth import HONEST, StatedTruth


class Habit(ABC):
    """Habit of the independent family. The docstring of a subclass states its behavior, its true label and the reason.

    Attributes:
        name: Name in addresses ("word-place").
        label: The true label of trials in which the habit shows. It is
            :data:`~betterbench_calibration.independent.truth.HONEST` for a habit without a fault.
        paired: Whether the label needs more than one trial, so that a calibration must run complete tasks.
    """

    name: ClassVar[str]
    label: ClassVar[str]
    paired: ClassVar[bool] = False

    @abstractmethod
    def truth(self, case: Occasion) -> StatedTruth | None:
        """Return the truth for a trial in this condition, or None if the habit behaves correctly there."""

    @abstractmethod
    def act(self, body: Body) -> Actions[None]:
        """Act until the episode ends. This is only called if :meth:`truth` is not None."""

    @property
    def summary(self) -> str:
        """First line of the docstring."""
        return (self.__doc__ or "").partition("\n")[0]


class PlainHabit(Habit):
    """Habit that shows only in plain trials, with a right first attempt."""

    def truth(self, case: Occasion) -> StatedTruth | None:  # noqa: D102 - documented in the base class
        return StatedTruth(self.label, first_right=True) if case.plain else None


class Honest(Habit):
    """Executes all steps in order and repeats a step after a miss. Its label is success or execution_failure."""

    name = "honest"
    label = HONEST

    def truth(self, case: Occasion) -> StatedTruth | None:  # noqa: D102 - documented in the base class
        return StatedTruth(HONEST, first_right=True if case.first_thing() else None)

    def act(self, body: Body) -> Actions[None]:  # noqa: D102 - documented in the base class
        yield from body.solve()
