"""Gymnasium environment for every task, with the observation keys and attributes that LeRobot expects."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium import spaces

from betterbench.episodes.gymnasium_env import TaskEnv
from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.geometry import TOOL_DOWN, to_axis_angle_near
from betterbench.interface import Observation
from betterbench.interface.actions import OPENING_SPACES, ActionSpace
from betterbench.interface.state import WorldState
from betterbench.sim.robots import motor_positions
from betterbench.sim.robots import robot as robot_named
from betterbench.tasks import Truth


def ee_state(seen: Observation, actions: ActionSpace) -> np.ndarray:
    """Return the robot state (8,) float32 in the format of policies trained on LIBERO.

    The state consists of the end-effector position [m], the rotation vector [rad], and the positions of both finger
    joints [m], the second negated as in robosuite. The rotation vector is continuous while the tool points down.
    """
    del actions
    finger = 0.5 * seen.gripper_width
    w, x, y, z = seen.ee_quaternion.tolist()
    return np.array(
        [*seen.ee_position, *to_axis_angle_near((w, x, y, z), TOOL_DOWN), finger, -finger], dtype=np.float32
    )


def joint_state(seen: Observation, actions: ActionSpace) -> np.ndarray:
    """Return the positions of the arm joints [rad] and the gripper width [m] as an array (n + 1,) float32."""
    del actions
    return np.array([*seen.joint_positions, seen.gripper_width], dtype=np.float32)


def motor_state(seen: Observation, actions: ActionSpace) -> np.ndarray:
    """Return the motor positions (n + 1,) float32 in the units of the action space, as in LeRobot's robot classes.

    The action space must use motor units (see :func:`require_motors`).
    """
    return np.array(motor_positions(actions, seen), dtype=np.float32)


def require_motors(actions: ActionSpace) -> None:
    """Raise InvalidInputError if an action space does not use motor units."""
    if actions.name not in OPENING_SPACES:
        raise InvalidInputError(
            "state",
            f"'motors' needs an action space in motor units, but the action space is {actions.name!r}",
            f"Use the action space {' or '.join(sorted(OPENING_SPACES))}, or the state 'joints'",
        )


@dataclass(frozen=True, slots=True)
class StateLayout:
    """Layout of the robot state in a policy's input.

    Attributes:
        read: Function that computes the state (size,) float32 from an observation and an action space.
        size: Number of values. None means one value per arm joint and one value for the gripper.
        bound: Largest possible absolute value of all entries.
    """

    read: Callable[[Observation, ActionSpace], np.ndarray]
    size: int | None
    bound: float

    def size_for(self, robot: str) -> int:
        """Return the number of values in the state of a robot."""
        return self.size or len(robot_named(robot).arm_joints) + 1


# The bounds are larger than all possible values: joints stay within 3.8 rad, rotation vectors within 2 pi, positions
# within a few meters, and motor positions within 180 degrees.
STATES: Mapping[str, StateLayout] = {
    "ee": StateLayout(ee_state, 8, 7.0),
    "joints": StateLayout(joint_state, None, 7.0),
    "motors": StateLayout(motor_state, None, 200.0),
}
"""State layouts by name."""


def state_layout(name: str) -> StateLayout:
    """Return the state layout with the given name. Raises UnknownNameError if the name is unknown."""
    if name not in STATES:
        raise UnknownNameError("state layout", name, STATES)
    return STATES[name]


class LeRobotTaskEnv(TaskEnv):
    """Environment for a task in one condition, with the observation keys that LeRobot expects.

    In an observation, ``pixels`` contains one image (height, width, 3) uint8 per camera, upright as in ``better eval``,
    and ``agent_pos`` is the robot state (float32). ``info["is_success"]`` is set by ``reset`` and ``step``.

    Args:
        task: ID of the task.
        variation: Name of a variation or training condition. By default, the first training condition.
        state: Name of the state layout: "ee", "joints" or "motors". The layout "motors" requires an action space in
            motor units.
        cameras: New camera names by original name, such as {"front": "image", "wrist": "image2"}. Other cameras keep
            their names.
        observation: Name of an observation preset.
        action_space: Name of an action space. By default, the standard action space of the robot.
        quality: Name of a rendering preset.
        robot: Name of a robot. By default, the robot for which the task is designed.
        render_mode: "rgb_array" if ``render`` must return images of the front camera.
    """

    def __init__(
        self,
        task: str,
        *,
        variation: str | None = None,
        state: str = "ee",
        cameras: Mapping[str, str] | None = None,
        observation: str = "default",
        action_space: str | None = None,
        quality: str = "standard",
        robot: str | None = None,
        render_mode: str | None = "rgb_array",
    ) -> None:
        """Check the arguments. The scene is compiled by ``reset``."""
        super().__init__(
            task,
            variation=variation,
            observation=observation,
            action_space=action_space,
            quality=quality,
            robot=robot,
            render_mode=render_mode,
        )
        layout = state_layout(state)
        if layout is STATES["motors"]:
            require_motors(self._actions)
        own = tuple(c.name for c in self._spec.cameras)
        for name in cameras or {}:
            if name not in own:
                raise UnknownNameError(f"camera of the preset {observation!r}", name, own)
        self._state_of = layout.read
        self._names = {name: (cameras or {}).get(name, name) for name in own}
        if len(set(self._names.values())) < len(own):
            raise InvalidInputError("cameras", "two cameras have the same name", "Give each camera a different name")
        self.observation_space = spaces.Dict(
            {
                "pixels": spaces.Dict(
                    {
                        self._names[c.name]: spaces.Box(0, 255, (c.height, c.width, 3), np.uint8)
                        for c in self._spec.cameras
                    }
                ),
                "agent_pos": spaces.Box(-layout.bound, layout.bound, (layout.size_for(self._robot),), np.float32),
            }
        )
        self.task = self._condition.id
        """Task and condition, for example "fast_food/T1"."""
        self.task_description = self.instruction
        """Instruction, which LeRobot passes to the policy as the task description."""
        self._max_episode_steps = self.step_limit

    def _form(self, seen: Observation) -> dict[str, Any]:
        return {
            "pixels": {self._names[name]: image for name, image in seen.images.items()},
            "agent_pos": self._state_of(seen, self._actions),
        }

    def _info(self, state: WorldState, truth: Truth, trial: int) -> dict[str, Any]:
        return {**super()._info(state, truth, trial), "is_success": truth.success}
