"""LIBERO as a world: plans that follow published evaluation protocols, and images of recorded states."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import TypeAdapter

from betterbench.errors import RecordError, require_between
from betterbench.interface.actions import PLAYED_IN
from betterbench.json_form import open_form, read_form
from betterbench.sim.worlds.installation import Installation
from betterbench.sim.worlds.process import WorldError, WorldProcess, as_agreed, sent_text, sent_texts
from betterbench.sim.worlds.scene import ProcessWorld, WorldTask, task_id
from betterbench.sim.worlds.world import Photo, PlanRequest
from betterbench.tasks import Expected
from betterbench.tasks.trial import Trial
from betterbench.tasks.worlds.facts import WorldFacts
from betterbench.tasks.worlds.libero import CONTROL_RATE_HZ, LIBERO, OURS, STATES, protocol_named, suite_named
from betterbench.tasks.worlds.libero_training import TrainedTask
from betterbench.wording import plural

INSTALLATION = Installation(
    LIBERO.name,
    "peer-libero.lock",
    "betterbench.sim.worlds.libero.simulator",
    "360 MB (2 GB unpacked)",
    "LIBERO and LIBERO-PRO with robosuite 1.4.0 and MuJoCo 3.3.7",
)


@dataclass(frozen=True, slots=True)
class LiberoOptions:
    """Options of a run in LIBERO.

    Attributes:
        protocol: Name of the evaluation protocol.
        broken_premises: "refuse" stops the run if a scene violates an assumption of its instruction. "run" continues
            the run in this case.
        command: Command that starts the simulator process. If it is empty, the installed environment is used.
    """

    protocol: str = "openpi"
    broken_premises: Literal["refuse", "run"] = "refuse"
    command: Sequence[str] = ()


@open_form
@dataclass(frozen=True, slots=True)
class _DrawnTask:
    """Fields of a stored task that are needed to render its states."""

    suite: str
    number: int
    variant: str | None = None


@open_form
@dataclass(frozen=True, slots=True)
class _DrawnProtocol:
    seed: int


@open_form
@dataclass(frozen=True, slots=True)
class _Drawn:
    """Fields of a stored world that are needed to render recorded states."""

    protocol: _DrawnProtocol
    tasks: dict[str, _DrawnTask]


_DRAWN = TypeAdapter(_Drawn)


@dataclass(frozen=True, slots=True)
class LiberoWorld(ProcessWorld):
    """LIBERO with the suites of LIBERO-PRO. The simulator reports which tasks exist."""

    facts: ClassVar[WorldFacts] = LIBERO
    control_rate_hz: ClassVar[float] = CONTROL_RATE_HZ
    action_spaces: ClassVar[tuple[str, ...]] = PLAYED_IN["libero"]
    dialect: ClassVar[str] = "libero"
    options: ClassVar[type | None] = LiberoOptions
    installation: ClassVar[Installation | None] = INSTALLATION

    def plan(self, asked: PlanRequest) -> tuple[tuple[Trial, ...], LiberoWorld]:
        """Plan one trial for each requested initial state.

        Return the trials and the world to be stored with the plan.
        """
        options = asked.options_as(LiberoOptions, world=self.facts.title)
        chosen, by = suite_named(asked.suite), protocol_named(options.protocol)
        count = by.trials if asked.trials is None else asked.trials
        require_states(asked.seed, count)
        names = asked.chosen(task_id(chosen.name, i) for i in range(chosen.tasks))
        started = tuple(options.command or self.start_command())
        known, regime, versions = _described(started, chosen.name)
        if len(known) != chosen.tasks:
            raise WorldError(
                f"{asked.suite} has {len(known)} tasks in the simulator, but {chosen.tasks} were expected. "
                "Install the world again"
            )
        found = [task for task in known if task.id in names]
        change = chosen.change
        planned = tuple(
            Trial(task.id, task.condition, change, None, change and "base", state, Expected.SUCCEED.value)
            for task in found
            for state in range(asked.seed, asked.seed + count)
        )
        world = replace(
            self,
            command=started,
            protocol=by,
            tasks={f"{t.id}/{t.condition}": t for t in found},
            versions=versions,
            regime=regime,
            refuse_broken=options.broken_premises == "refuse",
        )
        return planned, world

    def announcement(self, trials: Sequence[Trial], suite: str) -> tuple[str, ...]:
        """Return one message that states the protocol of the run and its differences from other protocols."""
        by = self.protocol
        steps = by.steps[suite_named(suite).base]
        said = (
            f"{plural(len(trials), 'trial')} of {suite}, protocol {by.name}: {by.settling_steps} settling steps, "
            f"then at most {steps} steps; seed {by.seed}. Differences from openpi: {by.differences or 'none'}. "
            f"Differences from all protocols: {OURS}."
        )
        return (said,)

    def photos(
        self, stored: Mapping[str, Any], wanted: Sequence[Photo], *, size: int, where: str
    ) -> Iterator[np.ndarray]:
        """Yield one image (size, size, 3) for each requested recorded state, rendered with LIBERO's front camera."""
        cure = "Restore the file, or start the run again"
        form = read_form(_DRAWN, stored, where=f"{where}: plan.world", cure=cure, raises=RecordError)
        if not wanted:
            return
        with WorldProcess(self.start_command()) as process:
            for name, photos in itertools.groupby(wanted, key=lambda photo: photo.scene):
                task = form.tasks[name]
                asked = {"suite": task.suite, "task": task.number, "seed": form.protocol.seed, "size": size}
                asked |= {} if task.variant is None else {"variant": task.variant}
                yield from process.draw(asked, np.array([photo.record.qpos[photo.row] for photo in photos]))


def require_states(seed: int, count: int) -> None:
    """Check that the initial states of a run exist. Raises InvalidInputError if an index is out of range."""
    require_between("--seed", seed, 0, STATES - 1)
    require_between("--trials", count, 1, STATES - seed)


def trained_task(said: Mapping[str, Any]) -> TrainedTask:
    """Return the training task that corresponds to the simulator's description of a task in a base suite."""
    steps = tuple((sent_text(r), sent_text(o), _words(k), _words(t)) for r, o, k, t in said["steps"])
    starts = {sent_text(name): (_words(kind), sent_text(place)) for name, (kind, place) in said["starts"].items()}
    return TrainedTask(sent_text(said["instruction"]), steps, starts)


def _described(command: Sequence[str], suite: str) -> tuple[list[WorldTask], tuple[TrainedTask, ...], dict[str, str]]:
    """Return the tasks of a suite, the training tasks of its base suite, and the versions of the packages."""
    chosen = suite_named(suite)
    with WorldProcess(command) as process:
        said = process.suite(suite)
        base = said if chosen.base == suite else process.suite(chosen.base)
    # Existing clients take the instruction from the task's name. In these suites, the task's file contains a different
    # one.
    key = "file_instruction" if chosen.change in ("lan", "task") else "instruction"
    with as_agreed(f"sent a description of {suite}"):
        tasks = [
            WorldTask(suite, i, sent_text(task["name"]), sent_text(task[key]), sent_text(task["bddl_sha256"]))
            for i, task in enumerate(said["tasks"])
        ]
        regime = tuple(trained_task(task) for task in base["tasks"])
        return tasks, regime, sent_texts(said["versions"])


def _words(kind: str) -> str:
    return sent_text(kind).replace("_", " ")
