"""Interfaces of worlds (the simulated environments of trials) and of their scenes."""

from __future__ import annotations

import hashlib
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, TypeVar

import numpy as np

from betterbench.errors import MissingDependencyError, UnknownNameError
from betterbench.interface import ObservationSpec
from betterbench.interface.actions import EE_DELTA, USUAL_ROBOT, ActionSpace
from betterbench.interface.state import SceneInfo, WorldState
from betterbench.sim.worlds.process import WorldProcesses
from betterbench.tasks import Expected, Looks, TrialId, Truth
from betterbench.tasks.trial import Trial
from betterbench.tasks.worlds.facts import WorldFacts

if TYPE_CHECKING:
    from betterbench.records import Record
    from betterbench.sim.scenes.described import SceneDescription
    from betterbench.sim.scenes.rendering import Images, Renderers
    from betterbench.sim.worlds.installation import Installation

Form = TypeVar("Form")


@dataclass(frozen=True, slots=True)
class Photo:
    """Recorded state of a trial that should be rendered.

    Attributes:
        scene: Task and condition of the trial as one string ("libero_spatial-05/base").
        record: Record of the trial.
        row: Row of the record that contains the state.
    """

    scene: str
    record: Record
    row: int


@dataclass(frozen=True, slots=True)
class PlanRequest:
    """The trials that a user has chosen for a run.

    Attributes:
        suite: Suite name.
        tasks: Tasks to run, by name or number (see :meth:`chosen`). By default, all tasks in the suite are run.
        trials: Number of trials per variation, of initial states or of chains, depending on the world. If it is None,
            the world's usual number is used.
        seed: First seed, first initial state or first chain, depending on the world.
        options: Values of the options that only this world has, by name.
    """

    suite: str
    tasks: tuple[str, ...] = ()
    trials: int | None = None
    seed: int = 0
    options: Mapping[str, Any] = field(default_factory=dict)

    def chosen(self, known: Iterable[str]) -> tuple[str, ...]:
        """Return the names of the tasks to run, in the order of the suite.

        Args:
            known: Names of all tasks in the suite. A task may also be requested by its number, counted from 0.

        Raises:
            UnknownNameError: If a requested task does not exist.
        """
        names = tuple(known)
        named = {str(i): name for i, name in enumerate(names)} | {name: name for name in names}
        for task in self.tasks:
            if task not in named:
                raise UnknownNameError("task", task, names)
        wanted = {named[task] for task in self.tasks or names}
        return tuple(name for name in names if name in wanted)

    def options_as(self, form: Callable[..., Form], *, world: str) -> Form:
        """Return the options as an instance of the given dataclass. Raises UnknownNameError for an unknown option."""
        known = [f.name for f in fields(form)]  # type: ignore[arg-type]
        for name in self.options:
            if name not in known:
                raise UnknownNameError(f"{world} option", name, known)
        return form(**self.options)


@dataclass(frozen=True, slots=True)
class SceneOptions:
    """Scene options that only some worlds support: render preset, robot, and the variants of objects to use."""

    quality: str = "standard"
    robot: str = USUAL_ROBOT
    looks: Looks = "seen"


USUAL_SCENE = SceneOptions()
"""Scene options that are used if none are given."""


@dataclass(frozen=True, slots=True)
class Instruction:
    """Instruction of a trial for the policy."""

    text: str


@dataclass(frozen=True, slots=True)
class Instructed:
    """Condition of a trial in another world, reduced to the fields that an episode needs.

    Attributes:
        id: Task and condition as one string ("libero_spatial-05/base").
        name: Name of the condition.
    """

    id: str
    name: str
    instruction: Instruction
    expected: Expected = Expected.SUCCEED

    @classmethod
    def of(cls, whole: str, name: str, sentence: str) -> Instructed:
        """Return a condition with the id ``whole`` ("libero_spatial-05/base") and the given instruction."""
        return cls(whole, name, Instruction(sentence))


class Named(Protocol):
    """Interface of a scene's task, with the properties that an episode needs."""

    @property
    def id(self) -> str:
        """Name of the task in plans and records."""


class Told(Protocol):
    """Interface of a condition's instruction, with the properties that an episode needs."""

    @property
    def text(self) -> str:
        """Text of the instruction, as the policy gets it."""


class SceneCondition(Protocol):
    """Interface of a scene's condition, with the properties that an episode needs."""

    @property
    def id(self) -> str:
        """Task and condition as one string, such as "libero_spatial-05/base"."""

    @property
    def name(self) -> str:
        """Name of the condition."""

    @property
    def instruction(self) -> Told:
        """Instruction for the policy."""

    @property
    def expected(self) -> Expected:
        """Behavior that is expected of a correct policy."""


class Tracker(Protocol):
    """Tracker that judges whether the goal is met during an episode."""

    @property
    def relation_names(self) -> tuple[str, ...]:
        """Names of the relations that are recorded."""

    @property
    def subgoal_names(self) -> tuple[str, ...]:
        """Names of the subgoals, in order."""

    @property
    def undecided_states(self) -> int:
        """Minimum number of states before the episode can succeed, or 0 if it can succeed in the next state."""

    def update(self, state: WorldState) -> Truth:
        """Return the relations and subgoals that hold in a state. Pass the states in order, starting with the reset."""


def digest_of_files(files: Mapping[str, bytes]) -> str:
    """Return the SHA-256 digest of a scene's files, under which the scene is stored."""
    return hashlib.sha256(b"\0".join(data for _, data in sorted(files.items()))).hexdigest()


class TrialScene(Protocol):
    """Interface of a trial's scene, i.e. the properties and methods that an episode uses."""

    @property
    def world(self) -> str:
        """Name of the world that defines how privileged policies read the state."""

    @property
    def draws_in_step(self) -> bool:
        """Whether images are rendered during a control step.

        If so, :meth:`draw_next` is called before each step, and the rendering time is measured separately.
        """

    @property
    def instructed_anew(self) -> bool:
        """Whether the policy gets a new instruction after the last step."""

    @property
    def over(self) -> bool:
        """Whether the episode ends before its step limit because it can no longer succeed."""

    @property
    def task(self) -> Named:
        """Task of the trial."""

    @property
    def condition(self) -> SceneCondition:
        """Condition of the trial, with its instruction."""

    @property
    def seed(self) -> int:
        """Seed of the trial."""

    @property
    def action_space(self) -> ActionSpace:
        """Action space of the run."""

    @property
    def control_rate_hz(self) -> float:
        """Number of actions per second [Hz]."""

    @property
    def step_limit(self) -> int:
        """Number of control steps after which the episode ends."""

    @property
    def info(self) -> SceneInfo:
        """Properties of the scene that are constant during the episode. They are known after the reset."""

    @property
    def content_hash(self) -> str:
        """Digest of :meth:`files`, under which the scene is stored."""

    def files(self) -> dict[str, bytes]:
        """Return the files that describe the scene. They are stored once for each distinct scene."""

    def reset(self) -> WorldState:
        """Go to the start of the trial, and return the state at the start.

        Raises PremiseError if the scene violates an assumption of the task about its initial state.
        """

    def step(self, action: np.ndarray) -> np.ndarray:
        """Execute an action for one control step, and return the action that was applied.

        Raises InvalidActionError if the action is malformed.
        """

    def draw_next(self, *, wanted: bool) -> None:
        """Set whether the policy needs images after the next step."""

    def state(self) -> WorldState:
        """Return the current privileged state."""

    def simulator_state(self) -> Mapping[str, np.ndarray]:
        """Return the arrays ``qpos``, ``qvel``, ``ctrl`` and ``act`` that are stored in the episode record."""

    def tracker(self) -> Tracker:
        """Return the tracker that judges the goal during an episode. Call it after the reset."""

    def described(self, *, images: bool) -> SceneDescription:
        """Return the scene description that is stored in the episode record.

        ``images`` is True if images are rendered.
        """

    def views(self, spec: ObservationSpec, renderers: Renderers) -> Mapping[str, Images]:
        """Return the current images by camera. ``renderers`` are the worker's renderers of MuJoCo models."""

    def native(self) -> Mapping[str, np.ndarray]:
        """Return the values that the world's own clients read from the state, under the names that betterbench uses.

        The result is empty if the world's clients read only values that betterbench's observations contain as well.
        Otherwise, it includes the tool position "ee_position" that the policy gets.
        """

    def close(self, *, well: bool) -> None:
        """Free the resources of the trial. ``well`` is True if the record of the trial was written."""


class World(ABC):
    """World with its tasks, scenes and conventions, as a frozen value.

    The registered value (:mod:`betterbench.sim.worlds.registry`) describes the world. :meth:`plan` returns the trials
    of a run and the value that is stored as ``plan.world``, which may contain additional data of this run. Subclasses
    are frozen dataclasses with fields that can be pickled. A world is pickled by its name in the registry.

    Attributes:
        facts: Properties of the world that can be read without its simulator.
        control_rate_hz: Number of actions per second.
        action_spaces: Supported action spaces, starting with the default.
        observations: Supported observation presets. Keys are the requested names, values the presets that are used.
        dialect: World whose conventions are used with a policy server ("libero"). It is empty for betterbench's own
            scenes.
        drawn_by: Name of the component that renders the images, as used in messages. It is empty if the workers render
            MuJoCo models.
        options: Dataclass of the options that only this world has, for :attr:`PlanRequest.options`.
        installation: Environment in which the simulator is installed, or None if there is none.
        command: Command of the simulator's process. It is empty if the world has no such process.
    """

    __slots__ = ()

    facts: ClassVar[WorldFacts]
    control_rate_hz: ClassVar[float] = 20.0
    action_spaces: ClassVar[tuple[str, ...]] = (EE_DELTA.name,)
    observations: ClassVar[Mapping[str, str]] = {"default": "default", "state_only": "state_only"}
    dialect: ClassVar[str] = ""
    drawn_by: ClassVar[str] = "the world itself"
    options: ClassVar[type | None] = None
    installation: ClassVar[Installation | None] = None
    command: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """Name of the world in plans and on the command line."""
        return self.facts.name

    @property
    def is_ready(self) -> bool:
        """Whether trials can run without installing anything else."""
        return self.installation is None or self.installation.is_installed

    @abstractmethod
    def plan(self, asked: PlanRequest) -> tuple[tuple[Trial, ...], World]:
        """Return the trials of a run, and the world that is stored with the plan.

        Raises:
            InvalidInputError: If a number is out of range or no trial is left to run.
            UnknownNameError: If a suite, task or option does not exist.
            MissingDependencyError: If the world was not installed with ``better worlds install``.
            WorldError: If the simulator does not answer.
        """

    @abstractmethod
    def open_scene(
        self,
        processes: WorldProcesses,
        *,
        task: str,
        condition: str,
        seed: int,
        action_space: ActionSpace,
        images: bool,
        depth: bool = False,
        options: SceneOptions = USUAL_SCENE,
    ) -> TrialScene:
        """Open the scene of a trial.

        Args:
            processes: Pool of processes that run :attr:`command`. The scene may take one of them.
            task: Task name.
            condition: Condition name.
            seed: Seed of the trial.
            action_space: Action space of the run.
            images: Whether the policy gets images.
            depth: Whether the policy also gets depth images.
            options: Scene options that only some worlds support.
        """

    def start_command(self) -> tuple[str, ...]:
        """Return the command of the simulator's process with default options.

        It is empty if there is no such process.
        """
        return () if self.installation is None else self.installation.command()

    def to_json(self) -> dict[str, Any]:
        """Return the world as JSON that is stored in a plan, so that the run can be read without the world's code."""
        return {"name": self.name, "facts": self.facts.to_json()}

    def plan_head(self, tasks: Sequence[str]) -> dict[str, Any]:
        """Return the fields of a plan that describe the world and the versions of the tasks."""
        del tasks
        return {"world": self.to_json()}

    def plan_options(self, options: SceneOptions) -> dict[str, Any]:
        """Return the plan fields for those scene options that only some worlds support."""
        del options
        return {}

    def conventions(self, robot: str) -> dict[str, Any]:
        """Return the world's conventions as short strings. ``robot`` is the name of the run's robot."""
        del robot
        return {"control_rate_hz": self.control_rate_hz, "units": "m, kg, s, rad"}

    def announcement(self, trials: Sequence[Trial], suite: str) -> tuple[str, ...]:
        """Return the messages about the extent and the limitations of a run, which are shown before it starts."""
        return (f"{len(trials)} trial{'' if len(trials) == 1 else 's'} of {suite}.",)

    def prepare(self, robot: str, on_progress: Callable[[str, int, int], None]) -> None:  # noqa: B027 - most need nothing
        """Prepare this machine once, before the workers start.

        ``on_progress`` is called with the name of the work, the number of steps done and the total number of steps.
        """

    def environments(self, usual: int) -> int:
        """Return how many environments each worker starts with, if the policy runs in another process."""
        return usual

    def step_limits(self, trials: Sequence[Trial]) -> Mapping[TrialId, int]:
        """Return the step limit of each trial, or an empty mapping if the limits are unknown."""
        del trials
        return {}

    def in_order(self, trials: Sequence[Trial], *, last: int) -> list[Trial]:
        """Return the trials in the order in which they are executed. The order does not affect the results.

        ``last`` is the number of trials in the last phase of a run, in which idle workers may have to wait for others.
        """
        del last
        return sorted(trials, key=lambda t: (t.task, t.seed))

    def interventions(self, trial: Trial) -> tuple[str, ...]:
        """Return the interventions of the trial's variation, as the record stores them."""
        return () if trial.variation is None else (f"{self.name}: {trial.variation}",)

    def photos(
        self, stored: Mapping[str, Any], wanted: Sequence[Photo], *, size: int, where: str
    ) -> Iterator[np.ndarray]:
        """Yield one image (size, size, 3) for each requested recorded state of a run.

        Args:
            stored: The world as JSON, from the run's plan.
            wanted: Recorded states to render, grouped by scene.
            size: Width and height of an image [pixel].
            where: Name of the plan file, for messages.

        Raises:
            RecordError: If the plan is malformed.
            MissingDependencyError: If the states cannot be rendered on this machine.
            WorldError: If the simulator fails.
        """
        del stored, size, where
        if wanted:
            raise _no_photos(self)
        return iter(())


def require_photos(world: World) -> None:
    """Raise MissingDependencyError if a world does not define :meth:`World.photos`."""
    if type(world).photos is World.photos:
        raise _no_photos(world)


def _no_photos(world: World) -> MissingDependencyError:
    problem = "have no images, because this world cannot render recorded states"
    return MissingDependencyError(f"trials in {world.facts.title} {problem}")
