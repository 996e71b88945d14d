"""Interfaces for worlds (the environments of trials) and for scenes in a world."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
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
    """Moment in a trial to render.

    Attributes:
        scene: Task and condition of the trial as one text ("libero_spatial-05/base").
        record: Trial record.
        row: Row of the record.
    """

    scene: str
    record: Record
    row: int


@dataclass(frozen=True, slots=True)
class PlanRequest:
    """Choice of a run's trials.

    Attributes:
        suite: Suite name.
        tasks: Tasks to run, by name or number. By default, all tasks in the suite.
        trials: Number of trials in the world's unit. If None, the usual number is used.
        seed: First seed, initial state or chain.
        options: This world's options, by name.
    """

    suite: str
    tasks: tuple[str, ...] = ()
    trials: int | None = None
    seed: int = 0
    options: Mapping[str, Any] = field(default_factory=dict)

    def options_as(self, form: Callable[..., Form], *, world: str) -> Form:
        """Return the options as a dataclass. Raises UnknownNameError for an unknown option."""
        known = [f.name for f in fields(form)]  # type: ignore[arg-type]
        for name in self.options:
            if name not in known:
                raise UnknownNameError(f"option of {world}", name, known)
        return form(**self.options)


@dataclass(frozen=True, slots=True)
class SceneOptions:
    """Scene options supported only by some worlds: render preset, robot, and looks of objects."""

    quality: str = "standard"
    robot: str = USUAL_ROBOT
    looks: Looks = "seen"


USUAL_SCENE = SceneOptions()
"""Default options."""


@dataclass(frozen=True, slots=True)
class Instruction:
    """Trial instruction for the policy."""

    text: str


@dataclass(frozen=True, slots=True)
class Instructed:
    """Condition in another world, with the fields that an episode needs.

    Attributes:
        id: Task and condition as one text ("libero_spatial-05/base").
        name: Condition name.
    """

    id: str
    name: str
    instruction: Instruction
    expected: Expected = Expected.SUCCEED

    @classmethod
    def of(cls, whole: str, name: str, sentence: str) -> Instructed:
        """Return the condition ``whole`` ("libero_spatial-05/base") with an instruction text."""
        return cls(whole, name, Instruction(sentence))


class Named(Protocol):
    """Task of a scene."""

    @property
    def id(self) -> str:
        """Task name in plans and records."""


class Told(Protocol):
    """Instruction of a condition."""

    @property
    def text(self) -> str:
        """Text for the policy."""


class SceneCondition(Protocol):
    """Condition of a scene."""

    @property
    def id(self) -> str:
        """Task and condition as one text."""

    @property
    def name(self) -> str:
        """Condition name."""

    @property
    def instruction(self) -> Told:
        """Instruction to the policy."""

    @property
    def expected(self) -> Expected:
        """Behavior of a correct policy."""


class Tracker(Protocol):
    """Judge of the goal in an episode."""

    @property
    def relation_names(self) -> tuple[str, ...]:
        """Names of a record's relation columns."""

    @property
    def subgoal_names(self) -> tuple[str, ...]:
        """Names of the subgoals, in their order."""

    @property
    def undecided_states(self) -> int:
        """Minimum number of states before the episode can succeed, or 0 if the next state may be a success."""

    def update(self, state: WorldState) -> Truth:
        """Return the relations and subgoals that hold in a state. Pass the states in order, starting at reset."""


class TrialScene(Protocol):
    """Interface of a trial's scene for an episode."""

    @property
    def world(self) -> str:
        """Name of the world that defines the state for privileged policies."""

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
        """Whether the episode can no longer succeed and ends before its step limit."""

    @property
    def task(self) -> Named:
        """Trial task."""

    @property
    def condition(self) -> SceneCondition:
        """Trial condition, with its instruction."""

    @property
    def seed(self) -> int:
        """Trial seed."""

    @property
    def action_space(self) -> ActionSpace:
        """Action space of the run."""

    @property
    def control_rate_hz(self) -> float:
        """Actions per second."""

    @property
    def step_limit(self) -> int:
        """Control steps after which an episode ends."""

    @property
    def info(self) -> SceneInfo:
        """Constant properties of the scene, known after the reset."""

    @property
    def content_hash(self) -> str:
        """Name of the stored scene: a digest of :meth:`files`."""

    def files(self) -> dict[str, bytes]:
        """Return the files that are stored once per distinct scene."""

    def reset(self) -> WorldState:
        """Go to the start of the trial and return the state.

        Raises PremiseError if the scene contradicts its premise.
        """

    def step(self, action: np.ndarray) -> np.ndarray:
        """Execute an action for one control step and return the applied action.

        Raises InvalidActionError if the action is malformed.
        """

    def draw_next(self, *, wanted: bool) -> None:
        """Set whether the policy needs images after the next step."""

    def state(self) -> WorldState:
        """Return the privileged state."""

    def simulator_state(self) -> Mapping[str, np.ndarray]:
        """Return the arrays ``qpos``, ``qvel``, ``ctrl`` and ``act`` that are stored in the episode record."""

    def tracker(self) -> Tracker:
        """Return the judge of an episode, after the reset."""

    def described(self, *, images: bool) -> SceneDescription:
        """Return the scene description that is stored in the episode record.

        ``images`` is True if images are rendered.
        """

    def views(self, spec: ObservationSpec, renderers: Renderers) -> Mapping[str, Images]:
        """Return the current images by camera. ``renderers`` are the worker's renderers for MuJoCo models."""

    def native(self) -> Mapping[str, np.ndarray]:
        """Return the state as read by the world's own clients, by the names of our state parts.

        The result is empty if none.

        If not empty, "ee_position" is the tool position for the policy.
        """

    def close(self, *, well: bool) -> None:
        """Free the resources of the trial. ``well`` is True if its record was written."""


class World(ABC):
    """World: tasks, scenes and conventions, as a frozen value.

    The registered value (:mod:`betterbench.sim.worlds.registry`) describes the world. :meth:`plan` returns a run's
    trials and the value for ``plan.world``, which may contain additional data of this run. Subclasses are frozen
    dataclasses with picklable fields. The registry pickles worlds by name.

    Attributes:
        facts: Facts that need no simulator.
        control_rate_hz: Actions per second.
        action_spaces: Supported action spaces, the default first.
        observations: Supported observation presets: the preset to use, by requested name.
        dialect: World whose conventions are used with a policy server ("libero"). It is empty for our own scenes.
        drawn_by: Renderer of the images, for the manifest. It is empty if the workers render MuJoCo models.
        options: Dataclass of the options that only this world has, for :attr:`PlanRequest.options`.
        installation: Environment of the simulator, or None.
        command: Command of the simulator's process. It is empty without a process.
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
        """Name in plans and on the command line."""
        return self.facts.name

    @property
    def is_ready(self) -> bool:
        """Whether trials can be run without another installation."""
        return self.installation is None or self.installation.is_installed

    @abstractmethod
    def plan(self, asked: PlanRequest) -> tuple[tuple[Trial, ...], World]:
        """Return a run's trials, and the world for the stored plan.

        Raises:
            InvalidInputError: If a number is out of range or nothing is left to run.
            UnknownNameError: If a suite, task or option does not exist.
            MissingDependencyError: If the world is not installed.
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
        """Return a trial's scene.

        Args:
            processes: Pool of processes that run :attr:`command`, from which the scene may take one.
            task: Task name.
            condition: Condition name.
            seed: Trial seed.
            action_space: Action space of the run.
            images: Whether the policy gets images.
            depth: Whether the policy also gets depth images.
            options: Options that only some worlds have.
        """

    def start_command(self) -> tuple[str, ...]:
        """Return the command of the simulator's process, with default options."""
        return () if self.installation is None else self.installation.command()

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict for plans, so that a run can be read without the world's code."""
        return {"name": self.name, "facts": self.facts.to_json()}

    def plan_head(self, tasks: Sequence[str]) -> dict[str, Any]:
        """Return the plan fields that describe the world and its task versions."""
        del tasks
        return {"world": self.to_json()}

    def plan_options(self, options: SceneOptions) -> dict[str, Any]:
        """Return the fields of a plan about options that only some worlds have."""
        del options
        return {}

    def conventions(self, robot: str) -> dict[str, Any]:
        """Return a description of the world's conventions. ``robot`` is the name of the run's robot."""
        del robot
        return {"control_rate_hz": self.control_rate_hz, "units": "m, kg, s, rad"}

    def announcement(self, trials: Sequence[Trial], suite: str) -> tuple[str, ...]:
        """Return the message before a run: extent and limitations."""
        return (f"{len(trials)} trial{'' if len(trials) == 1 else 's'} of {suite}.",)

    def prepare(self, robot: str, on_progress: Callable[[str, int, int], None]) -> None:  # noqa: B027 - most need nothing
        """Prepare this machine once, before any worker starts.

        ``on_progress`` is called with the work's name, the steps done and the total steps.
        """

    def environments(self, usual: int) -> int:
        """Return the initial number of environments for a worker whose policy answers from another process."""
        return usual

    def step_limits(self, trials: Sequence[Trial]) -> Mapping[TrialId, int]:
        """Return the step limit of each trial, or an empty mapping if unknown."""
        del trials
        return {}

    def in_order(self, trials: Sequence[Trial], *, last: int) -> list[Trial]:
        """Return the trials in execution order. The order does not affect results.

        Workers wait for the ``last`` trials at the end of a run.
        """
        del last
        return sorted(trials, key=lambda t: (t.task, t.seed))

    def interventions(self, trial: Trial) -> tuple[str, ...]:
        """Return the interventions of a variation, for the record."""
        return () if trial.variation is None else (f"{self.name}: {trial.variation}",)

    def photos(
        self, stored: Mapping[str, Any], wanted: Sequence[Photo], *, size: int, where: str
    ) -> Iterator[np.ndarray]:
        """Yield one image (size, size, 3) for each requested moment in a run.

        Args:
            stored: the world as JSON, from the run plan.
            wanted: Moments, grouped by scene.
            size: Width and height of an image [pixel].
            where: Name of the plan file, for messages.

        Raises:
            RecordError: If the plan is malformed.
            MissingDependencyError: If rendering is not possible here.
            WorldError: If the simulator fails.
        """
        del stored, size, where
        if wanted:
            raise MissingDependencyError(
                f"trials in {self.facts.title} have no images, because this world cannot render recorded states"
            )
        return iter(())
