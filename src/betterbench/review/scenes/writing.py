"""Output of reviewed tasks. New files contain the moved slots, and leave out rejected variations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from betterbench.errors import InvalidInputError
from betterbench.jobs.decisions import histories
from betterbench.jobs.durable import write_durably
from betterbench.json_form import dump_json
from betterbench.review.scenes.changes import FrameChange, SceneChange, SceneHistory, SlotChange, read_scene_reviews
from betterbench.review.scenes.forms import patched, task_content
from betterbench.review.scenes.queue import QueuedScene, ReviewedTask
from betterbench.sim.assets.folders.manifest import manifest_of
from betterbench.sim.assets.folders.reviewed import write_reviewed_folder
from betterbench.sim.assets.importing.review import RegionChange
from betterbench.tasks import get_task, task_from_json
from betterbench.tasks.authoring.task_form import task_forms
from betterbench.tasks.interventions.resolve import condition_names

SHOWN = 16
"""Number of digits of a content hash that messages show."""


@dataclass(frozen=True, slots=True)
class ReviewedForm:
    """JSON form of a task after its review.

    Attributes:
        form: JSON form with all changes applied, and without rejected variations.
        rejected: Reason for each rejected variation, keyed by its name.
        moved: Whether a slot was moved. If so, the demonstrations must be measured again.
        changes: All changes that were not undone.
    """

    form: dict[str, Any]
    rejected: Mapping[str, str]
    moved: bool
    changes: tuple[SceneChange, ...]


def reviewed_form(form: Mapping[str, Any], history: SceneHistory) -> ReviewedForm:
    """Apply the decisions of a review to the JSON form of a task.

    Raises:
        InvalidInputError: If a condition has no valid verdict, or a training condition was rejected.
    """
    task = ReviewedTask(form, task_content(form))
    name, changes = task.name, history.changes
    rejected: dict[str, str] = {}
    conditions = condition_names(task.changed(()))
    verdicts = {condition: QueuedScene(task, condition).verdict(history) for condition in conditions}
    missing = [condition for condition, verdict in verdicts.items() if verdict is None]
    if missing:
        problem = f"{len(missing)} of {len(conditions)} conditions have no verdict: {', '.join(missing)}"
        cure = (
            "Accept or reject them with better review scenes. Moving a slot withdraws the verdicts on all scenes with "
            "that slot"
        )
        raise InvalidInputError(name, problem, cure)
    for condition, verdict in verdicts.items():
        if verdict is not None and verdict.verdict == "reject":
            rejected[condition] = verdict.reason
    trained = [condition for condition in rejected if condition in {c.name for c in task.changed(()).training}]
    if trained:
        problem = f"the training condition {trained[0]} was rejected: {rejected[trained[0]]}"
        raise InvalidInputError(
            name, problem, "Write a new task, because all variations are derived from the training condition"
        )
    new = patched(form, changes, where=name)
    new["variations"] = [variation for variation in new["variations"] if variation["name"] not in rejected]
    if rejected and new["version"] == form["version"]:
        new["version"] = int(new["version"]) + 1
    task_from_json(new, where=name)
    return ReviewedForm(new, rejected, any(isinstance(change, SlotChange) for change in changes), changes)


def reviewed_forms(path: Path) -> dict[str, ReviewedForm]:
    """Return the reviewed tasks in a review file, keyed by name. All of these tasks must be loaded.

    Raises:
        RecordError: If the review file cannot be read.
        InvalidInputError: If a condition has no valid verdict, if a training condition was rejected, or if a task has
            changed since its review.
        UnknownNameError: If a task is not loaded.
    """
    reviews = read_scene_reviews(path)
    names = {review.content: review.task for review in reviews}
    found: dict[str, ReviewedForm] = {}
    for content, history in histories(reviews, str(path)).items():
        if not history.reviews:
            continue
        name = names[content]
        get_task(name)
        form = task_forms([name])[name]
        here = task_content(form)
        if here != content:
            problem = f"it was reviewed with the content {content[:SHOWN]}, but its content is now {here[:SHOWN]}"
            raise InvalidInputError(
                name, problem, "Restore the task file that was reviewed, or review the current task file"
            )
        found[name] = reviewed_form(form, history)
    if not found:
        raise InvalidInputError(
            str(path), "it contains no decisions, or all of them were undone", "Review the scenes of a task first"
        )
    return found


def write_reviewed_tasks(found: Mapping[str, ReviewedForm], out: Path) -> list[Path]:
    """Write each task to a file ``NAME.json`` in a folder, and return the paths of the files."""
    paths = []
    for name, reviewed in found.items():
        paths.append(out / f"{name}.json")
        write_durably(paths[-1], dump_json(reviewed.form) + b"\n")
    return paths


def write_moved_frames(found: Mapping[str, ReviewedForm], folders: Sequence[Path], out: Path) -> list[Path]:
    """Copy each asset folder to a new folder of the same name.

    In the copies, placement frames that were moved in a review get their new poses.

    Returns:
        The paths of the new folders.

    Raises:
        InvalidInputError: If an asset with moved frames is not in any of the folders, or if two folders have the same
            name.
    """
    moves: dict[str, dict[tuple[str, str], RegionChange]] = {}
    for reviewed in found.values():
        for change in reviewed.changes:
            if isinstance(change, FrameChange):
                moved = moves.setdefault(change.asset, {})
                key = (change.before.name, repr(change.before))
                moved.setdefault(key, RegionChange(change.before, change.after))  # tasks share assets
    paths: list[Path] = []
    for folder in folders:
        changes = {name: list(moves.pop(name).values()) for name in manifest_of(folder).assets if name in moves}
        if changes:
            paths.append(out / folder.name)
            paths[-1].mkdir(parents=True, exist_ok=True)
            write_reviewed_folder(folder, paths[-1], changes)
    if moves:
        raise InvalidInputError(
            next(iter(moves)), "it is not in an asset folder", "Pass the folder that contains it with --asset-dir"
        )
    return paths
