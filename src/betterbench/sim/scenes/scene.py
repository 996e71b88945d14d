"""Simulated scene of a trial: a compiled model and its state. Only reset, step and restore change the state."""

from __future__ import annotations

import copy
import functools
import platform
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import mujoco
import numpy as np

from betterbench.errors import PremiseError
from betterbench.geometry import Pose, distance, unit_quaternion
from betterbench.interface import ObservationSpec
from betterbench.interface.actions import ActionSpace
from betterbench.interface.state import ObjectInfo, SceneInfo, SlotInfo, WorldState
from betterbench.sim.assets.asset import origin_of
from betterbench.sim.robots import ArmController
from betterbench.sim.robots.control import ControllerState
from betterbench.sim.robots.dynamics import with_dynamics
from betterbench.sim.robots.physics import PHYSICS
from betterbench.sim.robots.readers import number_reader, row_reader, speed_reader
from betterbench.sim.scenes.appearance import NO_VIEW_JITTER, dynamics_of, room_of, start_joints_of, view_jitter_of
from betterbench.sim.scenes.builder import (
    LABELS,
    CompiledScene,
    Placement,
    compile_scene,
    engine_version,
    place_objects,
)
from betterbench.sim.scenes.cameras import ViewPlacement
from betterbench.sim.scenes.contacts import ContactReader
from betterbench.sim.scenes.described import SceneDescription
from betterbench.sim.scenes.instances import ROBOT_PREFIX
from betterbench.sim.scenes.rooms import with_cloth
from betterbench.sim.scenes.stage import QUALITIES, Quality
from betterbench.sim.scenes.stored import scene_files
from betterbench.tasks import (
    SUITE_VERSION,
    Condition,
    Expected,
    GoalTracker,
    Looks,
    Task,
    broken_premises,
    training_distribution_of,
)
from betterbench.tasks.worlds.facts import OURS

if TYPE_CHECKING:
    from betterbench.sim.scenes.rendering import Images, Renderers

TIMESTEP_S = PHYSICS.timestep_s
"""Duration of one physics step [s]."""
CONTROL_RATE_HZ = PHYSICS.control_rate_hz
"""Number of actions that are executed per second [Hz]."""


@dataclass(frozen=True, slots=True, eq=False)
class SceneSnapshot:
    """Snapshot of the complete state of a scene. Continuing a scene from a snapshot gives bit-identical results.

    The snapshot contains all of the engine's data, because the results also depend on the solver's warm start and on
    the bodies that are asleep.
    """

    data: mujoco.MjData
    controller: ControllerState
    contacts: Mapping[str, Any]
    step: int
    gripper_command: float


class Scene:
    """Simulated scene of one trial. Implements :class:`betterbench.sim.worlds.TrialScene`.

    The initial state is computed, not simulated: every object starts in the resting pose of its asset, independently of
    the other objects.
    """

    world: ClassVar[str] = OURS.name
    draws_in_step: ClassVar[bool] = False
    instructed_anew: ClassVar[bool] = False
    over: ClassVar[bool] = False

    def __init__(
        self,
        task: Task,
        condition: Condition,
        *,
        seed: int,
        action_space: ActionSpace,
        quality: Quality = QUALITIES["standard"],
        robot_name: str | None = None,
        control_rate_hz: float = CONTROL_RATE_HZ,
        looks: Looks = "seen",
        steady_views: bool = False,
    ) -> None:
        """Build, compile and reset the scene.

        By default, the robot is the robot that the task was designed for. If ``steady_views`` is True, the cameras and
        the light are in their nominal poses, like a real camera that is not moved between trials. A control step must
        consist of an integer number of physics steps of 2 ms, so ``control_rate_hz`` is rounded accordingly.
        """
        self.task, self.condition, self.seed, self.quality = task, condition, seed, quality
        self.action_space, self.looks = action_space, looks
        self.placements = place_objects(task, condition, seed, shown=looks)
        self.room = with_cloth(room_of(task.id, seed, shown=looks), condition.cloth)
        self.view_jitter = NO_VIEW_JITTER if steady_views else view_jitter_of(task.id, seed)
        self.compiled: CompiledScene = compile_scene(
            self.placements, quality, robot_name=robot_name or task.robot, room=self.room
        )
        self.dynamics = dynamics_of(task.id, seed, self.compiled.robot)
        self.model = _with_dynamics(self.compiled, tuple(self.dynamics.items()))
        self._data = mujoco.MjData(self.model)
        self._views = ViewPlacement(self.model, self.view_jitter)
        self._views_are_placed = False
        self.physics_steps = max(1, round(1.0 / (TIMESTEP_S * control_rate_hz)))
        self.control_rate_hz = 1.0 / (TIMESTEP_S * self.physics_steps)
        self.controller = ArmController(
            self.model, self.compiled.robot, action_space, prefix=ROBOT_PREFIX, dynamics=self.dynamics
        )
        self._find_addresses()
        self._home_qpos = self._initial_qpos()
        self._step = 0
        self._gripper_command = -1.0
        self.info = self._describe()
        self.reset(check_premise=False)

    def _find_addresses(self) -> None:
        c, r = self.compiled, self.compiled.robot
        self._arm_qpos = np.array([self.model.joint(ROBOT_PREFIX + j).qposadr[0] for j in r.arm_joints])
        self._arm_dofs = np.array([self.model.joint(ROBOT_PREFIX + j).dofadr[0] for j in r.arm_joints])
        self._finger_qpos = np.array([self.model.joint(ROBOT_PREFIX + j).qposadr[0] for j in r.finger_joints])
        self._tcp = self.model.site(ROBOT_PREFIX + r.tcp_site).id
        self._names = tuple(p.spec.name for p in self.placements)
        self._labels = (*self._names, *LABELS)
        self._contacts = ContactReader(c, self._names)
        self._find_memory()

    def _find_memory(self) -> None:
        """Store functions that read the state from the engine's arrays, which never move in memory."""
        data, bodies = self._data, self.compiled.bodies.tolist()
        self._simulator_state = {"qpos": data.qpos, "qvel": data.qvel, "ctrl": data.ctrl, "act": data.act}
        self._positions, self._quaternions = row_reader(data.xpos, bodies), row_reader(data.xquat, bodies)
        c = self.compiled
        moving = list(zip(c.dof_addresses.tolist(), c.slides.tolist(), strict=True))
        free, slides = ([d if slid == kind else -1 for d, slid in moving] for kind in (False, True))
        self._speeds = speed_reader(data.qvel, free, slides)
        self._joint_positions = number_reader(data.qpos, self._arm_qpos.tolist())
        self._joint_velocities = number_reader(data.qvel, self._arm_dofs.tolist())
        self._tool_position = number_reader(data.site_xpos[self._tcp], range(3))
        self._tool_matrix, self._quaternion = data.site_xmat[self._tcp], np.empty(4)
        self._tool_quaternion = number_reader(self._quaternion, range(4))
        self._tool: Pose | None = None

    def _initial_qpos(self) -> np.ndarray:
        c = self.compiled
        qpos: np.ndarray = self.model.qpos0.copy()
        qpos[self._arm_qpos] = start_joints_of(self.task.id, self.seed, c.robot)
        qpos[self._finger_qpos] = c.robot.jaw.joints_at(c.robot.gripper_opening_m)
        for i, placement in enumerate(self.placements):
            address = c.qpos_addresses[i]
            if placement.shut is not None:
                qpos[address] = distance(placement.pose.position, placement.shut.position)
            elif address >= 0:
                qpos[address : address + 3] = placement.pose.position
                qpos[address + 3 : address + 7] = placement.pose.quaternion
        return qpos

    def _describe(self) -> SceneInfo:
        trained = training_distribution_of(self.task)
        slots = tuple(
            SlotInfo(
                s.name,
                (s.x, s.y, 0.0),
                s.yaw,
                trained.standing_kinds.get(s.name, ()),
                tuple(sorted(k for k, slots in trained.kind_slots.items() if s.name in slots)),
            )
            for s in self.task.slots
        )
        objects = tuple(_object_info(p, self.condition.layout.get(p.spec.name)) for p in self.placements)
        self._data.qpos[:] = self._home_qpos
        mujoco.mj_kinematics(self.model, self._data)
        x, y, z = self._data.site_xpos[self._tcp].tolist()
        return SceneInfo(objects, slots, (x, y, z), self.compiled.robot.gripper_opening_m)

    @property
    def content_hash(self) -> str:
        """Hash of the compiled model, under which the scene is stored."""
        return self.compiled.content_hash

    @property
    def step_limit(self) -> int:
        """Number of control steps after which the episode ends."""
        return self.task.step_limit(self.condition)

    @property
    def data(self) -> mujoco.MjData:
        """The engine's data, with poses of bodies, cameras and lights that are up to date.

        Read this property again after each step, because the poses of cameras and lights are updated only when it is
        read.
        """
        self._tool = None  # the caller may move the arm in the data
        if not self._views_are_placed:  # not computed for steps without images
            self._views.apply(self._data)
            self._views_are_placed = True
        return self._data

    def simulator_state(self) -> dict[str, np.ndarray]:
        """Return views of the engine's arrays qpos (nq,), qvel (nv,), ctrl (nu,) and act (na,)."""
        return self._simulator_state

    def body_poses(self) -> tuple[np.ndarray, np.ndarray]:
        """Return a copy of the positions (nbody, 3) [m] and quaternions (nbody, 4) of all bodies in the model."""
        return self._data.xpos.copy(), self._data.xquat.copy()

    @property
    def arm_addresses(self) -> np.ndarray:
        """Indices of the arm joints in the engine's array qpos, (n,)."""
        return self._arm_qpos

    @property
    def finger_addresses(self) -> np.ndarray:
        """Indices of the finger joints in the engine's array qpos, (2,) if the gripper has two moving fingers."""
        return self._finger_qpos

    @property
    def body_names(self) -> tuple[str, ...]:
        """Names of the bodies in contacts: first the objects, then the parts of the robot and the stage."""
        return self._labels

    def files(self) -> dict[str, bytes]:
        """Return the compiled model as files, which are stored once for each distinct scene."""
        return scene_files(self.compiled.model, self.compiled.content_hash)

    def tracker(self) -> GoalTracker:
        """Return the tracker that judges the goal during an episode."""
        return GoalTracker(self.condition, self.info, template=self.task.template, control_rate_hz=self.control_rate_hz)

    def described(self, *, images: bool) -> SceneDescription:
        """Return the scene description that is stored in the episode record."""
        return SceneDescription(
            task_version=self.task.version,
            suite_version=SUITE_VERSION,
            instruction=self.condition.instruction.text,
            render_quality=self.quality.name if images else None,
            engine={
                "simulator": "mujoco",
                "mujoco": engine_version(),
                "machine": platform.machine(),
                "model": self.compiled.content_hash,
            },
            looks=self.looks,
            room=self.room.name,
            view_jitter=self.view_jitter,
            dynamics=self.dynamics,
        )

    def views(self, spec: ObservationSpec, renderers: Renderers) -> dict[str, Images]:
        """Return the images of the current state by camera.

        Raises MissingDependencyError if off-screen OpenGL is not available.
        """
        largest = max(spec.cameras, key=lambda c: c.width * c.height)
        renderer = renderers.of(
            self.content_hash, self.compiled.model, width=largest.width, height=largest.height, quality=self.quality
        )
        wanted = tuple((c.name, c.width, c.height) for c in spec.cameras)
        images = renderer.render_views(self.data, wanted, depth=spec.depth, masks=spec.masks)
        return dict(zip((c.name for c in spec.cameras), images, strict=True))

    def native(self) -> dict[str, np.ndarray]:
        """Return an empty dictionary, because policies get only the standard observation in this world."""
        return {}

    def draw_next(self, *, wanted: bool) -> None:
        """Do nothing, because images are rendered when they are requested."""

    def close(self, *, well: bool) -> None:
        """Do nothing, because this scene runs in this process and has no separate simulator to close."""

    def reset(self, *, check_premise: bool = True) -> WorldState:
        """Reset the scene to the start of the trial, and return the state at the start.

        Raises PremiseError if ``check_premise`` is True and the scene violates an assumption of the task about its
        initial state.
        """
        mujoco.mj_resetData(self.model, self._data)
        self._data.qpos[:] = self._home_qpos
        self.controller.reset(self._data)
        self._contacts.start_step()
        mujoco.mj_forward(self.model, self._data)
        self._views_are_placed, self._tool = False, None
        self._step = 0
        self._gripper_command = -1.0
        state = self.state()
        if check_premise:
            problems = broken_premises(self.condition, state)
            if problems:
                text = "; ".join(problems)
                msg = (
                    f"{self.condition.id} seed {self.seed}: the scene contradicts the premise of the instruction "
                    f"({text}). A changed asset or a new version of the physics engine (MuJoCo "
                    f"{mujoco.__version__}) can cause this. The run stops, so that the trial is not counted as a "
                    "failure."
                )
                raise PremiseError(msg)
        return state

    def snapshot(self) -> SceneSnapshot:
        """Return a snapshot of the complete current state, for :meth:`restore`."""
        return SceneSnapshot(
            copy.copy(self._data),
            self.controller.state(),
            self._contacts.snapshot(),
            self._step,
            self._gripper_command,
        )

    def restore(self, snapshot: SceneSnapshot) -> WorldState:
        """Go back to a snapshot of this scene, and return its state. A snapshot can be restored any number of times."""
        mujoco.mj_copyData(self._data, self.model, snapshot.data)
        self.controller.restore(snapshot.controller)
        self._contacts.restore(snapshot.contacts)
        self._step, self._gripper_command = snapshot.step, snapshot.gripper_command
        self._views_are_placed, self._tool = False, None
        return self.state()

    def step(self, action: np.ndarray) -> np.ndarray:
        """Execute an action for one control step, and return the action after clipping.

        Raises InvalidActionError if the action is not finite or has a wrong shape.
        """
        applied = self.controller.apply(self._data, action, measured=self._tool_pose())
        self._gripper_command = self.controller.gripper_command(applied, self._gripper_command)
        if self.condition.expected is Expected.SUCCEED:
            mujoco.mj_step(self.model, self._data, nstep=self.physics_steps)
        else:
            self._step_and_watch()
        mujoco.mj_kinematics(self.model, self._data)
        self._views_are_placed, self._tool = False, None
        self._step += 1
        return applied

    def _step_and_watch(self) -> None:
        """Execute the physics steps of a control step one by one, and note the contacts after each of them.

        This is used if the task forbids contacts, because even a brief contact must be detected.
        """
        self._contacts.start_step()
        for _ in range(self.physics_steps):
            mujoco.mj_step(self.model, self._data)
            self._contacts.see_step(self._data)

    def state(self) -> WorldState:
        """Return the complete current state, including derived values."""
        data = self._data
        linear_speeds, angular_speeds = self._speeds()
        positions = self._positions()
        contacts, held = self._contacts.read(data, positions)
        return WorldState(
            info=self.info,
            step=self._step,
            time_s=self._step * TIMESTEP_S * self.physics_steps,
            positions=positions,
            quaternions=self._quaternions(),
            linear_speeds=linear_speeds,
            angular_speeds=angular_speeds,
            ee_pose=self._tool_pose(),
            commanded_pose=self.controller.commanded_pose,
            finger_width_m=self.controller.measured_width_m(data),
            gripper_command=self._gripper_command,
            joint_positions=self._joint_positions(),
            joint_velocities=self._joint_velocities(),
            contacts=contacts,
            held=held,
        )

    def _tool_pose(self) -> Pose:
        """Return the measured pose of the tool center point after the last reset or step."""
        if self._tool is None:
            mujoco.mju_mat2Quat(self._quaternion, self._tool_matrix)
            self._tool = Pose(self._tool_position(), unit_quaternion(self._tool_quaternion()))
        return self._tool


@functools.lru_cache(maxsize=4)
def _with_dynamics(compiled: CompiledScene, dynamics: tuple[tuple[str, tuple[float, ...]], ...]) -> mujoco.MjModel:
    """Return the model of a scene with the dynamics of a trial.

    Trials with the same objects and the same seed share the model.
    """
    return with_dynamics(compiled.model, compiled.robot, dict(dynamics), prefix=ROBOT_PREFIX)


def _object_info(placement: Placement, slot: str | None) -> ObjectInfo:
    spec, asset = placement.spec, placement.asset
    source, license_name = origin_of(asset)
    return ObjectInfo(
        name=spec.name,
        kind=spec.kind,
        asset=asset.identity,
        category=asset.category,
        color=asset.color,
        shape=asset.shape,
        role=spec.role,
        fixed=spec.fixed,
        mass_kg=asset.mass_kg,
        size_m=asset.size_m,
        regions=asset.regions,
        slot=slot,
        source=source,
        license=license_name,
        keeps_upright=asset.keeps_upright,
    )
