"""Functions that apply the changes of a review to the JSON form of a task, without modifying their arguments."""

from __future__ import annotations

import copy
import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from typing import Any

from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.geometry import angle_between, distance
from betterbench.interface.state import Region
from betterbench.json_form import dump_json
from betterbench.review.scenes.changes import FrameChange, SceneChange, SlotChange, SlotPlace
from betterbench.tasks import Condition, Task

SAME_M, SAME_RAD = 1e-6, 1e-6
"""Tolerances for comparing a value with the rounded value that the reviewer saw."""
_OTHER_CURE = "Restore the task file that was reviewed, or review the current task file"


def task_content(form: Mapping[str, Any]) -> str:
    """Return the hexadecimal hash of a task's JSON form."""
    return hashlib.sha256(dump_json(dict(form))).hexdigest()


def scene_content(task: Task, condition: Condition, changes: Iterable[SceneChange] = ()) -> str:
    """Return the hexadecimal hash of the scene of a condition.

    The hash covers the condition, the slots that it uses, and the placement frames that were moved.
    """
    used = sorted(set(condition.layout.values()))
    categories = {spec.category for spec in condition.objects}
    frames = moved_frames(changes)
    form = {
        "condition": condition.to_json(),
        "slots": [asdict(task.slot(name)) for name in used],
        "frames": {name: [asdict(r) for r in found.values()] for name, found in frames.items() if name in categories},
    }
    return hashlib.sha256(dump_json(form)).hexdigest()


def place_of(slot: Mapping[str, Any]) -> SlotPlace:
    """Return the center and heading of a slot, given its JSON form."""
    return SlotPlace(float(slot["x"]), float(slot["y"]), float(slot["yaw"]))


def changed_form(form: Mapping[str, Any], change: SceneChange, *, where: str = "review") -> dict[str, Any]:
    """Apply one change to the JSON form of a task.

    If the change moved a placement frame, the JSON form stays the same, because placement frames are stored in assets.

    Raises:
        InvalidInputError: If the task has no such slot, or the slot is not at the position that the reviewer moved it
            from.
    """
    new: dict[str, Any] = copy.deepcopy(dict(form))
    if isinstance(change, FrameChange):
        return new
    slot = next((slot for slot in new["slots"] if slot["name"] == change.slot), None)
    if slot is None:
        unknown = UnknownNameError("slot", change.slot, [str(slot["name"]) for slot in new["slots"]])
        raise InvalidInputError(where, str(unknown).rstrip("."), _OTHER_CURE)
    here = place_of(slot)
    if not _is_same_place(here, change.before):
        problem = f"in the review, the slot {change.slot!r} was at {_at(change.before)}, but here it is at {_at(here)}"
        raise InvalidInputError(where, problem, _OTHER_CURE)
    slot.update(asdict(change.after))
    return new


def _is_same_place(a: SlotPlace, b: SlotPlace) -> bool:
    return max(abs(a.x - b.x), abs(a.y - b.y)) < SAME_M and abs(a.yaw - b.yaw) < SAME_RAD


def _at(place: SlotPlace) -> str:
    return f"({place.x:.4g} m, {place.y:.4g} m, {place.yaw:.3g} rad)"


def patched(form: Mapping[str, Any], changes: Sequence[SceneChange], *, where: str = "review") -> dict[str, Any]:
    """Apply changes to the JSON form of a task, in order. If a slot was moved, the version of the task is incremented.

    The same form and the same changes always give the same result.

    Raises:
        InvalidInputError: If the task has no such slot, or the slot is not at the position that the reviewer moved it
            from.
    """
    new = dict(form)
    for change in changes:
        new = changed_form(new, change, where=where)
    if any(isinstance(change, SlotChange) for change in changes):
        new["version"] = int(new["version"]) + 1
    return new


def moved_frames(changes: Iterable[SceneChange]) -> dict[str, dict[str, Region]]:
    """Return the final pose of each placement frame that was moved, keyed by asset name and frame name."""
    found: dict[str, dict[str, Region]] = {}
    for change in changes:
        if isinstance(change, FrameChange):
            found.setdefault(change.asset, {})[change.after.name] = change.after
    return found


def is_same_frame(a: Region, b: Region) -> bool:
    """Return whether two placement frames are equal, apart from rounding errors."""
    apart = max(distance(a.position, b.position), distance(a.half_size, b.half_size))
    return a.name == b.name and apart < 1e-5 and angle_between(a.quaternion, b.quaternion) < 1e-4
