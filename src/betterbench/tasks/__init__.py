"""Templates, conditions, relations, goals and the tasks of the suite; everything here is value or pure function."""

from betterbench.tasks import suite
from betterbench.tasks.axes import Axis, Expected, Support
from betterbench.tasks.condition import Condition, ObjectSpec, Slot, TargetRegion
from betterbench.tasks.goal import GoalTracker, Truth
from betterbench.tasks.labels import Kind, Label, all_labels, new_label, remove_label
from betterbench.tasks.looks import LOOKS, Looks, looks_named
from betterbench.tasks.operations import Changes, Operation, operation_names
from betterbench.tasks.premise import broken_premises
from betterbench.tasks.randomness import SUITE_VERSION, stream
from betterbench.tasks.registry import all_tasks, environment_id, get_task, suite_tasks, task_names
from betterbench.tasks.subgoal import Instruction, Reference, Subgoal
from betterbench.tasks.task import Task
from betterbench.tasks.template import ObjectGroup, Template
from betterbench.tasks.templates import TEMPLATES
from betterbench.tasks.thresholds import THRESHOLDS, Threshold, Thresholds, threshold, threshold_table
from betterbench.tasks.training_distribution import TrainingDistribution, training_distribution_of
from betterbench.tasks.trial_id import TrialId
from betterbench.tasks.variation import Variation

__all__ = [
    "LOOKS",
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
    "Looks",
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
    "Threshold",
    "Thresholds",
    "TrainingDistribution",
    "TrialId",
    "Truth",
    "Variation",
    "all_labels",
    "all_tasks",
    "broken_premises",
    "environment_id",
    "get_task",
    "looks_named",
    "new_label",
    "operation_names",
    "remove_label",
    "stream",
    "suite",
    "suite_tasks",
    "task_names",
    "threshold",
    "threshold_table",
    "training_distribution_of",
]
