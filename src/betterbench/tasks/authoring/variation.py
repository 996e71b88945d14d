"""Variations as data: a training condition, the operations that change it, and the meaning of a failure."""

from dataclasses import dataclass

from betterbench.tasks.authoring.operations import Operation
from betterbench.tasks.axes import Axis, Expected, Support


@dataclass(frozen=True, slots=True)
class Variation:
    """Variation: a training condition that operations turn into a test condition.

    Attributes:
        name: Letter of the axis and running number ("L3").
        interventions: Operations, applied in order.
        title: Difference from training in a few words, for tables.
        hypothesis: Ability that a success shows.
        base: Name of its training condition; the same seed of it is the counterfactual twin.
        support: Whether all poses lie inside the training regime.
    """

    name: str
    interventions: tuple[Operation, ...]
    title: str
    hypothesis: str
    base: str = "train1"
    expected: Expected = Expected.SUCCEED
    support: Support = Support.SEEN
    mid_task_look: bool = False
    premise_broken: bool = False

    def __post_init__(self) -> None:
        """Check that the name begins with the letter of an axis."""
        Axis.of(self.name)

    @property
    def axis(self) -> Axis:
        """Axis of the intervention, from its name."""
        return Axis.of(self.name)
