"""Recursive stacking: plates are put on plates, as in the task ``dinner_plates``."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from betterbench.errors import InvalidInputError
from betterbench.generation.cast import Cast
from betterbench.generation.layout import Table
from betterbench.generation.measures import footprint, require_usable
from betterbench.generation.patterns.draft import Draft
from betterbench.generation.patterns.pattern import GeneratedTask, pattern
from betterbench.generation.patterns.roles import in_role, look_alikes_of
from betterbench.generation.stated_goal import stated_goal
from betterbench.generation.wording import words_of
from betterbench.tasks import authoring as a
from betterbench.tasks.condition import Condition, ObjectSpec, Slot

_LEFT_BACK, _LEFT_FRONT = a.Slot("left_back", 0.48, -0.19), a.Slot("left_front", 0.69, -0.10)
_RIGHT_BACK, _RIGHT_FRONT = a.Slot("right_back", 0.48, 0.19), a.Slot("right_front", 0.69, 0.10)
_STAND_RIGHT = a.Slot("stand_right", 0.42, 0.17, jitter_m=0.010)
_STAND_MIDDLE = a.Slot("stand_middle", 0.37, 0.0, jitter_m=0.010)
TABLE = Table((_LEFT_BACK, _LEFT_FRONT, _RIGHT_BACK, _RIGHT_FRONT), (_STAND_RIGHT, _STAND_MIDDLE))
"""Slots as in the suite's task dinner_plates: two slots for each position of the lowest plate.

The front slots are 2 cm farther from the robot than in the suite, so that plates of any size do not touch."""

BY_KIND = "Plates are found by what they are, not by where they stood in training."
BY_TARGET = "A plate is put where the lowest one stands, not where it stood."
BY_LOOK = "The target plate is chosen by its look, not by its slot."
LOOK_ALIKE = "The policy distinguishes a plate from an object that looks like it, in its slot."
LONGER = "A chain of known steps that is longer than any in training is completed."
DONE = "The policy sees what is done already and finishes the stack."


@dataclass(frozen=True, slots=True)
class _Plates:
    """Plates of a stack: the lowest plate and two plates on top of it."""

    base: ObjectSpec
    middle: ObjectSpec
    top: ObjectSpec
    words: dict[str, str]

    def onto(self, *steps: tuple[ObjectSpec, ObjectSpec]) -> a.Instruction:
        """Return the instruction to put plates on other plates, from bottom to top."""
        parts = [f"the {upper.kind} on the {lower.kind}" for upper, lower in steps]
        goals = (a.subgoal(f"{u.name}_on_{lo.name}", a.ON_PLATE, u, lo, word=self.words[u.kind]) for u, lo in steps)
        return a.ordered(f"Put {', then '.join(parts)}.", *goals)


@pattern(a.RECURSIVE_STACKING)
def recursive_stacking(cast: Cast) -> GeneratedTask:
    """Return a task with three plates.

    Each training instruction puts one of the two smaller plates on the widest plate, or one of the two smaller plates
    on the other. If the instruction of the scenario puts one plate on another, the training conditions do so too. If
    only one of the two plates has a look-alike, it becomes the middle plate of the complete stack. Distractors are not
    used, because the plates fill the table.

    Raises:
        InvalidInputError: If there are not three plates, a plate cannot be grasped at its rim, or a plate does not fit
            on another plate.
    """
    plates = in_role("item", cast.groups.get("plates", ()))
    if len(plates) != 3:
        problem = f"has {len(plates)} objects, but three are needed"
        raise InvalidInputError("cast group 'plates'", problem, "Choose exactly three plates")
    require_usable(plates)
    onto = stated_goal(cast.scenario).onto
    carried = {upper for upper, _ in onto}
    free = [o for o in plates if o.name not in carried] or plates
    base = max(free, key=lambda o: (footprint(o.category).radius_m, -plates.index(o)))
    others = [o for o in plates if o is not base]
    carrying = [o for o in others if o.name in {name for _, name in onto}] or others
    middle = next((o for o in carrying if cast.look_alikes.get(o.name)), carrying[0])
    (top,) = (o for o in others if o is not middle)
    for upper, lower in ((middle, base), (top, base), (top, middle)):
        _require_carried(upper, lower)
    return _stacked(cast, _Plates(base, middle, top, words_of(plates)))


def _require_carried(upper: ObjectSpec, lower: ObjectSpec) -> None:
    """Check that a plate can stand on another plate."""
    for spec in (upper, lower):
        if not {"base", "floor"} <= footprint(spec.category).regions:
            problem = f"a {spec.kind} (category {spec.category}) is not a plate: it lacks the region 'base' or 'floor'"
            raise InvalidInputError(f"cast group 'plates': {spec.name}", problem, "Choose plates from the library")
    over, under = footprint(upper.category), footprint(lower.category)
    if over.radius_m > under.radius_m:
        problem = (
            f"a {upper.kind} is {2000 * over.radius_m:.0f} mm wide, but the {lower.kind} below it is only "
            f"{2000 * under.radius_m:.0f} mm wide"
        )
        raise InvalidInputError(f"cast group 'plates': {upper.name}", problem, "Choose a smaller upper plate")


def _stacked(cast: Cast, plates: _Plates) -> GeneratedTask:
    base, middle, top = plates.base, plates.middle, plates.top
    layouts: tuple[dict[ObjectSpec, Slot], ...] = (
        {middle: _LEFT_BACK, top: _LEFT_FRONT, base: _STAND_RIGHT},
        {middle: _RIGHT_BACK, top: _RIGHT_FRONT, base: _STAND_MIDDLE},
    )
    if cast.seed % 2:
        layouts = tuple({**layout, middle: layout[top], top: layout[middle]} for layout in layouts)
    near = layouts[0]
    single = [plates.onto((middle, base)), plates.onto((top, base))]
    finish, whole = plates.onto((top, middle)), plates.onto((middle, base), (top, middle))
    training = [
        condition
        for layout in layouts
        for condition in (
            *a.conditions([layout], single),
            a.condition(layout, finish, preplaced={middle: base}),
        )
    ]
    description = f"Put the named plate on the named plate or stack: {middle.kind}, {top.kind} and {base.kind}."
    draft = Draft(a.RECURSIVE_STACKING, cast, TABLE, tuple(training), description)
    draft.vary("L", [a.swap(middle, top)], f"{middle.kind} and {top.kind} exchanged", BY_KIND)
    draft.vary("L", [a.move(base, _STAND_MIDDLE)], f"{base.kind} at its other position", BY_TARGET, "train2")
    around = [a.move(middle, _STAND_MIDDLE), a.move(top, near[middle]), a.move(base, near[top]), a.instruct(finish)]
    on_middle = f"{top.kind} on {middle.kind}, where the {base.kind} stood"
    draft.vary("R", around, on_middle, BY_LOOK, "train2")
    _add_look_alike(draft, cast, plates, near)
    draft.vary("T", [a.chain(whole)], "stack of three from single plates", LONGER)
    elsewhere = [a.move(base, _STAND_MIDDLE), a.move(top, near[middle]), a.chain(whole)]
    title = f"whole stack, {middle.kind} already on {base.kind} at its other position"
    draft.vary("T", elsewhere, title, DONE, "train3", mid_task=True)
    return draft.finish(
        list(_balanced(plates, near)),
        confounds=(
            f"Each position of the {base.kind} has its own start layout.",
            f"The word {plates.words[base.kind]!r} always names the target of a single plate.",
        ),
        crossed=(
            f"{middle.kind} and {top.kind} stand in each slot, with the {base.kind} at either position",
            f"the {base.kind} and the {middle.kind} are the target of the {top.kind}, with each of its slots",
            "three plates at the start, or the two requested ones",
        ),
    )


def _add_look_alike(draft: Draft, cast: Cast, plates: _Plates, near: dict[ObjectSpec, Slot]) -> None:
    """Add a variation in which a look-alike takes the slot of the middle plate.

    The middle plate itself moves to the slot of the top plate.
    """
    for other in look_alikes_of(cast, plates.middle):
        moves = [a.move(plates.top, _RIGHT_FRONT), a.move(plates.middle, near[plates.top])]
        kind = plates.middle.kind
        title = f"{other.kind} where the {kind} stood, {kind} in the slot of the {plates.top.kind}"
        if draft.vary("O", [*moves, a.add(other, near[plates.middle])], title, LOOK_ALIKE):
            return
    if not cast.look_alikes.get(plates.middle.name):
        reason = "no plate that is stacked has a look-alike; a bowl of its color would help"
        draft.leave_out("O", "look-alike in the slot of a plate", reason)


def _balanced(plates: _Plates, near: dict[ObjectSpec, Slot]) -> Iterator[Condition]:
    """Yield balanced conditions for each instruction, with the plates in different slots.

    The lowest plate is at either of its two positions. If it is on the right, only the left slots are used, because the
    right side then has no room for other plates.
    """
    base, middle, top = plates.base, plates.middle, plates.top
    on_base = {o: plates.onto((o, base)) for o in (middle, top)}
    finish = plates.onto((top, middle))
    same = replace(finish, text=f"Put the {top.kind} on the {middle.kind} that stands on the {base.kind}.")
    for o in (middle, top):
        other = near[top if o is middle else middle]
        yield a.condition(near, on_base[o])
        yield a.condition({o: other, base: _STAND_RIGHT}, on_base[o])
    for slot in (_LEFT_FRONT, _LEFT_BACK):
        there = _LEFT_BACK if slot is _LEFT_FRONT else _LEFT_FRONT
        for asked in (finish, same):
            yield a.condition({middle: there, top: slot, base: _STAND_RIGHT}, asked, preplaced={middle: base})
    for one, two in (
        (_LEFT_BACK, _RIGHT_FRONT),
        (_LEFT_FRONT, _RIGHT_BACK),
        (_RIGHT_BACK, _LEFT_FRONT),
        (_RIGHT_FRONT, _LEFT_BACK),
    ):
        layout = {middle: one, top: two, base: _STAND_MIDDLE}
        yield from (a.condition(layout, asked) for asked in on_base.values())
        yield from (a.condition(layout, asked, preplaced={middle: base}) for asked in (finish, same))
