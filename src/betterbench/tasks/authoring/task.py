"""Tasks, each with its fixtures, slots, training conditions and variations.

The training conditions contain confounds.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

from betterbench.errors import find_named
from betterbench.interface.actions import USUAL_ROBOT
from betterbench.tasks.authoring.condition_matrix import ConditionMatrix
from betterbench.tasks.authoring.regimes import ListedRegime
from betterbench.tasks.authoring.template import Template
from betterbench.tasks.authoring.variation import Variation
from betterbench.tasks.condition import Condition, Slot


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """Base task with its training conditions and variations.

    Attributes:
        version: Version of the task's behavior. It is incremented if a goal, a tolerance or an instruction changes.
        title: Title for tables and cards.
        template: Constraint template of the task.
        slots: Start positions on the table.
        training: Training conditions. The registry names them train1, train2, ... in this order.
        variations: Variations of the training conditions.
        id: Identifier ("fast_food"). The registry sets it to the name of the decorated function.
        description: Description of the task. The registry sets it to the first line of that function's docstring.
        regimes: Listed regimes by name, such as "balanced" and "diverse-confounded".
        robot: Name of the robot that the slots are laid out for.
        matrices: Diagnostic matrices with conditions of the task as cells.
    """

    version: int
    title: str
    template: Template
    slots: tuple[Slot, ...]
    training: tuple[Condition, ...]
    variations: tuple[Variation, ...]
    id: str = ""
    description: str = ""
    regimes: Mapping[str, ListedRegime] = field(default_factory=dict)
    robot: str = USUAL_ROBOT
    matrices: tuple[ConditionMatrix, ...] = ()

    def slot(self, name: str) -> Slot:
        """Return a slot by its name.

        Raises:
            UnknownNameError: If the task has no such slot.
        """
        return find_named(f"slot of {self.id}", name, self.slots)

    def train(self, name: str) -> Condition:
        """Return a training condition by its name.

        Raises:
            UnknownNameError: If the task has no such training condition.
        """
        return find_named(f"training condition of {self.id}", name, self.training)

    def variation(self, name: str) -> Variation:
        """Return a variation by its name.

        Raises:
            UnknownNameError: If the task has no such variation.
        """
        return find_named(f"variation of {self.id}", name, self.variations)

    def step_limit(self, condition: Condition) -> int:
        """Return the maximum number of control steps of an episode in a condition."""
        return self.template.step_limit(condition)
