"""Logical assembly: layers are put on a base in a strict order, as in the task ``cheeseburger``."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Sequence
from dataclasses import dataclass

from betterbench.errors import InvalidInputError
from betterbench.generation.cast import Cast
from betterbench.generation.layout import Table
from betterbench.generation.measures import footprint, require_finger_room, require_usable
from betterbench.generation.patterns.draft import Draft, shuffled
from betterbench.generation.patterns.pattern import GeneratedTask, pattern
from betterbench.generation.patterns.roles import in_role, look_alikes_of, second
from betterbench.generation.wording import words_of
from betterbench.tasks import authoring as a
from betterbench.tasks.condition import ObjectSpec, Slot
from betterbench.tasks.demonstrated import HEIGHT_MM
from betterbench.tasks.words import is_countable, plural

TABLE = Table(
    starts=(
        a.Slot("first", 0.48, -0.21),
        a.Slot("second", 0.64, -0.19),
        a.Slot("third", 0.48, -0.06),
        a.Slot("fourth", 0.64, -0.05),
    ),
    stands=(a.Slot("stand", 0.52, 0.14, jitter_m=0.005, yaw_jitter=0.0),),
)
"""Slots of the task cheeseburger in the suite."""

_TALLEST_M = 0.15
"""Maximum height of a stack above its base [m].

This is the highest stack over which the arm can carry the last layer.
"""

BY_KIND = "Layers are found by what they are, not by where they lay in training."
WITHOUT_FIRST = "Known steps are combined in a new way, without the step that always came first."
NEW_ORDER = "Known steps are carried out in an order that training never showed."
LOOK_ALIKE = "The policy distinguishes a layer from an object that looks like it, in its slot."
DONE = "The policy sees what is done already and goes on from there."
AGAIN = "A known step is repeated as often as the instruction asks."


@dataclass(frozen=True, slots=True)
class _Stack:
    """Objects of a stack: the base, three layers in varying order, and optionally a layer that is always on top."""

    base: ObjectSpec
    layers: tuple[ObjectSpec, ObjectSpec, ObjectSpec]
    last: tuple[ObjectSpec, ...]
    words: dict[str, str]

    def of(self, *things: ObjectSpec) -> a.Instruction:
        """Return the instruction to stack layers on the base from bottom to top, with the last layer on top of them."""
        return self.only(*things, *self.last)

    def only(self, *things: ObjectSpec) -> a.Instruction:
        """Return the instruction to stack only the given layers on the base, from bottom to top."""
        names = [f"the {o.kind}" for o in things]
        for i in range(1, len(things)):
            if things[i].kind == things[i - 1].kind:
                names[i - 1 : i + 1] = [f"a {things[i].kind}", f"another {things[i].kind}"]
        steps = (
            a.subgoal(f"layer_{i}_{o.kind.replace(' ', '_')}", a.LAYER, o, self.base, str(i), word=self.words[o.kind])
            for i, o in enumerate(things, start=1)
        )
        return a.ordered(f"Stack {', then '.join((f'{names[0]} on the {self.base.kind}', *names[1:]))}.", *steps)


@pattern(a.LOGICAL_ASSEMBLY)
def logical_assembly(cast: Cast) -> GeneratedTask:
    """Return a task in which a first layer and then one of two other layers are put on a base.

    If there are four layers, the fourth layer is always put on top. Distractors are not used, because the layers occupy
    all slots.

    Raises:
        InvalidInputError: If there are not three or four layers, a layer cannot be grasped or cannot carry the next
            one, the fingers would touch the rim of the base, a stack would be too high, or a layer would be released in
            a test at a height that does not occur in training.
    """
    (base,) = in_role("container", (cast.one("base"),))
    layers = in_role("item", cast.groups.get("layers", ()))
    if not 3 <= len(layers) <= 4:
        problem = f"has {len(layers)} objects, but three or four are needed"
        cure = "Choose three layers that change, and possibly one that always comes last"
        raise InvalidInputError("cast group 'layers'", problem, cure)
    require_usable(layers)
    one, two, three = layers[:3]
    stack = _Stack(base, (one, two, three), layers[3:], words_of((*layers, base)))
    for spec in (base, *stack.layers):
        if "top" not in footprint(spec.category).regions:
            problem = f"nothing can lie on a {spec.kind} (category {spec.category}): it has no region 'top'"
            group = "base" if spec is base else "layers"
            raise InvalidInputError(f"cast group {group!r}: {spec.name}", problem, "Choose an asset with a flat top")
    _require_heights(stack)
    for spec in stack.layers:
        require_finger_room(spec, base)
    return _assembled(cast, stack)


def _require_heights(stack: _Stack) -> None:
    """Check that each layer in a test has a release height within 5 mm of a height in the demonstrations."""
    one, two, three = stack.layers
    trained = [(one, two), (one, three)]
    tested = [*itertools.permutations(stack.layers, 2), *((o, o) for o in stack.layers[:1])]
    for level in range(1, 2 + len(stack.last)):
        known = [_below_m(layers[:level]) for layers in trained]
        low, high = min(k[0] for k in known), max(k[1] for k in known)
        for layers in tested:
            least, most = _below_m(layers[:level])
            if least < low - 0.001 * HEIGHT_MM or most > high + 0.001 * HEIGHT_MM:
                spec = next((o for o in layers[:level] if o is not one), one)
                found = f"with a {spec.kind}, layer {level + 1} lies {1000 * least:.0f} to {1000 * most:.0f} mm high"
                problem = f"{found}, but {1000 * low:.0f} to {1000 * high:.0f} mm high in training"
                cure = "Choose layers whose thickness differs by at most 5 mm; only the last layer may be thicker"
                raise InvalidInputError(f"cast group 'layers': {spec.name}", problem, cure)
            if most > _TALLEST_M:
                problem = f"a stack of {layers[0].kind} and {layers[1].kind} is {1000 * most:.0f} mm high"
                raise InvalidInputError("cast group 'layers'", problem, "Choose layers that are at most 75 mm high")


def _below_m(layers: Sequence[ObjectSpec]) -> tuple[float, float]:
    """Return the smallest and largest height of stacked layers above their base [m].

    All variants of the layers are considered.
    """
    heights = [footprint(spec.category).layer_m for spec in layers]
    return sum(low for low, _ in heights), sum(high for _, high in heights)


def _assembled(cast: Cast, stack: _Stack) -> GeneratedTask:
    one, two, three = stack.layers
    slots = shuffled(cast, TABLE.starts)
    objects = (*stack.layers, *stack.last)
    starts = dict(zip(objects, slots, strict=False))
    draft = Draft(
        a.LOGICAL_ASSEMBLY,
        cast,
        TABLE,
        a.conditions([{**starts, stack.base: TABLE.stands[0]}], [stack.of(one, two), stack.of(one, three)]),
        f"Stack the named layers on the {stack.base.kind}, in the order in which they are named.",
    )
    draft.vary("L", [a.swap(one, two)], f"{one.kind} and {two.kind} exchanged", BY_KIND)
    title = functools.partial(_title, stack)
    draft.vary("R", [a.instruct(stack.of(two, three))], title(two, three), WITHOUT_FIRST, "train2")
    draft.vary("R", [a.instruct(stack.of(two, one))], title(two, one), NEW_ORDER)
    _add_look_alike(draft, cast, stack, starts)
    begun = [a.preplace(one, stack.base, "1"), a.move(three, starts[one])]
    there = f"{one.kind} already on the {stack.base.kind}, {three.kind} where it lay"
    draft.vary("T", begun, there, DONE, mid_task=True)
    if is_countable(one.kind):
        other = second(cast, one)
        again = a.repeat(stack.of(one, other))
        twice = f"two {plural(one.kind)}, {three.kind} where one of them lay"
        draft.vary("T", [a.replace(two, other), a.swap(one, three), again], twice, AGAIN)
    else:
        draft.leave_out("T", f"{one.kind} twice", f"{one.kind!r} has no plural")
    draft.leave_out("T", "all layers in one stack", "the last one would lie higher than in any demonstration")
    pairs = [pair for pair in itertools.permutations(stack.layers, 2) if pair not in ((two, three), (two, one))]
    asked = [stack.of(*pair) for pair in pairs]
    asked += [stack.only(two, one), stack.only(two, three)] if stack.last else []
    asked += [stack.of(o) for o in stack.layers]
    balanced = draft.crossed(objects, slots[: len(objects)], {stack.base: TABLE.stands[0]}, asked)
    tops = [f"the {o.kind} is the second layer and the third" for o in stack.last]
    return draft.finish(
        balanced,
        confounds=(f"The {one.kind} is always the first layer.", "Every layer always starts in the same slot."),
        crossed=(
            "each layer lies in each slot",
            f"{one.kind}, {two.kind} and {three.kind} are each the first layer and the second",
            *tops,
            "all layers at the start, or one less that is not requested",
        ),
    )


def _title(stack: _Stack, *things: ObjectSpec) -> str:
    return f"{', '.join(o.kind for o in (*things, *stack.last))}"


def _add_look_alike(draft: Draft, cast: Cast, stack: _Stack, starts: dict[ObjectSpec, Slot]) -> None:
    """Add a variation in which a look-alike takes the slot of a requested layer.

    The layer itself is moved to the slot of a layer that is not requested.
    """
    one, two, three = stack.layers
    for spec, goes, base in ((two, three, "train1"), (three, two, "train2"), (one, three, "train1")):
        for other in look_alikes_of(cast, spec):
            choice = [a.remove(goes), a.move(spec, starts[goes]), a.add(other, starts[spec])]
            title = f"{other.kind} where the {spec.kind} lay"
            if draft.vary("O", choice, title, LOOK_ALIKE, base):
                return
    if not any(cast.look_alikes.get(o.name) for o in stack.layers):
        draft.leave_out("O", "look-alike in the slot of a layer", "the library has nothing else that looks like one")
