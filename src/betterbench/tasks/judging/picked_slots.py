"""Points where the gripper is expected to close in the slots of a task.

If the gripper closes without an object, its position is compared with these points.

The expert does not close at the center of every slot. It grasps a mug at the handle, cutlery at the grip and a plate at
the rim, 3 to 8 cm from the center. The points are derived from the annotated grasps of the assets, in the expert's
order of preference, and are rotated with the slot. ``tools/closing_points.py`` writes the file. Because no
demonstrations need to be measured, the points are also available for a user's tasks with objects of the library.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from typing import Literal, NamedTuple

from pydantic import TypeAdapter

from betterbench.errors import UnknownNameError
from betterbench.interface.state import SceneInfo
from betterbench.json_form import open_seal, read_form, strict_form
from betterbench.tasks.authoring.registry import get_task
from betterbench.tasks.authoring.task import Task
from betterbench.tasks.thresholds import EMPTY_SLOT_REACH

PACKAGED = "closing_points.json"
FORM: Literal["betterbench closing points"] = "betterbench closing points"


class ClosingPoint(NamedTuple):
    """Point where the gripper closes in the preferred grasp of a category of objects, in the frame of the object.

    Attributes:
        x_mm: x coordinate of the point [mm].
        y_mm: y coordinate of the point [mm].
        spread_mm: Variation of the point over the variants of the object [mm].
    """

    x_mm: float
    y_mm: float
    spread_mm: float


@strict_form
@dataclass(frozen=True, slots=True)
class ClosingPoints:
    """File with the points where the gripper closes in preferred grasps, by category of the asset."""

    categories: Mapping[str, tuple[ClosingPoint, ...]]
    form: Literal["betterbench closing points"] = FORM


@dataclass(frozen=True, slots=True)
class PickedSlot:
    """Slot of the scene where demonstrations pick up an object.

    Attributes:
        name: Name of the slot.
        middle: Center of the slot, x and y in the world frame [m].
        closings: Points where demonstrations close the gripper, starting with the center of the slot. Each has x and y
            in the world frame, and a spread caused by the jitter of the slot and the variants of the object [m].
    """

    name: str
    middle: tuple[float, float]
    closings: tuple[tuple[float, float, float], ...]

    def beyond(self, point: Sequence[float]) -> float:
        """Return how far a point is outside the region where demonstrations close the gripper, seen from above [m].

        This is 0 for a point inside the region.
        """
        return max(0.0, min(math.dist(point[:2], (x, y)) - spread for x, y, spread in self.closings))

    def is_met(self, point: Sequence[float]) -> bool:
        """Return whether an empty gripper that closes at this point may have been aimed at this slot."""
        return self.beyond(point) <= EMPTY_SLOT_REACH


_FILE = TypeAdapter(ClosingPoints)
_WHERE = "packaged closing points"
_CURE = "Write them again with tools/closing_points.py"


@functools.lru_cache(maxsize=1)
def closing_points() -> Mapping[str, tuple[ClosingPoint, ...]]:
    """Return the points where the gripper closes in preferred grasps, by category of the asset.

    Raises:
        InvalidInputError: If the packaged file is damaged.
    """
    text = resources.files("betterbench.tasks").joinpath("data", PACKAGED).read_text(encoding="utf-8")
    form = open_seal(text, where=_WHERE, cure=_CURE, since=("version", 1))
    form.pop("version", None)
    return read_form(_FILE, form, where=_WHERE, cure=_CURE).categories


def picked_slots(task: str, info: SceneInfo) -> tuple[PickedSlot, ...]:
    """Return the slots where training picks up an object, in the order of the scene.

    Args:
        task: Id of the task. For an unknown task, the result is empty.
        info: The scene with the positions of the slots.
    """
    try:
        known = get_task(task)
    except UnknownNameError:
        return ()
    picked = _picked_categories(known)
    found = []
    for slot in info.slots:
        if slot.name not in picked:
            continue
        jitter = known.slot(slot.name)
        corner = math.sqrt(2.0) * jitter.jitter_m
        x, y, _ = slot.position
        cos, sin = math.cos(slot.yaw), math.sin(slot.yaw)
        closings = [(x, y, corner)]
        for category in sorted(picked[slot.name]):
            for point in closing_points().get(category, ()):
                px, py, looks = (0.001 * value for value in point)
                spread = corner + jitter.yaw_jitter * math.hypot(px, py) + looks
                closings.append((x + cos * px - sin * py, y + sin * px + cos * py, spread))
        found.append(PickedSlot(slot.name, (x, y), tuple(closings)))
    return tuple(found)


def _picked_categories(task: Task) -> dict[str, set[str]]:
    """Return the categories of the objects that training picks from each slot, by slot name."""
    picked: dict[str, set[str]] = {}
    for condition in task.training:
        for goal in condition.instruction.subgoals:
            for name in condition.resolve(goal.reference):
                if name in condition.layout:
                    picked.setdefault(condition.layout[name], set()).add(condition.object(name).category)
    return picked
