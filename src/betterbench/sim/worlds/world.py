"""World: what a run asks of the place in which its trials are played, and what an episode asks of a scene there."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, TypeVar

import numpy as np

from betterbench.errors import MissingDependencyError, UnknownNameError
from betterbench.interface import ObservationSpec
from betterbench.interface.actions import EE_DELTA, ActionSpace
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
    """Moment of a trial to be drawn.

    Attributes:
        scene: Task and condition of the trial as one text ("libero_spatial-05/base").
        record: Record of the trial.
        row: Row of the record.
    """

    scene: str
    record: Record
    row: int


@dataclass(frozen=True, slots=True)
class PlanRequest:
    """Choice of the trials of a run.

    Attributes:
        suite: Name of the suite.
        tasks: Tasks to run, by name or number; all of the suite if none is named.
        trials: Number of trials as the world counts them; its usual number if None.
        seed: First seed, or the first of what the world numbers.
        options: Options of this world alone, by name.
    """

    suite: str
    tasks: tuple[str, ...] = ()
    trials: int | None = None
    seed: int = 0
    options: Mapping[str, Any] = field(default_factory=dict)

    def options_as(self, form: Callable[..., Form], *, world: str) -> Form:
        """Return the options as a dataclass; an option that it lacks raises an UnknownNameError."""
        known = [f.name for f in fields(form)]  # type: ignore[arg-type]
        for name in self.options:
            if name not in known:
                raise UnknownNameError(f"option of {world}", name, known)
        return form(**self.options)


@dataclass(frozen=True, slots=True)
class SceneOptions:
    """Choices about a scene that only some worlds have: its render preset, its robot, and the looks of its objects."""

    quality: str = "standard"
    robot: str = "panda"
    looks: Looks = "seen"


USUAL_SCENE = SceneOptions()
"""Choices of a run that says nothing about them."""


@dataclass(frozen=True, slots=True)
class Instruction:
    """Instruction of a trial as the policy gets it."""

    text: str


@dataclass(frozen=True, slots=True)
class Instructed:
    """Condition of a world whose tasks are not ours, with the fields that an episode reads.

    Attributes:
        id: Task and condition as one text ("libero_spatial-05/base").
        name: Name of the condition.
    """

    id: str
    name: str
    instruction: Instruction
    expected: Expected = Expected.SUCCEED

    @classmethod
    def of(cls, whole: str, name: str, sentence: str) -> Instructed:
        """Return the condition ``whole`` ("libero_spatial-05/base") with a sentence."""
        return cls(whole, name, Instruction(sentence))


class Named(Protocol):
    """Task of a scene."""

    @property
    def id(self) -> str:
        """Name of the task in plans and records."""


class Told(Protocol):
    """Instruction of a condition."""

    @property
    def text(self) -> str:
        """The sentence that the policy gets."""


class SceneCondition(Protocol):
    """Condition of a scene."""

    @property
    def id(self) -> str:
        """Task and condition as one text."""

    @property
    def name(self) -> str:
        """Name of the condition."""

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
        """Names of the relation columns of a record."""

    @property
    def subgoal_names(self) -> tuple[str, ...]:
        """Names of the subgoals, in their order."""

    @property
    def undecided_states(self) -> int:
        """States that follow before the episode can succeed, at least; 0 if the next one may end it."""

    def update(self, state: WorldState) -> Truth:
        """Return the relations and subgoals that hold in a state; states are given in order, from reset on."""


class TrialScene(Protocol):
    """Scene of one trial, as an episode drives it."""

    @property
    def world(self) -> str:
        """Name of the world in whose terms privileged policies read the state."""

    @property
    def draws_in_step(self) -> bool:
        """Whether images are drawn in the middle of a control step.

        Before each step, :meth:`draw_next` is then called, and the time of drawing is measured apart.
        """

    @property
    def instructed_anew(self) -> bool:
        """Whether the policy gets another instruction after the last step."""

    @property
    def over(self) -> bool:
        """Whether the episode cannot succeed any more and ends before its step limit."""

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
        """Actions per second."""

    @property
    def step_limit(self) -> int:
        """Control steps after which an episode ends."""

    @property
    def info(self) -> SceneInfo:
        """Properties of the scene that stay the same in the episode; known after the reset."""

    @property
    def content_hash(self) -> str:
        """Name of the stored scene: a digest of :meth:`files`."""

    def files(self) -> dict[str, bytes]:
        """Return the files that are stored once per distinct scene."""

    def reset(self) -> WorldState:
        """Go to the start of the trial and return the state; PremiseError if the scene breaks its premise."""

    def step(self, action: np.ndarray) -> np.ndarray:
        """Execute an action for one control step and return it as it was applied; InvalidActionError if malformed."""

    def draw_next(self, *, wanted: bool) -> None:
        """Say whether the policy is shown images after the next step."""

    def state(self) -> WorldState:
        """Return the privileged state."""

    def simulator_state(self) -> Mapping[str, np.ndarray]:
        """Return the arrays ``qpos``, ``qvel``, ``ctrl`` and ``act``, which the records keep."""

    def tracker(self) -> Tracker:
        """Return the judge of an episode that has been reset."""

    def described(self, *, images: bool) -> SceneDescription:
        """Return what a record says about the scene; ``images`` tells whether any are drawn."""

    def views(self, spec: ObservationSpec, renderers: Renderers) -> Mapping[str, Images]:
        """Return the images of this moment by camera; ``renderers`` are those of the worker, for MuJoCo models."""

    def native(self) -> Mapping[str, np.ndarray]:
        """Return what the world's own clients read of the state, by the names of our state parts; empty if nothing.

        If it is not empty, "ee_position" is what a policy gets for the position of the tool.
        """

    def close(self, *, well: bool) -> None:
        """Free what the trial holds; ``well`` tells whether its record was written."""


class World(ABC):
    """A world: its tasks, its scenes and its conventions. A frozen value.

    The registered value (:mod:`betterbench.sim.worlds.registry`) describes the world; :meth:`plan` returns the trials
    of a run together with the value that the run keeps as ``plan.world``, which may hold what only this run needs.
    Subclasses are frozen dataclasses whose fields can be pickled; the register pickles them by name.

    Attributes:
        facts: Facts that need no simulator.
        control_rate_hz: Actions per second.
        action_spaces: Action spaces that it plays, its usual one first.
        observations: Observation presets that it offers: from the name that is asked for to the preset that is used.
        dialect: World in whose conventions a policy server is spoken to ("libero"); empty for those of our own scenes.
        drawn_by: Where images are rendered, for the manifest; empty if the workers render MuJoCo models.
        options: Dataclass of the options that only this world has, as :attr:`PlanRequest.options` may name them.
        installation: Environment of its simulator, or None if it needs none.
        command: Command of its simulator's process; empty if it has none.
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
        """Its name in plans and on the command line."""
        return self.facts.name

    @property
    def is_ready(self) -> bool:
        """Whether trials can be run here: nothing has to be installed first."""
        return self.installation is None or self.installation.is_installed

    @abstractmethod
    def plan(self, asked: PlanRequest) -> tuple[tuple[Trial, ...], World]:
        """Return the trials of a run, and the world as the run keeps it.

        Raises:
            InvalidInputError: If a number is out of range or nothing is left to run.
            UnknownNameError: If there is no such suite, task or option.
            MissingDependencyError: If the world is not installed.
            WorldError: If its simulator does not answer.
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
        """Return the scene of a trial.

        Args:
            processes: Processes of :attr:`command`, of which the scene may take one.
            task: Name of the task.
            condition: Name of the condition.
            seed: Seed of the trial.
            action_space: Action space of the run.
            images: Whether the policy is shown images.
            depth: Whether it is shown depth images beside them.
            options: Choices that only some worlds have.
        """

    def start_command(self) -> tuple[str, ...]:
        """Return the command of the simulator's process, as far as it needs nothing else of the user."""
        return () if self.installation is None else self.installation.command()

    def to_json(self) -> dict[str, Any]:
        """Return the JSON form for plans: with it, a run can be read where the world is not known."""
        return {"name": self.name, "facts": self.facts.to_json()}

    def plan_head(self, tasks: Sequence[str]) -> dict[str, Any]:
        """Return what a plan says about the world and the versions of its tasks."""
        del tasks
        return {"world": self.to_json()}

    def plan_options(self, options: SceneOptions) -> dict[str, Any]:
        """Return what a plan says about choices that only some worlds have."""
        del options
        return {}

    def conventions(self, robot: str) -> dict[str, Any]:
        """Return the conventions of the world in words; ``robot`` is the name of the run's robot."""
        del robot
        return {"control_rate_hz": self.control_rate_hz, "units": "m, kg, s, rad"}

    def announcement(self, trials: Sequence[Trial], suite: str) -> tuple[str, ...]:
        """Return the sentences that are said before a run begins: its extent, and what it cannot show."""
        return (f"{len(trials)} trial{'' if len(trials) == 1 else 's'} of {suite}.",)

    def prepare(self, robot: str, on_progress: Callable[[str, int, int], None]) -> None:  # noqa: B027 - most need nothing
        """Prepare this machine once, before any worker starts.

        ``on_progress`` is called with what is being done, the steps done and the steps in all.
        """

    def environments(self, usual: int) -> int:
        """Return with how many environments a worker begins whose policy answers from elsewhere."""
        return usual

    def step_limits(self, trials: Sequence[Trial]) -> Mapping[TrialId, int]:
        """Return how many control steps each trial may take; empty if that is not known beforehand."""
        del trials
        return {}

    def in_order(self, trials: Sequence[Trial], *, last: int) -> list[Trial]:
        """Return trials in the order in which they are run; results do not depend on it.

        The ``last`` ones are those for which workers wait at the end of a run.
        """
        del last
        return sorted(trials, key=lambda t: (t.task, t.seed))

    def interventions(self, trial: Trial) -> tuple[str, ...]:
        """Return what a variation changes, for its record."""
        return () if trial.variation is None else (f"{self.name}: {trial.variation}",)

    def photos(
        self, stored: Mapping[str, Any], wanted: Sequence[Photo], *, size: int, where: str
    ) -> Iterator[np.ndarray]:
        """Yield one image (size, size, 3) for each moment of a run.

        Args:
            stored: JSON form of the world in the plan of the run.
            wanted: Moments, those of one scene one after the other.
            size: Width and height of an image [pixel].
            where: Name of the file of the plan, for messages.

        Raises:
            RecordError: If the plan is malformed.
            MissingDependencyError: If nothing here can draw them.
            WorldError: If the simulator fails.
        """
        del stored, size, where
        if wanted:
            raise MissingDependencyError(
                f"trials in {self.facts.title} have no images: the world cannot draw a recorded state"
            )
        return iter(())
