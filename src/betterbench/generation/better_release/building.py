"""Conversion of a task of the BeTTER release to our task format.

Training variations become training conditions. A test variation becomes a list of operations on the training condition
that requires the fewest operations.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from betterbench.errors import BetterError, one_line
from betterbench.generation.better_release.files import ReleasePredicate, ReleaseTask
from betterbench.generation.better_release.layout import PlacedSlots, place_slots
from betterbench.generation.better_release.matching import Match
from betterbench.generation.better_release.predicates import SYNONYMS, holds_at_start
from betterbench.generation.better_release.resolved import Resolved, left_behind
from betterbench.generation.better_release.sentence import Lexicon, color_of
from betterbench.tasks import (
    TEMPLATES,
    Axis,
    Condition,
    Instruction,
    ObjectSpec,
    Operation,
    Reference,
    Slot,
    Subgoal,
    TargetRegion,
    Task,
    Template,
    Variation,
    task_from_json,
    task_to_json,
)
from betterbench.tasks import authoring as a
from betterbench.tasks.condition import Role
from betterbench.tasks.relations import RELATIONS

_OF_RELATION: Mapping[str, tuple[str, Role]] = {
    "inside": ("loose_packing", "container"),
    "on_ring": ("constrained_positioning", "fixture"),
    "on_plate": ("recursive_stacking", "item"),
    "layer": ("logical_assembly", "container"),
    "beside": ("patterned_arrangement", "fixture"),
}
"""Template and role of the target, for each of our relations."""

_SIDES = {"left_of": "left", "right_of": "right", "behind": "behind"}
"""For each side relation of the release, the region of our relation "beside" that corresponds to it.

Our relation also requires that the objects are aligned.
"""

_HYPOTHESES = {
    Axis.SPATIAL_LAYOUT_SHIFT: "Objects are found by what they are, not by where they lay in training.",
    Axis.PRIMITIVE_RECOMPOSITION: "The instruction decides which known steps are done.",
    Axis.ADVERSARIAL_OBJECT_PERTURBATION: "An object in the place of another is judged by what it is.",
    Axis.TEMPORAL_EXTRAPOLATION: "What is done already is seen, and known steps go on from there.",
}

_NAMES_IN_TITLE = 2


@dataclass(frozen=True)
class Represented:
    """Representation of a release variation in our task format.

    Attributes:
        name: Name of the condition in our task ("train1", "O1"), or None if the variation is not represented.
        reasons: Reasons why the variation cannot be represented.
        left_out: Objects that are in the scene of the release but not in our condition, with the reason for each.
        predicates: Predicates of the release that have no counterpart among our relations.
        base: Training condition that a test variation is derived from.
        operations: Operations that convert the training condition to the variation, described as text.
    """

    name: str | None
    reasons: tuple[str, ...] = ()
    left_out: Mapping[str, str] = field(default_factory=dict)
    predicates: tuple[ReleasePredicate, ...] = ()
    base: str | None = None
    operations: tuple[str, ...] = ()


@dataclass(frozen=True)
class Built:
    """Task built from a release task.

    Attributes:
        task: The task, or None if no training condition can be represented.
        variations: Representation of each variation of the release.
        slots: Slots of the task.
    """

    task: Task | None
    variations: Mapping[str, Represented]
    slots: PlacedSlots


def task_id_of(task: ReleaseTask) -> str:
    """Return the id that a release task gets in our task format ("better_packing_a_fruit_lunch")."""
    plain = re.sub(r"[^a-z0-9]+", "_", task.task.task_id.lower()).strip("_")
    return f"better_{plain}"[:60].rstrip("_")


def build_task(task: ReleaseTask, resolved: Mapping[str, Resolved], matches: Mapping[str, Match]) -> Built:
    """Convert a release task to our task format, with objects from our library.

    An object is left out if no library asset represents it, or if a variation replaces it without removing it from the
    scene. A variation is left out if our task format cannot express its goals.

    Args:
        task: The release task.
        resolved: Variations of the release task, including inherited values.
        matches: Library asset that represents each object, by object id.
    """
    maker = _Maker(task, resolved, matches)
    return maker.build()


class _Maker:
    """Builds the conditions of a task."""

    def __init__(self, task: ReleaseTask, resolved: Mapping[str, Resolved], matches: Mapping[str, Match]) -> None:
        self.task, self.resolved, self.matches = task, resolved, matches
        self.lexicon = Lexicon(task)
        self.training = [v for v in resolved.values() if v.training]
        self.template, self.target_role = self._template()
        self.specs = {name: self._spec(name) for name in task.instances if name in matches}
        self.left_out = {name: self._left_out(v) for name, v in resolved.items()}
        self.rests = {name: self._at_rest(v) for name, v in resolved.items()}
        self.slots = place_slots(list(resolved.values()), self.rests, matches)

    def build(self) -> Built:
        made: dict[str, Represented] = {}
        conditions: dict[str, Condition] = {}
        for name, variation in self.resolved.items():
            reasons = self._obstacles(variation)
            if not reasons:
                condition = self._condition(variation)
                reasons = list(self.template.problems(condition)) if self.template else []
                conditions[name] = condition
            lost = tuple(p for p in (*variation.success, *variation.fail) if not self._is_covered(p, variation))
            made[name] = Represented(None, tuple(reasons), self.left_out[name], lost)
        training: dict[str, Condition] = {}
        for v in self.training:
            if not made[v.name].reasons:
                number = next((n for n, c in training.items() if _same(c, conditions[v.name])), None)
                number = number or f"train{len(training) + 1}"
                training.setdefault(number, conditions[v.name].with_(name=number))
                made[v.name] = replace(made[v.name], name=number)
        if not training or self.template is None:
            return Built(None, made, self.slots)
        variations: list[Variation] = []
        for name, variation in self.resolved.items():
            if not variation.training and not made[name].reasons:
                made[name], found = self._variation(variation, conditions[name], training, made[name], variations)
                variations += [found] if found is not None else []
        return Built(self._task(tuple(training.values()), variations), made, self.slots)

    def _task(self, training: tuple[Condition, ...], variations: Sequence[Variation]) -> Task:
        assert self.template is not None  # noqa: S101 - for the type checker; build() returns without a template
        used = {slot for condition in training for slot in condition.layout.values()}
        used |= {
            v.name for one in variations for o in one.interventions for v in o.arguments.values() if isinstance(v, Slot)
        }
        task = Task(
            id=task_id_of(self.task),
            version=1,
            title=self.task.task.task_id.replace("_", " "),
            description=one_line(self.task.task.description, most=300) or self.task.task.task_id,
            template=self.template,
            slots=tuple(slot for name, slot in self.slots.slots.items() if name in used),
            training=tuple(c.with_(task=task_id_of(self.task)) for c in training),
            variations=tuple(variations),
        )
        return task_from_json(task_to_json(task), where=f"the task made of {self.task.folder}")

    # ------------------------------------------------------------------------------------------------ present objects

    def _left_out(self, variation: Resolved) -> dict[str, str]:
        found = {one.name: f"replaced by {one.by}" for one in left_behind(variation, self.training)}
        for name in variation.active:
            if name not in self.task.instances:
                found[name] = "not an object of the task"
            elif name not in variation.poses:
                found[name] = "it has no pose"
            elif name not in self.matches:
                found[name] = "no similar asset in our library"
        return found

    def _at_rest(self, variation: Resolved) -> tuple[str, ...]:
        """Return the objects of a variation that start in a slot on the table."""
        inside = self._preplaced(variation)
        names = (name for name in variation.active if name not in inside)
        return tuple(name for name in names if name not in self.left_out[variation.name])

    def _preplaced(self, variation: Resolved) -> tuple[str, ...]:
        """Return the objects that are already in the container at the start, based on the sizes of our assets."""
        sizes = {name: match.asset.size_m for name, match in self.matches.items()}
        container = variation.container
        if container not in self.matches or "inside" not in _regions(self.matches[container]):
            return ()
        found = []
        for name in variation.active:
            start = ReleasePredicate(name, "in", container)
            if name != container and name in self.specs and holds_at_start(start, variation.poses, sizes):
                found.append(name)
        return tuple(found)

    def _obstacles(self, variation: Resolved) -> list[str]:
        """Return the reasons why our task format cannot represent a variation, or an empty list."""
        if not variation.enabled:
            return ["the release has disabled it"]
        reasons = []
        missing = self.left_out[variation.name]
        needed = dict.fromkeys((*(p.subject_id for p in variation.success), *(p.target_id for p in variation.success)))
        reasons += [
            f"{name}: {missing.get(name, 'not in the scene')}" for name in needed if name not in self._there(variation)
        ]
        if not variation.success:
            reasons.append("it has no goal")
        if not variation.instruction.strip():
            reasons.append("it has no instruction")
        for predicate in variation.success:
            if not reasons and self._relation(predicate) is None:
                reasons.append(f"{predicate} has no counterpart")
        names = {r[0] for p in variation.success if (r := self._relation(p)) is not None}
        if not reasons and self.template is not None and not names <= {self.template.relation}:
            reasons.append(
                f"its goals need {', '.join(sorted(names))}, and the task has the pattern {self.template.name}"
            )
        if self.template is None and not reasons:
            reasons.append("no goal of the training variations has a counterpart")
        return reasons

    def _there(self, variation: Resolved) -> set[str]:
        return {*self.rests[variation.name], *self._preplaced(variation)}

    # ------------------------------------------------------------------------------------------------------- relations

    def _template(self) -> tuple[Template | None, Role]:
        """Return the template of the task, and the role that the target of the goals has in it.

        The first goal with a relation that exists in our task format determines the template.
        """
        for variation in self.resolved.values():
            for predicate in variation.success:
                found = self._relation(predicate)
                if found is not None:
                    name, role = _OF_RELATION[found[0]]
                    return TEMPLATES[name], role
        return None, "container"

    def _relation(self, predicate: ReleasePredicate) -> tuple[str, str] | None:
        """Return the relation in our task format that corresponds to a predicate, and the region of the target.

        Return None if our task format has no such relation.
        """
        if predicate.target_id not in self.matches:
            return None
        regions = _regions(self.matches[predicate.target_id])
        relation = SYNONYMS.get(predicate.relation, predicate.relation)
        if relation == "in" and "inside" in regions:
            return "inside", ""
        if relation == "on":
            for name in ("on_ring", "on_plate", "layer"):
                if set(RELATIONS[name].needs) <= regions:
                    return name, ""
        side = _SIDES.get(relation, "")
        return ("beside", side) if side and side in regions else None

    def _is_covered(self, predicate: ReleasePredicate, variation: Resolved) -> bool:
        """Return whether our task format covers a predicate.

        A goal is covered if our format has its relation. A fail predicate is covered if it forbids putting an
        object into or onto the container, because our goals allow no other objects there.
        """
        if predicate in variation.success:
            return self._relation(predicate) is not None
        return predicate.target_id == variation.container and predicate.relation in ("in", "on")

    # ------------------------------------------------------------------------------------------------------ conditions

    def _spec(self, name: str) -> ObjectSpec:
        match = self.matches[name]
        targets = {p.target_id for v in self.resolved.values() for p in v.success}
        goals = {p.subject_id for v in self.resolved.values() for p in v.success}
        role: Role = "item" if name in goals else "distractor"
        if name in targets:
            role = self.target_role
        color = match.color
        return ObjectSpec(name, self._kind(name), match.category, color, role, fixed=False)

    def _kind(self, name: str) -> str:
        """Return the noun of an object, with its color if another object has the same noun."""
        noun = self.lexicon.noun(name)
        others = [other for other in self.task.instances if other != name and self.lexicon.noun(other) == noun]
        color = color_of(self.task.instances[name])
        return f"{color} {noun}" if others and color is not None else noun

    def _condition(self, variation: Resolved) -> Condition:
        rests, inside = self.rests[variation.name], self._preplaced(variation)
        names = (*rests, *inside)
        return Condition(
            task=task_id_of(self.task),
            name="",
            objects=tuple(self.specs[name] for name in self.specs if name in names),
            layout={name: self.slots.of[variation.name, name] for name in rests},
            instruction=self._instruction(variation),
            preplaced={name: TargetRegion(variation.container) for name in inside},
        )

    def _instruction(self, variation: Resolved) -> Instruction:
        nouns = self.lexicon.parse(variation.instruction).nouns
        goals: list[Subgoal] = []
        kinds: list[str] = []
        for predicate in _from_below(variation.success):
            relation, region = self._relation(predicate) or ("", "")
            kind = self.specs[predicate.subject_id].kind
            kinds.append(kind)
            count = kinds.count(kind)
            target = predicate.target_id
            # In a stack, the layers are numbered from the base upward.
            if relation == "layer":
                target, region = variation.container, str(len(goals) + 1)
            name = f"{relation}_{kind.replace(' ', '_')}" + (f"_{count}" if count > 1 else "")
            word = next((n.text for n in nouns if predicate.subject_id in n.objects), kind.split()[-1])
            goals.append(Subgoal(name, relation, Reference(kind=kind), target, word, count, region))
        ordered = self.template is not None and self.template.order == "built"
        return Instruction(variation.instruction, tuple(goals), ordered=ordered)

    # ------------------------------------------------------------------------------------------------------ variations

    def _variation(
        self,
        variation: Resolved,
        wanted: Condition,
        training: Mapping[str, Condition],
        made: Represented,
        before: Sequence[Variation],
    ) -> tuple[Represented, Variation | None]:
        """Express a test variation as operations on the training condition that requires the fewest of them.

        Returns:
            The completed representation, and the variation. The variation is None if it cannot be expressed.
        """
        ways = {
            name: operations
            for name, base in training.items()
            if (operations := operations_between(base, wanted, self.slots.slots)) is not None
        }
        if not ways:
            return replace(made, reasons=("no operations lead to it from a training condition",)), None
        base = min(ways, key=lambda name: (len(ways[name]), int(name.removeprefix("train"))))
        if not ways[base]:
            return replace(made, reasons=(f"it does not differ from {base}",), base=base), None
        axis = axis_of(ways[base])
        number = 1 + sum(v.axis is axis for v in before)
        said = tuple(_said(operation) for operation in ways[base])
        found = Variation(
            f"{axis.letter}{number}",
            ways[base],
            title=f"{variation.name}: {_title(ways[base])}",
            hypothesis=_HYPOTHESES[axis],
            base=base,
            mid_task_look=bool(wanted.preplaced),
        )
        return replace(made, name=found.name, base=base, operations=said), found


def _regions(match: Match) -> set[str]:
    return {region.name for region in match.asset.regions}


def _same(one: Condition, other: Condition) -> bool:
    return one.with_(name="") == other.with_(name="")


def _from_below(predicates: Sequence[ReleasePredicate]) -> list[ReleasePredicate]:
    """Order predicates so that a supporting object is placed before the objects that are placed on it."""
    waiting, found = list(predicates), []
    while waiting:
        subjects = {p.subject_id for p in waiting}
        ready = [p for p in waiting if p.target_id not in subjects] or waiting[:1]
        found += ready
        waiting = [p for p in waiting if p not in ready]
    return found


def operations_between(base: Condition, wanted: Condition, slots: Mapping[str, Slot]) -> tuple[Operation, ...] | None:
    """Return the operations that convert one condition to another, or None if this is not possible.

    The operations are ordered as follows: replacements, removals, moves and exchanges, additions, pre-placements, and
    finally the instruction.
    """
    found: list[Operation] = []
    now = base

    def do(operation: Operation) -> None:
        nonlocal now
        now, _ = operation.carry_out(now)
        found.append(operation)

    try:
        _exchange_objects(base, wanted, do)
        _arrange(lambda: now, wanted, slots, do)
        for spec in wanted.objects:
            if spec not in now.objects and spec.name in wanted.layout:
                do(a.add(spec, slots[wanted.layout[spec.name]]))
        for name, place in wanted.preplaced.items():
            if name not in now.preplaced:
                do(a.preplace(wanted.object(name), wanted.object(place.target), place.region))
        if now.instruction != wanted.instruction:
            more = len(wanted.instruction.subgoals) > len(now.instruction.subgoals)
            references = {goal.reference for goal in wanted.instruction.subgoals}
            is_repeated = len(references) < len(wanted.instruction.subgoals)
            make: Callable[[Instruction], Operation] = a.repeat if is_repeated else a.chain if more else a.instruct
            do(make(wanted.instruction))
    except BetterError:
        return None
    agrees = (
        set(now.objects) == set(wanted.objects)
        and dict(now.layout) == dict(wanted.layout)
        and dict(now.preplaced) == dict(wanted.preplaced)
        and now.instruction == wanted.instruction
    )
    return tuple(found) if agrees else None


def _exchange_objects(base: Condition, wanted: Condition, do: Callable[[Operation], None]) -> None:
    """Replace each unwanted object by the new object that needs its slot.

    If no new object needs the slot, remove the object.
    """
    gone = [spec for spec in base.objects if spec not in wanted.objects]
    gone += [s for s in base.objects if s in wanted.objects and s.name in base.preplaced and s.name in wanted.layout]
    new = {wanted.layout[s.name]: s for s in wanted.objects if s not in base.objects and s.name in wanted.layout}
    for spec in gone:
        by = new.get(base.layout.get(spec.name, ""))
        do(a.remove(spec) if by is None else a.replace(spec, by))


def _arrange(
    now: Callable[[], Condition], wanted: Condition, slots: Mapping[str, Slot], do: Callable[[Operation], None]
) -> None:
    """Move objects to their slots in the test variation. If none of these slots is free, exchange two objects."""
    while True:
        state = now()
        astray = [n for n, s in state.layout.items() if n in wanted.layout and wanted.layout[n] != s]
        if not astray:
            return
        free = [name for name in astray if state.occupant(wanted.layout[name]) is None]
        pair = next(
            (n for n in astray if (o := state.occupant(wanted.layout[n])) and wanted.layout.get(o) == state.layout[n]),
            None,
        )
        if pair is None and free:
            do(a.move(state.object(free[0]), slots[wanted.layout[free[0]]]))
            continue
        name = pair or astray[0]
        other = state.occupant(wanted.layout[name])
        do(a.swap(state.object(name), state.object(other or name)))


def axis_of(operations: Sequence[Operation]) -> Axis:
    """Return the axis that a variation belongs to, based on its operations.

    If the operations belong to several axes, the variation gets the first of these axes in the order object
    perturbation, temporal extrapolation, layout shift, recomposition.
    """
    names = {operation.name for operation in operations}
    if names & {"replace", "add", "remove"}:
        return Axis.ADVERSARIAL_OBJECT_PERTURBATION
    if names & {"preplace", "repeat", "chain", "draw_out"}:
        return Axis.TEMPORAL_EXTRAPOLATION
    return Axis.SPATIAL_LAYOUT_SHIFT if names & {"swap", "move"} else Axis.PRIMITIVE_RECOMPOSITION


def _title(operations: Sequence[Operation]) -> str:
    """Describe operations in a short title. If there are many moves, the title states only their number."""
    moves = [operation for operation in operations if operation.name in ("move", "swap")]
    others = [_said(operation) for operation in operations if operation not in moves]
    count = sum(1 if operation.name == "move" else 2 for operation in moves)
    said = [f"{count} objects moved"] if len(moves) > _NAMES_IN_TITLE else [_said(operation) for operation in moves]
    return ", ".join((*said, *others))


def _said(operation: Operation) -> str:
    """Describe an operation in a few words ("apple moved to slot_3")."""
    arguments = {key: getattr(value, "kind", getattr(value, "name", "")) for key, value in operation.arguments.items()}
    match operation.name:
        case "swap":
            return f"{arguments['a']} and {arguments['b']} exchanged"
        case "move":
            return f"{arguments['object']} moved to {arguments['slot']}"
        case "replace":
            return f"{arguments['object']} replaced by {arguments['by']}"
        case "add":
            return f"{arguments['object']} added"
        case "remove":
            return f"{arguments['object']} removed"
        case "preplace":
            return f"{arguments['object']} already in the {arguments['target']}"
    return "other goals"
