"""Patterned arrangement: items are put at the sides of an anchor, as in ``desk_meeting`` and ``breakfast_table``."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NoReturn

import numpy as np

from betterbench.errors import InvalidInputError
from betterbench.generation.cast import Cast
from betterbench.generation.layout import Table
from betterbench.generation.measures import footprint, require_usable
from betterbench.generation.patterns.draft import Draft, first_that_fits
from betterbench.generation.patterns.pattern import GeneratedTask, pattern
from betterbench.generation.patterns.roles import in_role, look_alikes_of
from betterbench.generation.stated_goal import stated_goal
from betterbench.sim.assets import build_unpainted
from betterbench.tasks import authoring as a
from betterbench.tasks.authoring.operations import Operation
from betterbench.tasks.condition import Condition, ObjectSpec, Slot
from betterbench.tasks.relations.beside import SIDES

_FRONT = tuple(
    a.Slot(f"front_{i}", 0.686, y) for i, y in enumerate((-0.202, -0.012, 0.178, -0.178, 0.012, 0.202), start=1)
)
_DESKS = tuple(
    Table(
        _FRONT,
        (
            a.Slot("anchor_right", x, 0.023, jitter_m=0.004, yaw_jitter=0.03),
            a.Slot("anchor_left", x, -0.023, jitter_m=0.004, yaw_jitter=0.03),
        ),
    )
    for x in (0.500, 0.495, 0.490, 0.485)
)
"""Choices of slots as in the suite's task desk_meeting: six slots in front, three for each position of the anchor.

The anchor has less jitter than in the suite, so that objects do not touch after an exchange. The anchor is as far from
the robot as the objects in front of it allow, because a laptop closer to the robot would leave less reachable space
behind it."""

_SETTING = Table(
    starts=(
        a.Slot("left_edge", 0.52, -0.255, jitter_m=0.010),
        a.Slot("right_edge", 0.52, 0.255, jitter_m=0.010),
        a.Slot("front", 0.69, -0.04),
        a.Slot("left_corner", 0.44, -0.255, jitter_m=0.010),
        a.Slot("right_corner", 0.44, 0.255, jitter_m=0.010),
        a.Slot("front_right", 0.69, 0.13),
    ),
    stands=(
        a.Slot("anchor_right", 0.51, 0.06, jitter_m=0.008, yaw_jitter=0.05),
        a.Slot("anchor_left", 0.51, -0.06, jitter_m=0.008, yaw_jitter=0.05),
    ),
    besides=(a.Slot("front_left", 0.69, -0.17), a.Slot("back", 0.29, 0.24), a.Slot("back_left", 0.32, -0.15)),
)
"""Slots as in the suite's task breakfast_table: two long pieces at the edges, and a compact object in front."""
TABLES = (*_DESKS, _SETTING)

_FRONT_M = 0.070
"""Maximum radius of an object in a front slot [m]. Larger objects extend beyond the view of the front camera."""
_NARROW_M = 0.072
"""Maximum width of an object behind an anchor [m].

Behind an anchor, there is little room for the gripper, and no room for the handle of a mug.
"""
_WIDE_M = 0.115
"""Maximum width of an object at any other side of an anchor [m]."""
_CUTLERY_M = 0.09
"""Maximum radius of a piece of cutlery at the edge of the table [m]."""
_TRIED_LAST = ("behind", "upper_right")
"""Sides with little room, in order of preference.

The third item goes to the first of these sides that the anchor has.
"""

BY_KIND = "Objects are found by what they are, not by where they stood in training."
BY_ANCHOR = "A side is relative to the anchor, not a place on the table."
NEW_PAIR = "A known object and a known side are combined in a new way."
LOOK_ALIKE = "The policy distinguishes an object from one that looks like it, in its slot."
LONGER = "A chain of known steps that is longer than any in training is completed."

Step = tuple[ObjectSpec, str]


@dataclass(frozen=True, slots=True)
class _Plan:
    """Items with their initial slots, and the sides of the anchor where they are put in training.

    Attributes:
        anchor: Object that the items are put beside.
        steps: Three items, each with the side where it is put in training.
        layouts: Initial slots for the first and the second position of the anchor.
        pairs: Pairs of steps that occur together in training.
    """

    anchor: ObjectSpec
    steps: tuple[Step, ...]
    layouts: tuple[Mapping[ObjectSpec, Slot], ...]
    pairs: tuple[tuple[Step, Step], ...]

    def put(self, *steps: Step) -> a.Instruction:
        """Return the instruction to put objects at sides of the anchor."""
        return a.arranged(self.anchor, *steps, close=_is_round(self.anchor))


@pattern(a.PATTERNED_ARRANGEMENT)
def patterned_arrangement(cast: Cast) -> GeneratedTask:
    """Return a task in which two of three items are put beside an anchor, each at a given side.

    If the anchor is round and the items are two long pieces and a compact object, they form a place setting. In all
    other cases, the items start in front of the anchor. Distractors are used only around a place setting, if there is
    room.

    Raises:
        InvalidInputError: If the anchor has fewer than three sides, there are not three items, an item cannot be
            grasped or is too large, or no item fits at the side with the least room.
    """
    (anchor,) = in_role("fixture", (cast.one("anchor"),))
    items = in_role("item", cast.groups.get("items", ()))
    sides = _sides(anchor)
    if len(items) != 3:
        problem = f"has {len(items)} objects, but three are needed"
        cure = "Choose three objects, so that known objects and sides can be combined in a new way"
        raise InvalidInputError("cast group 'items'", problem, cure)
    require_usable(items)
    stated = stated_goal(cast.scenario).regions
    for spec in (o for o in items if stated.get(o.name, sides[0]) not in sides):
        _refuse_side(spec, stated[spec.name])
    long = [spec for spec in items if footprint(spec.category).radius_m > _FRONT_M]
    if long and (not _is_round(anchor) or len(long) != 2):
        _refuse_long(long[0])
    if not long:
        return first_that_fits(_DESKS, functools.partial(_desk, cast, anchor, items, sides))
    stay = [o for o in in_role("distractor", cast.groups.get("distractors", ())) if _is_compact(o)]
    return first_that_fits([*_crowds(stay)], functools.partial(_setting, cast, anchor, items, sides))


def _crowds(distractors: Sequence[ObjectSpec]) -> Iterator[Mapping[ObjectSpec, Slot]]:
    """Yield possible assignments of distractors to slots around a place setting, starting with the largest assignment.

    The first distractor always uses a slot that is meant for the compact item.
    """
    slots = _SETTING.besides
    for count in range(min(len(slots), len(distractors) - 1), -1, -1):
        for first, *others in itertools.combinations(distractors, 1 + count):
            for placed in itertools.permutations(slots, count):
                yield {first: _SETTING.starts[-1], **dict(zip(others, placed, strict=True))}
    yield {}


def _sides(anchor: ObjectSpec) -> tuple[str, str, str]:
    """Return the right and left sides of an anchor, which have plenty of room, and the side with the least room."""
    offered = footprint(anchor.category).regions & set(SIDES)
    last = next((side for side in _TRIED_LAST if side in offered), None)
    if last is None or not {"left", "right"} <= offered:
        found = f"a {anchor.kind} (category {anchor.category}) has the sides {sorted(offered)}"
        cure = (
            "Choose an anchor with regions left and right, and behind or upper_right, such as a laptop or place_plate"
        )
        raise InvalidInputError("cast group 'anchor'", found, cure)
    return "right", "left", last


def _is_round(anchor: ObjectSpec) -> bool:
    return build_unpainted(anchor.category).shape == "round"


def _refuse_long(spec: ObjectSpec) -> None:
    """Raise InvalidInputError because an object is too long to be completely visible to the camera."""
    size = footprint(spec.category)
    problem = f"a {spec.kind} reaches {1000 * size.radius_m:.0f} mm from its center"
    cure = "Choose objects of at most 70 mm, or two pieces of cutlery and a compact object at a plate"
    raise InvalidInputError(f"cast group 'items': {spec.name}", problem, cure)


def _refuse_side(spec: ObjectSpec, side: str) -> NoReturn:
    """Raise InvalidInputError because the scenario's instruction puts an object at a side where it has no room."""
    where = f"cast group 'items': {spec.name}"
    problem = f"the instruction puts the {spec.kind} {SIDES[side]} the anchor, where it has no room"
    raise InvalidInputError(where, problem, "Choose another side, or leave the side out")


def _fits(spec: ObjectSpec, side: str) -> bool:
    """Return whether an object fits at a side of the anchor."""
    size = footprint(spec.category)
    if side == "upper_right" and size.radius_m > _FRONT_M:
        return False
    across = size.y_m[1] - size.y_m[0] if size.longish else size.width_m
    return across <= (_NARROW_M if side == "behind" else _WIDE_M)


def _with_last(items: Sequence[ObjectSpec], last: ObjectSpec) -> tuple[ObjectSpec, ObjectSpec, ObjectSpec]:
    first, second = (o for o in items if o is not last)
    return first, second, last


def _desk(
    cast: Cast, anchor: ObjectSpec, items: Sequence[ObjectSpec], sides: tuple[str, str, str], table: Table
) -> GeneratedTask:
    """Return a task in which the items start in front of the anchor, as on a desk."""
    stated = stated_goal(cast.scenario).regions
    last = next((o for o in reversed(items) if _fits(o, sides[2]) and stated.get(o.name, sides[2]) == sides[2]), None)
    last = next((o for o in items if stated.get(o.name) == sides[2]), last)
    if last is not None and not _fits(last, sides[2]):
        _refuse_side(last, sides[2])
    wide = next((o for o in items if not _fits(o, "right")), None)
    if last is None or wide is not None:
        spec = wide or items[-1]
        width, most = footprint(spec.category).width_m, _WIDE_M if wide else _NARROW_M
        problem = f"a {spec.kind} is {1000 * width:.0f} mm wide; at most {1000 * most:.0f} mm fit"
        raise InvalidInputError(f"cast group 'items': {spec.name}", problem, "Choose a narrower object")
    first, second, last = _with_last(items, last)
    exchanged = stated.get(first.name) == sides[1] or stated.get(second.name) == sides[0]
    ordered = (second, first, last) if exchanged else (first, second, last)
    steps = tuple(zip(ordered, sides, strict=True))
    turn = np.random.default_rng(cast.seed).permutation(3).tolist()
    near = {o: table.starts[turn[i]] for i, o in enumerate(ordered)}
    far = {o: table.starts[3 + (turn[i] + 1) % 3] for i, o in enumerate(ordered)}
    layouts = ({**near, anchor: table.stands[0]}, {**far, anchor: table.stands[1]})
    plan = _Plan(anchor, steps, layouts, tuple(itertools.permutations(steps, 2)))
    draft = _draft(cast, plan, table)
    one, two, three = plan.steps
    first, second, third = ordered
    draft.vary("L", [a.swap(first, second)], f"{first.kind} and {second.kind} exchanged", BY_KIND)
    _add_moved_anchor(draft, plan)
    _add_recomposed(draft, plan, ((second, one[1]), (first, two[1])), (one, two))
    _add_recomposed(draft, plan, ((third, two[1]), (second, one[1])), (three, two))
    for x, y, z in ((first, second, third), (second, first, third), (third, first, second)):
        pair = next(p for p in plan.pairs if [o for o, _ in p] == [x, y])
        slots = near[z], near[x]
        if _add_look_alike(draft, x, [a.remove(z), a.move(x, slots[0])], slots[1], draft.base_of(plan.put(*pair))):
            break
    else:
        _leave_out_look_alike(draft)
    title = f"all three in one instruction, {first.kind} and {third.kind} exchanged"
    draft.vary("T", [a.swap(first, third), a.chain(plan.put(*plan.steps))], title, LONGER)
    _leave_out_preplaced(draft)
    return _finish(draft, plan, list(_desk_balanced(draft, plan)))


def _draft(cast: Cast, plan: _Plan, table: Table) -> Draft:
    return Draft(
        a.PATTERNED_ARRANGEMENT,
        cast,
        table,
        a.conditions(plan.layouts, [plan.put(*pair) for pair in plan.pairs]),
        f"Put the named objects to the named sides of the {plan.anchor.kind}.",
    )


def _add_moved_anchor(draft: Draft, plan: _Plan) -> None:
    """Add a variation in which the anchor is at its other position.

    The instruction does not begin with the object in the alphabetically first slot, so that a policy that always begins
    at this slot fails.
    """
    layout = plan.layouts[0]
    favorite = min(slot.name for o, slot in layout.items() if o is not plan.anchor)
    pair = next(p for p in plan.pairs if layout[p[0][0]].name != favorite)
    moved = a.move(plan.anchor, plan.layouts[1][plan.anchor])
    title = f"{plan.anchor.kind} at its other position"
    draft.vary("L", [moved], title, BY_ANCHOR, draft.base_of(plan.put(*pair)))


def _add_recomposed(draft: Draft, plan: _Plan, steps: tuple[Step, Step], base: tuple[Step, Step]) -> None:
    title = ", ".join(f"{o.kind} {side.replace('_', ' ')}" for o, side in steps)
    draft.vary("R", [a.instruct(plan.put(*steps))], title, NEW_PAIR, draft.base_of(plan.put(*base)))


def _add_look_alike(draft: Draft, spec: ObjectSpec, room: Sequence[Operation], slot: Slot, base: str) -> bool:
    """Add a variation in which a look-alike replaces an object in its slot.

    The operations in ``room`` are applied first, to make room for it. Return whether a variation was added. It is not
    added if no look-alike fits.
    """
    for other in look_alikes_of(draft.cast, spec):
        if draft.vary("O", [*room, a.add(other, slot)], f"{other.kind} where the {spec.kind} stood", LOOK_ALIKE, base):
            return True
    return False


def _leave_out_look_alike(draft: Draft) -> None:
    reason = "the cast has no look-alike of an item that fits; a library with more objects of these colors would help"
    draft.leave_out("O", "look-alike in the slot of an item", reason)


def _leave_out_preplaced(draft: Draft) -> None:
    reason = "an object at a side of an anchor is part of the setup, and no relation places it there from the start"
    draft.leave_out("T", "one item already at its side", reason)


def _finish(draft: Draft, plan: _Plan, balanced: Sequence[Condition]) -> GeneratedTask:
    tied = ", ".join(f"the {o.kind} {side.replace('_', ' ')}" for o, side in plan.steps)
    return draft.finish(
        balanced,
        confounds=(
            f"Each object always goes to the same side: {tied}.",
            "Each object starts in one slot for each position of the anchor.",
            "Each position of the anchor has its own start layout.",
        ),
        crossed=(
            "each object starts in each of its slots, with the anchor at either position",
            "each object goes to every side with enough room, first or second",
            "three objects at the start, or the two requested ones",
        ),
    )


def _new_pairs(draft: Draft, plan: _Plan) -> Iterator[tuple[Step, Step]]:
    """Yield the pairs of steps with different objects and different sides, except pairs that occur only in tests."""
    sides = [side for _, side in plan.steps]
    trained = {frozenset(pair) for pair in plan.pairs}
    given = [o.arguments.get("instruction") for v in draft.variations for o in v.interventions]
    tested = {frozenset(goal.name for goal in _goals(instruction)) for instruction in given}
    for one, two in itertools.combinations([o for o, _ in plan.steps], 2):
        for left, right in itertools.permutations(sides, 2):
            pair = ((one, left), (two, right))
            if not (_fits(one, left) and _fits(two, right)):
                continue
            names = frozenset(f"{o.name}_{side}" for o, side in pair)
            if frozenset(pair) in trained or names not in tested:
                yield pair


def _goals(instruction: object) -> tuple[a.Subgoal, ...]:
    return instruction.subgoals if isinstance(instruction, a.Instruction) else ()


def _desk_balanced(draft: Draft, plan: _Plan) -> Iterator[Condition]:
    """Yield balanced conditions for each pair of steps, in both orders.

    The objects start in different slots, and the anchor is at either of its two positions.
    """
    objects = [o for o, _ in plan.steps]
    starts, stands = draft.table.starts, draft.table.stands
    for number, pair in enumerate(_new_pairs(draft, plan)):
        for order, steps in enumerate((pair, pair[::-1])):
            for which in (0, 1):
                part = starts[:3] if (number + which) % 2 else starts[3:]
                turn = (number // 2 + order + which) % 3
                layout = {o: part[(i + turn) % 3] for i, o in enumerate(objects)}
                if (number + order + which) % 3 == 0:
                    del layout[next(o for o in objects if o not in [step[0] for step in steps])]
                yield a.condition({**layout, plan.anchor: stands[(which + order) % 2]}, plan.put(*steps))


def _setting(
    cast: Cast,
    anchor: ObjectSpec,
    items: Sequence[ObjectSpec],
    sides: tuple[str, str, str],
    distractors: Mapping[ObjectSpec, Slot],
) -> GeneratedTask:
    """Return a task with a place setting: two long pieces at the edges of the table, and a compact object in front."""
    table = _SETTING
    left, right = (o for o in items if footprint(o.category).radius_m > _FRONT_M)
    (compact,) = (o for o in items if o not in (left, right))
    stated = stated_goal(cast.scenario).regions
    if stated.get(compact.name, sides[2]) != sides[2]:
        _refuse_side(compact, stated[compact.name])
    if sides[2] in (stated.get(left.name), stated.get(right.name)):
        _refuse_side(left if stated.get(left.name) == sides[2] else right, sides[2])
    if stated.get(left.name) == "right" or stated.get(right.name) == "left":
        left, right = right, left
    for piece in (left, right):
        if footprint(piece.category).radius_m > _CUTLERY_M or not footprint(piece.category).longish:
            _refuse_long(piece)
    edge_1, edge_2, front, corner_1, corner_2, front_right = table.starts
    spare, others = [*distractors][:1], dict([*distractors.items()][1:])
    placed = (
        {left: edge_1, compact: front, right: edge_2, **dict.fromkeys(spare, front_right)},
        {left: corner_1, compact: front_right, right: corner_2, **dict.fromkeys(spare, front)},
    )
    layouts = tuple({**layout, **others, anchor: stand} for layout, stand in zip(placed, table.stands, strict=True))
    f, c, s = (left, "left"), (compact, sides[2]), (right, "right")
    plan = _Plan(anchor, (f, s, c), layouts, ((f, c), (s, f), (c, s)))
    draft = _draft(cast, plan, table)
    away = [a.swap(compact, spare[0])] if spare else [a.move(compact, front_right)]
    moved = f"{compact.kind} and {spare[0].kind} exchanged" if spare else f"{compact.kind} in its other slot"
    draft.vary("L", away, moved, BY_KIND)
    _add_moved_anchor(draft, plan)
    _add_recomposed(draft, plan, ((right, "left"), (compact, "right")), (c, s))
    exchanged = f"{right.kind} where the {left.kind} lay, {left.kind} where the {right.kind} lay"
    draft.vary("O", [a.swap(left, right)], exchanged, LOOK_ALIKE)
    room = [*(a.remove(o) for o in spare), a.move(compact, front_right)]
    if not _add_look_alike(draft, compact, room, front, "train1"):
        _leave_out_look_alike(draft)
    title = f"all three in one instruction, {moved}"
    draft.vary("T", [*away, a.chain(plan.put(f, c, s))], title, LONGER)
    _leave_out_preplaced(draft)
    return _finish(draft, plan, list(_setting_balanced(draft, plan, spare, others)))


def _is_compact(spec: ObjectSpec) -> bool:
    return footprint(spec.category).radius_m <= 0.06


def _setting_balanced(
    draft: Draft, plan: _Plan, spare: Sequence[ObjectSpec], others: Mapping[ObjectSpec, Slot]
) -> Iterator[Condition]:
    """Yield balanced conditions for each pair of steps, in both orders.

    The long pieces start at either edge of the table, and the anchor is at either of its two positions.
    """
    (left, _), (right, _), (compact, _) = plan.steps
    edge_1, edge_2, front, corner_1, corner_2, front_right = draft.table.starts
    for number, pair in enumerate(_new_pairs(draft, plan)):
        for order, steps in enumerate((pair, pair[::-1])):
            for which, stand in enumerate(draft.table.stands):
                edges = (edge_1, edge_2) if which == 0 else (corner_1, corner_2)
                fronts = (front, front_right)
                one, two = edges if (number + order) % 2 else edges[::-1]
                near, taken = ("right", edges[1]) if which == 0 else ("left", edges[0])
                if _is_blocked(steps, near, left if one is taken else right):
                    one, two = two, one
                if _is_blocked(steps, near, left if one is taken else right):
                    continue
                here, there = fronts if (number // 2 + which) % 2 else fronts[::-1]
                layout = {left: one, right: two, compact: here, **dict.fromkeys(spare, there)}
                if (number + order + which) % 3 == 0:
                    asked = [step[0] for step in steps]
                    del layout[next(o for o in (left, right, compact) if o not in asked)]
                yield a.condition({**layout, **others, plan.anchor: stand}, plan.put(*steps))


def _is_blocked(steps: Sequence[Step], side: str, piece: ObjectSpec) -> bool:
    """Return whether the object of the first step would block the piece of the second step.

    The object blocks the piece if it is put at the given side, where the anchor leaves little room for a piece at the
    table edge.
    """
    return steps[0][1] == side and steps[1][0] is piece
