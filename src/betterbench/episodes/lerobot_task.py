"""Environment for LeRobot for every task, with LeRobot's observation keys and attributes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from gymnasium import spaces

from betterbench.episodes.gymnasium_env import TaskEnv
from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.geometry import TOOL_DOWN, to_axis_angle_near
from betterbench.interface import Observation
from betterbench.interface.state import WorldState
from betterbench.tasks import Truth


def ee_state(seen: Observation) -> np.ndarray:
    """Return the state for policies trained on LIBERO.

    Returns:
        (8,) float32: tool position [m], rotation vector [rad], continuous around a tool that points down, and the
        positions of both fingers [m], the second one negative, as in robosuite.
    """
    finger = 0.5 * seen.gripper_width
    w, x, y, z = seen.ee_quaternion.tolist()
    return np.array(
        [*seen.ee_position, *to_axis_angle_near((w, x, y, z), TOOL_DOWN), finger, -finger], dtype=np.float32
    )


def joint_state(seen: Observation) -> np.ndarray:
    """Return the joints, (8,) float32: arm joint positions [rad] and the opening width [m]."""
    return np.array([*seen.joint_positions, seen.gripper_width], dtype=np.float32)


STATES: Mapping[str, Callable[[Observation], np.ndarray]] = {"ee": ee_state, "joints": joint_state}
"""State layouts by name; both have eight numbers."""

STATE_DIM = 8


class LeRobotTaskEnv(TaskEnv):
    """Task under one condition, with LeRobot's observation keys.

    Observation: ``pixels``, one (height, width, 3) uint8 image per camera, upright as in ``better eval``, and
    ``agent_pos`` (8,) float32. ``info["is_success"]`` is set at reset and at every step.

    Args:
        task: Task id.
        variation: Name of a variation or training condition; default: the first training condition.
        state: Name of the state layout, "ee" or "joints".
        cameras: New names of the cameras ({"front": "image", "wrist": "image2"}); other cameras keep their names.
        observation: Name of an observation preset.
        action_space: Name of an action space.
        quality: Name of a render preset.
        render_mode: "rgb_array" for images of the front camera.
    """

    def __init__(
        self,
        task: str,
        *,
        variation: str | None = None,
        state: str = "ee",
        cameras: Mapping[str, str] | None = None,
        observation: str = "default",
        action_space: str = "ee_delta",
        quality: str = "standard",
        render_mode: str | None = "rgb_array",
    ) -> None:
        """Check all names; scenes are compiled at reset."""
        super().__init__(
            task,
            variation=variation,
            observation=observation,
            action_space=action_space,
            quality=quality,
            render_mode=render_mode,
        )
        if state not in STATES:
            raise UnknownNameError("state layout", state, STATES)
        own = tuple(c.name for c in self._spec.cameras)
        for name in cameras or {}:
            if name not in own:
                raise UnknownNameError(f"camera of the preset {observation!r}", name, own)
        self._state_of = STATES[state]
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
                # wider than all possible values: joints within 3.8 rad, rotation vectors within 2 pi, positions within
                # meters
                "agent_pos": spaces.Box(-7.0, 7.0, (STATE_DIM,), np.float32),
            }
        )
        self.task = self._condition.id
        """Task and condition, "fast_food/T1"."""
        self.task_description = self.instruction
        """Task description that LeRobot gives the policy."""
        self._max_episode_steps = self.step_limit

    def _form(self, seen: Observation) -> dict[str, Any]:
        return {
            "pixels": {self._names[name]: image for name, image in seen.images.items()},
            "agent_pos": self._state_of(seen),
        }

    def _info(self, state: WorldState, truth: Truth, trial: int) -> dict[str, Any]:
        return {**super()._info(state, truth, trial), "is_success": truth.success}
