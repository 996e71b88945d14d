"""Variations as data, with a training condition, the operations that change it, and the tested ability."""

from dataclasses import dataclass

from betterbench.tasks.authoring.operations import Operation
from betterbench.tasks.axes import Axis, Expected, Support


@dataclass(frozen=True, slots=True)
class Variation:
    """Test condition, made from a training condition by operations.

    Attributes:
        name: Letter of the axis and running number ("L3").
        interventions: Operations, applied in order.
        title: Short description of the difference from training, for tables.
        hypothesis: Ability that a success demonstrates.
        base: Name of the training condition. Its trial with the same seed is the counterfactual twin.
        support: Whether all poses are inside the training distribution.
        watch_steps: Control steps for which the episode continues after the goal is met. A grasp attempt in this time
            is a failure.
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
    watch_steps: int = 0

    def __post_init__(self) -> None:
        """Check that the name begins with the letter of an axis."""
        Axis.of(self.name)

    @property
    def axis(self) -> Axis:
        """Axis of the intervention, from its name."""
        return Axis.of(self.name)
