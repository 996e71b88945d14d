"""Conditions: fully specified settings of a task, with their objects and slots."""

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
    """Target region, such as a container, rack hole, stack layer or drawer mount.

    ``target`` is a name in the scene. ``region`` is "" if the target has only one region.
    """

    target: str
    region: str = ""


@dataclass(frozen=True, slots=True)
class Slot:
    """A named start position on the table.

    Attributes:
        x: Center [m], world frame.
        y: Center [m], world frame.
        yaw: Nominal heading of the object [rad].
        jitter_m: Half width of the uniform position jitter [m].
        yaw_jitter: Half width of the uniform heading jitter [rad].
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
        name: Name in the scene. Names have no meaning, so renaming all objects does not change verdicts.
        kind: Object noun in instructions ("red mug").
        category: Its asset's category ("mug").
        color: Its asset's color, or None to let the generator choose.
        mount: For a drawer, its mount in the cabinet.
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
    """Fully specified setting of a task, with layout, object identities, initial state, instruction and subgoals.

    Attributes:
        name: Name within the task ("train1", "L3").
        layout: Slot name by object name, for every object that starts on the table.
        preplaced: Target region by object name, for objects that start at a target.
        opened: Opening at the start [m] by drawer name. Other drawers are closed.
        expected: Behavior of a policy that understands the instruction.
        mid_task_look: Whether the initial state looks like the middle of a demonstration.
        premise_broken: Whether a premise of the instruction is deliberately false.
        cloth: Color of the tablecloth, or None for the table top of the room.
        watch_steps: Control steps for which the episode continues after the goal is met. A grasp attempt in this time
            is a failure.
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
        """Identifier across tasks ("fast_food/train1")."""
        return f"{self.task}/{self.name}"

    def object(self, name: str) -> ObjectSpec:
        """Return an object by name.

        Raises:
            UnknownNameError: If the condition has no such object.
        """
        for found in self.objects:  # this is called often, and the kind is only for the message
            if found.name == name:
                return found
        return find_named(f"object of {self.id}", name, self.objects)

    def occupant(self, slot: str) -> str | None:
        """Return the name of the object that starts in a slot, or None."""
        for name, place in self.layout.items():
            if place == slot:
                return name
        return None

    def resolve(self, reference: Reference) -> tuple[str, ...]:
        """Return the names of a reference's possible objects, in a stable order."""
        if reference.slot is not None:
            occupant = self.occupant(reference.slot)
            return () if occupant is None else (occupant,)
        return tuple(sorted(o.name for o in self.objects if o.kind == reference.kind))

    def with_(self, **changes: Any) -> Condition:  # noqa: ANN401 - the fields' own types, checked by the constructor
        """Return a copy with some fields changed."""
        return replace(self, **changes)

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict."""
        form = asdict(replace(self, layout={}, preplaced={}, opened={}))
        form["layout"] = dict(self.layout)
        form["preplaced"] = {name: asdict(place) for name, place in self.preplaced.items()}
        form["opened"] = dict(self.opened)
        if self.cloth is None:  # conditions without a cloth or watch keep the form of earlier versions
            del form["cloth"]
        if not self.watch_steps:
            del form["watch_steps"]
        return form
