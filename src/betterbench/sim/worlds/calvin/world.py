"""CALVIN ABC→D as a world: chains of five instructions, simulated in the user's checkout of ``calvin_env``.

A trial is a chain, and its seed is the index of the chain. The trial succeeds when all five subtasks are done. The
record contains the number of consecutive subtasks that were done. The suite ``calvin`` starts each chain as CALVIN
does. In the suite ``calvin_resampled``, the blocks may start anywhere in the range of the training data.
"""

from __future__ import annotations

import json
import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import TypeAdapter

from betterbench.errors import InvalidInputError, PremiseError, UnknownNameError, one_line, require_between
from betterbench.geometry import Pose, Quaternion, Vector, horizontal_distance, multiply, rotate, vector_of
from betterbench.interface.actions import (
    CALVIN_ABSOLUTE,
    CALVIN_ABSOLUTE_QUATERNION,
    CALVIN_DELTA,
    PANDA_OPENING_M,
    PLAYED_IN,
    ActionSpace,
)
from betterbench.interface.state import Contact, ObjectInfo, SceneInfo, WorldState
from betterbench.json_form import open_form, read_form
from betterbench.sim.worlds.installation import Installation
from betterbench.sim.worlds.process import WorldError, WorldProcess, WorldProcesses, as_agreed, sent_text, sent_texts
from betterbench.sim.worlds.scene import (
    ProcessScene,
    ProcessWorld,
    WorldTask,
    held_object,
    require_finite,
    require_image,
)
from betterbench.sim.worlds.world import Instructed, PlanRequest
from betterbench.tasks import Expected, Truth
from betterbench.tasks.trial import Trial
from betterbench.tasks.worlds.calvin import (
    CHAINS,
    STEPS_PER_SUBTASK,
    Chain,
    ChainStart,
    PlayTable,
    calvin_chains,
    done,
    read_play_table,
    resampled_start_of,
    start_of,
)
from betterbench.tasks.worlds.calvin.play_table import finite_number
from betterbench.tasks.worlds.calvin.sequences import CHAIN_LENGTH, GOLDEN
from betterbench.tasks.worlds.calvin.starts import BLOCKS, DRAWER_OPEN_M, SLIDER_OPEN_M
from betterbench.tasks.worlds.calvin.suites import CALVIN, CHAIN_SUITES, OFFICIAL
from betterbench.tasks.worlds.facts import WorldFacts
from betterbench.tasks.worlds.libero import FieldProtocol
from betterbench.wording import plural

logger = logging.getLogger(__name__)

INSTALLATION = Installation(
    CALVIN.name,
    "world-calvin.lock",
    "betterbench.sim.worlds.calvin.simulator",
    "270 MB (0.9 GB unpacked)",
    "CALVIN ABC→D with PyBullet 3.2.7, in your checkout of calvin_env",
)

OURS = (
    "every chain runs in a separate process, like the first one of CALVIN's evaluation, so that it does not "
    "depend on earlier chains"
)
"""Difference between CALVIN's own evaluation and every run in betterbench."""

PROTOCOL = FieldProtocol("calvin", {OFFICIAL: CHAIN_LENGTH * STEPS_PER_SUBTASK}, CHAINS, settling_steps=0, seed=0)
"""CALVIN's own evaluation protocol (mees/calvin@fa03f01, ``evaluate_policy.py``)."""

RELATIONS = ("open(drawer)", "left(slider)", "on(lightbulb)", "on(led)")
"""Relations of the table that are recorded.

A door counts as open if it is open by more than half of the opening that it has in start states with an open door.
"""

_SPLITS = {
    CALVIN_ABSOLUTE.name: [3, 6],
    CALVIN_DELTA.name: [3, 6],
    CALVIN_ABSOLUTE_QUATERNION.name: [3, 7],
}
"""Indices at which calvin_env splits an action into position, rotation and gripper, for each action space."""

_HALF_CLOSED = 0.5
"""Gripper command below which X-VLA's client considers the gripper closed."""
_MODULE = "envs/play_table_env.py"
_RENDERER_WORDS = {True: "egl", False: "", None: "auto"}
"""Last word of the simulator's command, which chooses the renderer.

The keys mean EGL, TinyRenderer, and EGL if it works.
"""

_DISPLACED_M = 0.03
_DOOR_OFF_M = 0.02
_ROW = {"robot": (15,), "scene": (24,), "target": (6,)}
_IMAGES = {
    "image_front": (200, 200, 3),
    "image_wrist": (84, 84, 3),
    "depth_front": (200, 200),
    "depth_wrist": (84, 84),
}


@open_form
@dataclass(frozen=True, slots=True)
class _ChainStart:
    """The simulator's reply at the start of a chain, except for the part that :func:`read_play_table` reads."""

    engine: dict[str, str]
    code: str
    fingers: tuple[int, ...]
    flange: int


_CHAIN_START = TypeAdapter(_ChainStart)


@dataclass(frozen=True, slots=True)
class ChainTask(WorldTask):
    """Task that represents all chains of a CALVIN suite. Each of its trials is one chain.

    ``bddl_sha256`` is the digest of the checkout's code.
    """

    @property
    def id(self) -> str:
        """Name of the task in plans and records."""
        return OFFICIAL

    @property
    def condition(self) -> str:
        """Name of the condition: "base" for CALVIN's own start states, "resampled" otherwise."""
        return CHAIN_SUITES[self.suite].change or "base"


@dataclass(frozen=True, slots=True)
class ChainOptions:
    """Options of a run in CALVIN.

    Attributes:
        broken_premises: "refuse" stops the run if a scene differs from the start state of its chain. "run" continues
            the run in this case.
        calvin_env: A checkout of calvin_env, or of mees/calvin, which contains calvin_env.
        calvin_config: The ``merged_config.yaml`` of a data set. If it is None, the checkout's configuration is used.
        calvin_renderer: "egl", "tiny" (PyBullet's TinyRenderer), or "auto", which uses EGL if it works.
        command: Command that starts the simulator process. If it is empty, the other options determine the command.
    """

    broken_premises: Literal["refuse", "run"] = "refuse"
    calvin_env: Path | None = None
    calvin_config: Path | None = None
    calvin_renderer: Literal["auto", "egl", "tiny"] = "auto"
    command: Sequence[str] = ()


@dataclass(frozen=True, slots=True)
class CalvinWorld(ProcessWorld):
    """CALVIN as the world of a run. The simulator reports the versions of its components.

    Attributes:
        objects: The objects of the scene: first the blocks, then the fixtures.
    """

    facts: ClassVar[WorldFacts] = CALVIN
    control_rate_hz: ClassVar[float] = 30.0
    action_spaces: ClassVar[tuple[str, ...]] = PLAYED_IN["calvin"]
    observations: ClassVar[Mapping[str, str]] = {
        "default": "calvin",
        "calvin": "calvin",
        "calvin_depth": "calvin_depth",
        "state_only": "state_only",
    }
    dialect: ClassVar[str] = "calvin"
    options: ClassVar[type | None] = ChainOptions
    installation: ClassVar[Installation | None] = INSTALLATION

    protocol: FieldProtocol = PROTOCOL
    objects: tuple[ObjectInfo, ...] = ()

    def step_limit(self, task: WorldTask) -> int:
        """Return the maximum number of control steps in a chain."""
        del task
        return self.protocol.steps[OFFICIAL]

    def _scene_class(self) -> type[ProcessScene]:
        return ChainScene

    def plan(self, asked: PlanRequest) -> tuple[tuple[Trial, ...], CalvinWorld]:
        """Plan chains as trials (by default all 1,000). Return the trials and the world to be stored with the plan."""
        options = asked.options_as(ChainOptions, world=self.facts.title)
        suite, seed = asked.suite, asked.seed
        if suite not in CHAIN_SUITES:
            raise UnknownNameError("CALVIN suite", suite, CHAIN_SUITES)
        if asked.tasks:
            raise InvalidInputError(
                "--tasks", "CALVIN has no tasks, only chains", "Choose chains with --seed and --trials"
            )
        change = CHAIN_SUITES[suite].change
        require_between("--seed", seed, 0, CHAINS - 1)
        count = CHAINS - seed if asked.trials is None else asked.trials
        require_between("--trials", count, 1, CHAINS - seed)
        egl = None if options.calvin_renderer == "auto" else options.calvin_renderer == "egl"
        command = options.command or calvin_command(options.calvin_env, options.calvin_config, egl=egl)
        started, said = describe_chains(command, suite)
        with as_agreed(f"sent a description of {suite}"):
            task = ChainTask(suite, 0, suite, "five instructions in a row", sent_text(said["tasks"][0]["fingerprint"]))
            versions = sent_texts(said["versions"])
            objects = chain_objects(said["objects"])
        planned = tuple(
            Trial(task.id, task.condition, change, None, change and "base", number, Expected.SUCCEED.value)
            for number in range(seed, seed + count)
        )
        world = replace(
            self,
            command=started,
            tasks={f"{task.id}/{task.condition}": task},
            versions=versions,
            refuse_broken=options.broken_premises == "refuse",
            objects=objects,
        )
        return planned, world

    def announcement(self, trials: Sequence[Trial], suite: str) -> tuple[str, ...]:
        """Return one message that states the number of chains and the versions of the components."""
        made_of = "; ".join(f"{k}: {v}" for k, v in self.versions.items())
        said = (
            f"{plural(len(trials), 'chain')} of {suite}, with at most {STEPS_PER_SUBTASK} steps for each of the five "
            f"instructions. {made_of}."
        )
        return (said,)

    def conventions(self, robot: str) -> dict[str, Any]:
        """Return the world's conventions as short strings."""
        return {
            **ProcessWorld.conventions(self, robot),
            "controller": "calvin_env: relative actions are added to the last target, absolute actions replace the "
            "target; unclipped",
            "images": "CALVIN's, as rendered: upright; RGB, uint8",
            "poses": "CALVIN's world frame [m]",
        }

    def to_json(self) -> dict[str, Any]:
        """Return the world in JSON form, without the location of the checkout."""
        return {
            "name": self.name,
            "protocol": self.protocol.to_json(),
            "steps_per_subtask": STEPS_PER_SUBTASK,
            "chains_sha256": GOLDEN,
            "tasks": {name: asdict(task) for name, task in self.tasks.items()},
            "versions": dict(self.versions),
            "broken_premises": "refuse" if self.refuse_broken else "run",
            "our_difference": OURS,
        }


class ChainScene(ProcessScene):
    """Scene of one CALVIN chain. Its instruction changes whenever a subtask is done."""

    settings: CalvinWorld

    def __init__(
        self,
        settings: CalvinWorld,
        processes: WorldProcesses,
        *,
        task: str,
        condition: str,
        seed: int,
        action_space: ActionSpace,
        images: bool,
    ) -> None:
        """Prepare the scene of the chain with the index ``seed``. Nothing is simulated before :meth:`reset`."""
        super().__init__(
            settings, processes, task=task, condition=condition, seed=seed, action_space=action_space, images=images
        )
        self.chain: Chain = calvin_chains()[seed]
        self._done = 0
        self._steps_of_subtask = 0
        self._name = f"{task}/{condition}"
        self._begun: PlayTable | None = None
        self._now: PlayTable | None = None
        self._commanded = np.zeros(6)
        self._instruct()

    @property
    def whole_instruction(self) -> str:
        """The five instructions of the chain, joined with semicolons."""
        return "; ".join(subtask.instruction for subtask in self.chain.subtasks)

    @property
    def _process_key(self) -> object:
        """Always None, because every chain needs a new process: PyBullet keeps some state that no reset clears."""
        return None

    @property
    def relation_names(self) -> tuple[str, ...]:
        """Names of the recorded relations, which describe the objects on CALVIN's table."""
        return RELATIONS

    @property
    def subgoal_names(self) -> tuple[str, ...]:
        """Names of the chain's subtasks, in the order in which they must be done."""
        return self.chain.names

    @property
    def engine(self) -> dict[str, str]:
        """Name of the simulator, and the versions of all components that can change the results."""
        return {"simulator": self.settings.name, **self._fixed["engine"], "code": self.task.bddl_sha256}

    @property
    def over(self) -> bool:
        """Whether the chain has ended because the current subtask took too many steps."""
        return self._steps_of_subtask >= STEPS_PER_SUBTASK

    def files(self) -> dict[str, bytes]:
        """Return the stored files of the scene: one JSON file that describes the chain and the objects."""
        objects = [
            {"name": o.name, "size": o.size_m, "mass": o.mass_kg, "fixed": o.fixed} for o in self.settings.objects
        ]
        known = {"objects": objects, "engine": self._fixed["engine"]}
        form = {**known, "chain": self.chain.number, "start": dict(self.chain.start), "subtasks": self.chain.names}
        return {"scene.json": json.dumps(form, indent=1, sort_keys=True).encode()}

    def start(self) -> ChainStart:
        """Return the state of the robot and of the scene at the start of the chain."""
        return start_of(self.chain.start) if self.condition.name == "base" else resampled_start_of(self.chain)

    def reset(self) -> WorldState:
        """Set the robot and the scene, and check that they are in the start state of the chain.

        Raises:
            PremiseError: If a block, a door or a light is not in its start state, and the options say to refuse such
                scenes.
            WorldError: If the simulator fails, or its versions have changed since the run began.
        """
        start = self.start()
        asked = {"robot": start.robot.tolist(), "scene": start.scene.tolist(), **self._shown}
        self._take(self._take_process().start(asked))
        where, cure = (
            "the start that the simulator sent",
            "Check out the version of calvin_env that the docs name",
        )
        read_form(_CHAIN_START, self._document, where=where, cure=cure, raises=WorldError)
        self._fixed = self._document
        self._require_same_versions()
        self.instructed_anew = False
        self._step = self._done = self._steps_of_subtask = 0
        self._gripper_command = -1.0
        self._begun = self._now = self._read()
        self._instruct()
        self._commanded = self._measured()
        self._info = SceneInfo(self.settings.objects, (), vector_of(self._arrays["robot"][:3]), PANDA_OPENING_M)
        self.broken_premises = self._misplaced(start)
        if self.broken_premises and self.settings.refuse_broken:
            raise PremiseError(
                f"chain {self.chain.number}: {', '.join(self.broken_premises)} after the reset, because this "
                "configuration or this version of calvin_env differs. Use commit 797142c or 1431a46 and the "
                "validation/.hydra/merged_config.yaml of the data (--calvin-config), or pass --broken-premises run "
                "to continue as CALVIN does."
            )
        return self.state()

    def step(self, action: np.ndarray) -> np.ndarray:
        """Execute an action for one control step, and return it unchanged, because CALVIN does not clip actions.

        If the action completes a subtask, the next subtask begins and ``instructed_anew`` becomes True.
        """
        applied = self.action_space.clip(action)
        if self._process is None or self._begun is None:
            raise WorldError("the episode has not begun")
        self._take(self._process.step(self._played(applied), look=self._draws_next))
        self._step += 1
        self._steps_of_subtask += 1
        self._gripper_command = -1.0 if applied[-1] > 0.0 else 1.0
        self._now = self._read()
        self.instructed_anew = False
        with as_agreed("sent a state"):
            is_done = done(self.chain.subtasks[self._done].rule, self._begun, self._now)
        if is_done:
            self._done += 1
            if self._done < CHAIN_LENGTH:
                self._take(self._process.start({"next": True, **self._shown}))
                self._steps_of_subtask, self.instructed_anew = 0, True
                self._begun = self._now = self._read()
                self._instruct()
                self._commanded = self._measured()
        return applied

    def state(self) -> WorldState:
        """Return the privileged state. Raises WorldError if the simulator has sent impossible values."""
        with as_agreed("sent a state"):
            return self._state()

    def _state(self) -> WorldState:
        if self._now is None:
            raise WorldError("the episode has not begun")
        robot, target = self._arrays["robot"], self._arrays["target"]
        blocks = [self._now.blocks[name] for name in self._block_names()]
        fixed = [thing for thing in self._info.objects if thing.fixed]
        contacts = self._contacts()
        return WorldState(
            info=self._info,
            step=self._step,
            time_s=self._step / self.control_rate_hz,
            positions=(
                *(self._bottom(name, self._now.blocks[name].position) for name in self._block_names()),
                *((0.0, 0.0, 0.0) for _ in fixed),
            ),
            quaternions=(*(block.rotation for block in blocks), *((1.0, 0.0, 0.0, 0.0) for _ in fixed)),
            linear_speeds=(*(math.hypot(*block.velocity[:3]) for block in blocks), *(0.0 for _ in fixed)),
            angular_speeds=(*(math.hypot(*block.velocity[3:]) for block in blocks), *(0.0 for _ in fixed)),
            ee_pose=Pose(vector_of(robot[:3]), from_euler(robot[3:6])),
            commanded_pose=Pose(vector_of(target[:3]), from_euler(target[3:])),
            finger_width_m=float(robot[6]),
            gripper_command=self._gripper_command,
            joint_positions=tuple(robot[7:14].tolist()),
            joint_velocities=(0.0,) * 7,
            contacts=contacts,
            held=held_object(contacts, self._info),
        )

    def simulator_state(self) -> dict[str, np.ndarray]:
        """Return the arrays that are stored for each state.

        ``qpos`` contains the two arguments of ``env.reset``: the state of the robot (15,) and the state of the scene
        (24,). ``ctrl`` is the target pose (6,).
        """
        none = np.zeros(0)
        both = np.concatenate([self._arrays["robot"], self._arrays["scene"]])
        return {"qpos": both, "qvel": none, "act": none, "ctrl": self._arrays["target"]}

    def truth(self) -> Truth:
        """Return the relations of the table that hold now, and the subtasks that are done."""
        if self._now is None:
            raise WorldError("the episode has not begun")
        doors, lights = self._now.doors, self._now.lights
        finished = tuple(i < self._done for i in range(CHAIN_LENGTH))
        with as_agreed("sent a state"):
            relations = (
                doors["base__drawer"] > 0.5 * DRAWER_OPEN_M,
                doors["base__slide"] > 0.5 * SLIDER_OPEN_M,
                bool(lights["lightbulb"]),
                bool(lights["led"]),
            )
        return Truth(
            relations=relations,
            subgoals=finished,
            in_order=True,
            goal=all(finished),
            forbidden=False,
            success=all(finished),
        )

    def native(self) -> dict[str, np.ndarray]:
        """Return CALVIN's ``robot_obs`` (15,), and parts of it under the names that betterbench's observations use."""
        robot = self._arrays["robot"]
        command = robot[14:15]
        return {
            "robot_obs": robot,
            "ee_position": robot[:3],
            "ee_rpy": robot[3:6],
            "gripper_width": robot[6:7],
            "joint_positions": robot[7:14],
            "gripper_command": command,
            "gripper_command_closed": (command < _HALF_CLOSED).astype(float),
        }

    @property
    def _shown(self) -> dict[str, Any]:
        """Settings that are sent to the simulator at the start of each subtask.

        They select the images to render, and the indices at which the simulator splits an action into its parts.
        """
        return {
            "images": self._images,
            "depth": self.draws_depth,
            "split": _SPLITS.get(self.action_space.name),
        }

    def _measured(self) -> np.ndarray:
        """Return the measured end-effector pose, as position [m] and Euler angles [rad], (6,)."""
        measured: np.ndarray = self._arrays["robot"][:6].copy()
        return measured

    def _played(self, action: np.ndarray) -> np.ndarray:
        """Return the action in the format that the simulator expects.

        Deltas of the action space ``calvin_delta`` are added to the last commanded pose, which gives an absolute pose.
        """
        if self.action_space.name != CALVIN_DELTA.name:
            return action
        pose = self._commanded + action[:6]
        pose[3:] = (pose[3:] + np.pi) % (2.0 * np.pi) - np.pi
        self._commanded = pose
        played: np.ndarray = np.append(pose, action[6]).astype(np.float32).astype(np.float64)
        return played

    def _instruct(self) -> None:
        sentence = self.chain.subtasks[min(self._done, CHAIN_LENGTH - 1)].instruction
        self.condition = Instructed.of(self._name, self.task.condition, sentence)

    def _take(self, answer: tuple[dict[str, Any], dict[str, np.ndarray]]) -> None:
        """Store the simulator's answer after checking it.

        Raises WorldError if an array is missing, has a wrong shape or contains a non-finite number.
        """
        document, arrays = answer
        for name, shape in _ROW.items():
            found = arrays.get(name)
            if found is None or found.shape != shape or found.dtype != np.float64:
                shown = "nothing" if found is None else f"{found.dtype} {found.shape}"
                raise WorldError(f"the simulator sent {shown} as {name}, expected float64 {shape}")
        for name, size in _IMAGES.items():
            if name in arrays:
                require_image(name, arrays[name], size)
        require_finite(arrays)
        self._document, self._arrays = document, dict(arrays)

    def _require_same_versions(self) -> None:
        """Raise WorldError if the simulator process reports other versions than the plan contains."""
        found = {**self._fixed["engine"], "code": self._fixed.get("code")}
        for name, planned in {**self.settings.versions, "code": self.task.bddl_sha256}.items():
            if str(found.get(name)) != planned:
                raise WorldError(
                    f"{name} is {one_line(found.get(name), most=80)} in the simulator, but it was {planned} when the "
                    "run began. Restore the checkout and the configuration, or begin a new run"
                )

    def _read(self) -> PlayTable:
        try:
            return read_play_table(self._document["info"])
        except (InvalidInputError, KeyError) as problem:
            told = one_line(problem, most=300)
            raise WorldError(f"the simulator sent no valid information about its scene: {told}") from problem

    def _block_names(self) -> tuple[str, ...]:
        return tuple(thing.name for thing in self._info.objects if not thing.fixed)

    def _bottom(self, name: str, center: Vector) -> Vector:
        """Return the center of a block's bottom face in the world frame [m].

        ``center`` is the origin of the block's body.
        """
        down = (0.0, 0.0, -0.5 * self._info.object(name).size_m[2])
        turned = rotate(self._now.blocks[name].rotation, down) if self._now is not None else down
        return (center[0] + turned[0], center[1] + turned[1], center[2] + turned[2])

    def _misplaced(self, start: ChainStart) -> tuple[str, ...]:
        """Describe each door, light and block that is not in the start state of the chain."""
        scene, found = start.scene, []
        there = self._arrays["scene"]
        for name, i in (("slider", 0), ("drawer", 1)):
            if abs(there[i] - scene[i]) > _DOOR_OFF_M:
                found.append(f"the {name} is at {there[i]:.3f} m instead of {scene[i]:.3f} m")
        for name, i in (("light bulb", 4), ("LED", 5)):
            if int(there[i]) != int(scene[i]):
                found.append(f"the {name} is {'on' if there[i] else 'off'}")
        for k, block in enumerate(BLOCKS):
            at = slice(6 + 6 * k, 9 + 6 * k)
            gap = horizontal_distance(there[at].tolist(), scene[at].tolist())
            if gap > _DISPLACED_M:
                found.append(f"the {block.replace('_', ' ')} is {1000 * gap:.0f} mm from its place")
        return tuple(found)

    def _contacts(self) -> tuple[Contact, ...]:
        """Return the contacts that involve the gripper or a block. The forces of several contact points are summed."""
        info = self._document["info"]
        scene, robot = info["scene_info"], info["robot_info"]
        blocks = {int(b["uid"]): str(name) for name, b in scene["movable_objects"].items()}
        fixed = {int(t["uid"]): str(name) for name, t in scene["fixed_objects"].items()}
        hand = dict(zip(self._fixed["fingers"], ("left_finger", "right_finger"), strict=False))

        def label(body: int, link: int) -> str:
            if body == robot["uid"]:
                return str(hand.get(link, "hand" if link > self._fixed["flange"] else "arm"))
            return blocks.get(body) or fixed.get(body) or "floor"

        sums: dict[tuple[str, str], float] = {}
        points = [c for b in scene["movable_objects"].values() for c in b["contacts"]]
        # Each block lists its own contacts. A contact between two blocks therefore occurs in two lists, but is counted
        # once.
        points = [c for c in points if int(c[2]) not in blocks or c[1] < c[2]]
        points += [c for c in robot["contacts"] if int(c[2]) not in blocks]
        for c in points:
            a, b = sorted((label(int(c[1]), int(c[3])), label(int(c[2]), int(c[4]))))
            if a != b and not {a, b} <= {"arm", "floor", *fixed.values()}:
                sums[a, b] = sums.get((a, b), 0.0) + finite_number(c[5])
        return tuple(Contact(a, b, force) for (a, b), force in sorted(sums.items()))


def calvin_command(checkout: Path | None, config: Path | None, *, egl: bool | None = None) -> tuple[str, ...]:
    """Return the command that starts CALVIN's simulator process.

    Args:
        checkout: A checkout of calvin_env, or of mees/calvin, which contains calvin_env.
        config: The ``merged_config.yaml`` of a data set. If it is None, the checkout's configuration is used.
        egl: True to render with EGL, False to render with PyBullet's TinyRenderer. None leaves the choice to
            :func:`describe_chains`, which takes EGL if it works.

    Raises:
        InvalidInputError: If no checkout of calvin_env is given, or the path is not a checkout.
        MissingDependencyError: If the world was not installed with ``better worlds install``.
    """
    if checkout is None:
        raise InvalidInputError(
            "--calvin-env",
            "the path of your calvin_env checkout is missing. betterbench cannot install calvin_env, because no "
            "package index contains it",
            "Clone https://github.com/mees/calvin_env and pass its path with --calvin-env",
        )
    root = checkout_root(checkout)
    if config is not None and not config.is_file():
        raise InvalidInputError(
            "--calvin-config", f"{config} is not a file", "Use the data set's validation/.hydra/merged_config.yaml"
        )
    chosen = "" if config is None else str(config.resolve())
    return (*INSTALLATION.command(), str(root.resolve()), chosen, _RENDERER_WORDS[egl])


def checkout_root(named: Path) -> Path:
    """Return the root of the calvin_env checkout at the given path, which may also be a clone of mees/calvin.

    Raises:
        InvalidInputError: If the path contains no checkout of calvin_env, for example in a clone without its
            submodules.
    """
    for root in (named, named / "calvin_env"):
        if (root / "calvin_env" / _MODULE).is_file():
            return root
    if (named / _MODULE).is_file():
        raise InvalidInputError(
            "--calvin-env",
            f"{named} is the package inside the checkout, not the checkout",
            f"Pass --calvin-env {named.resolve().parent}",
        )
    clone = next((p for p in (named, named.resolve().parent) if _names_calvin_env(p / ".gitmodules")), None)
    if clone is not None and not (clone / "calvin_env" / "calvin_env" / _MODULE).is_file():
        raise InvalidInputError(
            "--calvin-env",
            f"{clone} is a clone of mees/calvin whose submodule calvin_env is empty",
            f"Run `git -C {clone} submodule update --init --recursive`",
        )
    raise InvalidInputError(
        "--calvin-env",
        f"{named} has neither calvin_env/{_MODULE} nor calvin_env/calvin_env/{_MODULE}",
        "Pass the root of a clone of mees/calvin_env or mees/calvin",
    )


def describe_chains(command: Sequence[str], suite: str) -> tuple[tuple[str, ...], dict[str, Any]]:
    """Have the simulator process describe a suite. Return a command that specifies the renderer, and the description.

    If the given command does not specify the renderer, EGL is tried in a separate process, because a broken driver may
    crash that process.

    Raises:
        WorldError: If the process fails. If the command does not specify the renderer, this means that the process
            fails with both EGL and TinyRenderer.
    """
    if command[-1] != _RENDERER_WORDS[None]:
        with WorldProcess(command) as process:
            return tuple(command), process.suite(suite)
    try:
        return describe_chains((*command[:-1], _RENDERER_WORDS[True]), suite)
    except WorldError as error:
        found = describe_chains((*command[:-1], _RENDERER_WORDS[False]), suite)
        logger.warning(
            "CALVIN is rendered by TinyRenderer because EGL, which CALVIN itself uses, does not start here (%s). Its "
            "pixels differ from EGL's by 21 of 255 on average. Install Mesa's EGL (libegl1) or the graphics driver.",
            error,
        )
        return found


def chain_objects(described: Sequence[Mapping[str, Any]]) -> tuple[ObjectInfo, ...]:
    """Return the objects that the simulator process has described, with the blocks before the fixtures.

    Raises:
        WorldError: If a description is malformed.
    """
    with as_agreed("sent a description of its objects"):
        return tuple(
            ObjectInfo(
                name=str(o["name"]),
                kind=str(o["name"]).removeprefix("block_") + " block" if not o["fixed"] else str(o["name"]),
                asset=str(o["name"]),
                category="fixture" if o["fixed"] else "block",
                color="" if o["fixed"] else str(o["name"]).removeprefix("block_"),
                shape="" if o["fixed"] else "box",
                role="fixture" if o["fixed"] else "item",
                fixed=bool(o["fixed"]),
                mass_kg=float(o["mass"]),
                size_m=vector_of(o["size"]),
            )
            for o in sorted(described, key=lambda o: bool(o["fixed"]))
        )


def _names_calvin_env(modules: Path) -> bool:
    """Return whether the given ``.gitmodules`` file lists calvin_env as a submodule."""
    return modules.is_file() and "calvin_env" in modules.read_text(errors="replace")


def from_euler(angles: np.ndarray) -> Quaternion:
    """Convert Euler angles [rad] about the fixed axes x, y, z (PyBullet's order) to a quaternion (w, x, y, z)."""
    roll, pitch, yaw = (0.5 * float(a) for a in angles)
    about_x = (math.cos(roll), math.sin(roll), 0.0, 0.0)
    about_y = (math.cos(pitch), 0.0, math.sin(pitch), 0.0)
    about_z = (math.cos(yaw), 0.0, 0.0, math.sin(yaw))
    turned = multiply(about_z, multiply(about_y, about_x))
    w, x, y, z = turned if turned[0] >= 0.0 else tuple(-v for v in turned)
    return (w, x, y, z)
