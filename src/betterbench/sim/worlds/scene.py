"""Scene of a trial, simulated in a separate process that answers over a socket."""

from __future__ import annotations

import json
import math
import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np
from pydantic import Field, TypeAdapter

from betterbench.errors import PremiseError
from betterbench.geometry import Pose, Quaternion, Vector, normalize, to_axis_angle, unit_quaternion, vector_of
from betterbench.interface import ObservationSpec
from betterbench.interface.actions import LIBERO_ABSOLUTE, PANDA_OPENING_M, ActionSpace
from betterbench.interface.state import GRIPPER_BODIES, Contact, ObjectInfo, Region, SceneInfo, SlotInfo, WorldState
from betterbench.json_form import open_form, read_form
from betterbench.sim.worlds.process import WorldError, WorldProcess, WorldProcesses, as_agreed
from betterbench.sim.worlds.rows import RowForm
from betterbench.sim.worlds.world import USUAL_SCENE, Instructed, SceneOptions, World, digest_of_files
from betterbench.tasks import Truth
from betterbench.tasks.worlds.libero import IMAGE_SIDE, OURS, PROTOCOLS, FieldProtocol, suite_named
from betterbench.tasks.worlds.libero_training import TrainedTask

if TYPE_CHECKING:
    from betterbench.sim.scenes.described import SceneDescription
    from betterbench.sim.scenes.rendering import Images, Renderers

PROCESSES = 2
"""Initial number of environments per worker. It is small, because each environment is a separate
process that takes long to start."""

_STORED = ("objects", "places", "relations", "goal", "premises", "arena", "base")
_NUMBERS: Mapping[str, int | None] = {
    **dict.fromkeys(("qpos", "qvel", "act", "ctrl", "joints", "joint_speeds")),
    "ee_position": 3,
    "ee_rotation": 9,
    "goal_position": 3,
    "goal_rotation": 9,
    "fingers": 2,
    "native_position": 3,
    "native_quaternion": 4,
    "native_gripper": 2,
    "controller_position": 3,
    "controller_rotation": 9,
}
"""Arrays of a row and the number of values in each of them, or None if that number depends on the task."""
_PER_OBJECT = {"positions": 3, "quaternions": 4, "velocities": 6}
"""Arrays of a row that have one entry per object, and the number of values in each entry."""
_KINDS = {"row": "f", "touching": "iu", "forces": "f", "holds": "b"}
"""One-dimensional arrays that are sent at each step in addition to the images, with the allowed NumPy kinds."""
_ARRAYS = frozenset(_KINDS)
_IMAGES = frozenset({"image_front", "image_wrist"})
_SHOWN = _ARRAYS | _IMAGES


@open_form
@dataclass(frozen=True, slots=True)
class _StartRegion:
    name: str
    position: Vector
    half_size: Vector


@open_form
@dataclass(frozen=True, slots=True)
class _StartObject:
    name: str
    kind: str
    fixed: bool
    mass: Annotated[float, Field(ge=0.0)]
    size: Vector
    regions: tuple[_StartRegion, ...]
    start: str | None
    of_interest: bool


@open_form
@dataclass(frozen=True, slots=True)
class _EpisodeStart:
    """Reply of a simulator at the start of an episode, without ``row``, which :class:`RowForm` reads."""

    objects: tuple[_StartObject, ...]
    relations: tuple[str, ...]
    goal: tuple[str, ...]
    premises: tuple[str, ...]
    pairs: tuple[tuple[str, str], ...]
    places: tuple[tuple[str, Vector], ...]
    arena: str
    base: Vector
    bddl: str
    engine: dict[str, str]
    done: bool


_EPISODE_START = TypeAdapter(_EpisodeStart)


@dataclass(frozen=True, slots=True)
class WorldTask:
    """Task of a suite, as defined by the simulated world.

    Attributes:
        suite: Suite name ("libero_spatial_swap").
        number: Index of the task in the suite.
        name: Name of the task in the world.
        instruction: Instruction for the policy.
        bddl_sha256: SHA-256 fingerprint of the task's BDDL file.
    """

    suite: str
    number: int
    name: str
    instruction: str
    bddl_sha256: str

    @property
    def id(self) -> str:
        """Name of the task in plans and records.

        The name contains the base suite, so that a modified task and its base task have the same name.
        """
        return task_id(self.suite, self.number)

    @property
    def condition(self) -> str:
        """Name of the condition: the change that the suite makes to its base suite, or "base"."""
        return suite_named(self.suite).change or "base"

    def asked(self) -> dict[str, Any]:
        """Return the fields of a request that tell the simulator which scene to build."""
        return {"suite": self.suite, "task": self.number}


def task_id(suite: str, number: int) -> str:
    """Return the name of a task in plans and records, such as "libero_spatial-05"."""
    return f"{suite_named(suite).base}-{number:02d}"


@dataclass(frozen=True, slots=True)
class ProcessWorld(World):
    """World with a simulator that runs in a separate process. The fields contain data that differs between runs.

    Attributes:
        command: Command of the simulator's process.
        tasks: The tasks, by task name and condition ("libero_spatial-05/base").
        versions: Versions of the packages in the simulator's environment.
        regime: Training distribution of the base suite.
        refuse_broken: Whether the run stops if a scene violates an assumption of its instruction.
    """

    drawn_by: ClassVar[str] = "the simulator's process"

    command: tuple[str, ...] = ()
    protocol: FieldProtocol = PROTOCOLS["openpi"]
    tasks: Mapping[str, WorldTask] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=dict)
    regime: tuple[TrainedTask, ...] = ()
    refuse_broken: bool = True

    @property
    def simulator(self) -> str:
        """Name of the simulator. Records from different simulators are not compared."""
        return self.name

    def step_limit(self, task: WorldTask) -> int:
        """Return the maximum number of control steps in an episode of a task."""
        return self.protocol.steps[suite_named(task.suite).base]

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
    ) -> ProcessScene:
        """Open the scene of a trial. The scene must then be reset.

        If ``depth`` is True, depth images are rendered too.
        """
        del options
        scene = self._scene_class()(
            self, processes, task=task, condition=condition, seed=seed, action_space=action_space, images=images
        )
        scene.draws_depth = depth
        return scene

    def _scene_class(self) -> type[ProcessScene]:
        return ProcessScene

    def environments(self, usual: int) -> int:
        """Return the initial number of environments of a worker.

        Each environment is a process with a slow simulator.
        """
        del usual
        return PROCESSES

    def conventions(self, robot: str) -> dict[str, Any]:
        """Return the world's conventions as short strings."""
        del robot
        return {
            "controller": (
                "robosuite OSC_POSE: deltas are added to the measured pose, absolute poses are its goals; actions pass "
                "unchanged"
            ),
            "images": "LIBERO's, turned by 180 degrees as its clients do: upright and mirrored; RGB, uint8",
            "quaternions": "w x y z, w >= 0",
            "poses": "LIBERO's world frame [m]",
            "units": "m, kg, s, rad",
        }

    def to_json(self) -> dict[str, Any]:
        """Return the world in JSON form, without the location of the simulator."""
        return {
            "name": self.name,
            "protocol": self.protocol.to_json(),
            "tasks": {name: asdict(task) for name, task in self.tasks.items()},
            "versions": dict(self.versions),
            "regime": [task.to_json() for task in self.regime],
            "broken_premises": "refuse" if self.refuse_broken else "run",
            "our_difference": OURS,
        }


class ProcessScene:
    """Scene of a trial, simulated in a separate process.

    The trial starts from an initial state of the task.
    """

    draws_in_step: ClassVar[bool] = True

    def __init__(
        self,
        settings: ProcessWorld,
        processes: WorldProcesses,
        *,
        task: str,
        condition: str,
        seed: int,
        action_space: ActionSpace,
        images: bool,
    ) -> None:
        """Prepare the scene for the initial state with the index ``seed``. Nothing is simulated before :meth:`reset`.

        After a step, ``instructed_anew`` is True if the policy gets a new instruction.
        """
        self.settings, self.seed, self.action_space = settings, seed, action_space
        self.task = settings.tasks[f"{task}/{condition}"]
        self.condition = Instructed.of(f"{task}/{condition}", condition, self.task.instruction)
        self.control_rate_hz = settings.control_rate_hz
        self.step_limit = settings.step_limit(self.task)
        self.instructed_anew = self.draws_depth = False
        self.broken_premises: tuple[str, ...] = ()
        self._processes, self._images, self._draws_next = processes, images, images
        self._process: WorldProcess | None = None
        self._fixed: dict[str, Any] = {}
        self._goal: list[int] = []
        self._document: dict[str, Any] = {}
        self._arrays: dict[str, np.ndarray] = {}
        self._row, self._numbers = RowForm([]), list[float]()
        self._pairs: tuple[tuple[str, str], ...] = ()
        self._step = 0
        self._gripper_command = -1.0
        self._info = SceneInfo((), (), (0.0, 0.0, 0.0), PANDA_OPENING_M)

    @property
    def world(self) -> str:
        """Name of the world that defines how privileged policies read the state."""
        return self.settings.simulator

    @property
    def info(self) -> SceneInfo:
        """Properties of the scene that are constant during the episode. They are known after the reset."""
        return self._info

    @property
    def whole_instruction(self) -> str:
        """All instructions of the episode as one string."""
        return self.condition.instruction.text

    @property
    def over(self) -> bool:
        """Whether the episode ends before its step limit because it can no longer succeed."""
        return False

    @property
    def _process_key(self) -> object:
        """Key under which the process is kept for the next trial of the same scene. None if it runs only one trial."""
        return tuple(self.task.asked().values())

    @property
    def relation_names(self) -> tuple[str, ...]:
        """Names of the relations in the task's file: first those of the initial state, then those of the goal."""
        return tuple(self._fixed["relations"])

    @property
    def subgoal_names(self) -> tuple[str, ...]:
        """Names of the subgoals, which are the relations that make up the goal."""
        return tuple(self._fixed["goal"])

    @property
    def engine(self) -> dict[str, str]:
        """Versions of everything that can change the results."""
        return {"simulator": self.settings.simulator, **self._fixed["engine"], "scene_file": self.task.bddl_sha256}

    @property
    def content_hash(self) -> str:
        """SHA-256 digest of the scene's files, under which the scene is stored."""
        return digest_of_files(self.files())

    def files(self) -> dict[str, bytes]:
        """Return the files that are stored for the scene: the task's file, and a description of the settled scene.

        The models of the objects belong to the world's packages and are not redistributed.
        """
        known = {name: self._fixed[name] for name in _STORED}
        form = {**known, "suite": self.task.suite, "task": self.task.name, "engine": self.engine}
        return {
            "task.bddl": self._fixed["bddl"].encode(),
            "scene.json": json.dumps(form, indent=1, sort_keys=True).encode(),
        }

    def reset(self) -> WorldState:
        """Go to the initial state, execute the settling steps, and check the assumptions of the instruction.

        Raises:
            PremiseError: If the scene violates an assumption of the instruction and the options say to refuse such
                scenes.
            WorldError: If the simulator fails.
        """
        protocol = self.settings.protocol
        answer = self._take_process().start(
            {
                **self.task.asked(),
                "state": self.seed,
                "seed": protocol.seed,
                "settle": protocol.settling_steps,
                "absolute": self.action_space.name == LIBERO_ABSOLUTE.name,
                "images": self._images,
                "size": IMAGE_SIDE,
            }
        )
        with as_agreed("sent a start of an episode"):
            self._begin(answer)
        if self.broken_premises and self.settings.refuse_broken:
            raise PremiseError(
                f"{self.condition.id}, initial state {self.seed}: {', '.join(self.broken_premises)} is false after "
                f"settling, although the instruction {self.task.instruction!r} presupposes it. An update of the "
                "physics engine can break scenes; the installed version is MuJoCo "
                f"{self.engine.get('mujoco', 'of an unknown version')}. Run `better worlds install "
                f"{self.settings.name}` to install the pinned version, or pass --broken-premises run to continue as "
                "LIBERO does."
            )
        return self.state()

    def draw_next(self, *, wanted: bool) -> None:
        """Set whether the policy needs images after the next step. LIBERO renders them during that step."""
        self._draws_next = self._images and wanted

    def step(self, action: np.ndarray) -> np.ndarray:
        """Execute an action for one control step, and return the action that was applied.

        Raises:
            InvalidActionError: If the action is malformed.
            WorldError: If the simulator fails.
        """
        applied = self.action_space.clip(action)
        if self._process is None:
            raise WorldError("the episode has not begun")
        self._take(self._process.step(applied, look=self._draws_next))
        self._step += 1
        if applied[-1]:
            self._gripper_command = float(applied[-1])
        return applied

    def state(self) -> WorldState:
        """Return the privileged state. Raises WorldError if the simulator has sent impossible values."""
        with as_agreed("sent a state"):
            return self._state()

    def _state(self) -> WorldState:
        arrays, pairs = self._arrays, self._pairs
        # A negative index would count from the end of the array.
        touching = [pairs[number] for number in arrays["touching"].tolist() if number >= 0]
        forces = arrays["forces"].tolist()
        if not math.isfinite(sum(forces)):
            require_finite({"forces": arrays["forces"]})
        contacts = tuple([Contact(a, b, force) for (a, b), force in zip(touching, forces, strict=True)])
        v = self._get("velocities")
        turning, moving = zip(v[0::6], v[1::6], v[2::6], strict=True), zip(v[3::6], v[4::6], v[5::6], strict=True)
        p, q = self._get("positions"), self._get("quaternions")
        quaternions = zip(q[0::4], q[1::4], q[2::4], q[3::4], strict=True)
        left, right = self._get("fingers")
        return WorldState(
            info=self._info,
            step=self._step,
            time_s=self._step / self.control_rate_hz,
            positions=tuple(zip(p[0::3], p[1::3], p[2::3], strict=True)),
            quaternions=tuple(map(unit_quaternion, quaternions)),
            linear_speeds=tuple([math.sqrt(x * x + y * y + z * z) for x, y, z in moving]),
            angular_speeds=tuple([math.sqrt(x * x + y * y + z * z) for x, y, z in turning]),
            ee_pose=Pose(vector_of(self._get("ee_position")), _from_matrix(self._get("ee_rotation"))),
            commanded_pose=Pose(vector_of(self._get("goal_position")), _from_matrix(self._get("goal_rotation"))),
            finger_width_m=abs(left) + abs(right),
            gripper_command=self._gripper_command,
            joint_positions=tuple(self._get("joints")),
            joint_velocities=tuple(self._get("joint_speeds")),
            contacts=contacts,
            held=held_object(contacts, self._info),
        )

    def simulator_state(self) -> dict[str, np.ndarray]:
        """Return the simulator's arrays ``qpos``, ``qvel``, ``act`` and ``ctrl``."""
        row, places = self._arrays["row"], self._row.places
        return {name: row[places[name]] for name in ("qpos", "qvel", "act", "ctrl")}

    def truth(self) -> Truth:
        """Return the relations and subgoals that hold now. The world itself decides whether the task succeeded."""
        holds = self._arrays["holds"].tolist()
        subgoals = tuple([holds[i] for i in self._goal])
        return Truth(
            relations=tuple(holds),
            subgoals=subgoals,
            in_order=True,
            goal=all(subgoals),
            forbidden=False,
            success=bool(self._document["done"]),
        )

    def tracker(self) -> ProcessTracker:
        """Return the tracker that reports the world's own verdict during an episode. Call it after the reset."""
        return ProcessTracker(self)

    def described(self, *, images: bool) -> SceneDescription:
        """Return the scene's description for the record. Call it after a reset."""
        from betterbench.sim.scenes.described import SceneDescription  # noqa: PLC0415 - a list of suites needs none

        engine = {**self.engine, "machine": platform.machine()}
        if self.broken_premises:
            engine["scene_broken_premises"] = ", ".join(self.broken_premises)
        return SceneDescription(
            task_version=1,
            suite_version=self.task.suite,
            instruction=self.whole_instruction,
            render_quality=self.settings.name if images else None,
            engine=engine,
        )

    def views(self, spec: ObservationSpec, renderers: Renderers) -> dict[str, Images]:
        """Return the images of the current step by camera. The simulator process has rendered them."""
        from betterbench.sim.scenes.rendering import Images  # noqa: PLC0415 - a simulator's tests need no renderer

        del spec, renderers
        depth = self.depth()
        return {name: Images(image, depth.get(name), None) for name, image in self.images().items()}

    def images(self) -> dict[str, np.ndarray]:
        """Return the images of the current step by camera, rotated by 180 degrees as in LIBERO's clients."""
        return {name.removeprefix("image_"): a for name, a in self._arrays.items() if name.startswith("image_")}

    def depth(self) -> dict[str, np.ndarray]:
        """Return the depth images of the current step by camera, as (height, width) float32 arrays [m].

        The result is empty if no depth is rendered.
        """
        return {name.removeprefix("depth_"): a for name, a in self._arrays.items() if name.startswith("depth_")}

    def native(self) -> dict[str, np.ndarray]:
        """Return the values that LIBERO's clients compute from an observation, under betterbench's names for them."""
        row, places = self._arrays["row"], self._row.places
        quaternion = row[places["native_quaternion"]]
        turned = row[places["controller_rotation"]].reshape(3, 3)
        x, y, z = to_axis_angle(_from_matrix(turned.reshape(9).tolist()))
        return {
            "ee_position": row[places["native_position"]],
            "ee_axis_angle": quat2axisangle(quaternion),
            "ee_axis_angle_short": quat2axisangle(-quaternion if quaternion[3] < 0.0 else quaternion),
            "gripper_fingers": row[places["native_gripper"]],
            "controller_position": row[places["controller_position"]],
            "controller_axis_angle": np.array([x, y, z]),
            "controller_rotation_6d": np.concatenate([turned[:, 0], turned[:, 1]]),
        }

    def _take_process(self) -> WorldProcess:
        """Return a process for a new episode.

        If the policy ended the last episode early, the process of that episode is given back first.
        """
        self.close(well=True)
        self._process = self._processes.take(self._process_key)
        return self._process

    def close(self, *, well: bool) -> None:
        """Give the process back for reuse if the trial ended without an error (``well``). Otherwise end the process."""
        process, self._process = self._process, None
        if process is None:
            return
        if well:
            self._processes.give_back(self._process_key, process)
        else:
            process.close(0.0)

    def _take(self, answer: tuple[dict[str, Any], dict[str, np.ndarray]]) -> None:
        """Store the simulator's answer after checking it.

        Raises WorldError if an array is missing, has an unexpected size or contains a non-finite number.
        """
        document, arrays = answer
        due = _SHOWN if self._draws_next else _ARRAYS
        if not arrays.keys() >= due:
            raise WorldError(f"the simulator did not send the arrays {', '.join(sorted(due - arrays.keys()))}")
        if not isinstance(document.get("done"), bool):
            raise WorldError(
                f"the simulator must send a boolean as the success of the task, got {str(document.get('done'))[:40]!r}"
            )
        for name, kinds in _KINDS.items():
            if arrays[name].ndim != 1 or (arrays[name].dtype.kind not in kinds and arrays[name].size):
                found = f"{arrays[name].dtype} {arrays[name].shape}"
                raise WorldError(f"the simulator sent the array {name} with an unexpected type or shape: {found}")
        row = arrays["row"]
        if row.shape != (self._row.size,) or row.dtype.char != "d":
            raise WorldError(f"the simulator sent a row of {row.size} numbers, expected {self._row.size}")
        if arrays["holds"].shape != (len(self._fixed["relations"]),):
            raise WorldError(
                f"the simulator sent the values of {arrays['holds'].size} relations, "
                f"expected {len(self._fixed['relations'])}"
            )
        for name in _IMAGES if self._draws_next else ():
            require_image(name, arrays[name], (IMAGE_SIDE, IMAGE_SIDE, 3))
        numbers = row.tolist()
        # The sum is finite only if all numbers are, and computing it takes a third of the time of testing each number.
        if not math.isfinite(sum(numbers)) and (wrong := self._row.not_finite(row)):
            raise WorldError(f"the simulator sent a non-finite number in {', '.join(wrong)}")
        self._document, self._arrays, self._numbers = document, arrays, numbers

    def _begin(self, answer: tuple[dict[str, Any], dict[str, np.ndarray]]) -> None:
        """Store the reply to the start of an episode. Raises WorldError if the rows lack a required array.

        Other malformed replies raise exceptions that :func:`~betterbench.sim.worlds.process.as_agreed` converts into a
        WorldError.
        """
        where, cure = "the start that the simulator sent", "Install the world again (better worlds install)"
        start = read_form(_EPISODE_START, answer[0], where=where, cure=cure, raises=WorldError)
        self._row = RowForm(answer[0].get("row"))
        self._pairs = start.pairs
        objects = len(start.objects)
        due = {**_NUMBERS, **{name: width * objects for name, width in _PER_OBJECT.items()}}
        for name, count in due.items():
            shape = self._row.shapes.get(name)
            if shape is None or (count is not None and math.prod(shape) != count):
                raise WorldError(f"the simulator's rows contain {name} with the unexpected shape {shape}")
        self._fixed = answer[0]
        self._take(answer)
        self._goal = [self.relation_names.index(name) for name in self.subgoal_names]
        self._step, self._gripper_command = 0, -1.0
        self._info = self._describe()
        holds = dict(zip(self.relation_names, self._arrays["holds"].tolist(), strict=True))
        self.broken_premises = tuple(name for name in self._fixed["premises"] if not holds[name])

    def _get(self, name: str) -> list[float]:
        """Return the values of one array in the current row."""
        return self._numbers[self._row.places[name]]

    def _describe(self) -> SceneInfo:
        goal = " ".join(self._fixed["goal"])
        objects = tuple(
            ObjectInfo(
                name=o["name"],
                kind=o["kind"].replace("_", " "),
                asset=o["kind"],
                category=o["kind"],
                color="",
                shape="",
                role=_role(o, goal),
                fixed=bool(o["fixed"]),
                mass_kg=float(o["mass"]),
                size_m=vector_of(o["size"]),
                regions=tuple(
                    Region(str(r["name"]), vector_of(r["position"]), vector_of(r["half_size"])) for r in o["regions"]
                ),
                slot=o["start"],
            )
            for o in self._fixed["objects"]
        )
        slots = tuple(SlotInfo(str(name), vector_of(place), 0.0) for name, place in self._fixed["places"])
        return SceneInfo(objects, slots, vector_of(self._get("ee_position")), PANDA_OPENING_M)


class ProcessTracker:
    """Goal tracker for scenes of other worlds, the counterpart of :class:`betterbench.tasks.GoalTracker`."""

    def __init__(self, scene: ProcessScene) -> None:
        """Prepare to track an episode. The scene must already have been reset."""
        self._scene = scene

    @property
    def relation_names(self) -> tuple[str, ...]:
        """Names of the recorded relations."""
        return self._scene.relation_names

    @property
    def subgoal_names(self) -> tuple[str, ...]:
        """Names of the subgoals, which are the relations that make up the goal."""
        return self._scene.subgoal_names

    @property
    def undecided_states(self) -> int:
        """Always 0, because the world evaluates its relations in every state."""
        return 0

    def update(self, state: WorldState) -> Truth:
        """Return the relations and subgoals that hold in the world's current state. ``state`` is not used."""
        del state
        return self._scene.truth()


def quat2axisangle(quaternion: np.ndarray) -> np.ndarray:
    """Return the rotation vector (3,) [rad] of a quaternion (x, y, z, w), without choosing the shorter rotation.

    The result is bit-identical to that of the function with this name in robosuite and in openpi's
    ``examples/libero/main.py``. For w < 0, the vector is longer than half a turn, as in the training data of LIBERO's
    policies.
    """
    w = min(max(float(quaternion[3]), -1.0), 1.0)
    den = np.sqrt(1.0 - w * w)
    if math.isclose(den, 0.0):
        return np.zeros(3)
    rotation: np.ndarray = (quaternion[:3] * 2.0 * math.acos(w)) / den
    return rotation


def _role(thing: Mapping[str, Any], goal: str) -> str:
    if thing["fixed"]:
        return "fixture"
    if not thing["of_interest"]:
        return "distractor"
    return "item" if f"({thing['name']}" in goal else "container"


def held_object(contacts: tuple[Contact, ...], info: SceneInfo) -> str | None:
    """Return the name of the object that is touched by both fingers and by nothing else, or None if there is none."""
    left = _touching(contacts, "left_finger")
    between = left & _touching(contacts, "right_finger") if left else left
    if between:
        for thing in info.objects:
            if thing.name in between and not thing.fixed and _touching(contacts, thing.name) <= GRIPPER_BODIES:
                return thing.name
    return None


def _touching(contacts: tuple[Contact, ...], name: str) -> set[str]:
    """Return the names of all bodies in contact with the given body."""
    return {b if a == name else a for a, b, _ in contacts if name in (a, b)}


def require_finite(arrays: Mapping[str, np.ndarray]) -> None:
    """Raise WorldError if an array that a simulator has sent contains a non-finite number."""
    floats = [array.ravel() for array in arrays.values() if array.dtype.kind == "f"]
    if floats and not np.isfinite(np.concatenate(floats)).all():
        wrong = [n for n, array in arrays.items() if array.dtype.kind == "f" and not np.isfinite(array).all()]
        raise WorldError(f"the simulator sent a non-finite number in {', '.join(wrong)}")


def require_image(name: str, image: np.ndarray, shape: tuple[int, ...]) -> None:
    """Raise WorldError if an image or depth image from a simulator does not have the agreed shape and type."""
    agreed = np.float32 if name.startswith("depth_") else np.uint8
    if image.shape != shape or image.dtype != agreed:
        raise WorldError(
            f"the simulator sent {name} as {image.dtype} {image.shape}, expected {np.dtype(agreed)} {shape}"
        )


def _from_matrix(numbers: Sequence[float]) -> Quaternion:
    """Return the quaternion (w, x, y, z) of a rotation matrix given row by row.

    The quaternion is computed from its largest component (Shepperd 1978), which is numerically stable.
    """
    m = (numbers[0:3], numbers[3:6], numbers[6:9])
    trace = m[0][0] + m[1][1] + m[2][2]
    squares = [trace, m[0][0], m[1][1], m[2][2]]
    largest = squares.index(max(squares))
    if largest == 0:
        return normalize((1.0 + trace, m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1]))
    i = largest - 1
    j, k = (i + 1) % 3, (i + 2) % 3
    found = [0.0] * 4
    found[0] = m[k][j] - m[j][k]
    found[1 + i] = 1.0 + m[i][i] - m[j][j] - m[k][k]
    found[1 + j] = m[j][i] + m[i][j]
    found[1 + k] = m[k][i] + m[i][k]
    return normalize(found)
