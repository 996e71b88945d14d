"""Plan of a run for a suite of any benchmark, such as LIBERO."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from betterbench.errors import BetterError, InvalidInputError, UnknownNameError
from betterbench.evaluation.planning.plan import Plan
from betterbench.policies.kinds import kind_of
from betterbench.sim.worlds import PlanRequest, World, world_of_suite
from betterbench.tasks import Expected
from betterbench.tasks.trial import Trial
from betterbench.tasks.user_files import explaining
from betterbench.tasks.worlds.facts import known_facts


def make_world_plan(
    policy: str,
    *,
    suite: str,
    tasks: Sequence[str] = (),
    trials: int | None = None,
    seed: int = 0,
    action_space: str | None = None,
    observation: str = "default",
    **options: Any,  # noqa: ANN401 - options of the world
) -> Plan:
    """Return the plan of a run for a suite of any benchmark.

    The benchmark (called "world" in the code) lists the tasks of the suite.

    Args:
        policy: Address of the policy.
        suite: Name of the suite.
        tasks: Tasks to run. By default, all tasks of the suite.
        trials: Number of trials, in the unit of the benchmark (trials per variation, initial states, or chains of
            subtasks). None selects the benchmark's standard number.
        seed: First seed, or index of the first initial state or chain.
        action_space: Action space of the policy. None selects the action space that the policy address declares or, if
            it declares none, the standard action space of the benchmark.
        observation: Name of an observation preset. "default" selects the standard preset of the benchmark.
        options: Options of the benchmark (``World.options``).

    Raises:
        InvalidInputError: If a number is out of range, or the policy cannot act in this benchmark.
        UnknownNameError: If a name is unknown.
        MissingDependencyError: If the benchmark is not installed.
        WorldError: If the simulator of the benchmark does not respond.
    """
    world = world_of_suite(suite)
    title = world.facts.title
    if observation not in world.observations:
        raise UnknownNameError(f"observation preset of {title}", observation, world.observations)
    kind = kind_of(policy)
    kind.require_world(kind.parse(policy), known_facts().get(world.dialect, world.facts).title)
    space = _action_space(policy, world, action_space)
    planned, used = _planned(world, PlanRequest(suite, tuple(tasks), trials, seed, options))
    return Plan(policy, planned, space, world.observations[observation], "standard", world=used)


def _action_space(policy: str, world: World, asked: str | None) -> str:
    """Return the requested action space, else the policy's action space, else the default of the benchmark."""
    if asked is not None:
        if asked not in world.action_spaces:
            raise UnknownNameError(f"action space of {world.name}", asked, world.action_spaces)
        return asked
    kind = kind_of(policy)
    return kind.space_of(kind.parse(policy, world=world.dialect)) or world.action_spaces[0]


def _planned(world: World, asked: PlanRequest) -> tuple[tuple[Trial, ...], World]:
    """Return the trials and the world that :meth:`World.plan` returns for a request, after checking them.

    Raises:
        UnknownNameError: If none of the requested tasks exists.
        InvalidInputError: If no trial is planned, or if the world's code is wrong.
    """
    found: tuple[tuple[Trial, ...], World] | BetterError
    with explaining("world", world.name):
        try:
            found = world.plan(asked)
        except BetterError as error:  # caused by the user's options, not by the file that defines the world
            found = error
        else:
            _require_plan(world, asked, found)
    if isinstance(found, BetterError):
        raise found
    trials, used = found
    if not trials and asked.tasks:
        whole, _ = _planned(world, replace(asked, tasks=()))
        known = dict.fromkeys(t.task for t in whole)
        raise UnknownNameError("task", next((task for task in asked.tasks if task not in known), asked.tasks[0]), known)
    if not trials:
        problem = f"{world.facts.title} plans no trial"
        raise InvalidInputError(f"suite {asked.suite!r}", problem, "Choose other values of --trials and --seed")
    return tuple(trials), used


def _require_plan(world: World, asked: PlanRequest, found: object) -> None:
    """Check the form of the result of :meth:`World.plan`, and the tasks and expectations of its trials."""
    where = f"plan of world {world.name!r}"
    if not isinstance(found, tuple) or len(found) != 2 or getattr(found[1], "name", None) != world.name:
        kind = f"a {type(found).__name__} of {len(found)}" if isinstance(found, tuple | list) else repr(found)[:80]
        raise InvalidInputError(where, f"it returned {kind}", "It must return (trials, world)")
    if not isinstance(found[0], tuple | list) or not all(isinstance(trial, Trial) for trial in found[0]):
        raise InvalidInputError(where, "the first item that it returned is not a tuple of Trial", "Return such a tuple")
    suite = world.facts.suites.get(asked.suite)
    training: dict[str, dict[str, None]] = {}  # conditions of each task, in order
    for trial in found[0]:
        if trial.variation is None:
            training.setdefault(trial.task, {})[trial.condition] = None
    for trial in found[0]:
        known = training.get(trial.task, {})  # a suite may have variations only
        if trial.variation is not None and known and trial.base_condition not in known:
            kind = f"base_condition (a training condition of {trial.task})"
            raise UnknownNameError(kind, str(trial.base_condition), known)
        if trial.expected not in tuple(Expected):
            raise InvalidInputError(
                where,
                f"a trial has expected={trial.expected!r}",
                f"Use one of {', '.join(map(repr, map(str, Expected)))}",
            )
        if suite is None or world.facts.measured:
            continue  # betterbench's own tasks have names without a suite
        if trial.task != suite.base and not trial.task.startswith(f"{suite.base}-"):
            problem = f"task {trial.task!r} of suite {suite.name!r} does not begin with its base, {suite.base!r}"
            raise InvalidInputError(where, problem, f"Call it '{suite.base}-...', or change the base of the suite")
