"""Templates, conditions, predicates, goals and the tasks of the suite; everything here is value or pure function."""

from betterbench.tasks import suite
from betterbench.tasks.axes import Axis, Expected, Support
from betterbench.tasks.condition import Condition, ObjectSpec, Place, Slot
from betterbench.tasks.goal import GoalTracker, Truth
from betterbench.tasks.premise import broken_premises
from betterbench.tasks.randomness import SUITE_VERSION, stream
from betterbench.tasks.regime import Regime, regime_of
from betterbench.tasks.registry import all_tasks, environment_id, get_task, suite_tasks, task_names
from betterbench.tasks.subgoal import Instruction, Reference, Subgoal
from betterbench.tasks.task import Task
from betterbench.tasks.template import ObjectGroup, Template
from betterbench.tasks.templates import TEMPLATES
from betterbench.tasks.thresholds import THRESHOLDS, Thresholds
from betterbench.tasks.variation import Intervention, Variation, do

__all__ = [
    "SUITE_VERSION",
    "TEMPLATES",
    "THRESHOLDS",
    "Axis",
    "Condition",
    "Expected",
    "GoalTracker",
    "Instruction",
    "Intervention",
    "ObjectGroup",
    "ObjectSpec",
    "Place",
    "Reference",
    "Regime",
    "Slot",
    "Subgoal",
    "Support",
    "Task",
    "Template",
    "Thresholds",
    "Truth",
    "Variation",
    "all_tasks",
    "broken_premises",
    "do",
    "environment_id",
    "get_task",
    "regime_of",
    "stream",
    "suite",
    "suite_tasks",
    "task_names",
]
