"""The plan of a run in LIBERO-Plus: which variants are run, and which want the authors' assets."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from betterbench.errors import InvalidInputError, UnknownNameError, require_between
from betterbench.evaluation.planning.plan import Plan, Trial
from betterbench.evaluation.planning.world_plan import (
    OBSERVATIONS,
    check_policy,
    task_numbers,
    trained_task,
)
from betterbench.experts.libero import POLICIES
from betterbench.interface.actions import EE_DELTA
from betterbench.tasks import Expected
from betterbench.worlds import (
    PLUS_SUITES,
    PlusSettings,
    VariantTask,
    WorldError,
    WorldProcess,
    plus_command,
    protocol_named,
)
from betterbench.worlds.libero import STATES
from betterbench.worlds.libero_plus import AXES
from betterbench.worlds.libero_plus_scene import LIBERO_PLUS, SENTENCES

TRIALS = 1
"""Initial states of each variant by the book: LIBERO-Plus runs each of them once, from the first."""


def make_plus_plan(
    policy: str,
    *,
    suite: str,
    axes: Sequence[str] = (),
    variants: int | None = None,
    sentences: str = "clean",
    protocol: str = "openpi",
    tasks: Sequence[str] = (),
    trials: int | None = None,
    seed: int = 0,
    observation: str = "default",
    refuse_broken: bool = True,
    command: Sequence[str] | None = None,
) -> Plan:
    """Return the plan of a suite of LIBERO-Plus; the world is asked for its variants and what they need.

    Args:
        policy: Address of the policy.
        suite: Name of the suite.
        axes: Axes to run; all if none is named.
        variants: Most variants of each task on each axis, evenly spread over them; all if None.
        sentences: "clean" for the sentence of the base task (that of the file on the axis language), or "published"
            for LIBERO-Plus's own, which end with the name of the variant on six of the seven axes.
        protocol: Name of the protocol, for its steps.
        tasks: Base tasks to run, by name ("libero_spatial-05") or number; all if none is named.
        trials: Initial states of each variant, one if None. A new layout has one alone.
        seed: The first initial state.
        observation: "default", or "state_only" without images.
        refuse_broken: Whether a scene that does not show what its sentence presupposes stops the run.
        command: Command of the world's process; that of its installed environment, without the authors' assets, if
            None.

    Raises:
        InvalidInputError: If a number is out of range, the policy cannot be run in this world, or nothing is left to
            run without the authors' assets.
        UnknownNameError: If a name is unknown.
        MissingDependencyError: If the world is not installed.
        WorldError: If it does not answer.
    """
    if suite not in PLUS_SUITES:
        raise UnknownNameError("suite of LIBERO-Plus", suite, PLUS_SUITES)
    for axis in axes:
        if axis not in AXES:
            raise UnknownNameError("axis of LIBERO-Plus", axis, AXES)
    if sentences not in SENTENCES:
        raise UnknownNameError("kind of sentences", sentences, SENTENCES)
    chosen, by = PLUS_SUITES[suite], protocol_named(protocol)
    count = TRIALS if trials is None else trials
    require_between("--seed", seed, 0, STATES - 1)
    require_between("--trials", count, 1, STATES - seed)
    if variants is not None:
        require_between("--variants", variants, 1, STATES)
    if observation not in OBSERVATIONS:
        raise UnknownNameError("observation preset of LIBERO", observation, OBSERVATIONS)
    check_policy(policy, "LIBERO", POLICIES)
    numbers = task_numbers(suite, chosen.tasks, tasks)
    started = tuple(command or plus_command())
    with WorldProcess(started) as process:
        said, base = process.suite(suite), process.suite(chosen.base)
    try:
        wanted = [_read(suite, task, sentences) for task in said["tasks"] if int(task["task"]) in numbers]
        regime = tuple(trained_task(task) for task in base["tasks"])
        versions = {str(name): str(found) for name, found in said["versions"].items()}
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise WorldError(f"the world does not describe {suite} as agreed: {error} is missing or malformed") from error
    wanted = [found for found in wanted if found[0].axis in (axes or AXES)]
    ready = [(task, states) for task, states, needs in wanted if not needs]
    left_out = Counter(task.axis for task, _, needs in wanted if needs)
    if not ready:
        first = next((needs[0] for _, _, needs in wanted if needs), "")
        raise InvalidInputError(
            "--axes",
            f"none of the {len(wanted)} variants of {suite} on {', '.join(axes or AXES)} runs without the authors' "
            f"assets (the first wants {first})",
            "Download the assets of LIBERO-Plus and name their folder with --libero-plus-assets",
        )
    played = _spread(ready, variants)
    planned = tuple(
        Trial(task.id, task.condition, task.condition, task.axis, "base", state, Expected.SUCCEED.value)
        for task, states in played
        for state in (range(seed, seed + count) if states > 1 else (0,))
    )
    settings = PlusSettings(
        LIBERO_PLUS,
        started,
        by,
        {f"{task.id}/{task.condition}": task for task, _ in played},
        versions,
        regime,
        refuse_broken=refuse_broken,
        sentences=sentences,
        left_out={axis: left_out[axis] for axis in AXES if left_out[axis]},
    )
    return Plan(policy, planned, EE_DELTA.name, observation, "standard", world=settings)


def _read(suite: str, said: Mapping[str, Any], sentences: str) -> tuple[VariantTask, int, list[str]]:
    """Return a variant, the number of its initial states, and the files that it lacks."""
    name, sentence = str(said["name"]), str(said["published" if sentences == "published" else "instruction"])
    task = VariantTask(suite, int(said["task"]), name, sentence, str(said["bddl_sha256"]), name)
    return task, int(said["states"]), [str(file) for file in said["needs"]]


def _spread(ready: Sequence[tuple[VariantTask, int]], most: int | None) -> list[tuple[VariantTask, int]]:
    """Return at most so many variants of each task on each axis, evenly spread, by task and axis."""
    groups: dict[tuple[int, str], list[tuple[VariantTask, int]]] = {}
    for task, states in ready:
        groups.setdefault((task.number, task.axis), []).append((task, states))
    order = list(AXES)
    kept = []
    for _, group in sorted(groups.items(), key=lambda item: (item[0][0], order.index(item[0][1]))):
        count = len(group) if most is None else min(most, len(group))
        kept += [group[i * len(group) // count] for i in range(count)]
    return kept
