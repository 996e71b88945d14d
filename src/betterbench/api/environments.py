"""Functions that create Gymnasium environments of tasks, and load tasks and assets from user files."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path

from betterbench.argument_types import checked_arguments
from betterbench.episodes.gymnasium_env import TaskEnv
from betterbench.tasks import user_files


@checked_arguments
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
    """Create the Gymnasium environment of a task. In contrast to ``gymnasium.make``, no wrappers are added.

    Args:
        task: ID of the task, such as "fast_food".
        variation: Name of a variation, such as "T1", or of a training condition, such as "train2". By default, the
            first training condition.
        observation: Name of an observation preset. With "state_only", no images are rendered.
        action_space: Name of an action space.
        quality: Name of a rendering preset.
        looks: Appearance of objects and rooms: "seen" (as in the demonstrations) or "unseen".
        render_mode: "rgb_array" if ``render`` must return images of the front camera.

    Raises:
        UnknownNameError: If a name is unknown. The message suggests similar names.
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


@checked_arguments
def load_task_files(paths: Path | str | Iterable[Path | str]) -> None:
    """Load Python files that define tasks, assets, relations, failure modes or learners.

    The command-line option ``--task-file`` does the same. Worker processes load the files as well. If Gymnasium has
    been imported, the tasks are also registered with Gymnasium.

    Raises:
        InvalidInputError: If a file is missing, raises an error, or registers a name that already exists.
    """
    user_files.load_task_files([paths] if isinstance(paths, str | Path) else paths)
    if "gymnasium" in sys.modules:
        from betterbench.api.registration import register_environments  # noqa: PLC0415 - imports Gymnasium

        register_environments()


@checked_arguments
def load_asset_folders(folders: Path | str | Iterable[Path | str]) -> None:
    """Load folders of assets that were written by ``better assets import``. Tasks can then use the assets by name.

    The command-line option ``--asset-dir`` does the same. Worker processes load the folders as well.

    Raises:
        InvalidInputError: If a folder is missing or contains no imported assets.
    """
    user_files.load_asset_folders([folders] if isinstance(folders, str | Path) else folders)
