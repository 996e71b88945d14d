"""Base classes of habits: systematic wrong decisions, systematic execution errors, or unusual but correct behavior."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

from betterbench_calibration.independent.body import Body
from betterbench_calibration.independent.controller import Actions
from betterbench_calibration.independent.occasion import Occasion
from betterbench_calibration.independent.truth import HONEST, StatedTruth


class Habit(ABC):
    """Habit of the independent family.

    The docstring of each subclass describes the behavior and gives the true label with a reason.

    Attributes:
        name: Name in policy addresses ("word-place").
        label: True label of trials in which the habit shows. It is
            :data:`~betterbench_calibration.independent.truth.HONEST` for a habit without a fault.
        paired: Whether the diagnosis needs several trials to assign the label. A calibration then runs complete tasks.
    """

    name: ClassVar[str]
    label: ClassVar[str]
    paired: ClassVar[bool] = False

    @abstractmethod
    def truth(self, case: Occasion) -> StatedTruth | None:
        """Return the true label of a trial, or None if the habit does not show in the condition of the trial."""

    @abstractmethod
    def act(self, body: Body) -> Actions[None]:
        """Yield the actions of the episode. This is called only if :meth:`truth` does not return None."""

    @property
    def summary(self) -> str:
        """First line of the docstring."""
        return (self.__doc__ or "").partition("\n")[0]


class PlainHabit(Habit):
    """Habit that shows in all trials with a feasible instruction and a normal initial scene.

    The first grasp attempt is at the right object.
    """

    def truth(self, case: Occasion) -> StatedTruth | None:  # noqa: D102 - documented in the base class
        return StatedTruth(self.label, first_right=True) if case.plain else None


class Honest(Habit):
    """Executes all steps in order, and repeats a step after a miss.

    The true label is success, or timeout or execution_failure if the trial fails.
    """

    name = "honest"
    label = HONEST

    def truth(self, case: Occasion) -> StatedTruth | None:  # noqa: D102 - documented in the base class
        return StatedTruth(HONEST, first_right=True if case.first_thing() else None)

    def act(self, body: Body) -> Actions[None]:  # noqa: D102 - documented in the base class
        yield from body.solve()
