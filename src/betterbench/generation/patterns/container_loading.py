"""Container loading: the named object is put into the named drawer, and the drawer is closed.

In training, each object always goes into the same drawer, and the objects' slots depend on the position of the cabinet.
"""

import math
from dataclasses import replace

from betterbench.errors import InvalidInputError
from betterbench.generation.cast import Cast
from betterbench.generation.measures import (
    assets_of,
    mm,
    radius_below,
    refused,
    region_of,
    require_footprint,
    require_grasp,
)
from betterbench.generation.patterns.draft import in_order
from betterbench.generation.patterns.pattern import GeneratedTask, Unbuilt, pattern
from betterbench.generation.patterns.roles import BYSTANDER_M, group, standing_look_alikes
from betterbench.generation.stated_goal import stated_goal
from betterbench.sim.assets import Asset, colors, family_of
from betterbench.tasks import authoring as a
from betterbench.tasks.condition import Condition
from betterbench.tasks.relations.closed import MOUNTS

LEFT_BACK, LEFT_FRONT = a.Slot("left_back", 0.38, -0.22), a.Slot("left_front", 0.56, -0.21)
RIGHT_BACK, RIGHT_FRONT = a.Slot("right_back", 0.46, -0.20), a.Slot("right_front", 0.64, -0.22)
CABINET_BACK, CABINET_FRONT = (
    a.Slot(f"cabinet_{name}", x, 0.25, yaw=-1.0472, jitter_m=0.0, yaw_jitter=0.0)
    for name, x in (("back", 0.44), ("front", 0.54))
)
ASIDE = a.Slot("aside", 0.28, -0.05)

OPEN_M = 0.15
"""Opening of a drawer that is open at the start [m]."""
WALL_M = 0.005
"""Clearance between an object and the walls of a drawer [m]."""
LONGEST_M = 0.14
"""Maximum length of an object in a slot [m]."""
TURNED = CABINET_BACK.yaw
"""Heading of the slots for an object with corners, equal to the heading of the cabinet [rad].

With another heading, the corners would touch the walls of a drawer.
"""
CORNER_M = 0.005
"""Distance by which the corners of an object may extend beyond half of its length [m].

The expert keeps a gap of this size to the walls.
"""

BY_KIND = "Objects are found by what they are, not by where they stood in training."
BY_CABINET = "A drawer is found where the cabinet is, not where it was."
NEW_PAIR = "A known object and a known drawer are combined in a new way."
IN_THE_WAY = "An obstacle is noticed and removed first."
LONGER = "A chain of known steps that is longer than any in training is completed."


@pattern(a.CONTAINER_LOADING)
def container_loading(cast: Cast) -> GeneratedTask:
    """Return a task with two objects, and a cabinet with an upper and a lower drawer.

    Nothing can be put into the lower drawer while the upper one is open.

    Raises:
        InvalidInputError: If an object does not fit. The message names the object.
    """
    return _Loading(cast).task()


class _Loading:
    """Builds a task from a cast (a scenario with chosen assets).

    The task consists of layouts, instructions, variations and balanced conditions.
    """

    def __init__(self, cast: Cast) -> None:
        self.cast = cast
        (cabinet,) = group(cast, "cabinet", "fixture", 1, 1)
        self.cabinet = replace(cabinet, fixed=True)
        self.upper, self.lower = _drawers(cast, self.cabinet)
        self.items = self._ordered(group(cast, "items", "item", 2, 2))
        self.bystanders = group(cast, "distractors", "distractor", 0, 1)
        for item in self.items:
            _require_fit(item, self.cabinet, (self.upper, self.lower))
        for other in self.bystanders:
            require_footprint(other, BYSTANDER_M, "The place beside the slots")
        self.alike = standing_look_alikes(cast, self.items)
        self.around = dict.fromkeys(self.bystanders, ASIDE)
        first, second = self.items
        yaw = TURNED if any(map(_has_corners, self.items)) else 0.0
        self.slots = tuple(replace(slot, yaw=yaw) for slot in (LEFT_BACK, LEFT_FRONT, RIGHT_BACK, RIGHT_FRONT))
        left_back, left_front, right_back, right_front = self.slots
        self.layouts: tuple[a.SlotLayout, ...] = (
            {first: left_back, second: left_front, self.cabinet: CABINET_BACK, **self.around},
            {first: right_front, second: right_back, self.cabinet: CABINET_FRONT, **self.around},
        )

    def _ordered(self, items: tuple[a.ObjectSpec, ...]) -> tuple[a.ObjectSpec, ...]:
        """Return the two items, starting with the one that goes into the upper drawer in training.

        The given order is reversed if the scenario's instruction puts the items into the other drawers.
        """
        stated = stated_goal(self.cast.scenario).regions
        first, second = items
        exchanged = stated.get(first.name) == "lower" or stated.get(second.name) == "upper"
        return (second, first) if exchanged else items

    def load(self, *steps: tuple[a.ObjectSpec, a.ObjectSpec]) -> a.Instruction:
        """Return the instruction to put the given objects into drawers and then close the drawers."""
        parts = [f"the {item.kind} into the {into.kind}" for item, into in steps]
        goals: list[a.Subgoal] = []
        for item, into in steps:
            goals.append(a.subgoal(f"load_{item.name}", a.INSIDE, item, into, word=item.kind))
            region = into.mount.region if into.mount is not None else ""
            goals.append(a.subgoal(f"close_{into.name}", a.CLOSED, into, self.cabinet, region, word=into.kind))
        # "it" could refer to the object, and "the drawer" to either of two drawers
        shut = "it" if len(steps) == 1 else "both"
        return a.Instruction(f"Put {' and '.join(parts)}, then close {shut}.", tuple(goals))

    def task(self) -> GeneratedTask:
        """Return the task with its variations and balanced conditions."""
        first, second = self.items
        steps = ((first, self.upper), (second, self.lower))
        demonstrations = tuple((self.load(step), opened) for step in steps for opened in ({}, {step[1]: OPEN_M}))
        variations, unbuilt = self._variations()
        scenario = self.cast.scenario
        task = a.Task(
            version=1,
            title=scenario.name,
            description=scenario.instruction,
            template=a.CONTAINER_LOADING,
            slots=(*self.slots, CABINET_BACK, CABINET_FRONT, *(ASIDE for _ in self.bystanders)),
            training=tuple(
                a.condition(layout, asked, self.upper, self.lower, opened=opened)
                for layout in self.layouts
                for asked, opened in demonstrations
            ),
            variations=variations,
        )
        return GeneratedTask(task, self._confounds(), tuple(self._balanced()), self._crossed(), unbuilt)

    def _variations(self) -> tuple[tuple[a.Variation, ...], tuple[Unbuilt, ...]]:
        (first, second), upper, lower = self.items, self.upper, self.lower
        kinds, exchanged = f"{first.kind} and {second.kind} exchanged", a.swap(first, second)
        in_the_way = (a.draw_out(upper, OPEN_M), exchanged)
        chained = (exchanged, a.chain(self.load((first, upper), (second, lower))))
        moved, blocked = "cabinet at its other position", f"open {upper.kind} in the way, objects exchanged"
        found = [
            a.Variation("L1", (exchanged,), kinds, BY_KIND, "train2"),
            a.Variation("L2", (a.move(self.cabinet, CABINET_FRONT),), moved, BY_CABINET, "train3"),
            a.Variation(
                "R1", (a.instruct(self.load((first, lower))),), f"{first.kind} into the {lower.kind}", NEW_PAIR
            ),
            a.Variation("T1", in_the_way, blocked, IN_THE_WAY, "train3", mid_task_look=True),
            a.Variation("T2", chained, "load both drawers, objects exchanged", LONGER),
        ]
        unbuilt = []
        for item, other, base in ((first, second, "train2"), (second, first, "train4")):
            if item.name not in self.alike:
                missing = f"no other object has the color of the {item.kind}; choose one that has a look-alike"
                unbuilt.append(Unbuilt("O", f"look-alike where the {item.kind} stood", missing))
                continue
            alike, at, there = self.alike[item.name], self.layouts[0][item], self.layouts[0][other]
            operations = (a.remove(other), a.move(item, there), a.add(alike, at))
            number = 1 + sum(v.name.startswith("O") for v in found)
            ability = f"The policy distinguishes the {item.kind} from a look-alike in its slot."
            title = f"{alike.kind} where the {item.kind} stood"
            found.append(a.Variation(f"O{number}", operations, title, ability, base))
        return in_order(found), tuple(unbuilt)

    def _balanced(self) -> list[Condition]:
        """Return balanced conditions in four layouts.

        Each object is put into each drawer, and the drawers are open or closed at the start. One test instruction puts
        only the first object into the lower drawer. In the balanced conditions, such an instruction therefore always
        mentions the other object too.
        """
        (first, second), upper, lower = self.items, self.upper, self.lower
        back, front = {self.cabinet: CABINET_BACK}, {self.cabinet: CABINET_FRONT}
        left_back, left_front, right_back, right_front = self.slots
        exchanged: tuple[a.SlotLayout, ...] = (
            {first: left_front, second: left_back, **front, **self.around},
            {first: right_back, second: right_front, **back, **self.around},
        )
        found = []
        for layout in (*self.layouts, *exchanged):
            for item, other, into in ((first, second, upper), (second, first, lower)):
                alone = {o: slot for o, slot in layout.items() if o is not other}
                found.append(self._asked(layout, (item, into)))
                found.append(self._asked(alone, (item, into), opened={into: OPEN_M}))
            found.append(self._asked(layout, (first, lower), (second, upper)))
            found.append(self._asked(layout, (second, upper), (first, lower)))
        return found

    def _asked(
        self,
        layout: a.SlotLayout,
        *steps: tuple[a.ObjectSpec, a.ObjectSpec],
        opened: dict[a.ObjectSpec, float] | None = None,
    ) -> Condition:
        return a.condition(layout, self.load(*steps), self.upper, self.lower, opened=opened)

    def _confounds(self) -> tuple[str, ...]:
        first, second = self.items
        return (
            f"The {first.kind} always goes into the {self.upper.kind}.",
            f"The {second.kind} always goes into the {self.lower.kind}.",
            "Each object has one slot for each position of the cabinet.",
            "The other drawer is always closed at the start.",
        )

    def _crossed(self) -> tuple[str, ...]:
        first, second = self.items
        return (
            f"{first.kind} and {second.kind} lie in each slot, with the cabinet at either position",
            f"{first.kind} and {second.kind} go into either drawer, and either comes first",
            "both objects on the table, or without the one that is not requested",
        )


def _drawers(cast: Cast, cabinet: a.ObjectSpec) -> tuple[a.ObjectSpec, a.ObjectSpec]:
    """Return the upper and the lower drawer with their mounts.

    Raises:
        InvalidInputError: If the cast does not have one drawer for each mount of the cabinet, or a drawer does not
            match the family and color of the cabinet.
    """
    chosen = group(cast, "drawers", "drawer", 2, 2)
    found = []
    for mount in MOUNTS:
        fitting = [spec for spec in chosen if spec.category.startswith(mount)]
        if len(fitting) != 1:
            listed = " and ".join(spec.category for spec in chosen)
            raise InvalidInputError("cast group 'drawers'", f"has {listed}", "Choose an upper and a lower drawer")
        spec = fitting[0]
        found.append(replace(spec, color=cabinet.color, mount=a.drawer(mount, spec.category, cabinet).mount))
    for spec in found:
        if family_of(spec.category) != family_of(cabinet.category):
            raise refused(
                spec, f"does not belong to the cabinet {cabinet.name!r}", "Choose drawers made for this cabinet"
            )
        if cabinet.color is not None and cabinet.color not in colors(spec.category):
            known = ", ".join(colors(spec.category))
            raise refused(
                spec, f"does not exist in {cabinet.color}", f"Choose a cabinet in one of these colors: {known}"
            )
    return found[0], found[1]


def _has_corners(item: a.ObjectSpec) -> bool:
    """Return whether an object has corners. Such an object needs more room in a drawer when it is rotated."""
    turn = abs(TURNED)
    for asset in assets_of(item):
        long, wide = max(asset.size_m[:2]), min(asset.size_m[:2])
        c, s = math.cos(turn), math.sin(turn)
        reach = 0.5 * max(long * c + wide * s, long * s + wide * c)
        if reach - 0.5 * long > CORNER_M and not _is_round(asset):
            return True
    return False


def _is_round(asset: Asset) -> bool:
    """Return whether an object is about as wide as it is long, and has no corners."""
    long, wide = max(asset.size_m[:2]), min(asset.size_m[:2])
    return wide > 0.9 * long and radius_below(asset, math.inf) <= 0.5 * long + 0.003


def _require_fit(item: a.ObjectSpec, cabinet: a.ObjectSpec, drawers: tuple[a.ObjectSpec, ...]) -> None:
    """Check that every variant of an item fits into every variant of the drawers.

    Raises:
        InvalidInputError: If the item is too long or too high, or the gripper cannot hold it.
    """
    require_grasp(item)
    require_footprint(item, LONGEST_M, "A slot")
    length = max(max(asset.size_m[:2]) for asset in assets_of(item))
    height = max(asset.size_m[2] for asset in assets_of(item))
    for drawer in drawers:
        for asset, carcass in zip(assets_of(drawer), assets_of(cabinet), strict=True):
            inside = region_of(drawer, asset, "inside")
            mount = region_of(cabinet, carcass, drawer.mount.region if drawer.mount is not None else "")
            room = 2.0 * (min(inside.half_size[:2]) - WALL_M)
            if length > room:
                cure = f"The {drawer.kind} has room for {mm(room)}; choose a smaller object"
                raise refused(item, f"is {mm(length)} long", cure)
            floor = inside.position[2] - inside.half_size[2]
            free = 2.0 * mount.half_size[2] - floor - WALL_M
            if height > free:
                cure = f"The closed {drawer.kind} has room for {mm(free)}; choose an object that is not as tall"
                raise refused(item, f"is {mm(height)} high", cure)
