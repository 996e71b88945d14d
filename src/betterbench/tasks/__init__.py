"""Tasks as values and pure functions: setup, instruction and success condition.

- ``condition``, ``axes``, ``subgoal``, ``thresholds``: the values that conditions are made of.
- ``relations``: one file per relation ("inside", "beside"), with its check and its placements.
- ``authoring``: templates, variations and the task registry, for writing tasks.
- ``suite``: the tasks of better60, with one file per task.
- ``regimes``: further sets of training conditions for these tasks (called listed regimes).
- ``judging``: goals, grasp attempts, restraint, harm and premises, judged from world states.
- ``interventions``: functions that find conditions by name or by regime.
- ``worlds``: suites and protocols of LIBERO, LIBERO-Plus and CALVIN, as data.
"""

from betterbench.tasks import regimes as regimes  # adds the regimes of the suite to its tasks
from betterbench.tasks import suite
from betterbench.tasks.authoring.operations import Changes, Operation, operation_names
from betterbench.tasks.authoring.registry import (
    all_tasks,
    built_in_suite,
    environment_id,
    get_task,
    suite_of,
    suite_tasks,
    task_names,
)
from betterbench.tasks.authoring.task import Task
from betterbench.tasks.authoring.task_form import task_from_json, task_to_json
from betterbench.tasks.authoring.template import ObjectGroup, Template
from betterbench.tasks.authoring.template_form import template_from_json, template_to_json
from betterbench.tasks.authoring.templates import TEMPLATES
from betterbench.tasks.authoring.training_distribution import TrainingDistribution, training_distribution_of
from betterbench.tasks.authoring.variation import Variation
from betterbench.tasks.axes import Axis, Expected, Support
from betterbench.tasks.condition import Condition, ObjectSpec, Slot, TargetRegion
from betterbench.tasks.judging.goal import GoalTracker
from betterbench.tasks.judging.premise import broken_premises
from betterbench.tasks.judging.truth import Truth
from betterbench.tasks.labels import Kind, Label, all_labels, new_label, remove_label
from betterbench.tasks.looks import LOOKS, Looks, looks_named
from betterbench.tasks.randomness import SUITE_VERSION, stream
from betterbench.tasks.subgoal import Instruction, Reference, Subgoal
from betterbench.tasks.suite_folder import SuiteFolder, read_suite_folder, require_suite_name, suite_files
from betterbench.tasks.thresholds import THRESHOLDS, Threshold, Thresholds, threshold, threshold_table
from betterbench.tasks.trial_id import TrialId

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
    "SuiteFolder",
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
    "built_in_suite",
    "environment_id",
    "get_task",
    "looks_named",
    "new_label",
    "operation_names",
    "read_suite_folder",
    "remove_label",
    "require_suite_name",
    "stream",
    "suite",
    "suite_files",
    "suite_of",
    "suite_tasks",
    "task_from_json",
    "task_names",
    "task_to_json",
    "template_from_json",
    "template_to_json",
    "threshold",
    "threshold_table",
    "training_distribution_of",
]
