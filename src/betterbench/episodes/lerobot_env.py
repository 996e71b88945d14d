"""Environments for LeRobot: ``make_env`` returns one vector environment per condition.

``lerobot-eval`` uses ``hasattr`` to find the attributes of an environment that contain the instruction. Gymnasium's
wrappers would hide these attributes, so the environments are created without wrappers. This module does not import
LeRobot. LeRobot imports it through :mod:`betterbench.episodes.envhub`.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any

import gymnasium
from gymnasium.vector import VectorEnv

from betterbench.episodes.lazy_vector_env import ActiveEnv, LazyAsyncVectorEnv, LazySyncVectorEnv
from betterbench.episodes.lerobot_task import LeRobotTaskEnv
from betterbench.episodes.selection import select_conditions
from betterbench.errors import InvalidInputError

__all__ = ["ENVIRONMENT_ID", "SETTINGS", "make_env"]

ENVIRONMENT_ID = "BeTTER/LeRobot-v0"
"""ID under which the environments are registered in Gymnasium, without wrappers."""

SETTINGS = ("state", "cameras", "observation", "action_space", "quality", "robot")
"""Options of LeRobot's environment configuration, except the task. They are arguments of :class:`LeRobotTaskEnv`."""

gymnasium.register(
    ENVIRONMENT_ID,
    entry_point="betterbench.episodes.lerobot_env:LeRobotTaskEnv",
    order_enforce=False,
    disable_env_checker=True,
)


class _Seen:
    """Stand-in for an environment that runs in another process, with the attributes that LeRobot reads."""

    def __init__(self, env: LeRobotTaskEnv) -> None:
        self.task, self.task_description = env.task, env.task_description


def make_env(
    n_envs: int = 1,
    use_async_envs: bool = False,
    cfg: object | None = None,
    *,
    conditions: str | Sequence[str] | None = None,
    **settings: Any,  # noqa: ANN401 - passed on to LeRobotTaskEnv, which names and checks each
) -> dict[str, dict[int, VectorEnv[Any, Any, Any]]]:
    """Return one vector environment per condition, in the format that LeRobot's environment hub expects.

    Args:
        n_envs: Number of environments per condition.
        use_async_envs: Whether each environment runs in its own process.
        cfg: LeRobot's configuration of the environment. Its ``task`` is used if ``conditions`` is None, and its
            attributes named in :data:`SETTINGS` are used unless they are given in ``settings``.
        conditions: Names of conditions ("fast_food/T1", "fast_food/train1") or of tasks ("fast_food", which selects all
            conditions of the task), as a list or as a string separated by commas. By default, all conditions of the
            suite better60.
        settings: Other arguments of :class:`LeRobotTaskEnv`, for all environments.

    Returns:
        Vector environments by suite and index. In LeRobot's terms, each condition is a separate suite, so that LeRobot
        reports success rates by condition. As in ``better eval``, seed 3 is trial 3.

    Raises:
        InvalidInputError: If a number is out of range.
        UnknownNameError: If a task, condition or setting is unknown.
    """
    if n_envs < 1:
        raise InvalidInputError("n_envs", f"{n_envs} is not positive", "Use a number of at least 1")
    if getattr(cfg, "max_parallel_tasks", 1) > 1:
        raise InvalidInputError(
            "max_parallel_tasks",
            "rendering is limited to one thread",
            "Leave max_parallel_tasks at 1 and increase n_envs instead",
        )
    wanted = conditions if conditions is not None else getattr(cfg, "task", None)
    given = {name: value for name in SETTINGS if (value := getattr(cfg, name, None)) is not None} | settings
    group = ActiveEnv()
    envs: dict[str, dict[int, VectorEnv[Any, Any, Any]]] = {}
    for task, name in select_conditions(wanted):
        make = functools.partial(LeRobotTaskEnv, task, variation=name, **given)
        seen = _Seen(make())  # create an environment now, so that an invalid setting is reported immediately
        env = (
            LazyAsyncVectorEnv([make] * n_envs, group, stand_ins=[seen] * n_envs)
            if use_async_envs
            else LazySyncVectorEnv([make] * n_envs, group)
        )
        envs[f"{task}-{name}"] = {0: env}
    return envs
