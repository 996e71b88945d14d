"""Loose packing: the first item and another item are put into a container, as in ``fruit_lunch`` and ``fast_food``."""

from __future__ import annotations

import functools
from collections.abc import Sequence

from betterbench.errors import InvalidInputError
from betterbench.generation.cast import Cast
from betterbench.generation.layout import Table
from betterbench.generation.measures import footprint, require_usable
from betterbench.generation.patterns.draft import Draft, first_that_fits, shuffled
from betterbench.generation.patterns.pattern import GeneratedTask, pattern
from betterbench.generation.patterns.roles import in_role, look_alikes_of, second
from betterbench.generation.wording import words_of
from betterbench.tasks import authoring as a
from betterbench.tasks.condition import ObjectSpec, Slot
from betterbench.tasks.words import is_countable, plural

_STAND = a.Slot("stand", 0.44, 0.11, yaw=-1.5708, jitter_m=0.005, yaw_jitter=0.03)
_ACROSS = a.Slot("stand", 0.47, 0.1160, jitter_m=0.005, yaw_jitter=0.03)
_FLOOR = a.Slot("stand", 0.52, 0.150, jitter_m=0.005, yaw_jitter=0.0)
_THREE = (a.Slot("first", 0.43, -0.235), a.Slot("second", 0.62, -0.22), a.Slot("third", 0.66, -0.07))
_FOUR = (
    a.Slot("first", 0.43, -0.238),
    a.Slot("second", 0.60, -0.227),
    a.Slot("third", 0.43, -0.11),
    a.Slot("fourth", 0.60, -0.1063),
)
OPEN_TABLES = tuple(
    Table(starts, (stand,))
    for starts, stand in ((_FOUR, _ACROSS), (_FOUR, _FLOOR), (_THREE, _FLOOR), (_THREE, _ACROSS))
)
"""Choices of slots for containers without a lid.

They are the slots of the task ``fast_food``, the same slots with the container position of the task ``tidy_desk``, and
three slots with more room.
"""
LID_TABLES = (Table(_THREE, (_STAND,)),)
"""Slots of the suite's task ``fruit_lunch``, for containers with a raised lid. The lid points away from the arm."""
TABLES = (*OPEN_TABLES, *LID_TABLES)

_LID_M = 0.10
"""Minimum difference between the height and the inner depth of a container with a raised lid [m]."""

_ROOM_M = 0.005
"""Clearance that the expert keeps between an item and the walls [m], see the relation ``inside``."""

BY_KIND = "Objects are found by what they are, not by where they stood in training."
NEW_ORDER = "Known steps are combined in a new way, without the step that always came first."
ABSENT = "An absent target is not replaced by an object that looks like it."
LOOK_ALIKE = "The policy distinguishes an object from one that looks like it, in its slot."
DONE = "The policy sees what is done already and goes on from there."
AGAIN = "A known step is repeated as often as the instruction asks."
LONGER = "A chain of known steps that is longer than any in training is completed."


@pattern(a.LOOSE_PACKING)
def loose_packing(cast: Cast) -> GeneratedTask:
    """Return a task in which the first item and then one of the other items are packed into a container.

    Three or four items are required. Distractors are only used if slots are free.

    Raises:
        InvalidInputError: If there are too few or too many items, an item cannot be grasped or does not fit into the
            container, or the slots are too close together.
    """
    (container,) = in_role("container", (cast.one("container"),))
    items = in_role("item", cast.groups.get("items", ()))
    if not 3 <= len(items) <= 4:
        problem = f"has {len(items)} objects, but three or four are needed"
        cure = "Choose three or four objects, so that a known step can be combined with two others"
        raise InvalidInputError("cast group 'items'", problem, cure)
    require_usable(items)
    _require_room(container, items)
    tables = [t for t in (LID_TABLES if _has_lid(container) else OPEN_TABLES) if len(t.starts) >= len(items)]
    if not tables:
        problem = f"has {len(items)} objects; beside a {container.kind} with its lid, there is room for three"
        raise InvalidInputError("cast group 'items'", problem, "Choose three objects, or a container without a lid")
    return first_that_fits(tables, functools.partial(_packed, cast, container, items))


def _has_lid(container: ObjectSpec) -> bool:
    size = footprint(container.category)
    return size.inside_m is not None and size.height_m - size.inside_m[2] > _LID_M


def _holds_three(container: ObjectSpec, items: Sequence[ObjectSpec]) -> bool:
    """Return whether the container has room for a third item, although demonstrations put only two items into it.

    A container with a lid has room for two items. In other containers, three items fit if they can lie side by side, or
    if they can be stacked without rising above the rim.
    """
    room = footprint(container.category).inside_m
    if room is None or _has_lid(container):
        return False
    sizes = [footprint(spec.category) for spec in items]
    is_wide = all(size.width_m + _ROOM_M <= max(room[:2]) for size in sizes)
    return is_wide or sum(size.height_m for size in sizes) <= room[2]


def _require_room(container: ObjectSpec, items: Sequence[ObjectSpec]) -> None:
    """Check that two items fit into the container, side by side or stacked, with their centers below the rim."""
    room = footprint(container.category).inside_m
    if room is None:
        problem = f"a {container.kind} (category {container.category}) has no region 'inside'"
        raise InvalidInputError("cast group 'container'", problem, "Choose a container that is open at the top")
    half_x, half_y, depth = room
    short, long = sorted((half_x, half_y))
    for spec in items:
        size = footprint(spec.category)
        half = 0.5 * size.width_m + _ROOM_M
        is_roomy = size.width_m + _ROOM_M <= long or 1.5 * size.height_m <= depth
        if half > short or not is_roomy or 0.5 * size.height_m > depth:
            found = f"{1000 * size.width_m:.0f} mm wide and {1000 * size.height_m:.0f} mm high"
            most = f"{1000 * (min(2.0 * (short - _ROOM_M), long - _ROOM_M)):.0f} mm wide and {2000 * depth:.0f} mm high"
            problem = f"a {spec.kind} is up to {found}; two objects fit next to each other if they are up to {most}"
            cure = f"Choose a smaller object, or a container larger than the {container.kind}"
            raise InvalidInputError(f"cast group 'items': {spec.name}", problem, cure)


def _packed(cast: Cast, container: ObjectSpec, items: Sequence[ObjectSpec], table: Table) -> GeneratedTask:
    slots = shuffled(cast, table.starts)
    starts = dict(zip(items, slots, strict=False))
    besides = dict(zip(in_role("distractor", cast.groups.get("distractors", ())), slots[len(items) :], strict=False))
    fixed: dict[ObjectSpec, Slot] = {**besides, container: table.stands[0]}
    layout = {**starts, **fixed}
    first, *others = items
    asked = functools.partial(_pack, container, words_of((*items, container)))
    draft = Draft(
        a.LOOSE_PACKING,
        cast,
        table,
        a.conditions([layout], [asked(first, other) for other in others]),
        f"Put the named objects into the {container.kind}, in the order in which they are named.",
    )
    second_one, third_one = others[0], others[1]
    draft.vary("L", [a.swap(first, second_one)], f"{first.kind} and {second_one.kind} exchanged", BY_KIND)
    forward, back = asked(second_one, third_one), asked(third_one, second_one)
    then = "{}, then {}, without the {}"
    draft.vary("R", [a.instruct(forward)], then.format(second_one.kind, third_one.kind, first.kind), NEW_ORDER)
    draft.vary("R", [a.instruct(back)], then.format(third_one.kind, second_one.kind, first.kind), NEW_ORDER, "train2")
    _add_look_alikes(draft, cast, first, third_one, starts)
    begun = [a.preplace(first, container), a.move(second_one, starts[first])]
    there = f"{first.kind} already in the {container.kind}, {second_one.kind} in its slot"
    draft.vary("T", begun, there, DONE, "train2", mid_task=True)
    _add_repeated(draft, items, asked)
    exchanged = f"{', '.join(o.kind for o in items[:3])}; {second_one.kind} and {third_one.kind} exchanged"
    if not _holds_three(container, items[:3]):
        reason = f"the {container.kind} has no room for a third object where demonstrations release one"
        draft.leave_out("T", exchanged, reason)
    else:
        draft.vary("T", [a.swap(second_one, third_one), a.chain(asked(*items[:3]))], exchanged, LONGER)
    steps = [pair for o in others for pair in ((first, o), (o, first), (o,))]
    balanced = draft.crossed(
        (*items, *besides), slots[: len(items) + len(besides)], {container: table.stands[0]}, [asked(*s) for s in steps]
    )
    return draft.finish(
        balanced,
        confounds=(
            f"The {first.kind} is always packed first.",
            "Every object always starts in the same slot.",
        ),
        crossed=(
            f"the {len(items)} objects stand in every slot",
            f"the {first.kind} comes first, second or not at all",
            "every other object comes first, second or alone",
            "all objects at the start, or one less that is not requested",
        ),
    )


def _pack(container: ObjectSpec, words: dict[str, str], *things: ObjectSpec) -> a.Instruction:
    """Return the instruction to pack objects one after the other.

    If the first two objects are of the same kind, they are named together as a pair.
    """
    kinds = [thing.kind for thing in things]
    if kinds[:1] == kinds[1:2]:
        parts = [f"both {plural(kinds[0])}", *(f"the {kind}" for kind in kinds[2:])]
    else:
        parts = [f"the {kind}" for kind in kinds]
    steps = [
        a.subgoal(
            f"pack_{kind.replace(' ', '_')}" + (f"_{count}" if (count := kinds[: i + 1].count(kind)) > 1 else ""),
            a.INSIDE,
            thing,
            container,
            word=words[kind],
            count=count,
        )
        for i, (kind, thing) in enumerate(zip(kinds, things, strict=True))
    ]
    return a.ordered(f"Put {', then '.join((f'{parts[0]} into the {container.kind}', *parts[1:]))}.", *steps)


def _add_look_alikes(
    draft: Draft, cast: Cast, first: ObjectSpec, third_one: ObjectSpec, starts: dict[ObjectSpec, Slot]
) -> None:
    """Add two variations in which a look-alike takes the slot of the first item.

    In one variation, the first item is missing. In the other variation, the first item is in another slot.
    """
    for other in look_alikes_of(cast, first):
        before = len(draft.variations)
        alike = f"{other.kind} where the {first.kind} stood"
        draft.vary("O", [a.replace(first, other)], f"{alike}, and no {first.kind}", ABSENT, refuse=True)
        choice = (a.remove(third_one), a.move(first, starts[third_one]), a.add(other, starts[first]))
        draft.vary("O", choice, f"{alike}, {first.kind} in the slot of the {third_one.kind}", LOOK_ALIKE)
        if len(draft.variations) > before:
            return
    if not cast.look_alikes.get(first.name):
        reason = f"the library has nothing else that looks like the {first.kind}"
        draft.leave_out("O", f"look-alike where the {first.kind} stood", reason)


def _add_repeated(draft: Draft, items: Sequence[ObjectSpec], asked: functools.partial[a.Instruction]) -> None:
    """Add a variation in which two identical objects are packed.

    The second object starts in the slot of another item.
    """
    repeated = next((o for o in items[:3] if is_countable(o.kind)), None)
    if repeated is None:
        draft.leave_out("T", "two equal objects to be packed", "no item has a plural")
        return
    stays, goes = (o for o in items[:3] if o is not repeated)
    again = second(draft.cast, repeated)
    title = f"two {plural(repeated.kind)} to be packed, {stays.kind} in the slot of one"
    twice = a.repeat(asked(repeated, again))
    draft.vary("T", [a.replace(goes, again), a.swap(repeated, stays), twice], title, AGAIN)
