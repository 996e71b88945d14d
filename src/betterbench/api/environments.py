"""Tasks as Gymnasium environments, including those of user files."""

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
    """Return a task as an unwrapped Gymnasium environment; ``gymnasium.make`` adds wrappers.

    Args:
        task: Task id ("fast_food").
        variation: Variation ("T1") or training condition ("train2"); the first training condition if not given.
        observation: Observation preset; "state_only" renders no images.
        action_space: Action space.
        quality: Render preset.
        looks: Appearance of objects and rooms: "seen" (in demonstrations) or "unseen".
        render_mode: "rgb_array" for images of the front camera.

    Raises:
        UnknownNameError: If a name is unknown; the message lists the closest ones.
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
    """Load Python files that define tasks, assets, relations, failure modes or learners, like ``--task-file``.

    Each file is loaded once, also in worker processes. If Gymnasium is imported, the tasks are registered with
    Gymnasium.

    Raises:
        InvalidInputError: If a file is missing, raises an error or registers an existing name.
    """
    user_files.load_task_files([paths] if isinstance(paths, str | Path) else paths)
    if "gymnasium" in sys.modules:
        from betterbench.api.registration import register_environments  # noqa: PLC0415 - it imports Gymnasium

        register_environments()


def load_asset_folders(folders: Path | str | Iterable[Path | str]) -> None:
    """Load asset folders written by ``better assets import``, like ``--asset-dir``.

    Each folder is loaded once, also in worker processes. Tasks can then use the assets by name.

    Raises:
        InvalidInputError: If a folder is missing or contains no imported assets.
    """
    user_files.load_asset_folders([folders] if isinstance(folders, str | Path) else folders)
