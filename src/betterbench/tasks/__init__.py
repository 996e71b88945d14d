"""Templates, conditions, relations, goals and the tasks of the suite; everything here is value or pure function."""

from betterbench.tasks import suite
from betterbench.tasks.axes import Axis, Expected, Support
from betterbench.tasks.condition import Condition, ObjectSpec, Slot, TargetRegion
from betterbench.tasks.goal import GoalTracker, Truth
from betterbench.tasks.labels import Kind, Label
from betterbench.tasks.operations import Changes, Operation, operation_names
from betterbench.tasks.premise import broken_premises
from betterbench.tasks.randomness import SUITE_VERSION, stream
from betterbench.tasks.registry import all_tasks, environment_id, get_task, suite_tasks, task_names
from betterbench.tasks.subgoal import Instruction, Reference, Subgoal
from betterbench.tasks.task import Task
from betterbench.tasks.template import ObjectGroup, Template
from betterbench.tasks.templates import TEMPLATES
from betterbench.tasks.thresholds import THRESHOLDS, Thresholds
from betterbench.tasks.training_distribution import TrainingDistribution, training_distribution_of
from betterbench.tasks.trial_id import TrialId
from betterbench.tasks.variation import Variation

__all__ = [
    "SUITE_VERSION",
    "TEMPLATES",
    "THRESHOLDS",
    "Axis",
    "Changes",
    "Condition",
    "Expected",
    "GoalTracker",
    "Instruction",
    "Kind",
    "Label",
    "ObjectGroup",
    "ObjectSpec",
    "Operation",
    "Reference",
    "Slot",
    "Subgoal",
    "Support",
    "TargetRegion",
    "Task",
    "Template",
    "Thresholds",
    "TrainingDistribution",
    "TrialId",
    "Truth",
    "Variation",
    "all_tasks",
    "broken_premises",
    "environment_id",
    "get_task",
    "operation_names",
    "stream",
    "suite",
    "suite_tasks",
    "task_names",
    "training_distribution_of",
]
