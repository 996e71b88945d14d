"""Plan of a run in LIBERO-Plus: its variants, and which of them need the authors' assets."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from operator import index
from typing import Any

from betterbench.errors import InvalidInputError, UnknownNameError, require_between
from betterbench.evaluation.planning.plan import Plan, Trial
from betterbench.evaluation.planning.world_plan import (
    action_space_of,
    require_libero_trials,
    task_numbers,
    trained_task,
)
from betterbench.sim.worlds import PlusSettings, VariantTask, WorldProcess, plus_command
from betterbench.sim.worlds.libero_plus_scene import LIBERO_PLUS, SENTENCES
from betterbench.sim.worlds.process import as_agreed, sent_text, sent_texts
from betterbench.tasks import Expected
from betterbench.tasks.worlds.libero import PLUS_SUITES, STATES, protocol_named
from betterbench.tasks.worlds.libero_plus import AXES
from betterbench.tasks.worlds.libero_training import TrainedTask

TRIALS = 1
"""Initial states of each variant in LIBERO-Plus's own protocol: one run of each variant, from the first state."""


@dataclass(frozen=True, slots=True)
class VariantChoice:
    """Selection of the variants of a LIBERO-Plus suite that are run.

    Attributes:
        axes: Axes to run; all if empty.
        variants: Maximum variants of each task on each axis, evenly spread over them; all if None.
        sentences: "clean" for the sentence of the base task (that of the file on the axis language), or "published"
            for LIBERO-Plus's own, which end with the name of the variant on six of the seven axes.
    """

    axes: tuple[str, ...] = ()
    variants: int | None = None
    sentences: str = "clean"

    def __post_init__(self) -> None:
        """Raise an error for unknown names and for a number of variants out of range."""
        for axis in self.axes:
            if axis not in AXES:
                raise UnknownNameError("axis of LIBERO-Plus", axis, AXES)
        if self.sentences not in SENTENCES:
            raise UnknownNameError("kind of sentences", self.sentences, SENTENCES)
        if self.variants is not None:
            require_between("--variants", self.variants, 1, STATES)


def make_plus_plan(
    policy: str,
    *,
    suite: str,
    choice: VariantChoice = VariantChoice(),
    protocol: str = "openpi",
    tasks: Sequence[str] = (),
    trials: int | None = None,
    seed: int = 0,
    action_space: str | None = None,
    observation: str = "default",
    refuse_broken: bool = True,
    command: Sequence[str] | None = None,
) -> Plan:
    """Return the plan of a suite of LIBERO-Plus, with variants and requirements from its own process.

    Args:
        policy: Address of the policy.
        suite: Name of the suite.
        choice: Selection of its variants.
        protocol: Name of the protocol, for its steps.
        tasks: Base tasks to run, by name ("libero_spatial-05") or number; all if none is named.
        trials: Initial states of each variant, one if None. A new layout has only one.
        seed: The first initial state.
        action_space: Action space of the policy; if None, that of its address, or "ee_delta" if the address has none.
        observation: "default", or "state_only" without images.
        refuse_broken: Whether a scene that contradicts the premise of its instruction stops the run.
        command: Command of the world's process; that of its installed environment if None.

    Raises:
        InvalidInputError: If a number is out of range, the policy cannot be run in this world, or no variant
            can be run without the authors' assets.
        UnknownNameError: If a name is unknown.
        MissingDependencyError: If the world is not installed.
        WorldError: If it does not answer.
    """
    if suite not in PLUS_SUITES:
        raise UnknownNameError("suite of LIBERO-Plus", suite, PLUS_SUITES)
    by, count = protocol_named(protocol), TRIALS if trials is None else trials
    require_libero_trials(policy, seed=seed, count=count, observation=observation)
    space = action_space_of(policy, LIBERO_PLUS, action_space)
    numbers = task_numbers(suite, PLUS_SUITES[suite].tasks, tasks)
    started = tuple(command or plus_command())
    wanted, regime, versions = _variants_there(started, suite, choice.sentences)
    wanted = [v for v in wanted if v[0].number in numbers and v[0].axis in (choice.axes or AXES)]
    played = _spread([(task, states) for task, states, needs in wanted if not needs], choice.variants)
    if not played:
        raise _nothing_left(suite, choice, wanted)
    planned = tuple(
        Trial(task.id, task.condition, task.condition, task.axis, "base", state, Expected.SUCCEED.value)
        for task, states in played
        for state in (range(seed, seed + count) if states > 1 else (0,))
    )
    settings = PlusSettings(
        LIBERO_PLUS, started, by, {f"{task.id}/{task.condition}": task for task, _ in played}, versions, regime,
        refuse_broken=refuse_broken, sentences=choice.sentences,
        left_out=_left_out(wanted),
    )  # fmt: skip
    return Plan(policy, planned, space, observation, "standard", world=settings)


def _left_out(wanted: Sequence[tuple[VariantTask, int, list[str]]]) -> dict[str, int]:
    """Return the number of variants of each axis that lack files."""
    found = Counter(task.axis for task, _, needs in wanted if needs)
    return {axis: found[axis] for axis in AXES if found[axis]}


def _nothing_left(
    suite: str, choice: VariantChoice, wanted: Sequence[tuple[VariantTask, int, list[str]]]
) -> InvalidInputError:
    first = next((needs[0] for _, _, needs in wanted if needs), "")
    return InvalidInputError(
        "--axes",
        f"none of the {len(wanted)} variants of {suite} on {', '.join(choice.axes or AXES)} runs without the authors' "
        f"assets (the first wants {first})",
        "Download the assets of LIBERO-Plus and name their folder with --libero-plus-assets",
    )


def _variants_there(
    command: Sequence[str], suite: str, sentences: str
) -> tuple[list[tuple[VariantTask, int, list[str]]], tuple[TrainedTask, ...], dict[str, str]]:
    """Return the variants of a suite, the training of its base suite, and the versions of its packages."""
    with WorldProcess(command) as process:
        said, base = process.suite(suite), process.suite(PLUS_SUITES[suite].base)
    with as_agreed(f"describes {suite} in a way"):
        wanted = [_read(suite, task, sentences) for task in said["tasks"]]
        regime = tuple(trained_task(task) for task in base["tasks"])
        return wanted, regime, sent_texts(said["versions"])


def _read(suite: str, said: Mapping[str, Any], sentences: str) -> tuple[VariantTask, int, list[str]]:
    """Return a variant, the number of its initial states, and the files that it lacks."""
    name, sentence = (
        sent_text(said["name"]),
        sent_text(said["published" if sentences == "published" else "instruction"]),
    )
    task = VariantTask(suite, index(said["task"]), name, sentence, sent_text(said["bddl_sha256"]), name)
    return task, index(said["states"]), [sent_text(file) for file in said["needs"]]


def _spread(ready: Sequence[tuple[VariantTask, int]], most: int | None) -> list[tuple[VariantTask, int]]:
    """Return at most ``most`` variants of each task on each axis, evenly spread, by task and axis."""
    groups: dict[tuple[int, str], list[tuple[VariantTask, int]]] = {}
    for task, states in ready:
        groups.setdefault((task.number, task.axis), []).append((task, states))
    order = list(AXES)
    kept = []
    for _, group in sorted(groups.items(), key=lambda item: (item[0][0], order.index(item[0][1]))):
        count = len(group) if most is None else min(most, len(group))
        kept += [group[i * len(group) // count] for i in range(count)]
    return kept
