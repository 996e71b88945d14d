"""Tasks as Gymnasium environments, including tasks defined in user files."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path

from betterbench.episodes.gymnasium_env import TaskEnv
from betterbench.tasks import user_files


def make_env(
    task: str,
    variation: str | None = None,
    *,
    observation: str = "default",
    action_space: str = "ee_delta",
    quality: str = "standard",
    looks: str = "seen",
    render_mode: str | None = None,
) -> TaskEnv:
    """Create the Gymnasium environment of a task. Unlike ``gymnasium.make``, this adds no wrappers.

    Args:
        task: ID of the task ("fast_food").
        variation: Name of a variation ("T1") or training condition ("train2"). By default, the first training
            condition.
        observation: Name of an observation preset. "state_only" renders no images.
        action_space: Name of an action space.
        quality: Name of a rendering preset.
        looks: Set of appearances for objects and rooms: "seen" (those of the demonstrations) or "unseen" (new ones).
        render_mode: "rgb_array" for images of the front camera.

    Raises:
        UnknownNameError: If a name is unknown. The message lists the closest names.
    """
    return TaskEnv(
        task,
        variation=variation,
        observation=observation,
        action_space=action_space,
        quality=quality,
        looks=looks,
        render_mode=render_mode,
    )


def load_task_files(paths: Path | str | Iterable[Path | str]) -> None:
    """Load Python files that define tasks, assets, relations, failure modes or learners, as ``--task-file`` does.

    Each file is loaded once per process, including worker processes. If Gymnasium has been imported, the tasks are also
    registered with Gymnasium.

    Raises:
        InvalidInputError: If a file is missing, raises an error, or registers a name that already exists.
    """
    user_files.load_task_files([paths] if isinstance(paths, str | Path) else paths)
    if "gymnasium" in sys.modules:
        from betterbench.api.registration import register_environments  # noqa: PLC0415 - it imports Gymnasium

        register_environments()


def load_asset_folders(folders: Path | str | Iterable[Path | str]) -> None:
    """Load folders of assets that ``better assets import`` has written, as ``--asset-dir`` does.

    Each folder is loaded once per process, including worker processes. Tasks can then use the assets by name.

    Raises:
        InvalidInputError: If a folder is missing or contains no imported assets.
    """
    user_files.load_asset_folders([folders] if isinstance(folders, str | Path) else folders)
