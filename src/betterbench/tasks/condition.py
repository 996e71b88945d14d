"""Conditions: fully specified settings of a task, with objects, slots and instruction."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal

from betterbench.errors import find_named
from betterbench.tasks.axes import Expected
from betterbench.tasks.subgoal import Instruction, Reference

Role = Literal["item", "distractor", "container", "fixture", "drawer"]


@dataclass(frozen=True, slots=True)
class TargetRegion:
    """Target region, such as a container, a hole in a rack, a layer of a stack or a drawer's mount.

    Attributes:
        target: Name of the target in the scene.
        region: Region of the target, or "" if the target has only one region.
    """

    target: str
    region: str = ""


@dataclass(frozen=True, slots=True)
class Slot:
    """Named start position on the table.

    Attributes:
        name: Name of the slot.
        x: x coordinate of the center in the world frame [m].
        y: y coordinate of the center in the world frame [m].
        yaw: Heading of the object without jitter [rad].
        jitter_m: Half the width of the uniform jitter of the position [m].
        yaw_jitter: Half the width of the uniform jitter of the heading [rad].
    """

    name: str
    x: float
    y: float
    yaw: float = 0.0
    jitter_m: float = 0.015
    yaw_jitter: float = 0.15


@dataclass(frozen=True, slots=True)
class ObjectSpec:
    """Specification of an object in a condition.

    Attributes:
        name: Name in the scene. It can be chosen freely, because renaming objects does not change any verdict.
        kind: Noun for the object in instructions ("red mug").
        category: Category of the object's asset ("mug").
        color: Color of the asset, or None to let the scene generator choose.
        role: Role of the object in the scene.
        fixed: Whether the object cannot be moved.
        mount: For a drawer, the mount in the cabinet.
    """

    name: str
    kind: str
    category: str
    color: str | None = None
    role: Role = "item"
    fixed: bool = False
    mount: TargetRegion | None = None


@dataclass(frozen=True, slots=True)
class Condition:
    """Fully specified setting of a task: layout, identity of the objects, initial state, instruction and subgoals.

    Attributes:
        task: Name of the task.
        name: Name within the task ("train1", "L3").
        objects: All objects in the scene.
        layout: Slot of each object that starts on the table, by the object's name.
        instruction: Instruction with its subgoals.
        preplaced: Target region of each object that starts at a target, by the object's name.
        opened: How far each drawer is open at the start [m], by the drawer's name. Drawers that are not listed are
            closed.
        expected: Behavior of a policy that understands the instruction.
        mid_task_look: Whether the initial state looks like the middle of a demonstration.
        premise_broken: Whether a premise of the instruction is deliberately false.
        cloth: Color of the tablecloth, or None for the bare table top of the room.
        watch_steps: Number of control steps that the episode continues after the goal is met. A grasp attempt during
            these steps is a failure.
    """

    task: str
    name: str
    objects: tuple[ObjectSpec, ...]
    layout: Mapping[str, str]
    instruction: Instruction
    preplaced: Mapping[str, TargetRegion] = field(default_factory=dict)
    opened: Mapping[str, float] = field(default_factory=dict)
    expected: Expected = Expected.SUCCEED
    mid_task_look: bool = False
    premise_broken: bool = False
    cloth: str | None = None
    watch_steps: int = 0

    @property
    def id(self) -> str:
        """Identifier that is unique across tasks ("fast_food/train1")."""
        return f"{self.task}/{self.name}"

    def object(self, name: str) -> ObjectSpec:
        """Return an object by its name.

        Raises:
            UnknownNameError: If the condition has no such object.
        """
        for found in self.objects:  # a loop, because find_named() would format its message text at every call
            if found.name == name:
                return found
        return find_named(f"object of {self.id}", name, self.objects)

    def occupant(self, slot: str) -> str | None:
        """Return the name of the object that starts in a slot, or None if the slot is empty."""
        for name, place in self.layout.items():
            if place == slot:
                return name
        return None

    def resolve(self, reference: Reference) -> tuple[str, ...]:
        """Return the names of the objects that a reference may refer to, in a stable order."""
        if reference.slot is not None:
            occupant = self.occupant(reference.slot)
            return () if occupant is None else (occupant,)
        return tuple(sorted(o.name for o in self.objects if o.kind == reference.kind))

    def with_(self, **changes: Any) -> Condition:  # noqa: ANN401 - the fields' own types, checked by the constructor
        """Return a copy of the condition with some fields changed."""
        return replace(self, **changes)

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict."""
        form = asdict(replace(self, layout={}, preplaced={}, opened={}))
        form["layout"] = dict(self.layout)
        form["preplaced"] = {name: asdict(place) for name, place in self.preplaced.items()}
        form["opened"] = dict(self.opened)
        if self.cloth is None:  # without these fields, the JSON form is that of earlier versions
            del form["cloth"]
        if not self.watch_steps:
            del form["watch_steps"]
        return form
