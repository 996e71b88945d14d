"""LeRobot configuration of betterbench's environments, selected with ``--env.type=betterbench``."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from gymnasium.vector import VectorEnv
from lerobot.configs.types import FeatureType, PolicyFeature
from lerobot.envs.configs import EnvConfig

from betterbench.episodes.lerobot_env import ENVIRONMENT_ID, SETTINGS, make_env
from betterbench.episodes.lerobot_task import state_layout
from betterbench.episodes.selection import select_conditions
from betterbench.errors import InvalidInputError
from betterbench.interface import observation_spec
from betterbench.interface.actions import action_space
from betterbench.sim.robots import robot_space
from betterbench.tasks import get_task


@EnvConfig.register_subclass("betterbench")  # type: ignore[untyped-decorator, unused-ignore]
@dataclass
class BetterbenchEnv(EnvConfig):  # type: ignore[misc, unused-ignore]
    """LeRobot configuration of betterbench's environments.

    Attributes:
        task: Name of a condition, such as "fast_food/T1". With LeRobot 0.5 and later, several conditions or tasks,
            separated by commas, are also allowed.
        fps: Control rate [Hz].
        state: Name of the state layout, "ee", "joints" or "motors".
        cameras: New camera names by original camera name.
        observation: Name of an observation preset.
        action_space: Name of an action space. By default, the standard action space of the robot.
        quality: Name of a rendering preset.
        robot: Name of a robot. By default, the robot for which the tasks are designed.
        features: Types and shapes of the observations and actions. Set automatically.
        features_map: Name of the policy's feature, by name of the environment's feature. Set automatically.
    """

    task: str | None = "fast_food/train1"
    fps: int = 20
    state: str = "ee"
    cameras: dict[str, str] = field(default_factory=dict)
    observation: str = "default"
    action_space: str | None = None
    quality: str = "standard"
    robot: str | None = None
    features: dict[str, PolicyFeature] = field(default_factory=dict)
    features_map: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Set ``features`` and ``features_map``."""
        robot = self.robot or _robot_of(self.task)
        dim = action_space(robot_space(robot, self.action_space)).dim
        self.features = {
            "action": PolicyFeature(type=FeatureType.ACTION, shape=(dim,)),
            "agent_pos": PolicyFeature(type=FeatureType.STATE, shape=(state_layout(self.state).size_for(robot),)),
        }
        self.features_map = {"action": "action", "agent_pos": "observation.state"}
        for camera in observation_spec(self.observation).cameras:
            name = self.cameras.get(camera.name, camera.name)
            self.features[f"pixels/{name}"] = PolicyFeature(
                type=FeatureType.VISUAL, shape=(camera.height, camera.width, 3)
            )
            self.features_map[f"pixels/{name}"] = f"observation.images.{name}"

    @property
    def gym_id(self) -> str:
        """ID of the Gymnasium environment."""
        return ENVIRONMENT_ID

    @property
    def gym_kwargs(self) -> dict[str, Any]:
        """Arguments of the Gymnasium environment for LeRobot 0.4.

        Raises InvalidInputError if ``task`` selects several conditions.
        """
        named = select_conditions(self.task)
        if len(named) != 1:
            raise InvalidInputError(
                "--env.task",
                f"{self.task!r} selects {len(named)} conditions, but this LeRobot version supports only one",
                "Use a single condition, such as fast_food/T1, or install LeRobot 0.5 or newer",
            )
        ((task, variation),) = named
        return {"task": task, "variation": variation, **{name: getattr(self, name) for name in SETTINGS}}

    def create_envs(self, n_envs: int, use_async_envs: bool = False) -> dict[str, dict[int, VectorEnv[Any, Any, Any]]]:
        """Create the vector environments of all conditions. Called by LeRobot 0.5 and later."""
        return make_env(n_envs, use_async_envs, cfg=self)


def _robot_of(conditions: str | None) -> str:
    """Return the robot for which the tasks of these conditions are designed.

    Raises InvalidInputError if the tasks are designed for different robots.
    """
    robots = {task: get_task(task).robot for task, _ in select_conditions(conditions)}
    if len(set(robots.values())) > 1:
        listed = ", ".join(f"{task}: {robot}" for task, robot in robots.items())
        raise InvalidInputError(
            "--env.task",
            f"its tasks are designed for different robots ({listed})",
            "Evaluate the tasks of one robot at a time",
        )
    return next(iter(robots.values()))
