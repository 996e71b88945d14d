"""Registry of tasks.

Tasks are registered by decorating the functions that build them. Commands, task cards and tests are derived from the
registry.
"""

import dataclasses
import functools
import inspect
import types
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager

from betterbench.errors import (
    InvalidInputError,
    Place,
    UnknownNameError,
    errors_explained,
    name_taken,
    one_line,
    registering_place,
)
from betterbench.tasks.authoring.no_test import require_no_test
from betterbench.tasks.authoring.readable import require_readable
from betterbench.tasks.authoring.regimes import ListedRegime, named_regimes
from betterbench.tasks.authoring.task import Task
from betterbench.tasks.suite_folder import is_suite_folder, read_suite_folder
from betterbench.tasks.user_files import explaining, load_declared, load_task_files, registered

_BUILDERS: dict[str, Callable[[], Task]] = {}
_REGISTERED_AT: dict[str, tuple[str, Place]] = {}
"""Module and place that registered each task."""
_REGIME_SOURCES: list[Callable[[str], Mapping[str, ListedRegime]]] = []


def task(build: Callable[[], Task]) -> Callable[[], Task]:
    """Register a function that returns a task, under the function's name. This is used as a decorator.

    The function that it returns raises InvalidInputError if a training condition does not follow the task's template.

    Raises:
        InvalidInputError: If another file has registered a task of the same name.
    """
    name, module, here = build.__name__, build.__module__, registering_place()
    explained = registered("task", name, build, _BUILDERS)
    own = explained is not build  # a user's file, whose names registered() has checked
    if not own and name in _BUILDERS and module != _REGISTERED_AT[name][0]:
        raise name_taken(f"task {name!r}", _REGISTERED_AT[name][1], here)

    @functools.cache
    def complete() -> Task:
        with explaining("task", name) if own else errors_explained(here.file):
            made = explained()
            whole = named_task(made, name, (inspect.getdoc(build) or made.title).partition("\n")[0])
        _require_pattern(whole, inspect.unwrap(build).__code__)
        return whole

    _BUILDERS[name], _REGISTERED_AT[name] = functools.wraps(build)(complete), (module, here)
    return _BUILDERS[name]


def places_of_tasks() -> set[Place]:
    """Return the places at which tasks have been registered."""
    return {place for _, place in _REGISTERED_AT.values()}


def named_task(made: Task, name: str, description: str) -> Task:
    """Return a task with its id and description, and with names for its training conditions.

    Raises:
        InvalidInputError: If a text of the task contains characters that cannot be shown, or if a condition of a regime
            is also a test condition.
    """
    numbered = enumerate(made.training, start=1)
    training = tuple(dataclasses.replace(c, task=name, name=f"train{i}") for i, c in numbered)
    regimes = named_regimes(_regimes_of(made, name), name)
    whole = dataclasses.replace(made, id=name, description=description, training=training, regimes=regimes)
    require_readable(whole)
    require_no_test(whole)
    return whole


def _require_pattern(whole: Task, code: types.CodeType) -> None:
    """Check that the training conditions of a task follow its template; ``code`` is the code that makes the task."""
    for i, condition in enumerate(whole.training):
        problems = whole.template.problems(condition)
        if problems:
            where = f"{code.co_filename}, line {code.co_firstlineno}, task {whole.id}: training[{i}]"
            cure = f"Follow the template {whole.template.name}, or give the task a template whose `groups` allow this"
            raise InvalidInputError(where, one_line("; ".join(problems), most=400), cure)


@contextmanager
def registered_for_now(made: Task) -> Iterator[Task]:
    """Context manager that registers a task under its id, so that it can be checked before its file is written.

    Raises:
        InvalidInputError: If there is already a task with this id.
    """
    load_declared()
    if made.id in _BUILDERS:
        raise InvalidInputError(
            f"task {made.id}", "a task with this name already exists", "Give the task a different name"
        )
    whole = named_task(made, made.id, made.description)
    _BUILDERS[made.id] = lambda: whole
    try:
        yield whole
    finally:
        del _BUILDERS[made.id]


def _regimes_of(made: Task, name: str) -> dict[str, ListedRegime]:
    """Return the regimes that belong to a task, whether they are in the task itself or in separate files.

    Regimes that the task only inherited from another task are left out.
    """
    found = {regime: listed for source in _REGIME_SOURCES for regime, listed in source(name).items()}
    owners = {condition.task for listed in made.regimes.values() for condition in listed.conditions}
    inherited = any(owner in _BUILDERS and _BUILDERS[owner]().regimes is made.regimes for owner in owners - {name})
    return found if inherited else found | dict(made.regimes)


def regimes_from(source: Callable[[str], Mapping[str, ListedRegime]]) -> Callable[[str], Mapping[str, ListedRegime]]:
    """Register a function that takes the name of a task and returns the regimes of this task.

    It is used for regimes that are in separate files.
    """
    _REGIME_SOURCES.append(source)
    return source


def get_task(name: str) -> Task:
    """Return a task by its id.

    Raises:
        UnknownNameError: If there is no such task.
    """
    load_declared()
    if name not in _BUILDERS:
        raise UnknownNameError("task", name, _BUILDERS)
    return _BUILDERS[name]()


def notes_of(name: str) -> str:
    """Return the notes in a task's docstring, for example about randomization, success and premise.

    Raises:
        UnknownNameError: If there is no such task.
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
    ),
    "real_world": ("fruit_basket",),
    "so101": ("cheeseburger_so101",),
}
"""Tasks of each packaged suite, by the suite's name. The tasks are in the order of the suite's table.

A new task belongs to a suite only when the suite lists it.
"""


def suite_of(task: str) -> str | None:
    """Return the name of the packaged suite that lists a task, or None if no suite does."""
    return next((name for name, tasks in SUITES.items() if task in tasks), None)


def suite_tasks(name: str) -> tuple[str, ...]:
    """Return the ids of the tasks in a suite.

    Args:
        name: Name of a packaged suite, or path of a suite folder. If it is a folder, its tasks are loaded.

    Raises:
        UnknownNameError: If there is no such suite.
        InvalidInputError: If a file in the folder is damaged, or if the name of one of its tasks is already taken.
    """
    if name not in SUITES and is_suite_folder(name):
        load_task_files([name])
        return read_suite_folder(name).tasks
    if name not in SUITES:
        raise UnknownNameError("suite", name, SUITES)
    return SUITES[name]


def built_in_suite(tasks: Iterable[str]) -> str:
    """Return the packaged suite that contains all given tasks.

    If there is no such suite, or no task is given, return "better60".
    """
    named = set(tasks)
    return next((suite for suite, known in SUITES.items() if named <= set(known)), next(iter(SUITES)))


def environment_id(task: str) -> str:
    """Return the Gymnasium id of a task, for example "BeTTER/FastFood-v0" for "fast_food"."""
    return f"BeTTER/{''.join(part.capitalize() for part in task.split('_'))}-v0"
