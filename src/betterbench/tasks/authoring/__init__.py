"""Building blocks of a task file: typed values for objects, slots, instructions, conditions and operations."""

from collections.abc import Iterable, Mapping, Sequence

from betterbench.tasks.authoring.condition_matrix import ConditionMatrix, MatrixCell
from betterbench.tasks.authoring.laid_out import laid_out
from betterbench.tasks.authoring.operations import (
    add,
    chain,
    draw_out,
    instruct,
    move,
    preplace,
    remove,
    repeat,
    replace,
    swap,
)
from betterbench.tasks.authoring.regimes import ListedRegime
from betterbench.tasks.authoring.registry import task
from betterbench.tasks.authoring.task import Task
from betterbench.tasks.authoring.templates import (
    CONSTRAINED_POSITIONING,
    CONTAINER_LOADING,
    LOGICAL_ASSEMBLY,
    LOOSE_PACKING,
    PATTERNED_ARRANGEMENT,
    PRECISION_INSERTION,
    RECURSIVE_STACKING,
)
from betterbench.tasks.authoring.variation import Variation
from betterbench.tasks.axes import Expected, Support
from betterbench.tasks.condition import Condition, ObjectSpec, Role, Slot, TargetRegion
from betterbench.tasks.relations.beside import BESIDE, CLOSE_TO, HANDLES_TO_FRONT, SIDES, is_cutlery
from betterbench.tasks.relations.closed import CLOSED
from betterbench.tasks.relations.in_hole import IN_HOLE
from betterbench.tasks.relations.inside import INSIDE
from betterbench.tasks.relations.layer import LAYER
from betterbench.tasks.relations.on_plate import ON_PLATE
from betterbench.tasks.relations.on_ring import ON_RING
from betterbench.tasks.relations.relation import Relation
from betterbench.tasks.subgoal import Instruction, Reference, Subgoal

SlotLayout = Mapping[ObjectSpec, Slot]
"""Slot in which each object starts."""


def item(name: str, kind: str = "", category: str = "", color: str | None = None) -> ObjectSpec:
    """Return an object that instructions may refer to.

    Args:
        name: Name in the scene. It can be any name, because names do not affect verdicts.
        kind: Noun for the object in instructions. By default, this is the name with spaces instead of underscores.
        category: Category of the object's asset. By default, this is the kind with underscores instead of spaces.
        color: Color of the asset, or None to let the scene generator choose.
    """
    return _object("item", name, kind, category, color)


def distractor(name: str, kind: str = "", category: str = "", color: str | None = None) -> ObjectSpec:
    """Return an object that no instruction refers to. The arguments are the same as for :func:`item`."""
    return _object("distractor", name, kind, category, color)


def container(name: str, kind: str = "", category: str = "") -> ObjectSpec:
    """Return a movable container or support that stands on the table and takes other objects."""
    return _object("container", name, kind, category)


def fixture(name: str, kind: str = "", category: str = "", *, fixed: bool = False) -> ObjectSpec:
    """Return a fixture that objects are placed in or around. If ``fixed`` is True, the fixture cannot be moved."""
    return _object("fixture", name, kind, category, fixed=fixed)


def drawer(name: str, category: str, cabinet: ObjectSpec) -> ObjectSpec:
    """Return a drawer of a cabinet. It slides in the mount that has the same name as the drawer."""
    return _object("drawer", name, category.replace("_", " "), category, mount=TargetRegion(cabinet.name, name))


def _object(
    role: Role,
    name: str,
    kind: str,
    category: str,
    color: str | None = None,
    *,
    fixed: bool = False,
    mount: TargetRegion | None = None,
) -> ObjectSpec:
    kind = kind or name.replace("_", " ")
    return ObjectSpec(name, kind, category or kind.replace(" ", "_"), color, role, fixed, mount)


def subgoal(
    name: str,
    relation: Relation,
    thing: ObjectSpec | Reference,
    target: ObjectSpec,
    region: str = "",
    *,
    word: str,
    count: int = 1,
) -> Subgoal:
    """Return a step of an instruction. For ``name``, ``word`` and ``count``, see :class:`Subgoal`.

    If ``thing`` is an object, any object of the same kind is accepted. It can also be a reference to the object in a
    slot. The relation must hold between the accepted object and the target. If the target has several regions,
    ``region`` is the name of the region that is meant.
    """
    given: object = relation
    if not isinstance(given, Relation):
        raise TypeError(f"subgoal(name, relation, ...): relation must be a Relation such as a.INSIDE, got {given!r}")
    reference = thing if isinstance(thing, Reference) else Reference(kind=thing.kind)
    return Subgoal(name, relation.name, reference, target.name, word, count, region)


def packed(verb: str, target: ObjectSpec, *things: ObjectSpec) -> tuple[Subgoal, ...]:
    """Return the steps that put objects into a container.

    If several objects have the same kind, each additional step for this kind requires one more object in the container.

    Args:
        verb: Verb at the beginning of the name of each step.
        target: The container.
        *things: Objects to put into the container, in order.
    """
    if not isinstance(verb, str):
        raise TypeError(f"packed(verb, target, *things): the first argument must be a verb (a string), got {verb!r}")
    kinds = [thing.kind for thing in things]
    steps = []
    for i, thing in enumerate(things):
        count = kinds[: i + 1].count(thing.kind)
        name = f"{verb}_{thing.kind.replace(' ', '_')}" + (f"_{count}" if count > 1 else "")
        steps.append(subgoal(name, INSIDE, thing, target, word=thing.kind.split()[-1], count=count))
    return tuple(steps)


def ordered(text: str, *steps: Subgoal) -> Instruction:
    """Return an instruction that requires its steps to be done in order."""
    return Instruction(text, steps, ordered=True)


def arranged(anchor: ObjectSpec, *steps: tuple[ObjectSpec, str], close: bool = False) -> Instruction:
    """Return the instruction to put objects at the sides of another object, the anchor, in any order.

    Args:
        anchor: Object that the others are placed around.
        *steps: Pairs of an object and the side to which it must be moved.
        close: Whether the instruction says "next to" and states which way cutlery points. Use it for a round anchor
            such as a plate, since objects must be close to the plate and the handles of cutlery must point to the
            front.
    """
    at = f"the {anchor.kind}"
    parts = [
        f"the {thing.kind} {CLOSE_TO[side].format(at) if close else f'{SIDES[side]} {at}'}" for thing, side in steps
    ]
    goals = (subgoal(f"{t.name}_{side}", BESIDE, t, anchor, side, word=t.kind) for t, side in steps)
    cutlery = [thing.kind for thing, _ in steps if close and is_cutlery(thing.kind, thing.category)]
    direction = f", {HANDLES_TO_FRONT[len(cutlery) > 1].format(cutlery[0])}" if cutlery else ""
    return Instruction(f"Put {_listed(parts)}{direction}.", tuple(goals))


def _listed(parts: Sequence[str]) -> str:
    return f"{', '.join(parts[:-1])} and {parts[-1]}" if len(parts) > 1 else parts[0]


def condition(
    layout: SlotLayout,
    instruction: Instruction,
    *mounted: ObjectSpec,
    preplaced: Mapping[ObjectSpec, ObjectSpec] | None = None,
    opened: Mapping[ObjectSpec, float] | None = None,
    cloth: str | None = None,
) -> Condition:
    """Return a training condition. The registry sets its task and its name.

    Args:
        layout: Slot where each object starts.
        instruction: Instruction with its subgoals.
        *mounted: Drawers of the scene. Each starts in its mount.
        preplaced: Objects of the layout that start at a target instead of in their slot.
        opened: Drawers that are open at the start, with the width of their opening [m].
        cloth: Color of the tablecloth. By default, the table has no cloth.
    """
    if not isinstance(instruction, Instruction):
        raise TypeError("an instruction needs a text and steps: use ordered(text, *steps) or Instruction(text, steps)")
    resting = preplaced or {}
    return Condition(
        task="",
        name="",
        objects=(*layout, *mounted),
        layout={o.name: slot.name for o, slot in layout.items() if o not in resting},
        instruction=instruction,
        preplaced={o.name: TargetRegion(target.name) for o, target in resting.items()},
        opened={o.name: distance for o, distance in (opened or {}).items()},
        cloth=cloth,
    )


def conditions(layouts: Iterable[SlotLayout], instructions: Iterable[Instruction]) -> tuple[Condition, ...]:
    """Return one training condition for each combination of a layout and an instruction."""
    asked = tuple(instructions)
    return tuple(condition(layout, instruction) for layout in layouts for instruction in asked)


__all__ = [
    "BESIDE",
    "CLOSED",
    "CONSTRAINED_POSITIONING",
    "CONTAINER_LOADING",
    "INSIDE",
    "IN_HOLE",
    "LAYER",
    "LOGICAL_ASSEMBLY",
    "LOOSE_PACKING",
    "ON_PLATE",
    "ON_RING",
    "PATTERNED_ARRANGEMENT",
    "PRECISION_INSERTION",
    "RECURSIVE_STACKING",
    "Condition",
    "ConditionMatrix",
    "Expected",
    "Instruction",
    "ListedRegime",
    "MatrixCell",
    "ObjectSpec",
    "Reference",
    "Relation",
    "Slot",
    "SlotLayout",
    "Subgoal",
    "Support",
    "Task",
    "Variation",
    "add",
    "arranged",
    "chain",
    "condition",
    "conditions",
    "container",
    "distractor",
    "draw_out",
    "drawer",
    "fixture",
    "instruct",
    "item",
    "laid_out",
    "move",
    "ordered",
    "packed",
    "preplace",
    "remove",
    "repeat",
    "replace",
    "subgoal",
    "swap",
    "task",
]
