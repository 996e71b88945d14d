"""Gymnasium environment for every task: ``gymnasium.make("betterbench:BeTTER/FastFood-v0", variation="T1")``."""

from __future__ import annotations

from typing import Any, NoReturn

import gymnasium
import numpy as np
from gymnasium import spaces

from betterbench.argument_types import checked_arguments
from betterbench.episodes.observer import Observer
from betterbench.errors import InvalidInputError
from betterbench.interface import Observation, ObservationSpec, observation_spec
from betterbench.interface.actions import action_space as action_space_named
from betterbench.interface.state import WorldState
from betterbench.sim.robots import robot as robot_named
from betterbench.sim.robots import robot_space
from betterbench.sim.scenes import Renderer, Scene
from betterbench.sim.scenes.stage import quality_preset
from betterbench.tasks import GoalTracker, Truth, get_task, looks_named
from betterbench.tasks.interventions import resolve_condition

_BOUNDS = {
    "joint_positions": (None, 4.0),
    "joint_velocities": (None, 50.0),
    "ee_position": (3, 2.0),
    "ee_quaternion": (4, 1.0 + 1e-9),
    "gripper_width": (1, 0.2),
}
"""Length and largest absolute value of each measurement, in the units of the observation.

The length None means one value per arm joint. The bounds are larger than all possible values: joints stay within
3.8 rad and 3 rad/s, the reach is at most 1.2 m, and grippers open by at most 0.1 m.
"""


class TaskEnv(gymnasium.Env[dict[str, Any], np.ndarray]):
    """Gymnasium environment for a task in one condition. The seed of a reset selects the trial.

    An observation is a dict with one image (height, width, 3) uint8 per camera, ``joint_positions`` (n,) [rad],
    ``joint_velocities`` (n,) [rad/s], ``ee_position`` (3,) [m] and ``ee_quaternion`` (4,) (w, x, y, z) in the base
    frame, and ``gripper_width`` (1,) [m]. The instruction is in ``info["instruction"]`` and in the attribute
    ``instruction``. The reward is 1 at the step in which the goal is reached, and otherwise 0. Observations contain no
    privileged state. ``info`` contains the ground truth of the goal and subgoals, for training and evaluation code.

    Args:
        task: ID of the task.
        variation: Name of a variation or training condition. By default, the first training condition.
        observation: Name of an observation preset.
        action_space: Name of an action space. By default, the standard action space of the robot.
        quality: Name of a rendering preset.
        looks: Appearance of objects and rooms: "seen" (as in the demonstrations) or "unseen".
        robot: Name of a robot. By default, the robot for which the task is designed. It determines the number n of arm
            joints.
        render_mode: "rgb_array" if :meth:`render` must return images of the front camera.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 20}  # noqa: RUF012 - convention of Gymnasium

    @checked_arguments
    def __init__(
        self,
        task: str,
        *,
        variation: str | None = None,
        observation: str = "default",
        action_space: str | None = None,
        quality: str = "standard",
        looks: str = "seen",
        robot: str | None = None,
        render_mode: str | None = None,
    ) -> None:
        """Check the arguments. The scene is compiled by :meth:`reset`."""
        if render_mode not in (None, "rgb_array"):
            raise InvalidInputError("render_mode", f"{render_mode!r} is not supported", "Use 'rgb_array' or None")
        found = resolve_condition(task, get_task(task).training[0].name if variation is None else variation)
        self._task, self._condition = found.task, found.condition
        self._spec: ObservationSpec = observation_spec(observation)
        self._quality, self._looks = quality_preset(quality), looks_named(looks)
        self._robot = robot or self._task.robot
        self._actions = action_space_named(robot_space(self._robot, action_space))
        joints = len(robot_named(self._robot).arm_joints)
        self.render_mode = render_mode
        self._observer = Observer(self._spec)
        self._renderer: Renderer | None = None
        self._scene: Scene | None = None
        self._tracker: GoalTracker | None = None
        low, high = np.array(self._actions.low), np.array(self._actions.high)
        self.action_space = spaces.Box(low.astype(np.float32), high.astype(np.float32), dtype=np.float32)
        self.observation_space = spaces.Dict(
            {
                **{c.name: spaces.Box(0, 255, (c.height, c.width, 3), np.uint8) for c in self._spec.cameras},
                **{name: spaces.Box(-most, most, (n or joints,), np.float64) for name, (n, most) in _BOUNDS.items()},
            }
        )

    def __reduce__(self) -> NoReturn:
        """Raise InvalidInputError: the state of a simulation cannot be copied."""
        cure = "Create the environment again with the same arguments, in the process that uses it"
        raise InvalidInputError("TaskEnv", "an environment cannot be pickled or copied", cure)

    @property
    def instruction(self) -> str:
        """Instruction for the robot. In a vector environment, use ``envs.get_attr("instruction")``."""
        return self._condition.instruction.text

    @property
    def step_limit(self) -> int:
        """Number of control steps after which an episode is truncated."""
        return self._task.step_limit(self._condition)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Start a trial.

        Args:
            seed: Seed of the trial. Seed 3 is trial 3 of ``better eval``. Without a seed, a random seed is used.
            options: Not used.
        """
        super().reset(seed=seed)
        del options
        trial = int(self.np_random.integers(1 << 31)) if seed is None else seed
        self._scene = Scene(
            self._task,
            self._condition,
            seed=trial,
            action_space=self._actions,
            quality=self._quality,
            looks=self._looks,
            robot_name=self._robot,
        )
        state = self._scene.reset()
        self._tracker = GoalTracker(
            self._condition, self._scene.info, template=self._task.template, control_rate_hz=self._scene.control_rate_hz
        )
        truth = self._tracker.update(state)
        return self._observe(state), self._info(state, truth, trial)

    def step(self, action: np.ndarray) -> tuple[dict[str, Any], float, bool, bool, dict[str, Any]]:
        """Execute an action for one control step."""
        scene, tracker = self._scene, self._tracker
        if scene is None or tracker is None:
            raise InvalidInputError("step", "the environment was not reset", "Call reset first")
        scene.step(np.asarray(action, dtype=np.float64))
        state = scene.state()
        truth = tracker.update(state)
        truncated = not truth.success and state.step >= self.step_limit
        return (
            self._observe(state),
            float(truth.success),
            truth.success,
            truncated,
            self._info(state, truth, scene.seed),
        )

    def render(self) -> np.ndarray | None:
        """Return the image of the front camera, (256, 256, 3) uint8, or None without render mode or before a reset."""
        if self.render_mode is None or self._scene is None:
            return None
        if self._renderer is None or self._renderer.model is not self._scene.compiled.model:
            if self._renderer is not None:
                self._renderer.close()
            self._renderer = Renderer(self._scene.compiled.model, quality=self._quality)
        return self._renderer.render(self._scene.data, "front").rgb

    def close(self) -> None:
        """Close the renderers and delete the scene. The next reset creates them again."""
        self._observer.close()
        self._scene = self._tracker = None
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    def _observe(self, state: WorldState) -> dict[str, Any]:
        if self._scene is None:
            raise AssertionError("unreachable: there are no observations before a reset")
        return self._form(self._observer.observe(self._scene, state))

    def _form(self, seen: Observation) -> dict[str, Any]:
        """Convert an observation to a dict in the format of the observation space."""
        return {
            **seen.images,
            "joint_positions": seen.joint_positions,
            "joint_velocities": seen.joint_velocities,
            "ee_position": seen.ee_position,
            "ee_quaternion": seen.ee_quaternion,
            "gripper_width": np.array([seen.gripper_width]),
        }

    def _info(self, state: WorldState, truth: Truth, trial: int) -> dict[str, Any]:
        names = self._tracker.subgoal_names if self._tracker is not None else ()
        return {
            "instruction": self.instruction,
            "condition": self._condition.id,
            "seed": trial,
            "step": state.step,
            "success": truth.success,
            "subgoals": dict(zip(names, truth.subgoals, strict=True)),
        }
