"""LIBERO-Plus as a world, in which the variants of a task are its conditions."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from operator import index
from pathlib import Path
from typing import Any, ClassVar, Literal

from betterbench.errors import InvalidInputError, UnknownNameError, require_between
from betterbench.sim.worlds.installation import Installation
from betterbench.sim.worlds.libero.world import INSTALLATION as LIBERO_INSTALLATION
from betterbench.sim.worlds.libero.world import LiberoWorld, require_states, trained_task
from betterbench.sim.worlds.process import WorldProcess, as_agreed, sent_text, sent_texts
from betterbench.sim.worlds.scene import WorldTask, task_id
from betterbench.sim.worlds.world import PlanRequest
from betterbench.tasks import Expected
from betterbench.tasks.trial import Trial
from betterbench.tasks.worlds.facts import WorldFacts
from betterbench.tasks.worlds.libero import LIBERO_PLUS, PLUS_SUITES, STATES, protocol_named, suite_named
from betterbench.tasks.worlds.libero_plus import AXES, read_variant
from betterbench.tasks.worlds.libero_training import TrainedTask
from betterbench.wording import plural

INSTALLATION = Installation(
    LIBERO_PLUS.name,
    "world-libero-plus.lock",
    "betterbench.sim.worlds.libero_plus.simulator",
    "25 MB (150 MB unpacked), and LIBERO if it is missing",
    "LIBERO-Plus: its scene files, used with the world libero; download new objects, light and textures yourself",
    beside=LIBERO_INSTALLATION,
)

ASSETS_VARIABLE = "BETTERBENCH_LIBERO_PLUS_ASSETS"
"""Environment variable with the folder of the authors' assets. It is used if the option for the folder is not given."""

SENTENCES = ("clean", "published")

_FOLDERS = ("scenes", "textures", "new_objects")
"""Folders that the authors' assets must contain."""


TRIALS = 1
"""Number of trials per variant in LIBERO-Plus's own protocol, which runs each variant once."""


@dataclass(frozen=True, slots=True)
class PlusOptions:
    """Options of a run in LIBERO-Plus.

    Attributes:
        protocol: Name of the evaluation protocol, which defines the number of settling steps and the step limit.
        broken_premises: "refuse" stops the run if a scene violates an assumption of its instruction. "run" continues
            the run in this case.
        axes: Axes to run. By default, all axes are run.
        variants: Maximum number of variants per task and axis. They are spread evenly over all variants. If it is None,
            all variants are run.
        libero_plus_sentences: "clean" uses the instruction of the base task, and on the axis "language" the instruction
            in the variant's file. "published" uses LIBERO-Plus's own instructions, which end with the variant name on
            six of the seven axes.
        libero_plus_assets: Unzipped folder of the authors' assets. If it is None, the folder in the environment
            variable ``BETTERBENCH_LIBERO_PLUS_ASSETS`` is used.
        command: Command that starts the simulator process. If it is empty, the installed environment is used.
    """

    protocol: str = "openpi"
    broken_premises: Literal["refuse", "run"] = "refuse"
    axes: tuple[str, ...] = ()
    variants: int | None = None
    libero_plus_sentences: str = "clean"
    libero_plus_assets: Path | None = None
    command: Sequence[str] = ()

    def __post_init__(self) -> None:
        """Reject unknown names, and a number of variants that is out of range."""
        for axis in self.axes:
            if axis not in AXES:
                raise UnknownNameError("LIBERO-Plus axis", axis, AXES)
        if self.libero_plus_sentences not in SENTENCES:
            raise UnknownNameError("kind of instructions", self.libero_plus_sentences, SENTENCES)
        if self.variants is not None:
            require_between("--variants", self.variants, 1, STATES)


@dataclass(frozen=True, slots=True)
class VariantTask(WorldTask):
    """Variant of a LIBERO task. ``number`` is the index of the base task.

    Attributes:
        variant: Name of the variant in LIBERO-Plus.
    """

    variant: str

    @property
    def condition(self) -> str:
        """Name of the condition, such as "camera_0_0_100_2_352"."""
        return read_variant(self.variant).condition

    @property
    def axis(self) -> str:
        """Axis of the variant, i.e. the part of the task that it changes."""
        return read_variant(self.variant).axis

    def asked(self) -> dict[str, Any]:
        """Return the fields of a request that tell the simulator which scene to build."""
        return {**WorldTask.asked(self), "variant": self.variant}


@dataclass(frozen=True, slots=True)
class LiberoPlusWorld(LiberoWorld):
    """LIBERO-Plus as the world of a run. The simulator reports which variants exist and which files they need.

    Attributes:
        sentences: "clean" or "published". The published instructions are LIBERO-Plus's own, which end with the variant
            name.
        left_out: Number of variants on each axis that are left out because they need the authors' assets.
    """

    facts: ClassVar[WorldFacts] = LIBERO_PLUS
    options: ClassVar[type | None] = PlusOptions
    installation: ClassVar[Installation | None] = INSTALLATION

    sentences: str = "clean"
    left_out: Mapping[str, int] = field(default_factory=dict)

    @property
    def simulator(self) -> str:
        """Name of the simulator. LIBERO's name is used, so that trials can be compared with trials of base tasks."""
        return "libero"

    def start_command(self) -> tuple[str, ...]:
        """Return the command of the simulator process. The assets come from the folder in the environment variable."""
        return plus_command()

    def plan(self, asked: PlanRequest) -> tuple[tuple[Trial, ...], LiberoPlusWorld]:
        """Plan trials of variants, each with an initial state.

        Return the trials and the world to be stored with the plan.

        According to the protocol of LIBERO-Plus, each variant has one trial.

        Raises:
            InvalidInputError: If every requested variant needs the authors' assets and these are missing.
        """
        options = asked.options_as(PlusOptions, world=self.facts.title)
        suite, seed, count = asked.suite, asked.seed, TRIALS if asked.trials is None else asked.trials
        if suite not in PLUS_SUITES:
            raise UnknownNameError("LIBERO-Plus suite", suite, PLUS_SUITES)
        by = protocol_named(options.protocol)
        require_states(seed, count)
        names = asked.chosen(task_id(suite, i) for i in range(PLUS_SUITES[suite].tasks))
        started = tuple(options.command or plus_command(options.libero_plus_assets))
        wanted, regime, versions = _variants_there(started, suite, options.libero_plus_sentences)
        wanted = [v for v in wanted if v[0].id in names and v[0].axis in (options.axes or AXES)]
        played = _spread([(task, states) for task, states, needs in wanted if not needs], options.variants)
        if not played:
            raise _nothing_left(suite, options, wanted)
        planned = tuple(
            Trial(task.id, task.condition, task.condition, task.axis, "base", state, Expected.SUCCEED.value)
            for task, states in played
            for state in (range(seed, seed + count) if states > 1 else (0,))
        )
        world = replace(
            self,
            command=started,
            protocol=by,
            tasks={f"{task.id}/{task.condition}": task for task, _ in played},
            versions=versions,
            regime=regime,
            refuse_broken=options.broken_premises == "refuse",
            sentences=options.libero_plus_sentences,
            left_out=_left_out(wanted),
        )
        return planned, world

    def announcement(self, trials: Sequence[Trial], suite: str) -> tuple[str, ...]:
        """Return messages that state the protocol of the run and the variants that are left out."""
        by = self.protocol
        steps = by.steps[suite_named(suite).base]
        counts = Counter(trial.axis for trial in trials)
        said = (
            f"{plural(len(trials), 'trial')} of {suite} "
            f"({', '.join(f'{axis} {n}' for axis, n in counts.items())}): "
            f"{by.settling_steps} settling steps, then at most {steps} steps; seed {by.seed}; "
            f"{self.sentences} instructions."
        )
        if not self.left_out:
            return (said,)
        missing = ", ".join(f"{axis} {n}" for axis, n in self.left_out.items())
        return (
            said,
            f"Not run, because the authors' assets are missing: {missing}. Pass the folder with --libero-plus-assets.",
        )

    def to_json(self) -> dict[str, Any]:
        """Return the world in JSON form, without the locations of the simulator and the assets."""
        return {**LiberoWorld.to_json(self), "sentences": self.sentences, "left_out": dict(self.left_out)}


def plus_command(assets: Path | None = None) -> tuple[str, ...]:
    """Return the command of the simulator process, with the folder of the authors' assets if one is known.

    Args:
        assets: The folder of the assets. If it is None, the folder in the environment variable
            ``BETTERBENCH_LIBERO_PLUS_ASSETS`` is used, if it is set.

    Raises:
        InvalidInputError: If the folder does not contain the assets.
        MissingDependencyError: If the world was not installed with ``better worlds install``.
    """
    named = os.environ.get(ASSETS_VARIABLE)
    where = "--libero-plus-assets" if assets is not None else ASSETS_VARIABLE
    folder = assets if assets is not None else Path(named) if named else None
    if folder is not None and (missing := [name for name in _FOLDERS if not (folder / name).is_dir()]):
        raise InvalidInputError(
            where,
            f"{folder} does not contain the folder {', '.join(missing)}",
            "Pass the unzipped assets folder of LIBERO-Plus, which contains scenes, textures and new_objects",
        )
    return (*INSTALLATION.command(), *([] if folder is None else [str(folder.resolve())]))


def _left_out(wanted: Sequence[tuple[VariantTask, int, list[str]]]) -> dict[str, int]:
    """Return the number of variants on each axis that need missing files."""
    found = Counter(task.axis for task, _, needs in wanted if needs)
    return {axis: found[axis] for axis in AXES if found[axis]}


def _nothing_left(
    suite: str, choice: PlusOptions, wanted: Sequence[tuple[VariantTask, int, list[str]]]
) -> InvalidInputError:
    first = next((needs[0] for _, _, needs in wanted if needs), "")
    return InvalidInputError(
        "--axes",
        f"none of the {len(wanted)} variants of {suite} on {', '.join(choice.axes or AXES)} can run without the "
        f"authors' assets (the first needs {first})",
        "Download the assets of LIBERO-Plus and pass their folder with --libero-plus-assets",
    )


def _variants_there(
    command: Sequence[str], suite: str, sentences: str
) -> tuple[list[tuple[VariantTask, int, list[str]]], tuple[TrainedTask, ...], dict[str, str]]:
    """Return the variants of a suite, the training tasks of its base suite, and the versions of the packages."""
    with WorldProcess(command) as process:
        said, base = process.suite(suite), process.suite(PLUS_SUITES[suite].base)
    with as_agreed(f"sent a description of {suite}"):
        wanted = [_read(suite, task, sentences) for task in said["tasks"]]
        regime = tuple(trained_task(task) for task in base["tasks"])
        return wanted, regime, sent_texts(said["versions"])


def _read(suite: str, said: Mapping[str, Any], sentences: str) -> tuple[VariantTask, int, list[str]]:
    """Return a variant, the number of its initial states, and the names of its missing files."""
    name, sentence = (
        sent_text(said["name"]),
        sent_text(said["published" if sentences == "published" else "instruction"]),
    )
    task = VariantTask(suite, index(said["task"]), name, sentence, sent_text(said["bddl_sha256"]), name)
    return task, index(said["states"]), [sent_text(file) for file in said["needs"]]


def _spread(ready: Sequence[tuple[VariantTask, int]], most: int | None) -> list[tuple[VariantTask, int]]:
    """Return at most ``most`` variants per task and axis, spread evenly over all variants."""
    groups: dict[tuple[int, str], list[tuple[VariantTask, int]]] = {}
    for task, states in ready:
        groups.setdefault((task.number, task.axis), []).append((task, states))
    order = list(AXES)
    kept = []
    for _, group in sorted(groups.items(), key=lambda item: (item[0][0], order.index(item[0][1]))):
        count = len(group) if most is None else min(most, len(group))
        kept += [group[i * len(group) // count] for i in range(count)]
    return kept
