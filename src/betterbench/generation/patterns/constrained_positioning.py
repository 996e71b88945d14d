"""Constrained positioning: the named cup or mug is put on the marked ring of a fixture.

In training, instructions for the first layout name only the object, and instructions for the second layout only its
position.
"""

import itertools
from dataclasses import replace

from betterbench.generation.cast import Cast
from betterbench.generation.measures import assets_of, foot_of, mm, refused, region_of, require_footprint, require_grasp
from betterbench.generation.patterns.draft import in_order
from betterbench.generation.patterns.pattern import GeneratedTask, Unbuilt, pattern
from betterbench.generation.patterns.roles import BYSTANDER_M, group, standing_look_alikes
from betterbench.generation.wording import words_and_noun
from betterbench.tasks import authoring as a
from betterbench.tasks.condition import Condition
from betterbench.tasks.relations.on_ring import ENTRY_RISE_M

NEAR, FAR = a.Slot("near", 0.60, -0.13, yaw=-1.5708), a.Slot("far", 0.42, -0.14, yaw=-1.5708)
MIDDLE = a.Slot("middle", 0.51, -0.24, yaw=-1.5708)
STAND = a.Slot("machine", 0.52, 0.19, yaw=-1.5708, jitter_m=0.0, yaw_jitter=0.0)
IN_FRONT = a.Slot("in_front", 0.71, 0.0, yaw=-1.5708)
ASIDE = a.Slot("aside", 0.72, -0.19)

PLACES = {FAR.name: "top", NEAR.name: "bottom", MIDDLE.name: "middle"}
"""Words for the slots in the front camera image. The far slot is at the top of the image."""

HALF_HAND_M = 0.0325
"""Half the thickness of the gripper, which must stay in front of the head of the fixture [m]."""
MARGIN_M = 0.004
"""Clearance between the head of the fixture and an object or the gripper [m]."""
LONGEST_M = 0.13
"""Maximum length of an object in a slot [m]. The handle points away from the other slots."""

PLACE_WORD = "A position word is understood although training never used it in this layout."
KIND_WORD = "A word for an object means the object, not the slot where that object stood in training."
DONE = "The policy sees what is done already and does nothing again."


@pattern(a.CONSTRAINED_POSITIONING)
def constrained_positioning(cast: Cast) -> GeneratedTask:
    """Make a task with two or three cups or mugs and a fixture with a ring.

    The training twin of each of the variations L1 to L4 has the same scene, but its instruction names another item.

    Raises:
        InvalidInputError: If an object does not fit. The message names the object.
    """
    return _Positioning(cast).task()


class _Positioning:
    """Builds a task from a cast (a scenario with chosen assets).

    The task consists of layouts, instructions, variations and balanced conditions.
    """

    def __init__(self, cast: Cast) -> None:
        self.cast = cast
        (fixture,) = group(cast, "fixture", "fixture", 1, 1)
        self.fixture = replace(fixture, fixed=True)
        self.items = group(cast, "items", "item", 2, 3)
        self.bystanders = group(cast, "distractors", "distractor", 0, 1)
        for item in self.items:
            _require_fit(item, self.fixture)
        for other in self.bystanders:
            require_footprint(other, BYSTANDER_M, "The place beside the slots")
        self.alike = standing_look_alikes(cast, self.items)
        self.words, self.noun = words_and_noun(self.items)
        first, second, *others = self.items
        slots = (NEAR, FAR, *((MIDDLE,) if others else ()))
        around = {self.fixture: STAND, **dict.fromkeys(self.bystanders, ASIDE)}
        self.slots = slots
        orders = (self.items, (second, *others, first))
        self.layouts = tuple({**self._in_slots(order), **around} for order in orders)

    def _in_slots(self, order: tuple[a.ObjectSpec, ...]) -> dict[a.ObjectSpec, a.Slot]:
        """Return the slot of each item. ``order`` lists the items in the near, the far and the middle slot."""
        return {item: self.slots[order.index(item)] for item in self.items}

    def named(self, item: a.ObjectSpec) -> a.Instruction:
        """Return the instruction that names an item by its color or kind."""
        word = self.words[item.name]
        return self._put(word, f"{word} {self.noun}" if self.noun else word, item, _has_handle(item))

    def placed(self, slot: a.Slot) -> a.Instruction:
        """Return the instruction that names an item by the position of its slot."""
        word = PLACES[slot.name]
        text = f"{word} {self.noun or 'vessel'}"
        return self._put(word, text, a.Reference(slot=slot.name), all(map(_has_handle, self.items)))

    def _put(self, word: str, noun: str, what: a.ObjectSpec | a.Reference, handle: bool) -> a.Instruction:
        step = a.subgoal(f"place_{self.noun or 'item'}", a.ON_RING, what, self.fixture, word=word)
        machine = self.fixture.kind
        how = f", its handle not facing the {machine.split()[-1]}" if handle else ""
        return a.Instruction(f"Put the {noun} inside the ring of the {machine}{how}.", (step,))

    def task(self) -> GeneratedTask:
        """Return the task with its variations and balanced conditions."""
        by_name = [self.named(item) for item in self.items]
        by_place = [self.placed(slot) for slot in sorted(self.slots, key=lambda s: s.x)]
        training = a.conditions(self.layouts[:1], by_name) + a.conditions(self.layouts[1:], by_place)
        slots = (*self.slots, STAND, *(ASIDE for _ in self.bystanders))
        variations, unbuilt = self._variations(training)
        scenario = self.cast.scenario
        task = a.Task(
            version=1,
            title=scenario.name,
            description=scenario.instruction,
            template=a.CONSTRAINED_POSITIONING,
            slots=slots,
            training=training,
            variations=variations,
        )
        balanced = tuple(self._balanced())
        return GeneratedTask(task, self._confounds(), balanced, self._crossed(), unbuilt, aside=(IN_FRONT,))

    def _variations(self, training: tuple[Condition, ...]) -> tuple[tuple[a.Variation, ...], tuple[Unbuilt, ...]]:
        first, second, *_ = self.items
        known = [f"{self.words[item.name]}" for item in self.items]
        crossed = [
            ("layout 1, top", PLACE_WORD, 0, self.placed(FAR)),
            ("layout 1, bottom", PLACE_WORD, 0, self.placed(NEAR)),
            (f"layout 2, {known[0]}", KIND_WORD, 1, self.named(first)),
            (f"layout 2, {known[1]}", KIND_WORD, 1, self.named(second)),
        ]
        found = [
            a.Variation(f"L{i}", (a.instruct(asked),), title, hypothesis, self._twin(training, layout, asked))
            for i, (title, hypothesis, layout, asked) in enumerate(crossed, start=1)
        ]
        reason = "one object goes to one place, so there are no steps to combine in a new way"
        unbuilt = [Unbuilt("R", "known steps in a new combination", reason)]
        for item, other, base in ((first, second, "train1"), (second, first, "train2")):
            title = f"look-alike where the {item.kind} stood"
            if item.name not in self.alike:
                missing = f"no other object has the color of the {item.kind}; choose one that has a look-alike"
                unbuilt.append(Unbuilt("O", title, missing))
                continue
            alike, at, there = self.alike[item.name], self.layouts[0][item], self.layouts[0][other]
            exchanged = (a.remove(other), a.move(item, there), a.add(alike, at))
            number = 1 + sum(v.name.startswith("O") for v in found)
            ability = f"The policy distinguishes the {item.kind} from a look-alike in its slot."
            title = f"{alike.kind} where the {item.kind} stood"
            found.append(a.Variation(f"O{number}", exchanged, title, ability, base))
        done, title = (a.preplace(first, self.fixture),), f"{first.kind} already on the ring"
        still = a.Expected.STAY_STILL
        found.append(a.Variation("T1", done, title, DONE, expected=still, mid_task_look=True))
        return in_order(found), tuple(unbuilt)

    def _twin(self, training: tuple[Condition, ...], layout: int, asked: a.Instruction) -> str:
        """Return the training condition that serves as the twin of a variation.

        It is the first training condition with the same layout and an instruction for another item. Repeating the
        motion of the twin therefore does not solve the variation.
        """
        scene = next(c for c in training if c.layout == _slots_of(self.layouts[layout]))
        right = scene.resolve(asked.subgoals[0].reference)
        for number, condition in enumerate(training, start=1):
            wanted = condition.resolve(condition.instruction.subgoals[0].reference)
            if condition.layout == scene.layout and wanted != right:
                return f"train{number}"
        raise AssertionError("two items are requested in every layout")

    def _balanced(self) -> list[Condition]:
        """Return the balanced conditions of the task.

        Each word for an item or a position occurs in scenes with all items and an additional object, and in scenes with
        a single item. A single item is alone, or together with the look-alike of another item. It is never together
        with its own look-alike, because that scene is used in a test. The additional object distinguishes the scenes
        with all items from the test scenes. Only the words determine the target.
        """
        words = [*map(self.named, self.items), *(self.placed(s) for s in sorted(self.slots, key=lambda s: s.x))]
        around = {self.fixture: STAND, **dict.fromkeys(self.bystanders, ASIDE)}
        beside = self._beside()
        alikes = tuple(beside.values())
        found = []
        for number, order in enumerate(self._orders()):
            layout = {**self._in_slots(order), **around}
            extras = alikes if len(self.items) == 2 else (alikes[number % len(alikes)],)
            for extra in extras:
                found += [a.condition({**layout, extra: IN_FRONT}, asked) for asked in words]
        n = len(self.items)
        for number, item in enumerate(self.items):
            following = (beside.get(self.items[(number + i) % n].name) for i in range(1, n))
            other = next((spec for spec in following if spec is not None), beside.get(""))
            for slot, elsewhere in zip(self.slots, (*self.slots[1:], self.slots[0]), strict=True):
                for others in ({}, {other: elsewhere}) if other is not None else ({},):
                    alone = {item: slot, **others, **around}
                    found += [a.condition(alone, self.named(item)), a.condition(alone, self.placed(slot))]
        return found

    def _beside(self) -> dict[str, a.ObjectSpec]:
        """Return the look-alike of each item, by the name of the item.

        If no item has a look-alike, return a toy block with the key "".
        """
        return dict(self.alike) or {"": a.distractor("toy_block", "toy block", "block")}

    def _orders(self) -> list[tuple[a.ObjectSpec, ...]]:
        """Return all cyclic rotations of the items, so that every item appears in every slot exactly once."""
        n = len(self.items)
        return [tuple(self.items[(i + turn) % n] for i in range(n)) for turn in range(n)]

    def _confounds(self) -> tuple[str, ...]:
        named = ", ".join(
            f"“{self.words[item.name]}” always means the {PLACES[self.layouts[0][item].name]} one"
            for item in self.items
        )
        words = " and ".join(f"“{PLACES[slot.name]}”" for slot in sorted(self.slots, key=lambda s: s.x))
        return (
            f"Words that name an object occur only in the first layout: {named}.",
            f"The words {words} occur only in the second layout.",
        )

    def _crossed(self) -> tuple[str, ...]:
        return (
            "all items are present, in different orders, and each word occurs with each such scene",
            "an item that is named by a word stands in each slot equally often",
            "an item that is named by its place is each of the items equally often",
            "one item or more at the start, with or without another object",
        )


def _slots_of(layout: a.SlotLayout) -> dict[str, str]:
    return {spec.name: slot.name for spec, slot in layout.items()}


def _has_handle(item: a.ObjectSpec) -> bool:
    return all(any(region.name == "handle" for region in asset.regions) for asset in assets_of(item))


def _require_fit(item: a.ObjectSpec, fixture: a.ObjectSpec) -> None:
    """Check that every variant of an item fits on the ring of every variant of the fixture while the gripper holds it.

    Raises:
        InvalidInputError: If the fixture has no ring, if the item is too wide or too high, or if the gripper would
            touch the head of the fixture while it holds the item.
    """
    require_grasp(item)
    require_footprint(item, LONGEST_M, "A slot")
    for asset, machine in itertools.product(assets_of(item), assets_of(fixture)):
        ring, spout = region_of(fixture, machine, "ring"), region_of(fixture, machine, "spout")
        width, allowed = 2.0 * max(region_of(item, asset, "base").half_size[:2]), 2.0 * min(ring.half_size[:2])
        if width > allowed:
            raise refused(item, f"is {mm(width)} wide", f"The ring is {mm(allowed)} wide; choose a narrower object")
        free = spout.position[2] - spout.half_size[2] - ring.position[2] - ENTRY_RISE_M - MARGIN_M
        if asset.size_m[2] > free:
            cure = f"Below the spout there is room for {mm(free)}; choose an object that is not as tall"
            raise refused(item, f"is {mm(asset.size_m[2])} high", cure)
        head = spout.position[0] + spout.half_size[0] - ring.position[0]
        needed = head + HALF_HAND_M + MARGIN_M
        foot_x, _ = foot_of(asset)
        held = max(grasp.pose.position[0] - foot_x for grasp in asset.grasps)
        if held < needed:
            problem = f"would be grasped {mm(held)} in front of its middle"
            cure = f"The gripper needs {mm(needed)} to stay clear of the spout; choose an object with a handle"
            raise refused(item, problem, cure)
