"""Plan of a run for a suite of any benchmark, such as LIBERO. The benchmark itself lists the tasks of the suite."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from betterbench.errors import UnknownNameError
from betterbench.evaluation.planning.plan import Plan
from betterbench.policies.kinds import kind_of
from betterbench.sim.worlds import PlanRequest, World, world_of_suite
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
    **options: Any,  # noqa: ANN401 - those of the world
) -> Plan:
    """Return the plan of a run for a suite of any benchmark.

    The benchmark (called "world" here) lists the suite's tasks.

    Args:
        policy: Address of the policy.
        suite: Name of the suite.
        tasks: Tasks to run. By default, all tasks of the suite.
        trials: Number of trials, in the unit of the benchmark (trials per variation, initial states, or chains of
            subtasks). None selects the benchmark's standard number.
        seed: First seed, or index of the first initial state or chain.
        action_space: Action space of the policy. None selects the one that the policy address declares, or else the
            standard one of the benchmark.
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
    planned, used = world.plan(PlanRequest(suite, tuple(tasks), trials, seed, options))
    return Plan(policy, planned, space, world.observations[observation], "standard", world=used)


def _action_space(policy: str, world: World, asked: str | None) -> str:
    """Return the action space for a run in a benchmark: the requested one or, if none was requested, the policy's."""
    if asked is not None:
        if asked not in world.action_spaces:
            raise UnknownNameError(f"action space of {world.name}", asked, world.action_spaces)
        return asked
    kind = kind_of(policy)
    return kind.space_in_world(kind.parse(policy, world=world.dialect)) or world.action_spaces[0]
