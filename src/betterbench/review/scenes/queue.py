"""Queue of the scenes to review.

Each condition of a task has one scene. A scene is built when it is shown for the first time.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.jobs.decisions import Verdict
from betterbench.review.scenes.changes import SceneChange, SceneHistory, verdict_on
from betterbench.review.scenes.forms import patched, scene_content, task_content
from betterbench.tasks import Condition, Support, Task, get_task, task_from_json
from betterbench.tasks.authoring.task_form import task_forms
from betterbench.tasks.interventions.apply import vary
from betterbench.tasks.interventions.resolve import condition_names

MOST_SCENES = 10_000


@dataclass(frozen=True, slots=True, eq=False)
class ReviewedTask:
    """Task that is being reviewed.

    Attributes:
        form: JSON form of the task without changes.
        content: Hash of the JSON form.
    """

    form: Mapping[str, Any]
    content: str

    @property
    def name(self) -> str:
        """Name of the task."""
        return str(self.form["id"])

    def changed(self, changes: Sequence[SceneChange]) -> Task:
        """Return the task with changes applied, but with its original version number.

        The version number is kept because the demonstrations of the task were measured for that version.

        Raises:
            InvalidInputError: If the changes were made to a different task.
        """
        return _changed(self, tuple(changes))


@functools.lru_cache(maxsize=64)
def _changed(reviewed: ReviewedTask, changes: tuple[SceneChange, ...]) -> Task:
    form = {**patched(reviewed.form, changes, where=reviewed.name), "version": reviewed.form["version"]}
    return task_from_json(form, where=reviewed.name)


@dataclass(frozen=True, slots=True, eq=False)
class QueuedScene:
    """Scene in the queue: one condition (training or variation) of a task."""

    task: ReviewedTask
    condition: str

    @property
    def name(self) -> str:
        """Name of the scene on the page."""
        return f"{self.task.name}/{self.condition}"

    def verdict(self, history: SceneHistory) -> Verdict | None:
        """Return the current verdict on the scene, or None if it has none."""
        changed = self.task.changed(history.changes)
        scene = scene_content(changed, condition_of(changed, self.condition), history.changes)
        return verdict_on(history, self.condition, scene)


def condition_of(task: Task, name: str) -> Condition:
    """Return a condition (training or variation) of a task by its name. The task does not have to be registered.

    Raises:
        UnknownNameError: If the task has no such condition.
    """
    if name in {condition.name for condition in task.training}:
        return task.train(name)
    return vary(task, task.variation(name))[0]


def support_of(task: Task, name: str) -> Support:
    """Return the support ("seen" or "novel") that a task declares for a condition (training or variation).

    The support is "seen" if the poses in the condition occur in training, and "novel" otherwise.
    """
    return next((v.support for v in task.variations if v.name == name), Support.SEEN)


def scene_queue(given: Iterable[str]) -> list[QueuedScene]:
    """Return the review queue for tasks ("my_lunch", with all conditions) and for single conditions ("my_lunch/L1").

    Raises:
        InvalidInputError: If no task is given, or there are too many scenes.
        UnknownNameError: If a task or a condition does not exist.
    """
    names: dict[tuple[str, str], None] = {}
    for text in given:
        task, slash, condition = text.partition("/")
        known = condition_names(get_task(task))
        if slash and condition not in known:
            raise UnknownNameError(f"condition of {task}", condition, known)
        names.update(dict.fromkeys((task, name) for name in ([condition] if slash else known)))
    if not names:
        cure = "Pass tasks or conditions, for example my_lunch/L1, or use --suite or --task-file"
        raise InvalidInputError("review scenes", "no task is given", cure)
    if len(names) > MOST_SCENES:
        raise InvalidInputError(
            "review scenes", f"{len(names):,} scenes are too many", f"Review at most {MOST_SCENES:,} at once"
        )
    forms = task_forms(dict.fromkeys(task for task, _ in names))
    tasks = {name: ReviewedTask(form, task_content(form)) for name, form in forms.items()}
    return [QueuedScene(tasks[task], condition) for task, condition in names]
