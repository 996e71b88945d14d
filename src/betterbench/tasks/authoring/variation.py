"""Variations as data.

Each has a training condition, operations that change it, and the ability that the change tests.
"""

from dataclasses import dataclass

from betterbench.tasks.authoring.operations import Operation
from betterbench.tasks.axes import Axis, Expected, Support


@dataclass(frozen=True, slots=True)
class Variation:
    """Test condition that is made from a training condition by applying operations to it.

    Attributes:
        name: Letter of the axis and a number ("L3").
        interventions: Operations, in the order in which they are applied.
        title: Short description of the difference from training, for tables.
        hypothesis: Ability that a success demonstrates.
        base: Name of the training condition. The trial of this condition with the same seed is the counterfactual twin.
        expected: Behavior expected from a policy that understands the instruction.
        support: Whether all poses in the variation are within the training distribution.
        mid_task_look: Whether the initial state looks like the middle of a demonstration.
        premise_broken: Whether a premise of the instruction is deliberately false.
        watch_steps: Number of control steps that the episode continues after the goal is met. A grasp attempt during
            these steps is a failure.
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
        """Axis along which this variation changes the task. The first letter of the name determines it."""
        return Axis.of(self.name)
