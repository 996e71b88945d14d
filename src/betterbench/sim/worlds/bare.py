"""Base class for scenes of a world that computes its own states, without MuJoCo or a separate simulator process."""

from __future__ import annotations

import json
import platform
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from betterbench.errors import InvalidInputError, place_of
from betterbench.geometry import IDENTITY_QUATERNION, Pose, Vector, vector_of
from betterbench.interface import ObservationSpec
from betterbench.interface.actions import ActionSpace
from betterbench.interface.state import ObjectInfo, SceneInfo, WorldState
from betterbench.sim.scenes.described import SceneDescription
from betterbench.sim.worlds.world import Instructed, World, digest_of_files
from betterbench.tasks import Truth

if TYPE_CHECKING:
    from betterbench.sim.scenes.rendering import Images, Renderers

OPENING_M = 0.08
"""Distance between the finger pads that is reported by a world without a gripper [m]."""

_JOINTS = 7

_STARTED: set[type] = set()
"""Classes of scenes that have reached the same start twice."""


@dataclass(frozen=True, slots=True)
class _Task:
    id: str


class BareScene(ABC):
    """Scene with only a hand and objects, described by their positions. The goal is a set of named relations.

    A subclass sets :attr:`hand` and :attr:`positions` in :meth:`start`, changes them in :meth:`move`, and evaluates the
    relations of the goal in :meth:`relations`. It may override any other method, such as :meth:`state`.

    Attributes:
        hand: Position of the hand (3,) [m].
        positions: Positions of the objects (n, 3) [m].
    """

    draws_in_step: ClassVar[bool] = False
    instructed_anew: ClassVar[bool] = False
    over: ClassVar[bool] = False

    hand: np.ndarray
    positions: np.ndarray

    def __init__(
        self,
        world: World,
        *,
        task: str,
        condition: str,
        instruction: str,
        seed: int,
        action_space: ActionSpace,
        step_limit: int,
        objects: Sequence[ObjectInfo] = (),
    ) -> None:
        """Store the settings of the trial. The episode begins with :meth:`reset`."""
        self.world, self.control_rate_hz = world.name, world.control_rate_hz
        self.task = _Task(task)
        self.condition = Instructed.of(f"{task}/{condition}", condition, instruction)
        self.seed, self.action_space, self.step_limit = seed, action_space, step_limit
        self._objects, self._step, self._gripper_command = tuple(objects), 0, -1.0
        self._suite = task.rpartition("-")[0]
        self.info = SceneInfo(self._objects, (), (0.0, 0.0, 0.0), OPENING_M)

    @abstractmethod
    def start(self) -> None:
        """Place the hand and the objects at their start positions, which may depend only on the seed of the trial."""

    @abstractmethod
    def move(self, action: np.ndarray) -> None:
        """Move the hand and the objects as an action requests.

        The action lies within the bounds of the action space.
        """

    @abstractmethod
    def relations(self) -> Mapping[str, bool]:
        """Return the name of each relation of the goal, and whether it holds now.

        The goal is met when all of them hold.
        """

    def reset(self) -> WorldState:
        """Go back to the start of the trial, and return the state at the start."""
        self._step, self._gripper_command = 0, -1.0
        self.start()
        self._require_positions()
        if type(self) not in _STARTED:
            self._require_same_start()
        self.info = SceneInfo(self._objects, (), vector_of(self.hand), OPENING_M)
        return self.state()

    def _require_positions(self) -> None:
        """Check that :meth:`start` has set the positions of the hand and of all objects."""
        where = f"{type(self).__name__}.start"
        for name, shape in (("hand", (3,)), ("positions", (len(self._objects), 3))):
            rows = ", with one row for each object" if name == "positions" else ""
            cure = f"Set it to positions [m] in an array of shape {shape}{rows}"
            if not hasattr(self, name):
                raise InvalidInputError(where, f"self.{name} is missing", cure)
            given = np.asarray(getattr(self, name))
            if given.shape != shape and (given.size or 0 not in shape):
                raise InvalidInputError(where, f"self.{name} has shape {given.shape}", cure)
            if not np.issubdtype(given.dtype, np.number) or not np.isfinite(given).all():
                raise InvalidInputError(where, f"self.{name} is not finite", cure)

    def _require_same_start(self) -> None:
        """Check that :meth:`start` goes to the same state again. One trial per process is checked."""
        before = self.simulator_state()
        self.start()
        after = self.simulator_state()
        if any(not np.array_equal(before[name], after[name]) for name in before):
            cure = 'Draw random numbers from stream(self.task.id, self.seed, "PURPOSE"), and set all values anew'
            raise InvalidInputError(place_of(self, "start"), "two starts of one trial differ", cure)
        _STARTED.add(type(self))

    def step(self, action: np.ndarray) -> np.ndarray:
        """Execute an action for one control step, and return the action after clipping."""
        applied = self.action_space.clip(action)
        self.move(applied)
        self._step += 1
        self._gripper_command = float(applied[-1])
        return applied

    def state(self) -> WorldState:
        """Return the privileged state."""
        still = tuple(0.0 for _ in self._objects)
        pose = Pose(vector_of(self.hand), IDENTITY_QUATERNION)
        return WorldState(
            info=self.info,
            step=self._step,
            time_s=self._step / self.control_rate_hz,
            positions=tuple(map(vector_of, self.positions)),
            quaternions=tuple(IDENTITY_QUATERNION for _ in self._objects),
            linear_speeds=still,
            angular_speeds=still,
            ee_pose=pose,
            commanded_pose=pose,
            finger_width_m=OPENING_M,
            gripper_command=self._gripper_command,
            joint_positions=(0.0,) * _JOINTS,
            joint_velocities=(0.0,) * _JOINTS,
            contacts=(),
            held=None,
        )

    def simulator_state(self) -> dict[str, np.ndarray]:
        """Return the positions of the hand and the objects as ``qpos``. The other arrays are empty."""
        qpos = np.concatenate([np.ravel(self.hand), np.ravel(self.positions)]).astype(np.float64)
        return {"qpos": qpos, "qvel": np.zeros(0), "ctrl": np.zeros(0), "act": np.zeros(0)}

    def tracker(self) -> BareTracker:
        """Return the tracker that judges the goal during an episode."""
        return BareTracker(self)

    def described(self, *, images: bool) -> SceneDescription:
        """Return the scene description that is stored in the episode record."""
        return SceneDescription(
            task_version=1,
            suite_version=self._suite,
            instruction=self.condition.instruction.text,
            render_quality=self.world if images else None,
            engine={"simulator": self.world, "machine": platform.machine()},
        )

    def files(self) -> dict[str, bytes]:
        """Return the files that are stored with the record: one JSON file that lists the objects of the scene."""
        objects = [{"name": o.name, "kind": o.kind, "size": o.size_m} for o in self._objects]
        return {"scene.json": json.dumps({"task": self.task.id, "objects": objects}, indent=1).encode()}

    @property
    def content_hash(self) -> str:
        """SHA-256 digest of the scene's files, under which the scene is stored."""
        return digest_of_files(self.files())

    def views(self, spec: ObservationSpec, renderers: Renderers) -> dict[str, Images]:
        """Return an empty dictionary, because the scene has no cameras."""
        del spec, renderers
        return {}

    def native(self) -> dict[str, np.ndarray]:
        """Return an empty dictionary, because policies get only the standard observation in this world."""
        return {}

    def draw_next(self, *, wanted: bool) -> None:
        """Do nothing, because the scene renders no images."""
        del wanted

    def close(self, *, well: bool) -> None:
        """Do nothing, because the scene has no simulator process to close."""
        del well


class BareTracker:
    """Goal tracker for a :class:`BareScene`. The goal is met at the first state in which all relations hold."""

    undecided_states: ClassVar[int] = 0

    def __init__(self, scene: BareScene) -> None:
        """Start judging an episode. The scene must already have been reset."""
        self._scene = scene
        self.relation_names = self.subgoal_names = tuple(self._relations())

    def update(self, state: WorldState) -> Truth:
        """Return which relations hold in the current state of the scene. The argument ``state`` is not used."""
        del state
        found = self._relations()
        if tuple(found) != self.relation_names:
            problem = f"it returned the relations {tuple(found)}, but at the start {self.relation_names}"
            cure = "Return the same relations in the same order at each state"
            raise InvalidInputError(place_of(self._scene, "relations"), problem, cure)
        holds = tuple(map(bool, found.values()))
        return Truth(holds, holds, in_order=True, goal=all(holds), forbidden=False, success=all(holds))

    def _relations(self) -> Mapping[str, bool]:
        """Return the relations of the scene after checking their form."""
        found: object = self._scene.relations()
        problem = None
        if not isinstance(found, Mapping) or not found:
            problem = f"it returned {found!r:.60}"
        else:
            wrong = [name for name, holds in found.items() if not isinstance(holds, bool | np.bool_)]
            if wrong:
                problem = f"the value of {wrong[0]!r} is {found[wrong[0]]!r:.60}"
        if problem is not None:
            cure = "Return a dict from the name of each relation to whether it holds (True or False)"
            raise InvalidInputError(place_of(self._scene, "relations"), problem, cure)
        return found  # type: ignore[return-value]


def bare_object(name: str, kind: str, *, size_m: Vector = (0.04, 0.04, 0.04)) -> ObjectInfo:
    """Return the description of an object, given only the name, kind and size."""
    return ObjectInfo(
        name=name, kind=kind, asset=kind, category=kind, color="", shape="", role="fixture", fixed=True, mass_kg=0.0,
        size_m=size_m,
    )  # fmt: skip
