"""Registry of facts about worlds. With these facts, a run can be read without the simulator of its world.

The worlds that run trials are in :mod:`betterbench.sim.worlds`. Registering a world there registers its facts here.
"""

from __future__ import annotations

import functools
import importlib
import pkgutil
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from pydantic import TypeAdapter

from betterbench.errors import InvalidInputError, RecordError
from betterbench.json_form import open_form, read_form
from betterbench.tasks.suite_folder import is_suite_folder

Reading = Literal["conditions", "goals", "outcomes", "chains"]
"""How the diagnosis evaluates the records of a world.

- "conditions": with the conditions of betterbench's own tasks.
- "goals": with the goals and starts in LIBERO's files.
- "outcomes": only the success of each trial is used.
- "chains": trials get no labels. The success rates of subtasks are counted instead.
"""


@open_form
@dataclass(frozen=True, slots=True)
class Suite:
    """Suite of a world.

    Attributes:
        name: Name on the command line ("libero_spatial_swap").
        base: Name of the suite that is changed, or ``name`` for a suite without changes.
        change: Name of the change ("swap"), or None for a suite without changes.
        tasks: Number of tasks.
        summary: Description in one phrase.
    """

    name: str
    base: str
    change: str | None
    tasks: int
    summary: str


@open_form
@dataclass(frozen=True, slots=True, kw_only=True)
class WorldFacts:
    """Facts about a world.

    Attributes:
        name: Name in plans and on the command line ("libero").
        title: Name in messages ("LIBERO").
        suites: Suites by name. The tasks of a suite are called "BASE-...", where BASE is the suite's ``base``.
        reading: How the diagnosis evaluates the records.
        measured: Whether the tasks are covered by certificates, the power matrix, calibrations and demonstrations, and
            whether a stored plan can be run again.
        statements: Statements that a report makes about the scenes and about the accuracy of the labels, by heading.
    """

    name: str
    title: str
    suites: Mapping[str, Suite] = field(default_factory=dict)
    reading: Reading = "outcomes"
    measured: bool = False
    statements: Mapping[str, str] = field(default_factory=dict)

    @property
    def judges_causes(self) -> bool:
        """Whether the causes of failures are judged, and not only the outcome of each trial."""
        return self.reading != "outcomes"

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict."""
        return asdict(self)


OUR_SUITE = "better60"

OURS = WorldFacts(
    name="betterbench",
    title="betterbench",
    suites={
        OUR_SUITE: Suite(OUR_SUITE, OUR_SUITE, None, 10, "tasks with six variations each"),
        "real_world": Suite("real_world", "real_world", None, 1, "the paper's two matrices, for the SO-101"),
        "so101": Suite("so101", "so101", None, 1, "tasks of better60, laid out for the SO-101"),
    },
    reading="conditions",
    measured=True,
)
"""Facts about betterbench's own scenes. Their tasks are in :mod:`betterbench.tasks.suite`, or are defined by users."""

_FACTS: dict[str, WorldFacts] = {OURS.name: OURS}
_STORED = TypeAdapter(WorldFacts)


def register_facts(facts: WorldFacts) -> WorldFacts:
    """Register the facts about a world, and return them.

    Raises:
        InvalidInputError: If another world has the same name, or has a suite with the same name.
    """
    for known in _FACTS.values():
        taken = [suite for suite in facts.suites if suite in known.suites]
        if known.name != facts.name and taken:
            raise InvalidInputError(
                f"world {facts.name!r}", f"{known.name} also has a suite {taken[0]!r}", "Rename one of the two suites"
            )
    if _FACTS.setdefault(facts.name, facts) != facts:
        raise InvalidInputError(f"world {facts.name!r}", "another world has this name", "Rename one of the two worlds")
    return facts


def forget_facts(name: str) -> None:
    """Remove the facts about a world from the registry. This is meant for tests."""
    _FACTS.pop(name, None)


def known_facts() -> Mapping[str, WorldFacts]:
    """Return the facts about all registered worlds, by name. betterbench's own world comes first."""
    _import_built_in()
    return _FACTS


@functools.cache
def _import_built_in() -> None:
    """Import the modules that register the built-in worlds."""
    package = importlib.import_module("betterbench.tasks.worlds")
    for module in pkgutil.iter_modules(package.__path__):
        importlib.import_module(f"{package.__name__}.{module.name}")


def facts_of_suite(suite: str) -> WorldFacts | None:
    """Return the facts about the world of a suite, or None if no known world has this suite.

    For the path of a suite folder, the facts are those of betterbench's own world.
    """
    if suite in OURS.suites or is_suite_folder(suite):
        return OURS  # nothing about other worlds needs to be read
    return next((facts for facts in known_facts().values() if suite in facts.suites), None)


def facts_of_task(task: str) -> WorldFacts:
    """Return the facts about the world of a task ("libero_object-03").

    If no other world has such a task, the facts are those of betterbench's own world.
    """
    base = task.rpartition("-")[0]
    return next((facts for facts in known_facts().values() if base and base in facts.suites), OURS)


def outcomes_note(title: str) -> str:
    """Return the note on a world in which the causes of failures are not judged."""
    return f"In {title}, only the end of each trial is judged, not the cause of a failure."


def facts_of_plan(plan: Mapping[str, Any], *, where: str) -> WorldFacts:
    """Return the facts about the world of a stored plan, and register them if the plan contains them.

    Args:
        plan: Plan of the run.
        where: Name of the plan's file in messages.

    Raises:
        RecordError: If the plan names an unknown world without describing it.
    """
    if "world" not in plan:
        return OURS
    world = plan["world"]
    name = world.get("name") if isinstance(world, dict) else None
    known = known_facts()
    if isinstance(name, str) and name in known:
        return known[name]
    stored = world.get("facts") if isinstance(world, dict) else None
    cure = f"Restore the file, or use one of the worlds {', '.join(known)}"
    found = read_form(_STORED, stored, where=f"{where}: plan.world.facts", cure=cure, raises=RecordError)
    return register_facts(found)
