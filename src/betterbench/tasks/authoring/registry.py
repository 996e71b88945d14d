"""Registry of tasks.

Decorated functions register tasks; commands, task cards and tests are derived from the registry.
"""

import dataclasses
import functools
import inspect
from collections.abc import Callable

from betterbench.errors import UnknownNameError
from betterbench.tasks.authoring.readable import require_readable
from betterbench.tasks.authoring.task import Task
from betterbench.tasks.suite_folder import is_suite_folder, read_suite_folder
from betterbench.tasks.user_files import load_declared, load_task_files, registered

_BUILDERS: dict[str, Callable[[], Task]] = {}


def task(build: Callable[[], Task]) -> Callable[[], Task]:
    """Register a function that returns a task, under the function's name.

    Raises:
        InvalidInputError: If another file has registered a task of the same name.
    """
    name = build.__name__
    explained = registered("task", name, build, _BUILDERS)

    @functools.cache
    def complete() -> Task:
        made = explained()
        numbered = enumerate(made.training, start=1)
        training = tuple(dataclasses.replace(c, task=name, name=f"train{i}") for i, c in numbered)
        description = (inspect.getdoc(build) or made.title).partition("\n")[0]
        whole = dataclasses.replace(made, id=name, description=description, training=training)
        require_readable(whole)
        return whole

    _BUILDERS[name] = functools.wraps(build)(complete)
    return _BUILDERS[name]


def get_task(name: str) -> Task:
    """Return a task by id.

    Raises:
        UnknownNameError: If the task does not exist.
    """
    load_declared()
    if name not in _BUILDERS:
        raise UnknownNameError("task", name, _BUILDERS)
    return _BUILDERS[name]()


def notes_of(name: str) -> str:
    """Return the notes in the docstring of a task: randomizations, success and premise.

    Raises:
        UnknownNameError: If the task does not exist.
    """
    get_task(name)
    return inspect.getdoc(_BUILDERS[name]) or ""


def task_names() -> tuple[str, ...]:
    """Return the ids of all tasks, sorted."""
    load_declared()
    return tuple(sorted(_BUILDERS))


def all_tasks() -> tuple[Task, ...]:
    """Return all tasks, sorted by id."""
    return tuple(get_task(name) for name in task_names())


SUITES: dict[str, tuple[str, ...]] = {
    "better60": (
        "desk_meeting",
        "breakfast_table",
        "fruit_lunch",
        "fast_food",
        "tidy_desk",
        "morning_coffee",
        "office_drawer",
        "cheeseburger",
        "seasoning_rack",
        "dinner_plates",
    )
}
"""Suites by name: their tasks in the order of the table. A new task belongs to a suite only when the suite lists it."""


def suite_tasks(name: str) -> tuple[str, ...]:
    """Return the ids of a suite's tasks.

    Args:
        name: Name of a packaged suite, or the path of a suite folder, whose tasks are loaded.

    Raises:
        UnknownNameError: If the suite does not exist.
        InvalidInputError: If a file in the folder is damaged, or one of its tasks has a name that is taken.
    """
    if name not in SUITES and is_suite_folder(name):
        load_task_files([name])
        return read_suite_folder(name).tasks
    if name not in SUITES:
        raise UnknownNameError("suite", name, SUITES)
    return SUITES[name]


def environment_id(task: str) -> str:
    """Return the Gymnasium id of a task ("fast_food" to "BeTTER/FastFood-v0")."""
    return f"BeTTER/{''.join(part.capitalize() for part in task.split('_'))}-v0"
