"""Precision insertion: the named jars are put into the named holes of a rack.

In training, each jar has a fixed slot and a fixed hole.
"""

import itertools
from collections.abc import Mapping
from dataclasses import replace

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
from betterbench.generation.wording import words_and_noun
from betterbench.sim.assets import Asset, categories, colors
from betterbench.tasks import authoring as a
from betterbench.tasks.condition import Condition

FIRST, SECOND, THIRD = a.Slot("first", 0.42, -0.22), a.Slot("second", 0.60, -0.20), a.Slot("third", 0.51, -0.09)
STAND = a.Slot("stand", 0.52, 0.13, jitter_m=0.0, yaw_jitter=0.0)
ASIDE = a.Slot("aside", 0.71, -0.10)
HOLES = {"hole_1": "left", "hole_2": "middle", "hole_3": "right"}
"""Words for the holes in the front camera image."""

LEAST_CLEARANCE_M, MOST_CLEARANCE_M = 0.002, 0.003
"""Minimum and maximum clearance of a jar in its hole on each side [m]. The template requires 3 mm or less."""
HELD_M = 0.015
"""Minimum height of the grasp above the top of a hole [m]. The finger pads extend 9 mm below the grasp."""

BY_KIND = "Objects are found by what they are, not by where they stood in training."
BY_HOLE = "A hole is found by its position in the rack, whatever the other holes hold."
NEW_PAIR = "A known object and a known hole are combined in a new way."
LABELS = "Objects are distinguished by their labels alone."
LONGER = "A chain of known steps that is longer than any in training is completed."


@pattern(a.PRECISION_INSERTION)
def precision_insertion(cast: Cast) -> GeneratedTask:
    """Return a task with three jars and a rack with three holes.

    Raises:
        InvalidInputError: If an object does not fit. The message names the object.
    """
    return _Insertion(cast).task()


class _Insertion:
    """Builds a task from a cast (a scenario with chosen assets).

    The task consists of a layout, instructions, variations and balanced conditions.
    """

    def __init__(self, cast: Cast) -> None:
        self.cast = cast
        (rack,) = group(cast, "rack", "fixture", 1, 1)
        self.rack = replace(rack, fixed=True)
        self.items = _ordered(group(cast, "items", "item", 3, 3), stated_goal(cast.scenario).regions)
        self.bystanders = group(cast, "distractors", "distractor", 0, 1)
        for item in self.items:
            _require_fit(item, self.rack)
        for other in self.bystanders:
            require_footprint(other, BYSTANDER_M, "The place beside the slots")
        self.alike = standing_look_alikes(cast, self.items)
        self.words, _ = words_and_noun(self.items)
        self.around = {self.rack: STAND, **dict.fromkeys(self.bystanders, ASIDE)}
        self.layout = {**dict(zip(self.items, (FIRST, SECOND, THIRD), strict=True)), **self.around}

    def insert(self, *steps: tuple[a.ObjectSpec, str]) -> a.Instruction:
        """Return the instruction to put jars into holes of the rack, in any order."""
        parts = [f"the {jar.kind} into the {HOLES[hole]} hole" for jar, hole in steps]
        text = ", ".join(parts[:-1]) + (" and " if len(parts) > 1 else "") + parts[-1]
        goals = []
        for jar, hole in steps:
            word = self.words[jar.name]
            goals.append(a.subgoal(f"{jar.name}_{hole}", a.IN_HOLE, jar, self.rack, hole, word=word))
        return a.Instruction(f"Put {text} of the {self.rack.kind.split()[-1]}.", tuple(goals))

    def task(self) -> GeneratedTask:
        """Return the task with its variations and balanced conditions."""
        s, p, r = zip(self.items, HOLES, strict=True)
        variations, unbuilt = self._variations()
        scenario = self.cast.scenario
        task = a.Task(
            version=1,
            title=scenario.name,
            description=scenario.instruction,
            template=a.PRECISION_INSERTION,
            slots=(FIRST, SECOND, THIRD, STAND, *(ASIDE for _ in self.bystanders)),
            training=a.conditions(
                [self.layout], (self.insert(*jars) for jars in ((s,), (p,), (r,), (s, p), (p, r), (r, s)))
            ),
            variations=variations,
        )
        confounds = (
            *(f"The {jar.kind} has one slot and always goes into the {HOLES[hole]} hole." for jar, hole in (s, p, r)),
            "At most two holes are filled in one demonstration, and all holes are empty at the start.",
        )
        crossed = (
            "each object stands in each slot equally often, also for each instruction",
            "each object goes into each hole equally often, alone and with another one",
            "each object comes first or second; all on the table, or without one that is not requested",
        )
        return GeneratedTask(task, confounds, tuple(self._balanced()), crossed, unbuilt)

    def _variations(self) -> tuple[tuple[a.Variation, ...], tuple[Unbuilt, ...]]:
        first, second, third = self.items
        rack, (left, middle, right) = self.rack, HOLES
        filled = (a.preplace(second, rack, middle), a.preplace(third, rack, right), a.move(first, SECOND))
        crossed = a.instruct(self.insert((first, right), (third, left)))
        chained = (a.swap(second, third), a.chain(self.insert((first, left), (second, middle), (third, right))))
        kinds = [item.kind for item in self.items]
        holes = f"the other holes filled, {kinds[0]} in the slot of the {kinds[1]}"
        row = f"three in a row, {kinds[1]} and {kinds[2]} exchanged"
        swapped, pair = (a.swap(first, second),), f"{kinds[0]} into the right hole, {kinds[2]} into the left"
        found = [
            a.Variation("L1", swapped, f"{kinds[0]} and {kinds[1]} exchanged", BY_KIND, "train4"),
            a.Variation("L2", filled, holes, BY_HOLE, mid_task_look=True),
            a.Variation("R1", (crossed,), pair, NEW_PAIR, "train6"),
            a.Variation("T1", chained, row, LONGER, "train4"),
        ]
        unbuilt = []
        if first.name in self.alike:
            alike = self.alike[first.name]
            operations = (a.remove(third), a.move(first, THIRD), a.add(alike, FIRST))
            ability = f"The policy distinguishes the {kinds[0]} from a look-alike in its slot."
            found.append(a.Variation("O1", operations, f"{alike.kind} where the {kinds[0]} stood", ability, "train4"))
        else:
            missing = f"no other object has the color of the {kinds[0]}; choose one that has a look-alike"
            unbuilt.append(Unbuilt("O", f"look-alike where the {kinds[0]} stood", missing))
        plain = [self._plain(item) for item in self.items]
        title = "same cap and body on every jar"
        if any(spec is None for spec in plain):
            lacking = ", ".join(i.kind for i, spec in zip(self.items, plain, strict=True) if spec is None)
            reason = f"no versions that differ only in their labels exist of: {lacking}"
            unbuilt.append(Unbuilt("O", title, reason))
        else:
            same = [spec for spec in plain if spec is not None]
            replaced = tuple(a.replace(i, p) for i, p in zip(self.items, same, strict=True))
            title = f"{title}, {kinds[0]} and {kinds[1]} exchanged"
            number = 1 + sum(v.name.startswith("O") for v in found)
            found.append(a.Variation(f"O{number}", (*replaced, a.swap(same[0], same[1])), title, LABELS, "train4"))
        return in_order(found), tuple(unbuilt)

    def _plain(self, item: a.ObjectSpec) -> a.ObjectSpec | None:
        """Return the plain version of a jar, or None if it does not exist.

        Plain jars differ only in their labels. By convention, the category of the plain version is "plain_" followed by
        the kind, with underscores ("plain_salt_jar").
        """
        category = f"plain_{item.kind.replace(' ', '_')}"
        if category == item.category or category not in categories():
            return None
        return replace(item, name=f"plain_{item.name}", category=category, color=colors(category)[0])

    def _balanced(self) -> list[Condition]:
        """Return balanced conditions for each jar in each hole, and for each ordered pair of jars in two holes.

        Each instruction occurs in three layouts, so that it does not determine the slots of the jars.
        """
        holes, jars = tuple(HOLES), self.items
        found = []
        for shift, turn in itertools.product(range(3), repeat=2):
            into = {jar: holes[(place + shift) % 3] for place, jar in enumerate(jars)}
            asked = [(jar,) for jar in jars] + list(itertools.permutations(jars, 2))
            for number, some in enumerate(asked):
                layout = {jar: (FIRST, SECOND, THIRD)[(place + turn) % 3] for place, jar in enumerate(jars)}
                if (number + shift + turn) % 2:
                    del layout[next(jar for jar in jars if jar not in some)]
                found.append(a.condition({**layout, **self.around}, self.insert(*((jar, into[jar]) for jar in some))))
        return found


def _ordered(items: tuple[a.ObjectSpec, ...], stated: Mapping[str, str]) -> tuple[a.ObjectSpec, ...]:
    """Return the items in the order of their holes.

    Items without a hole in the instruction get the remaining holes.
    """
    placed = {stated[item.name]: item for item in items if item.name in stated}
    others = iter([item for item in items if item.name not in stated])
    return tuple(placed[hole] if hole in placed else next(others) for hole in HOLES)


def _require_fit(item: a.ObjectSpec, rack: a.ObjectSpec) -> None:
    """Check that every variant of an item fits into every hole of every variant of the rack.

    Raises:
        InvalidInputError: If the rack has no holes of a known width, or if the item does not fit into them with a
            clearance of 2 to 3 mm per side, or cannot be held above them.
    """
    require_grasp(item)
    for asset, holder in itertools.product(assets_of(item), assets_of(rack)):
        depths = [region_of(rack, holder, hole).half_size[2] for hole in HOLES]
        radius, hole = radius_below(asset, max(depths)), _half_width(rack, holder)
        clearance = hole - radius
        if not LEAST_CLEARANCE_M <= clearance <= MOST_CLEARANCE_M:
            problem = f"has a clearance of {mm(clearance)} per side in the holes of the {rack.kind} (look {asset.look})"
            wanted = f"{mm(2.0 * (hole - MOST_CLEARANCE_M))} to {mm(2.0 * (hole - LEAST_CLEARANCE_M))}"
            cure = f"It needs {mm(LEAST_CLEARANCE_M)} to {mm(MOST_CLEARANCE_M)}; choose an object {wanted} wide"
            raise refused(item, problem, cure)
        held, needed = max(grasp.pose.position[2] for grasp in asset.grasps), max(depths) + HELD_M
        if held < needed:
            cure = f"The gripper needs {mm(needed)} to stay above the rack; choose a taller object"
            raise refused(item, f"would be grasped {mm(held)} above its foot", cure)


def _half_width(rack: a.ObjectSpec, asset: Asset) -> float:
    """Return half the width of the holes of a rack [m]."""
    width = asset.parameters.get("apothem_m")
    if not isinstance(width, float):
        cure = "Choose a rack with the parameter apothem_m, half the width of its holes"
        raise refused(rack, "does not state the width of its holes", cure)
    return width
