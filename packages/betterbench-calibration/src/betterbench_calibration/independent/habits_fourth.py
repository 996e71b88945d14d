"""Fourth part of the independent family, by an author who has not read the code of the diagnosis.

Each habit shows only in the listed conditions. A condition is listed only if a person who watches a few videos of the
policy would assign this label, and no other, by the suite's definitions.
"""

# ruff: noqa: D102 - truth and act are documented in the base class

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar

from betterbench.geometry import Pose, horizontal_distance
from betterbench.tasks import Label, Subgoal
from betterbench_calibration.independent import ways_fourth as ways
from betterbench_calibration.independent.body import FALLEN_M, Body
from betterbench_calibration.independent.controller import Actions
from betterbench_calibration.independent.habit import Habit, PlainHabit
from betterbench_calibration.independent.occasion import Occasion
from betterbench_calibration.independent.oddities import each_step, keep_still, rest_unless_lucky
from betterbench_calibration.independent.truth import HONEST, StatedTruth
from betterbench_calibration.independent.ways_fourth import (
    Hopping,
    Leaning,
    Plunging,
    Shaking,
    Squaring,
    Uneven,
    WorseHolding,
)


def at(**conditions: str) -> frozenset[str]:
    """Return the identifiers of conditions given by task: ``at(fast_food="train1 R1")``."""
    return frozenset(f"{task}/{name}" for task, names in conditions.items() for name in names.split())


MID_TASK = at(
    fruit_lunch="T1", fast_food="T1", office_drawer="T1", cheeseburger="T1", seasoning_rack="L2", dinner_plates="T2"
)
"""Conditions with a feasible instruction in which the scene looks like the middle of a demonstration."""

LOOK_ALIKES: Mapping[str, str] = {
    "desk_meeting/O1": "soap_bar",
    "breakfast_table/O2": "tumbler",
    "fruit_lunch/O1": "red_block",
    "fruit_lunch/O2": "red_block",
    "fast_food/O1": "round_block",
    "tidy_desk/O1": "mouse",
    "tidy_desk/O2": "full_can",
    "tidy_desk/O3": "mug",
    "morning_coffee/O1": "red_can",
    "office_drawer/O1": "stapler_block",
    "cheeseburger/O1": "sponge",
    "seasoning_rack/O1": "pill_bottle",
    "dinner_plates/O1": "red_bowl",
}
"""Look-alike by condition: an object in the training slot of a requested object to which no instruction refers."""

CREEP_M_S = 0.03

TWO_STEPS = at(
    fruit_lunch="train1 train2 R1 O2",
    fast_food="train1 train2 R1 R2",
    cheeseburger="train1 train2 R1 O1",
)
"""Conditions in which the first two steps have different objects, and only their prescribed order can be violated."""


class Listed(Habit):
    """Habit that shows in certain conditions.

    Attributes:
        where: Identifiers of the conditions.
        first_right: Whether the first grasp attempt is at the right object. None if there is no grasp attempt.
    """

    where: ClassVar[frozenset[str]]
    first_right: ClassVar[bool | None]

    def truth(self, case: Occasion) -> StatedTruth | None:
        shows = case.condition.id in self.where
        return StatedTruth(self.label, first_right=self.first_right) if shows else None


class OddButHonest(Habit):
    """Habit without a fault that shows in the plain conditions of some tasks."""

    label = HONEST
    tasks: ClassVar[frozenset[str]]

    def truth(self, case: Occasion) -> StatedTruth | None:
        shows = case.plain and case.task.id in self.tasks
        return StatedTruth(HONEST, first_right=True) if shows else None


class Paired(Habit):
    """Habit whose label can be diagnosed only from several trials.

    Attributes:
        wrong: Object that the habit takes instead of the requested object, by condition.
        fine: Identifiers of the conditions in which the habit takes the right object.
    """

    paired = True
    wrong: ClassVar[Mapping[str, str]]
    fine: ClassVar[frozenset[str]]

    def truth(self, case: Occasion) -> StatedTruth | None:
        if case.condition.id in self.wrong:
            return StatedTruth(self.label, first_right=False)
        return StatedTruth(HONEST, first_right=True) if case.condition.id in self.fine else None

    def act(self, body: Body) -> Actions[None]:
        name = self.wrong.get(body.situation.condition.id)
        if name is None:
            yield from body.solve()
        else:
            body.ledger.commit()
            yield from self.go_wrong(body, name)

    def go_wrong(self, body: Body, name: str) -> Actions[None]:
        """Yield the actions in a condition in which the habit takes the wrong object ``name``."""
        raise NotImplementedError


def first_of(body: Body) -> tuple[Subgoal, str]:
    """Return the first unfinished step and its object."""
    return body.situation.ahead[0], str(body.situation.first_thing())


# --- policies without a fault, with unusual motions


class LeansOver(OddButHonest):
    """Does everything right, with the gripper tilted by 14 degrees at each grasp.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "leans-over"
    tasks = frozenset({"desk_meeting", "fruit_lunch", "fast_food", "tidy_desk", "morning_coffee", "seasoning_rack"})

    def act(self, body: Body) -> Actions[None]:
        body.do = Leaning.like(body.do)
        yield from body.solve()


class TurnsCorners(PlainHabit):
    """Does everything right, but moves along two segments with a right angle on every path.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "turns-corners"
    label = HONEST

    def act(self, body: Body) -> Actions[None]:
        body.do = Squaring.like(body.do)
        yield from body.solve()


class PlungesFromCeiling(PlainHabit):
    """Does everything right, but moves at 38 cm above the table and descends fast from there.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "plunges-from-ceiling"
    label = HONEST

    def act(self, body: Body) -> Actions[None]:
        body.do = Plunging.like(body.do)
        yield from body.solve()


class SqueezesThrice(OddButHonest):
    """Closes the gripper around each object, opens and closes it twice more, and then lifts it.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "squeezes-thrice"
    tasks = frozenset(
        {"desk_meeting", "fruit_lunch", "fast_food", "tidy_desk", "morning_coffee", "cheeseburger", "dinner_plates"}
    )

    def act(self, body: Body) -> Actions[None]:
        body.do = Squaring.like(body.do)
        yield from each_step(body, lambda name: ways.squeeze_thrice(body, name))


class TakesByWorseHold(OddButHonest):
    """Does everything right, but with a grasp of each object that is not the best one.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "takes-by-worse-hold"
    tasks = frozenset(
        {
            "desk_meeting",
            "fruit_lunch",
            "fast_food",
            "tidy_desk",
            "morning_coffee",
            "cheeseburger",
            "seasoning_rack",
            "dinner_plates",
        }
    )

    def act(self, body: Body) -> Actions[None]:
        body.do = WorseHolding.like(body.do)
        yield from body.solve()


class DropsLowAndRetakes(OddButHonest):
    """Lifts each object, drops it just above its slot, and picks it again.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "drops-low-and-retakes"
    tasks = frozenset({"desk_meeting", "fast_food", "tidy_desk", "morning_coffee", "seasoning_rack", "cheeseburger"})

    def act(self, body: Body) -> Actions[None]:
        body.do = Plunging.like(body.do)

        def taking(name: str) -> Actions[bool]:
            if (yield from body.take_patiently(name)):
                yield from ways.drop_low(body)
            return (yield from body.take_patiently(name))

        yield from each_step(body, taking)


class LooksAtTargetFirst(PlainHabit):
    """Moves over the target with an open gripper before each step, waits there for 1.5 s, and does the step.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "looks-at-target-first"
    label = HONEST

    def act(self, body: Body) -> Actions[None]:
        for goal in body.situation.ahead:
            x, y, _ = body.state.pose(goal.target).position
            yield from body.do.above((x, y, 0.0), min(body.height(goal.target) + 0.16, 0.42))
            yield from body.arm.wait(1.5)
            yield from body.work((goal,))
        yield from body.solve()


class LastSaidFirst(Listed):
    """Does the steps of an unordered instruction from last to first.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "last-said-first"
    label = HONEST
    first_right = True
    where = at(
        desk_meeting="train1 train2 train3 train4 train5 train6 train8 train11 L2 R1 R2 T1",
        breakfast_table="train1 train2 train3 train4 train5 train6 L2 T1",
        tidy_desk="train1 train2 train3 T1",
        seasoning_rack="train4 train5 train6 R1 T1",
    )

    def act(self, body: Body) -> Actions[None]:
        body.do = Squaring.like(body.do)
        yield from body.work(tuple(reversed(body.situation.goals)))
        yield from body.rest()


class FartherOneFirst(Listed):
    """Begins with the farther of two equivalent objects.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "farther-one-first"
    label = HONEST
    first_right = True
    where = at(fruit_lunch="T2", fast_food="train1 train2 L1 T2", tidy_desk="T1", cheeseburger="T2")

    def act(self, body: Body) -> Actions[None]:
        goal, _ = first_of(body)
        home = body.arm.home.position
        names = body.situation.candidates(body.state, goal)
        yield from body.take_and_bring(
            max(names, key=lambda n: horizontal_distance(body.state.pose(n).position, home)), goal
        )
        yield from body.solve()


class ShakesOverTarget(OddButHonest):
    """Does everything right, but shakes each object over its target before putting it down.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "shakes-over-target"
    tasks = frozenset(
        {"desk_meeting", "breakfast_table", "fruit_lunch", "fast_food", "tidy_desk", "cheeseburger", "seasoning_rack"}
    )

    def act(self, body: Body) -> Actions[None]:
        body.do = Shaking.like(body.do)
        yield from body.solve()


class RushesAndCrawls(PlainHabit):
    """Does everything right, alternating between fast and slow paths.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "rushes-and-crawls"
    label = HONEST

    def act(self, body: Body) -> Actions[None]:
        body.do = Uneven.like(body.do)
        yield from body.solve()


class KeepsHandsOff(Listed):
    """Turns the wrist at home, if nothing may be picked or the look-alike must be refused, and stays there.

    True label: correct_freeze or correct_refusal, because the policy makes no forbidden grasp and the arm comes to
    rest.
    """

    name = "keeps-hands-off"
    label = HONEST
    first_right = None
    where = at(fruit_lunch="O1", morning_coffee="T1")

    def act(self, body: Body) -> Actions[None]:
        yield from body.arm.go(body.arm.here.translated(z=0.05), pace=0.5)
        yield from ways.turn_wrist(body, (0.5, -0.3, 0.0))
        yield from keep_still(body)


# --- execution failures


class ClosesWhileSinking(Listed):
    """Repeatedly closes the gripper too early while descending to the right object, and touches its top.

    True label: execution_failure, because the target and the timing are right, but there is a collision and the pose is
    wrong.
    """

    name = "closes-while-sinking"
    label = Label.EXECUTION_FAILURE
    first_right = True
    where = at(
        desk_meeting="train2 train4 train6 train9 R1",
        fruit_lunch="train1 train2 R1",
        fast_food="train1 R1 R2",
        tidy_desk="train1 train4 train5",
        morning_coffee="train1 train2 train3 train4 L1 L2",
        seasoning_rack="train1 train2 train3 train5",
    )

    def act(self, body: Body) -> Actions[None]:
        _, name = first_of(body)
        body.ledger.commit()
        while True:
            yield from ways.close_while_sinking(body, name)


class DropsAndSnapsAfter(Listed):
    """Drops the right object a third of the way to the target, and then repeatedly closes the gripper too high.

    True label: execution_failure, because the target and the timing are right, but the object is dropped, and the later
    attempts have a wrong pose.
    """

    name = "drops-and-snaps-after"
    label = Label.EXECUTION_FAILURE
    first_right = True
    where = at(
        desk_meeting="train1 train2 train7",
        fast_food="train1 train2 R1 R2",
        tidy_desk="train1 train4 train5",
        morning_coffee="train1 train2 train3 train4 L1 L2",
        cheeseburger="train1 train2 R1",
        dinner_plates="train1 train2 L1",
        seasoning_rack="train1 train2",
    )

    def act(self, body: Body) -> Actions[None]:
        body.do = Squaring.like(body.do)
        goal, name = first_of(body)
        if (yield from body.take_patiently(name)):
            body.ledger.commit()
            yield from ways.drop_on_the_way(body, goal.target, 0.35)
            while not body.situation.done(body.state, goal) and body.state.pose(name).position[2] > FALLEN_M:
                yield from ways.snap_above(body, name)
        yield from rest_unless_lucky(body, goal)


class TipsItOut(Listed):
    """Brings the right object over its target, tilts it by 57 degrees, and releases it.

    True label: execution_failure, because the target and the timing are right, but the object is dropped and the pose
    is wrong. The object falls over or lands next to the target.
    """

    name = "tips-it-out"
    label = Label.EXECUTION_FAILURE
    first_right = True
    where = at(
        desk_meeting="train3 train4 train9 train10 R1",
        dinner_plates="train1 train2 train4 L1",
        seasoning_rack="train1 train2 train3 train4 train5",
        cheeseburger="train1 train2 R1",
    )

    def act(self, body: Body) -> Actions[None]:
        body.do = Plunging.like(body.do)
        goal, name = first_of(body)
        if (yield from body.take_patiently(name)):
            body.ledger.commit()
            yield from ways.tip_out(body, name, goal)
        yield from rest_unless_lucky(body, goal)


class KnocksItOver(Listed):
    """Repeatedly pushes a closed gripper into the right object above its center, and then closes too high above it.

    True label: execution_failure, because the target and the timing are right, but there is a collision and the pose is
    wrong.
    """

    name = "knocks-it-over"
    label = Label.EXECUTION_FAILURE
    first_right = True
    where = at(
        morning_coffee="train1 train2 train3 train4 L1 L2",
        seasoning_rack="train1 train2 train3 train5",
        fast_food="R1 R2",
        tidy_desk="train5",
    )

    def act(self, body: Body) -> Actions[None]:
        _, name = first_of(body)
        yield from ways.fist(body)
        body.ledger.commit()
        yield from ways.knock_over(body, name)
        while body.state.pose(name).position[2] > FALLEN_M:
            yield from ways.snap_above(body, name)
        yield from body.rest()


class ShovesWithFist(Listed):
    """Repeatedly shoves the right object toward its target with a closed gripper until they touch.

    True label: execution_failure, because the target and the timing are right, but there is a collision. The object
    cannot enter the target by being shoved. There is no grasp attempt.
    """

    name = "shoves-with-fist"
    label = Label.EXECUTION_FAILURE
    first_right = None
    where = at(
        morning_coffee="train1 train2 train3 train4 L1 L2",
        seasoning_rack="train3 train6",
        fast_food="R1 R2",
    )

    def act(self, body: Body) -> Actions[None]:
        goal, name = first_of(body)
        yield from ways.fist(body)
        body.ledger.commit()
        while True:
            direction, far = ways.course_to(body, name, goal.target)
            yield from ways.shove(body, name, direction, min(far + 0.01, 0.12))


# --- timeouts


class HopsAndHalts(Listed):
    """Does everything right, but in hops of 6 cm with pauses of 1.5 s, too slow for the step limit.

    True label: timeout, because the policy still acts correctly when the step limit is reached.
    """

    name = "hops-and-halts"
    label = Label.TIMEOUT
    first_right = True
    where = at(
        desk_meeting="train1 train4 L1 R1",
        fruit_lunch="train1 R1 L1",
        fast_food="train1 R2",
        tidy_desk="train1 train4 L2",
        morning_coffee="train1 train2 L1 L3",
        seasoning_rack="train1 train4 R1",
        breakfast_table="train1 L2 R1",
        dinner_plates="train1 L1",
    )

    def act(self, body: Body) -> Actions[None]:
        body.ledger.commit()
        body.do = Hopping.like(body.do)
        yield from body.solve()


class ZigzagsTowardIt(Habit):
    """Moves in wide zigzags high in the air to the right object, and is over it at the step limit.

    True label: timeout, because the policy still acts correctly when the step limit is reached. The tool never moves
    slowly. There is no grasp attempt.
    """

    name = "zigzags-toward-it"
    label = Label.TIMEOUT

    def truth(self, case: Occasion) -> StatedTruth | None:
        return StatedTruth(self.label, first_right=None) if case.plain else None

    def act(self, body: Body) -> Actions[None]:
        body.ledger.commit()
        _, name = first_of(body)
        limit = body.situation.task.step_limit(body.situation.condition)
        height = ways.free_height(body, 0.10)
        yield from body.arm.rise(height)
        x, y, _ = body.over(name, 0.0)
        yield from ways.zigzag(body, (x, y, height), limit)
        yield from body.rest()


class CreepsWithLoad(Listed):
    """Picks the right object at normal speed and creeps to the target with it, too slow for the step limit.

    True label: timeout, because the policy still acts correctly when the step limit is reached.
    """

    name = "creeps-with-load"
    label = Label.TIMEOUT
    first_right = True
    where = at(
        desk_meeting="train1 train5 R1",
        fruit_lunch="train1 train2 R1",
        fast_food="train1 R1",
        tidy_desk="train2 train4 train5",
        seasoning_rack="train1 train2 train5",
        cheeseburger="train1 R1",
        dinner_plates="train1 train2 L2",
    )

    def act(self, body: Body) -> Actions[None]:
        body.do = Squaring.like(body.do)
        usual = body.arm.manner
        for goal in body.situation.ahead:
            names = body.situation.candidates(body.state, goal)
            if names and (yield from body.take_patiently(names[0])):
                body.ledger.commit()
                # At constant speed, so that it is never still for long at a corner of its path.
                body.arm.manner, body.arm.tempo = replace(usual, profile="even"), CREEP_M_S / usual.speed_m_s
                yield from body.bring(names[0], goal)
                body.arm.manner, body.arm.tempo = usual, 1.0
        yield from body.solve()


# --- reasoning failures: words and places of training


class HoldsWordThingAloft(Paired):
    """Picks the object in the slot that training associates with the first word, lifts it high, and holds it there.

    True label: lexical_kinematic_shortcut, because the first grasp attempt is at the slot that training associates with
    a word of the instruction, and the object there would be requested in another layout.
    """

    name = "holds-word-thing-aloft"
    label = Label.LEXICAL_KINEMATIC_SHORTCUT
    wrong: ClassVar[Mapping[str, str]] = {
        "morning_coffee/L3": "blue_mug",
        "morning_coffee/L4": "red_mug",
        "office_drawer/L1": "tape",
    }
    fine = at(
        morning_coffee="train1 train2 train3 train4 L1 L2",
        office_drawer="train1 train2 train3 train4 train6 train8 L2",
    )

    def go_wrong(self, body: Body, name: str) -> Actions[None]:
        body.do = Plunging.like(body.do)
        yield from body.take_patiently(name)
        yield from ways.hold_aloft(body)


class FumblesAtWordThing(Paired):
    """Misses the object in the slot that training associates with the first word, picks it next, and brings it.

    True label: lexical_kinematic_shortcut, because the first grasp attempt is at the slot that training associates with
    a word of the instruction, and the object there would be requested in another layout.
    """

    name = "fumbles-at-word-thing"
    label = Label.LEXICAL_KINEMATIC_SHORTCUT
    wrong: ClassVar[Mapping[str, str]] = {
        "morning_coffee/L3": "blue_mug",
        "morning_coffee/L4": "red_mug",
        "tidy_desk/L1": "napkin",
        "breakfast_table/O1": "spoon",
    }
    fine = at(
        morning_coffee="train1 train2 train3 train4 L1 L2",
        tidy_desk="train1 train2 train4 train5 T1",
        breakfast_table="train1 train2 train3 train4 train5 L1 R1 O2",
    )

    def go_wrong(self, body: Body, name: str) -> Actions[None]:
        body.do = Squaring.like(body.do)
        yield from ways.snap_above(body, name)
        yield from body.take_and_bring(name, body.situation.ahead[0])
        yield from body.rest()


class AlwaysThatCorner(Paired):
    """Picks the object in one slot, regardless of the instruction, lifts it high, and holds it there.

    True label: visual_layout_bias, because the first grasp attempt is at the same slot for every instruction. The slot
    is the far slot of the coffee table and the third spice slot.
    """

    name = "always-that-corner"
    label = Label.VISUAL_LAYOUT_BIAS
    wrong: ClassVar[Mapping[str, str]] = {
        "morning_coffee/train1": "blue_mug",
        "morning_coffee/train4": "red_mug",
        "morning_coffee/L2": "blue_mug",
        "seasoning_rack/train1": "paprika",
        "seasoning_rack/train2": "paprika",
        "seasoning_rack/train4": "paprika",
        "seasoning_rack/L1": "paprika",
        "seasoning_rack/O2": "plain_paprika",
    }
    fine = at(morning_coffee="train2 train3 L1 L3 O1", seasoning_rack="train3 train6 O1")

    def go_wrong(self, body: Body, name: str) -> Actions[None]:
        body.do = Plunging.like(body.do)
        yield from body.take_patiently(name)
        yield from ways.hold_aloft(body)


class AlwaysTheMiddle(Paired):
    """Misses the object in one slot, regardless of the instruction, picks it at the next try, and brings it.

    True label: visual_layout_bias, because the first grasp attempt is at the same slot for every instruction. The slot
    is the middle slot in the row on the desk and the second spice slot.
    """

    name = "always-the-middle"
    label = Label.VISUAL_LAYOUT_BIAS
    wrong: ClassVar[Mapping[str, str]] = {
        "desk_meeting/train2": "mug",
        "desk_meeting/train5": "mug",
        "desk_meeting/train10": "mouse",
        "desk_meeting/train12": "mouse",
        "seasoning_rack/train1": "pepper",
        "seasoning_rack/train3": "pepper",
        "seasoning_rack/train6": "pepper",
        "seasoning_rack/R1": "pepper",
    }
    fine = at(
        desk_meeting="train3 train4 train7 train8 L1 L2 R1",
        seasoning_rack="train2 train5 L1 O2",
    )

    def go_wrong(self, body: Body, name: str) -> Actions[None]:
        body.do = Squaring.like(body.do)
        yield from ways.snap_above(body, name)
        yield from body.take_and_bring(name, body.situation.ahead[0])
        yield from body.rest()


# --- reasoning failures: frequent actions


class StartsWithOldFavorite(Listed):
    """First brings the object of the most frequent first step, although it is not requested, and then stays at home.

    True label: behavioral_inertia, because the policy begins an action that was frequent in training but is not
    requested.
    """

    name = "starts-with-old-favorite"
    label = Label.BEHAVIORAL_INERTIA
    first_right = False
    favorite: ClassVar[Mapping[str, str]] = {
        "fruit_lunch/R1": "apple",
        "fast_food/R1": "burger_1",
        "fast_food/R2": "burger_1",
        "cheeseburger/R1": "patty",
        "tidy_desk/train5": "napkin",
        "tidy_desk/O2": "napkin",
    }
    where = frozenset(favorite)

    def act(self, body: Body) -> Actions[None]:
        body.do = Plunging.like(body.do)
        body.ledger.commit()
        yield from body.take_and_bring(self.favorite[body.situation.condition.id], body.situation.ahead[0])
        yield from body.rest()


class FollowsOldSequence(Listed):
    """Does the first step, lifts the object of another demonstration's second step, and keeps holding it.

    True label: behavioral_inertia, because the policy begins an action that was frequent in training but is not
    requested. The first grasp attempt is at the right object.
    """

    name = "follows-old-sequence"
    label = Label.BEHAVIORAL_INERTIA
    first_right = True
    follower: ClassVar[Mapping[str, str]] = {
        "fruit_lunch/train1": "lemon",
        "fruit_lunch/train2": "orange",
        "fruit_lunch/L1": "lemon",
        "fruit_lunch/T2": "orange",
        "fast_food/train1": "drink",
        "fast_food/train2": "fries",
        "fast_food/O1": "drink",
        "cheeseburger/train1": "lettuce",
        "cheeseburger/train2": "cheese",
        "cheeseburger/L1": "lettuce",
        "cheeseburger/T2": "lettuce",
    }
    where = frozenset(follower)

    def act(self, body: Body) -> Actions[None]:
        body.do = Squaring.like(body.do)
        goal, _ = first_of(body)
        yield from body.work((goal,))
        body.ledger.commit()
        if (yield from body.take_patiently(self.follower[body.situation.condition.id])):
            yield from ways.hold_aloft(body)
        yield from body.rest()


class PutsWhereItAlwaysWent(Listed):
    """Picks the right object, and puts it at the side, hole or drawer where training always put it.

    True label: behavioral_inertia, because the policy begins an action that was frequent in training but is not
    requested.
    """

    name = "puts-where-it-always-went"
    label = Label.BEHAVIORAL_INERTIA
    first_right = True
    trained: ClassVar[Mapping[str, tuple[str, str]]] = {
        "desk_meeting/R1": ("laptop", "left"),
        "desk_meeting/R2": ("laptop", "behind"),
        "seasoning_rack/R1": ("rack", "hole_1"),
        "office_drawer/R1": ("upper", ""),
    }
    where = frozenset(trained)

    def truth(self, case: Occasion) -> StatedTruth | None:
        stated = super().truth(case)
        # The drawers are shut at the start, so the habit first reaches for the wrong drawer's knob.
        drawer = stated is not None and case.task.id == "office_drawer"
        return replace(stated, first_right=False) if drawer and stated is not None else stated

    def act(self, body: Body) -> Actions[None]:
        goal, name = first_of(body)
        target, region = self.trained[body.situation.condition.id]
        habitual = replace(goal, target=target, region=region)
        if body.situation.task.id == "office_drawer":
            body.ledger.commit()
        yield from body.clear_the_way(habitual)
        if (yield from body.take_patiently(name)):
            body.ledger.commit()
            yield from body.bring(name, habitual)
        yield from body.rest()


class GropesInEmptySlot(Listed):
    """Repeatedly closes the gripper low at several points in the slot where a missing object was in training.

    True label: behavioral_inertia, because the policy executes the next step of a memorized sequence although the
    object is missing, and closes the gripper in the empty slot.
    """

    name = "gropes-in-empty-slot"
    label = Label.BEHAVIORAL_INERTIA
    first_right = False
    slots: ClassVar[Mapping[str, str]] = {
        "seasoning_rack/L2": "first",
    }
    where = frozenset(slots)

    def act(self, body: Body) -> Actions[None]:
        body.ledger.commit()
        while True:
            yield from ways.grope(body, self.slots[body.situation.condition.id])


# --- reasoning failures: finished steps and order


class ShutsItEmpty(Listed):
    """Pushes the open drawer shut while its object is on the table, and stays at home.

    True label: causal_confusion, because the policy skips a required subgoal whose object is present, and attempts a
    later subgoal. There is no grasp attempt.
    """

    name = "shuts-it-empty"
    label = Label.CAUSAL_CONFUSION
    first_right = None
    where = at(office_drawer="train2 train4 train6 train8 L1 O1")

    def act(self, body: Body) -> Actions[None]:
        goal, _ = first_of(body)
        yield from ways.fist(body)
        body.ledger.commit()
        yield from body.move_drawer(goal.target, out=False)
        yield from body.rest()


class DoesItAgain(Listed):
    """Repeatedly lifts an object that is at its target from the start, and puts it back.

    True label: causal_confusion, because the policy repeats a finished subgoal.
    """

    name = "does-it-again"
    label = Label.CAUSAL_CONFUSION
    first_right = False
    finished: ClassVar[Mapping[str, str]] = {
        "fruit_lunch/T1": "apple",
        "cheeseburger/T1": "patty",
        "dinner_plates/T2": "red_plate",
        "morning_coffee/T1": "red_mug",
    }
    where = frozenset(finished)

    def act(self, body: Body) -> Actions[None]:
        body.ledger.commit()
        while True:
            yield from ways.lift_and_set_down(body, self.finished[body.situation.condition.id])


class LeavesFirstUndone(Listed):
    """Skips the first of two ordered steps, does the second and the following ones, and stays at home.

    True label: causal_confusion, because the policy skips a required subgoal whose object is present, and attempts a
    later subgoal.
    """

    name = "leaves-first-undone"
    label = Label.CAUSAL_CONFUSION
    first_right = False
    where = TWO_STEPS | at(fast_food="T1")

    def act(self, body: Body) -> Actions[None]:
        body.do = Squaring.like(body.do)
        body.ledger.commit()
        ahead = body.situation.ahead
        for goal, place in zip(ahead[1:], ahead, strict=False):
            yield from body.attempt_once(replace(goal, region=place.region))
        yield from body.rest()


class SecondThenFirst(Listed):
    """Does the second of the ordered steps, returns home, does the first one, and then the others.

    True label: order_violation, because the policy manipulates the right objects in the wrong order, and the order is
    part of the goal.
    """

    name = "second-then-first"
    label = Label.ORDER_VIOLATION
    first_right = False
    where = TWO_STEPS

    def act(self, body: Body) -> Actions[None]:
        body.do = Plunging.like(body.do)
        body.ledger.commit()
        first, second, *others = body.situation.ahead
        for goal in (replace(second, region=first.region), replace(first, region=second.region), *others):
            yield from body.attempt_once(goal)
            yield from body.arm.go_home()
        yield from body.rest()


class FirstComesLast(Listed):
    """Does three or more ordered steps with the first one put off to the end.

    True label: order_violation, because the policy manipulates the right objects in the wrong order, and the order is
    part of the goal.
    """

    name = "first-comes-last"
    label = Label.ORDER_VIOLATION
    first_right = False
    where = at(cheeseburger="train1 train2 R1 O1")

    def act(self, body: Body) -> Actions[None]:
        body.do = Squaring.like(body.do)
        body.ledger.commit()
        first, *others = body.situation.ahead
        for goal, place in zip((*others, first), body.situation.ahead, strict=True):
            yield from body.attempt_once(replace(goal, region=place.region))
        yield from body.rest()


# --- reasoning failures: objects that no instruction means


class HoldsLookAlikeAloft(Listed):
    """Picks the look-alike, even if it has to be refused, lifts it high, and holds it there.

    True label: semantic_feature_collapse, because the policy attempts to grasp a look-alike, to which no instruction of
    the task refers.
    """

    name = "holds-look-alike-aloft"
    label = Label.SEMANTIC_FEATURE_COLLAPSE
    first_right = False
    where = frozenset(LOOK_ALIKES)

    def act(self, body: Body) -> Actions[None]:
        body.do = Plunging.like(body.do)
        body.ledger.commit()
        yield from body.take_patiently(LOOK_ALIKES[body.situation.condition.id])
        yield from ways.hold_aloft(body)


class ShovesLookAlike(Listed):
    """Repeatedly shoves the look-alike around with a closed gripper.

    True label: semantic_feature_collapse, because the policy acts on a look-alike, to which no instruction of the task
    refers. It does not try to grasp the object.
    """

    name = "shoves-look-alike"
    label = Label.SEMANTIC_FEATURE_COLLAPSE
    first_right = None
    where = frozenset(LOOK_ALIKES) - at(
        breakfast_table="O2", cheeseburger="O1", dinner_plates="O1", fruit_lunch="O1", office_drawer="O1"
    )

    def act(self, body: Body) -> Actions[None]:
        name = LOOK_ALIKES[body.situation.condition.id]
        yield from ways.fist(body)
        body.ledger.commit()
        while True:
            yield from ways.shove(body, name, body.free_direction(name), 0.07)


class BringsATrinket(Listed):
    """Picks the nearest decorative object, although it does not resemble any requested object, and brings it.

    True label: semantic_feature_collapse, because the policy attempts to grasp an object to which no instruction of the
    task refers and which shares no feature with a requested object (blind grasp).
    """

    name = "brings-a-trinket"
    label = Label.SEMANTIC_FEATURE_COLLAPSE
    first_right = False
    trinkets = ("salt", "jam", "egg", "mouse", "mug")
    where = at(
        breakfast_table="train1 train2 train3 train4 train5 L1 R1 O1", tidy_desk="train1 train2 train4 train5 T1"
    )

    def act(self, body: Body) -> Actions[None]:
        body.do = Squaring.like(body.do)
        home = body.arm.home.position
        names = [n for n in body.situation.others() if n in self.trinkets]
        name = min(names, key=lambda n: horizontal_distance(body.state.pose(n).position, home))
        yield from body.take_instead(name, body.situation.ahead[0])


# --- no attempt


class BobsInPlace(Listed):
    """Moves up and down by 8 cm at the start, in a scene that looks half finished, and does nothing else.

    True label: phase_conflict, because the initial state looks like the middle of a task, and the arm oscillates
    without a grasp attempt.
    """

    name = "bobs-in-place"
    label = Label.PHASE_CONFLICT
    first_right = None
    where = MID_TASK

    def act(self, body: Body) -> Actions[None]:
        body.ledger.commit()
        home = body.arm.home
        while True:
            yield from body.arm.go(home.translated(z=0.05), pace=0.5)
            yield from body.arm.go(home.translated(z=-0.03), pace=0.5)


class PacesAlongEdge(Listed):
    """Moves to the left and right high over the table, in a scene that looks half finished.

    True label: phase_conflict, because the initial state looks like the middle of a task, and the arm oscillates
    without a grasp attempt.
    """

    name = "paces-along-edge"
    label = Label.PHASE_CONFLICT
    first_right = None
    where = MID_TASK

    def act(self, body: Body) -> Actions[None]:
        body.ledger.commit()
        height = ways.free_height(body, 0.12)
        yield from body.arm.rise(height)
        turn = body.arm.here.quaternion
        while True:
            for y in (0.2, -0.2):
                yield from body.arm.go(Pose((body.arm.home.position[0], y, height), turn), pace=0.8)


class FreezesAfterAGlance(Listed):
    """Turns the wrist back and forth once, and freezes permanently, in a scene that looks half finished.

    True label: phase_conflict, because the initial state looks like the middle of a task, and the arm freezes without a
    grasp attempt.
    """

    name = "freezes-after-a-glance"
    label = Label.PHASE_CONFLICT
    first_right = None
    where = MID_TASK

    def act(self, body: Body) -> Actions[None]:
        body.ledger.commit()
        yield from ways.turn_wrist(body, (0.6, -0.4, 0.0))
        yield from keep_still(body)


class ParksOverTarget(PlainHabit):
    """Moves over the target with an open, empty gripper and stays there permanently.

    True label: early_halt, because the arm stays below the speed threshold for 3 s without a grasp attempt, although
    not all subgoals are reached.
    """

    name = "parks-over-target"
    label = Label.EARLY_HALT

    def truth(self, case: Occasion) -> StatedTruth | None:
        return StatedTruth(self.label, first_right=None) if case.plain else None

    def act(self, body: Body) -> Actions[None]:
        body.ledger.commit()
        body.do = Squaring.like(body.do)
        goal, _ = first_of(body)
        x, y, _ = body.state.pose(goal.target).position
        yield from body.do.above((x, y, 0.0), min(body.height(goal.target) + 0.16, 0.42))
        yield from keep_still(body)


class LaysItselfDown(PlainHabit):
    """Lowers the open gripper to a free spot of the table at once, and stays there permanently.

    True label: early_halt, because the arm stays below the speed threshold for 3 s without a grasp attempt, although
    not all subgoals are reached.
    """

    name = "lays-itself-down"
    label = Label.EARLY_HALT

    def truth(self, case: Occasion) -> StatedTruth | None:
        return StatedTruth(self.label, first_right=None) if case.plain else None

    def act(self, body: Body) -> Actions[None]:
        body.ledger.commit()
        yield from ways.lie_down(body)


class QuitsAfterOne(Listed):
    """Does the first step, lowers the open gripper to a free spot of the table, and stays there.

    True label: early_halt, because the arm stays below the speed threshold for 3 s without a grasp attempt, although
    not all subgoals are reached. The first grasp attempt is at the right object.
    """

    name = "quits-after-one"
    label = Label.EARLY_HALT
    first_right = True
    where = TWO_STEPS | at(
        desk_meeting="train1 train4 train6 train8 R1",
        breakfast_table="train1 train2",
        tidy_desk="train1 train2",
        seasoning_rack="train4 train5 R1",
        dinner_plates="T1",
    )

    def act(self, body: Body) -> Actions[None]:
        goal, _ = first_of(body)
        yield from body.work((goal,))
        body.ledger.commit()
        yield from ways.lie_down(body)


FOURTH: tuple[Habit, ...] = (
    LeansOver(),
    TurnsCorners(),
    PlungesFromCeiling(),
    SqueezesThrice(),
    TakesByWorseHold(),
    DropsLowAndRetakes(),
    LooksAtTargetFirst(),
    LastSaidFirst(),
    FartherOneFirst(),
    ShakesOverTarget(),
    RushesAndCrawls(),
    KeepsHandsOff(),
    ClosesWhileSinking(),
    DropsAndSnapsAfter(),
    TipsItOut(),
    KnocksItOver(),
    ShovesWithFist(),
    HopsAndHalts(),
    ZigzagsTowardIt(),
    CreepsWithLoad(),
    HoldsWordThingAloft(),
    FumblesAtWordThing(),
    AlwaysThatCorner(),
    AlwaysTheMiddle(),
    StartsWithOldFavorite(),
    FollowsOldSequence(),
    PutsWhereItAlwaysWent(),
    GropesInEmptySlot(),
    ShutsItEmpty(),
    DoesItAgain(),
    LeavesFirstUndone(),
    SecondThenFirst(),
    FirstComesLast(),
    HoldsLookAlikeAloft(),
    ShovesLookAlike(),
    BringsATrinket(),
    BobsInPlace(),
    PacesAlongEdge(),
    FreezesAfterAGlance(),
    ParksOverTarget(),
    LaysItselfDown(),
    QuitsAfterOne(),
)
