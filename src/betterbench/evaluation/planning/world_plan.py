"""The plan of a run in a foreign world: its own tasks or chains, and the usual protocol of evaluation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from betterbench.errors import UnknownNameError, require_between
from betterbench.evaluation.planning.plan import Plan, Trial
from betterbench.interface.actions import PLAYED_IN
from betterbench.policies.kinds import kind_of
from betterbench.sim.worlds import WorldError, WorldProcess, WorldSettings, WorldTask, world_named
from betterbench.sim.worlds.calvin import CALVIN, PROTOCOL, ChainSettings, ChainTask, chain_objects, describe_chains
from betterbench.sim.worlds.process import as_agreed, sent_text, sent_texts
from betterbench.sim.worlds.scene import task_id
from betterbench.tasks import Expected
from betterbench.tasks.worlds.calvin import CHAIN_SUITES, CHAINS
from betterbench.tasks.worlds.libero import STATES, protocol_named, suite_named
from betterbench.tasks.worlds.libero_training import TrainedTask

LIBERO = "libero"

_OBSERVATIONS = ("default", "state_only")
_CALVIN_OBSERVATIONS = ("calvin", "calvin_depth", "state_only")


def make_world_plan(
    policy: str,
    *,
    suite: str,
    protocol: str = "openpi",
    tasks: Sequence[str] = (),
    trials: int | None = None,
    seed: int = 0,
    action_space: str | None = None,
    observation: str = "default",
    refuse_broken: bool = True,
    command: Sequence[str] | None = None,
) -> Plan:
    """Return the plan of a suite of LIBERO, with tasks from LIBERO's own process.

    Args:
        policy: Address of the policy.
        suite: Name of the suite.
        protocol: Name of the protocol.
        tasks: Tasks to run, by name ("libero_spatial-05") or number; all if none is named.
        trials: Initial states of each task; those of the protocol if None.
        seed: The first initial state.
        action_space: Action space of the policy; if None, that of its address, or "ee_delta" if the address has none.
        observation: "default", or "state_only" without images.
        refuse_broken: Whether a scene that does not show what its sentence presupposes stops the run.
        command: Command of the world's process; that of its installed environment if None.

    Raises:
        InvalidInputError: If a number is out of range, or the policy cannot be run in this world.
        UnknownNameError: If a name is unknown.
        MissingDependencyError: If the world is not installed.
        WorldError: If it does not answer.
    """
    chosen, by = suite_named(suite), protocol_named(protocol)
    count = by.trials if trials is None else trials
    require_libero_trials(policy, seed=seed, count=count, observation=observation)
    space = action_space_of(policy, LIBERO, action_space)
    numbers = task_numbers(chosen.name, chosen.tasks, tasks)
    started = tuple(command or world_named(LIBERO).command())
    known, regime, versions = _described(started, chosen.name)
    if len(known) != chosen.tasks:
        raise WorldError(f"{suite} has {len(known)} tasks there and {chosen.tasks} here; install the world again")
    found = [known[i] for i in numbers]
    change = chosen.change
    planned = tuple(
        Trial(task.id, task.condition, change, None, change and "base", state, Expected.SUCCEED.value)
        for task in found
        for state in range(seed, seed + count)
    )
    settings = WorldSettings(
        LIBERO,
        started,
        by,
        {f"{t.id}/{t.condition}": t for t in found},
        versions,
        regime,
        refuse_broken=refuse_broken,
    )
    return Plan(policy, planned, space, observation, "standard", world=settings)


def make_chain_plan(
    policy: str,
    *,
    suite: str,
    command: Sequence[str],
    trials: int | None = None,
    seed: int = 0,
    action_space: str | None = None,
    observation: str = "default",
    refuse_broken: bool = True,
) -> Plan:
    """Return the plan of a suite of CALVIN, with versions from CALVIN's own process.

    Args:
        policy: Address of the policy.
        suite: Name of the suite.
        command: Command of the world's process, by :func:`betterbench.sim.worlds.calvin.calvin_command`.
        trials: Chains; all 1,000 if None.
        seed: Number of the first chain.
        action_space: Action space of the policy; if None, that of its address, or "calvin_relative" if the address
            has none.
        observation: "default", which is CALVIN's two cameras ("calvin"), "calvin_depth" with depth images too, or
            "state_only" without images.
        refuse_broken: Whether a scene that differs from the initial state of its chain stops the run.

    Raises:
        InvalidInputError: If a number is out of range, or the policy cannot be run in this world.
        UnknownNameError: If a name is unknown.
        WorldError: If the world does not answer.
    """
    if suite not in CHAIN_SUITES:
        raise UnknownNameError("suite of CALVIN", suite, CHAIN_SUITES)
    change = CHAIN_SUITES[suite].change
    require_between("--seed", seed, 0, CHAINS - 1)
    count = CHAINS - seed if trials is None else trials
    require_between("--trials", count, 1, CHAINS - seed)
    shown = "calvin" if observation == "default" else observation
    if shown not in _CALVIN_OBSERVATIONS:
        raise UnknownNameError("observation preset of CALVIN", observation, ("default", *_CALVIN_OBSERVATIONS))
    _require_known(policy, "CALVIN")
    space = action_space_of(policy, CALVIN, action_space)
    started, said = describe_chains(command, suite)
    with as_agreed(f"describes {suite} in a way"):
        task = ChainTask(suite, 0, suite, "five instructions in a row", sent_text(said["tasks"][0]["fingerprint"]))
        versions = sent_texts(said["versions"])
        objects = chain_objects(said["objects"])
    planned = tuple(
        Trial(task.id, task.condition, change, None, change and "base", number, Expected.SUCCEED.value)
        for number in range(seed, seed + count)
    )
    tasks = {f"{task.id}/{task.condition}": task}
    settings = ChainSettings(
        CALVIN, started, PROTOCOL, tasks, versions, (), refuse_broken=refuse_broken, objects=objects
    )
    return Plan(policy, planned, space, shown, "standard", world=settings)


def require_libero_trials(policy: str, *, seed: int, count: int, observation: str) -> None:
    """Check initial states, observation preset and policy of a run in LIBERO or LIBERO-Plus.

    Raises InvalidInputError if a number is out of range or the policy cannot be run there, and UnknownNameError if the
    observation preset is unknown.
    """
    require_between("--seed", seed, 0, STATES - 1)
    require_between("--trials", count, 1, STATES - seed)
    if observation not in _OBSERVATIONS:
        raise UnknownNameError("observation preset of LIBERO", observation, _OBSERVATIONS)
    _require_known(policy, "LIBERO")


def action_space_of(policy: str, world: str, asked: str | None) -> str:
    """Return the action space of a run in a world: the requested one, otherwise the policy's own."""
    if asked is not None and asked not in PLAYED_IN[world]:
        raise UnknownNameError(f"action space of {world}", asked, PLAYED_IN[world])
    if asked is not None:
        return asked
    kind = kind_of(policy)
    return kind.space_in_world(kind.parse(policy, world=world)) or PLAYED_IN[world][0]


def _require_known(policy: str, world: str) -> None:
    """Raise InvalidInputError if a policy cannot act in a world ("LIBERO"), only in betterbench's own scenes."""
    kind = kind_of(policy)
    kind.require_world(kind.parse(policy), world)


def task_numbers(suite: str, count: int, tasks: Sequence[str]) -> list[int]:
    """Return the indices of the named tasks in the suite, in its order and without duplicates."""
    ids = {task_id(suite, i): i for i in range(count)} | {str(i): i for i in range(count)}
    for name in tasks:
        if name not in ids:
            raise UnknownNameError(f"task of {suite}", name, [task_id(suite, i) for i in range(count)])
    return sorted({ids[name] for name in tasks}) if tasks else list(range(count))


def _described(command: Sequence[str], suite: str) -> tuple[list[WorldTask], tuple[TrainedTask, ...], dict[str, str]]:
    """Return the tasks of a suite, the training of its base suite, and its package versions, from the world."""
    chosen = suite_named(suite)
    with WorldProcess(command) as process:
        said = process.suite(suite)
        base = said if chosen.base == suite else process.suite(chosen.base)
    # Only in these suites the sentence is another one than that of the task's name, which the field's clients say.
    key = "file_instruction" if chosen.change in ("lan", "task") else "instruction"
    with as_agreed(f"describes {suite} in a way"):
        tasks = [
            WorldTask(suite, i, sent_text(task["name"]), sent_text(task[key]), sent_text(task["bddl_sha256"]))
            for i, task in enumerate(said["tasks"])
        ]
        regime = tuple(trained_task(task) for task in base["tasks"])
        return tasks, regime, sent_texts(said["versions"])


def trained_task(said: Mapping[str, Any]) -> TrainedTask:
    """Return the training of a task of a base suite, as the world describes it."""
    steps = tuple((sent_text(r), sent_text(o), _words(k), _words(t)) for r, o, k, t in said["steps"])
    starts = {sent_text(name): (_words(kind), sent_text(place)) for name, (kind, place) in said["starts"].items()}
    return TrainedTask(sent_text(said["instruction"]), steps, starts)


def _words(kind: str) -> str:
    return sent_text(kind).replace("_", " ")
