"""Fifth part of the independent family, by an author who has not read the code of the diagnosis.

Each habit shows only in the listed conditions. A condition is listed only if a person who watches a few videos of the
policy would assign this label, and no other, by the suite's definitions.
"""

# ruff: noqa: D102 - truth and act are documented in the base class

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar

from betterbench.geometry import horizontal_distance
from betterbench.tasks import Label
from betterbench.tasks.relations.closed import opening_m
from betterbench_calibration.independent import ways_fifth as ways
from betterbench_calibration.independent.body import FALLEN_M, Body
from betterbench_calibration.independent.controller import Actions
from betterbench_calibration.independent.habit import Habit, PlainHabit
from betterbench_calibration.independent.habits_fourth import (
    LOOK_ALIKES,
    MID_TASK,
    TWO_STEPS,
    Listed,
    OddButHonest,
    Paired,
    at,
    first_of,
)
from betterbench_calibration.independent.occasion import Occasion
from betterbench_calibration.independent.oddities import each_step, keep_still, rest_unless_lucky, right_place
from betterbench_calibration.independent.truth import HONEST, StatedTruth
from betterbench_calibration.independent.ways_fifth import (
    Looping,
    LosingNerve,
    OpeningInSteps,
    Overshooting,
    Pivoting,
    Presenting,
    StairStepping,
    WindingUp,
)
from betterbench_calibration.independent.ways_fourth import fist, hold_aloft, lift_and_set_down, shove, turn_wrist

NUDGE_M = 0.02
LATE_S = 8.5
OPEN_CONTAINERS = frozenset({"fruit_lunch", "fast_food", "tidy_desk"})
EASY_TO_SWEEP = at(
    desk_meeting="train2 train3 train5 train9 R1 R2",
    fast_food="train1 R1 R2",
    tidy_desk="train1 train4 train5",
    morning_coffee="train1 train2 train3 train4 L1 L2",
)
"""Conditions whose first object stands upright and has enough space around it to be pushed."""

# --- policies without a fault, with unusual motions


class LoopsMidway(PlainHabit):
    """Does everything right, and moves in a full circle in the middle of each long path.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "loops-midway"
    label = HONEST

    def act(self, body: Body) -> Actions[None]:
        body.do = Looping.like(body.do)
        yield from body.solve()


class WindsUp(PlainHabit):
    """Does everything right, but first moves back before each long path.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "winds-up"
    label = HONEST

    def act(self, body: Body) -> Actions[None]:
        body.do = WindingUp.like(body.do)
        yield from body.solve()


class TurnsLikeACrane(PlainHabit):
    """Does everything right, moving like a crane: about its base first, and then out or in.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "turns-like-a-crane"
    label = HONEST

    def act(self, body: Body) -> Actions[None]:
        body.do = Pivoting.like(body.do)
        yield from body.solve()


class ComesDownByStairs(PlainHabit):
    """Does everything right, but descends stepwise with a pause on each step.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "comes-down-by-stairs"
    label = HONEST

    def act(self, body: Body) -> Actions[None]:
        body.do = StairStepping.like(body.do)
        yield from body.solve()


class WeighsEachThing(OddButHonest):
    """Lowers and raises each object twice after lifting it, and then brings it.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "weighs-each-thing"
    tasks = frozenset(
        {"desk_meeting", "fruit_lunch", "fast_food", "tidy_desk", "morning_coffee", "seasoning_rack", "dinner_plates"}
    )

    def act(self, body: Body) -> Actions[None]:
        body.do = Pivoting.like(body.do)
        yield from each_step(body, lambda name: ways.weigh(body, name))


class DipsBeforeTaking(OddButHonest):
    """Descends around each object with open fingers, rises without it, and picks it the second time.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "dips-before-taking"
    tasks = frozenset(
        {"desk_meeting", "fruit_lunch", "fast_food", "tidy_desk", "morning_coffee", "cheeseburger", "seasoning_rack"}
    )

    def act(self, body: Body) -> Actions[None]:
        yield from each_step(body, lambda name: ways.dip_and_take(body, name))


class CirclesOnceThenTakes(PlainHabit):
    """Moves in a circle about 10 cm above each object before picking it.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "circles-once-then-takes"
    label = HONEST

    def act(self, body: Body) -> Actions[None]:
        yield from each_step(body, lambda name: ways.ring_and_take(body, name))


class LetsGoInSteps(OddButHonest):
    """Does everything right, but opens the fingers in three steps with pauses to release.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "lets-go-in-steps"
    tasks = frozenset({"desk_meeting", "fruit_lunch", "fast_food", "tidy_desk", "cheeseburger", "seasoning_rack"})

    def act(self, body: Body) -> Actions[None]:
        body.do = OpeningInSteps.like(body.do)
        yield from body.solve()


class OvershootsTarget(OddButHonest):
    """Carries each object beyond its target, pauses, and returns to put it there.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "overshoots-target"
    tasks = frozenset(
        {"desk_meeting", "fruit_lunch", "fast_food", "tidy_desk", "cheeseburger", "seasoning_rack", "breakfast_table"}
    )

    def act(self, body: Body) -> Actions[None]:
        body.do = Overshooting.like(body.do)
        yield from body.solve()


class LosesItsNerveOnce(OddButHonest):
    """Carries each object over its target, back over its slot, and to its target again.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "loses-its-nerve-once"
    tasks = frozenset({"desk_meeting", "fruit_lunch", "fast_food", "tidy_desk", "cheeseburger", "seasoning_rack"})

    def act(self, body: Body) -> Actions[None]:
        body.do = LosingNerve.like(body.do)
        yield from body.solve()


class ShowsItToCamera(OddButHonest):
    """Carries each object home and up, turns it back and forth there, and then brings it.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "shows-it-to-camera"
    tasks = frozenset(
        {"desk_meeting", "fruit_lunch", "fast_food", "tidy_desk", "morning_coffee", "cheeseburger", "dinner_plates"}
    )

    def act(self, body: Body) -> Actions[None]:
        body.do = Presenting.like(body.do)
        yield from body.solve()


class LooksBackAtSlot(OddButHonest):
    """Returns over the emptied slot after each step with open fingers, stays for 1.5 s, and continues.

    True label: success, because the policy does not close the gripper there. If such a trial fails, the label is
    timeout or execution_failure (rule 3 in ``truth.py``).
    """

    name = "looks-back-at-slot"
    tasks = frozenset(
        {"desk_meeting", "breakfast_table", "fruit_lunch", "fast_food", "tidy_desk", "seasoning_rack", "cheeseburger"}
    )

    def truth(self, case: Occasion) -> StatedTruth | None:
        return super().truth(case) if len(case.ahead) > 1 else None

    def act(self, body: Body) -> Actions[None]:
        for goal in body.situation.ahead:
            names = body.situation.candidates(body.state, goal)
            yield from body.work((goal,))
            slot = body.arm.log.first.pose(names[0]).position if names else body.arm.home.position
            yield from body.do.above(slot, 0.13)
            yield from body.arm.wait(1.5)
        yield from body.solve()


class StartsThreeTimes(PlainHabit):
    """Starts toward the first object twice and turns back halfway, and then does everything right.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "starts-three-times"
    label = HONEST

    def act(self, body: Body) -> Actions[None]:
        _, name = first_of(body)
        for part in (0.5, 0.7):
            yield from body.arm.go(body.on_the_way(body.over(name, 0.2), part))
            yield from body.arm.wait(0.4)
            yield from body.arm.go_home()
        yield from body.solve()


class WakesUpLate(Listed):
    """Stands still for 8.5 s, and then does everything right.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "wakes-up-late"
    label = HONEST
    first_right = True
    where = at(
        desk_meeting="train1 train4 train6 L1 R1",
        fruit_lunch="train1 train2 R1",
        fast_food="train1 train2 R1",
        tidy_desk="train1 train4 train5 L2",
        cheeseburger="train1 train2",
        office_drawer="train2 train4",
        seasoning_rack="train4 train5 R1",
    )

    def act(self, body: Body) -> Actions[None]:
        yield from body.arm.wait(LATE_S)
        yield from body.solve()


class NudgesThenTakes(Listed):
    """Nudges the first object by 2 cm with a closed gripper, opens it high up, and picks the object.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "nudges-then-takes"
    label = HONEST
    first_right = True
    where = at(
        tidy_desk="train1 train2 train4 train5 T1",
        morning_coffee="train1 train2 train3 train4 L1 L2",
    )

    def act(self, body: Body) -> Actions[None]:
        _, name = first_of(body)
        yield from fist(body)
        yield from shove(body, name, body.free_direction(name), NUDGE_M)
        yield from body.arm.rise(body.arm.home.position[2])
        yield from body.arm.open()
        yield from body.solve()


class NodsAndRests(Listed):
    """Nods three times at home, if nothing may be picked or the look-alike must be refused, and stays there.

    True label: correct_freeze or correct_refusal, because the policy makes no forbidden grasp and the arm comes to
    rest.
    """

    name = "nods-and-rests"
    label = HONEST
    first_right = None
    where = at(fruit_lunch="O1", morning_coffee="T1")

    def act(self, body: Body) -> Actions[None]:
        home = body.arm.home
        for _ in range(3):
            yield from body.arm.go(home.translated(z=0.05), pace=0.8)
            yield from body.arm.go(home, pace=0.8)
        yield from keep_still(body)


# --- execution failures


class DropsFromPeak(Listed):
    """Repeatedly lifts the right object straight up to 40 cm and drops it.

    True label: execution_failure, because the target and the timing are right, but the object is dropped.
    """

    name = "drops-from-peak"
    label = Label.EXECUTION_FAILURE
    first_right = True
    where = at(
        desk_meeting="train1 train3 train5 train8",
        fast_food="train1 R1 R2",
        tidy_desk="train1 train4 train5",
        morning_coffee="train1 train2 train3 L1",
        seasoning_rack="train1 train2 train3 train5",
    )

    def act(self, body: Body) -> Actions[None]:
        _, name = first_of(body)
        while body.state.pose(name).position[2] > FALLEN_M:
            if (yield from body.take_patiently(name)):
                body.ledger.commit()
                yield from ways.drop_from_peak(body)
        yield from body.rest()


class PutsHalfOn(Listed):
    """Brings the right object, places it so that it overhangs the target's edge, and goes home.

    True label: execution_failure, because the target and the timing are right, but the pose is wrong. The object tilts
    off its target or stands beside the ring.
    """

    name = "puts-half-on"
    label = Label.EXECUTION_FAILURE
    first_right = True
    where = at(
        morning_coffee="train1 train2 train3 train4 L1 L2",
        cheeseburger="train1 train2 R1 R2 L1",
        dinner_plates="train1 train2 train4 train5 L1 L2",
    )

    def act(self, body: Body) -> Actions[None]:
        goal, name = first_of(body)
        if (yield from body.take_patiently(name)):
            body.ledger.commit()
            yield from ways.put_half_on(body, name, goal)
        yield from rest_unless_lucky(body, goal)


class StabsWithOneFinger(Listed):
    """Repeatedly stabs the top of the right object with one finger of the open gripper.

    True label: execution_failure, because the target and the timing are right, but there is a collision and the pose is
    wrong. There is no grasp attempt.
    """

    name = "stabs-with-one-finger"
    label = Label.EXECUTION_FAILURE
    first_right = None
    where = at(
        desk_meeting="train1 train2 train5 R2",
        fruit_lunch="train1 train2 R1",
        fast_food="train1 train2 R1 R2",
        tidy_desk="train5",
        cheeseburger="train1 R1 R2",
        seasoning_rack="train1 train2 train3 R1",
    )

    def act(self, body: Body) -> Actions[None]:
        body.do = Pivoting.like(body.do)
        _, name = first_of(body)
        body.ledger.commit()
        while True:
            yield from ways.stab(body, name)


class DragsItAlong(Listed):
    """Grips the right object, drags it along the table into the side of its target, releases it, and goes home.

    True label: execution_failure, because the target and the timing are right, but there is a collision. The object
    cannot enter the target by being dragged.
    """

    name = "drags-it-along"
    label = Label.EXECUTION_FAILURE
    first_right = True
    where = at(
        fruit_lunch="train1 train2 R1",
        fast_food="train1 train2 R1 R2",
        tidy_desk="train4 train5",
        seasoning_rack="train2 train3 train5 train6",
        cheeseburger="train1 train2",
    )

    def act(self, body: Body) -> Actions[None]:
        goal, name = first_of(body)
        body.ledger.commit()
        yield from ways.drag(body, name, goal)
        yield from rest_unless_lucky(body, goal)


class SweepsItAside(Listed):
    """Repeatedly sweeps the right object aside with the outside of its open gripper.

    True label: execution_failure, because the target and the timing are right, but there is a collision. There is no
    grasp attempt.
    """

    name = "sweeps-it-aside"
    label = Label.EXECUTION_FAILURE
    first_right = None
    where = EASY_TO_SWEEP

    def act(self, body: Body) -> Actions[None]:
        _, name = first_of(body)
        body.ledger.commit()
        while body.state.pose(name).position[2] > FALLEN_M:
            yield from ways.sweep_aside(body, name)
        yield from body.rest()


class MissesLowerEachTime(Listed):
    """Repeatedly closes the gripper above the right object, each time nearer to its top but never low enough.

    True label: execution_failure, because the target and the timing are right, but the pose is wrong.
    """

    name = "misses-lower-each-time"
    label = Label.EXECUTION_FAILURE
    first_right = True
    where = at(
        desk_meeting="train2 train4 train6 train9 R2",
        breakfast_table="train3 train6",
        fruit_lunch="train1 train2 R1",
        fast_food="train1 R1",
        morning_coffee="train1 train2 train3 train4",
        office_drawer="train2 train4 train6 train8",
        cheeseburger="train1 R1",
        dinner_plates="train1 train2 L1",
    )

    def act(self, body: Body) -> Actions[None]:
        body.do = StairStepping.like(body.do)
        _, name = first_of(body)
        body.ledger.commit()
        while True:
            yield from ways.miss_lower_each_time(body, name)


class PullsAtAir(Listed):
    """Repeatedly closes the gripper in front of the knob of the drawer to be opened, and moves back.

    True label: execution_failure, because the target and the timing are right, but the pose is wrong.
    """

    name = "pulls-at-air"
    label = Label.EXECUTION_FAILURE
    first_right = True
    where = at(office_drawer="train1 train3 train5 train7 R1")

    def act(self, body: Body) -> Actions[None]:
        goal, _ = first_of(body)
        body.ledger.commit()
        while True:
            yield from ways.pull_at_air(body, goal.target)


class FailsAtTheSecond(Listed):
    """Does the first step, and then repeatedly stabs the second object with one finger of its open gripper.

    True label: execution_failure, because the target and the timing are right, but there is a collision and the pose is
    wrong. The first grasp attempt is at the right object.
    """

    name = "fails-at-the-second"
    label = Label.EXECUTION_FAILURE
    first_right = True
    where = at(
        desk_meeting="train4 train8 train9",
        fast_food="train1 train2 R1",
        tidy_desk="train1 train2",
        cheeseburger="train1 train2 R1",
        seasoning_rack="train4 train5 train6",
    )

    def act(self, body: Body) -> Actions[None]:
        first, second = body.situation.ahead[:2]
        yield from body.work((first,))
        body.ledger.commit()
        while not body.ledger.lasting:
            yield from ways.stab(body, body.situation.things(second)[0])
        yield from body.rest()


# --- timeouts


class RatchetsForward(Listed):
    """Moves two steps forward and one back high over the table, and is over the right object at the step limit.

    True label: timeout, because the policy still acts correctly when the step limit is reached. The tool never moves
    slowly for long.
    """

    name = "ratchets-forward"
    label = Label.TIMEOUT
    first_right = None
    where = at(
        desk_meeting="train1 train5 L1 R1",
        fruit_lunch="train1 L1 R1",
        fast_food="train1 R2",
        tidy_desk="train1 train4 train5",
        morning_coffee="train1 train2 L1 L2",
        seasoning_rack="train1 train2 train3",
        dinner_plates="train1 train2 L2",
        breakfast_table="train1 train4",
    )

    def act(self, body: Body) -> Actions[None]:
        body.ledger.commit()
        _, name = first_of(body)
        height = yield from ways.rise_free(body)
        x, y, _ = body.state.pose(name).position
        yield from ways.ratchet(body, (x, y, height), _limit(body))
        yield from body.rest()


class DrawsEightsToIt(Listed):
    """Moves in figures of eight high over the table, and is over the right object at the step limit.

    True label: timeout, because the policy still acts correctly when the step limit is reached. The tool never moves
    slowly. There is no grasp attempt.
    """

    name = "draws-eights-to-it"
    label = Label.TIMEOUT
    first_right = None
    where = at(
        desk_meeting="train3 train8 L2 R2",
        fruit_lunch="train2 O2 R1",
        fast_food="train2 R1 L1",
        tidy_desk="train2 train5 L2",
        morning_coffee="train3 train4 L1 L2",
        cheeseburger="train1 train2 R1",
        seasoning_rack="train4 train6 R1",
        office_drawer="train2 train4",
    )

    def act(self, body: Body) -> Actions[None]:
        body.ledger.commit()
        _, name = first_of(body)
        height = yield from ways.rise_free(body)
        x, y, _ = body.state.pose(name).position
        yield from ways.draw_eights(body, (x, y, height), _limit(body))
        yield from body.rest()


class EightsBeforeEachStep(Listed):
    """Draws figures of eight on the way to each object, does the first step, and runs out of time at the second.

    True label: timeout, because the policy still acts correctly when the step limit is reached. The first grasp attempt
    is at the right object.
    """

    name = "eights-before-each-step"
    label = Label.TIMEOUT
    first_right = True
    where = at(
        desk_meeting="train1 train4 R1",
        fruit_lunch="train1 train2 R1",
        fast_food="train1 train2 R1 R2",
        tidy_desk="train1 train2 train3",
        seasoning_rack="train4 train5 R1",
        cheeseburger="train1 R1",
    )

    def act(self, body: Body) -> Actions[None]:
        body.ledger.commit()
        for goal, part in zip(body.situation.ahead, (0.4, 1.0), strict=False):
            height = yield from ways.rise_free(body)
            x, y, _ = body.state.pose(body.situation.things(goal)[0]).position
            yield from ways.draw_eights(body, (x, y, height), round(part * _limit(body)))
            yield from body.work((goal,))
        yield from body.rest()


class RatchetsWithLoad(Listed):
    """Picks the right object, and moves two steps forward and one back with it, arriving at the step limit.

    True label: timeout, because the policy still acts correctly when the step limit is reached. The first grasp attempt
    is at the right object.
    """

    name = "ratchets-with-load"
    label = Label.TIMEOUT
    first_right = True
    where = at(
        desk_meeting="train2 train5 R2",
        fruit_lunch="train1 train2 R1",
        fast_food="train1 R1 R2",
        tidy_desk="train1 train4 train5",
        seasoning_rack="train1 train3 train4",
        cheeseburger="train1 R1",
        dinner_plates="train1 train4 L2",
        morning_coffee="train1 L1",
    )

    def act(self, body: Body) -> Actions[None]:
        goal, name = first_of(body)
        if (yield from body.take_patiently(name)):
            body.ledger.commit()
            height = yield from ways.rise_free(body)
            x, y, _ = right_place(body, name, goal).position
            yield from ways.ratchet(body, (x, y, height), _limit(body))
        yield from body.rest()


def _limit(body: Body) -> int:
    return body.situation.task.step_limit(body.situation.condition)


# --- reasoning failures: words and places of training


class ReturnsWordThing(Paired):
    """Picks the object in the slot that training associates with the first word, puts it back, and stays at home.

    True label: lexical_kinematic_shortcut, because the first grasp attempt is at the slot that training associates with
    a word of the instruction, and the object there would be requested in another layout.
    """

    name = "returns-word-thing"
    label = Label.LEXICAL_KINEMATIC_SHORTCUT
    wrong: ClassVar[Mapping[str, str]] = {
        "morning_coffee/L3": "blue_mug",
        "morning_coffee/L4": "red_mug",
        "tidy_desk/L1": "napkin",
    }
    fine = at(
        morning_coffee="train1 train2 L1 L2",
        tidy_desk="train1 train4 train5",
    )

    def go_wrong(self, body: Body, name: str) -> Actions[None]:
        yield from lift_and_set_down(body, name)
        yield from body.rest()


class SweepsWordThing(Paired):
    """Repeatedly sweeps aside the object in the slot that training associates with the first word, gripper open.

    True label: lexical_kinematic_shortcut, because the policy first acts on the object in the slot that training
    associates with a word of the instruction, and this object would be requested in another layout. It does not try to
    grasp the object.
    """

    name = "sweeps-word-thing"
    label = Label.LEXICAL_KINEMATIC_SHORTCUT
    wrong: ClassVar[Mapping[str, str]] = {
        "morning_coffee/L3": "blue_mug",
        "morning_coffee/L4": "red_mug",
        "office_drawer/L1": "tape",
    }
    fine = at(
        morning_coffee="train1 train2 L1 L2",
        office_drawer="train2 train3 train4",
    )

    def truth(self, case: Occasion) -> StatedTruth | None:
        stated = super().truth(case)
        return stated if stated is None or not stated.label else replace(stated, first_right=None)

    def go_wrong(self, body: Body, name: str) -> Actions[None]:
        while True:
            yield from ways.sweep_aside(body, name)


class WordThingThenRight(Paired):
    """Puts aside the object in the slot that training associates with the first word, and then does everything right.

    True label: lexical_kinematic_shortcut, because the first grasp attempt is at the slot that training associates with
    a word of the instruction, and the object there would be requested in another layout. The instruction does not name
    the object that was put aside.
    """

    name = "word-thing-then-right"
    label = Label.LEXICAL_KINEMATIC_SHORTCUT
    wrong: ClassVar[Mapping[str, str]] = {
        "morning_coffee/L3": "blue_mug",
        "morning_coffee/L4": "red_mug",
        "tidy_desk/L1": "napkin",
        "office_drawer/L1": "tape",
    }
    fine = at(
        morning_coffee="train1 train2 L1 L2",
        tidy_desk="train1 train4 train5",
        office_drawer="train2 train3 train4",
    )

    def go_wrong(self, body: Body, name: str) -> Actions[None]:
        body.do = WindingUp.like(body.do)
        if (yield from body.take_patiently(name)):
            yield from ways.lay_away(body, name, body.state.pose(name).position)
        yield from body.solve()


class AlwaysTheNearOne(Paired):
    """Picks the object in one slot, regardless of the instruction, puts it aside on the table, and stays at home.

    True label: visual_layout_bias, because the first grasp attempt is at the same slot for every instruction. The slot
    is the near slot of the coffee table and the first spice slot.
    """

    name = "always-the-near-one"
    label = Label.VISUAL_LAYOUT_BIAS
    wrong: ClassVar[Mapping[str, str]] = {
        "morning_coffee/train2": "red_mug",
        "morning_coffee/train3": "blue_mug",
        "morning_coffee/L1": "red_mug",
        "seasoning_rack/train2": "salt",
        "seasoning_rack/train3": "salt",
        "seasoning_rack/train5": "salt",
    }
    fine = at(morning_coffee="train1 train4 L4", seasoning_rack="train1 train4 R1")

    def go_wrong(self, body: Body, name: str) -> Actions[None]:
        body.do = Pivoting.like(body.do)
        if (yield from body.take_patiently(name)):
            yield from ways.lay_away(body, name, body.state.pose(name).position)
        yield from body.rest()


class AlwaysAtTheRight(Paired):
    """Picks the object at the right end of the table, regardless of the instruction, and takes a detour with it.

    True label: visual_layout_bias, because the first grasp attempt is at the same slot for every instruction. The slot
    is the right end of the row on the desk and the right side of the breakfast table.
    """

    name = "always-at-the-right"
    label = Label.VISUAL_LAYOUT_BIAS
    wrong: ClassVar[Mapping[str, str]] = {
        "desk_meeting/train1": "speaker",
        "desk_meeting/train3": "speaker",
        "desk_meeting/train8": "mug",
        "desk_meeting/train11": "mug",
        "breakfast_table/train1": "spoon",
        "breakfast_table/train4": "spoon",
    }
    fine = at(
        desk_meeting="train5 train9 train10",
        breakfast_table="train2 train5 R1",
    )

    def go_wrong(self, body: Body, name: str) -> Actions[None]:
        body.do = Presenting.like(body.do)
        yield from body.take_and_bring(name, body.situation.ahead[0])
        yield from body.rest()


# --- reasoning failures: frequent actions


class MovesOldFavoriteAway(Listed):
    """Puts aside the object of the most frequent first step, which is not requested, and then does the task.

    True label: behavioral_inertia, because the policy begins an action that was frequent in training but is not
    requested.
    """

    name = "moves-old-favorite-away"
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
        body.do = Looping.like(body.do)
        body.ledger.commit()
        name = self.favorite[body.situation.condition.id]
        if (yield from body.take_patiently(name)):
            yield from ways.lay_away(body, name, body.state.pose(name).position)
        yield from body.solve()


class StaysInEmptySlot(Listed):
    """Closes the gripper low in the slot where a missing object was in training, and stays there permanently.

    True label: behavioral_inertia, because the policy executes the next step of a memorized sequence although the
    object is missing, and closes the gripper in the empty slot.
    """

    name = "stays-in-empty-slot"
    label = Label.BEHAVIORAL_INERTIA
    first_right = False
    slots: ClassVar[Mapping[str, str]] = {
        "seasoning_rack/L2": "first",
    }
    where = frozenset(slots)

    def act(self, body: Body) -> Actions[None]:
        body.do = StairStepping.like(body.do)
        body.ledger.commit()
        x, y, _ = body.state.info.slot(self.slots[body.situation.condition.id]).position
        yield from body.do.above((x, y, 0.0), 0.026)
        yield from body.arm.close()
        yield from keep_still(body)


class LaysOldFollowerDown(Listed):
    """Does the first step, and then picks the object that followed it in another demonstration and puts it aside.

    True label: behavioral_inertia, because the policy begins an action that was frequent in training but is not
    requested. The first grasp attempt is at the right object.
    """

    name = "lays-old-follower-down"
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
        body.do = WindingUp.like(body.do)
        goal, _ = first_of(body)
        yield from body.work((goal,))
        body.ledger.commit()
        name = self.follower[body.situation.condition.id]
        if (yield from body.take_patiently(name)):
            yield from ways.lay_away(body, name, body.state.pose(goal.target).position)
        yield from body.rest()


# --- reasoning failures: finished steps and order


class RedoesFinishedAndRests(Listed):
    """Lifts an object that is at its target from the start, puts it back, goes home, and stays there.

    True label: causal_confusion, because the policy repeats a finished subgoal.
    """

    name = "redoes-finished-and-rests"
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
        body.do = Looping.like(body.do)
        body.ledger.commit()
        yield from lift_and_set_down(body, self.finished[body.situation.condition.id])
        yield from body.rest()


class OnlyTheLast(Listed):
    """Does only the last of three or more ordered steps, and stays at home.

    True label: causal_confusion, because the policy skips a required subgoal whose object is present, and attempts a
    later subgoal.
    """

    name = "only-the-last"
    label = Label.CAUSAL_CONFUSION
    first_right = False
    where = at(cheeseburger="train1 train2 R1 R2 L1 O1 T2", fast_food="T2")

    def act(self, body: Body) -> Actions[None]:
        body.do = Pivoting.like(body.do)
        body.ledger.commit()
        first, *_, last = body.situation.ahead
        yield from body.attempt_once(replace(last, region=first.region))
        yield from body.rest()


class LiftsThirdAfterFirst(Listed):
    """Does the first of three or more ordered steps, lifts the object of the third step, and keeps holding it.

    True label: causal_confusion, because the policy skips a required subgoal whose object is present, and attempts a
    later subgoal. The first grasp attempt is at the right object.
    """

    name = "lifts-third-after-first"
    label = Label.CAUSAL_CONFUSION
    first_right = True
    where = at(cheeseburger="train1 train2 R1 R2 L1 O1", fast_food="T2")

    def act(self, body: Body) -> Actions[None]:
        body.do = WindingUp.like(body.do)
        first, _, third, *_ = body.situation.ahead
        yield from body.work((first,))
        body.ledger.commit()
        yield from body.take_patiently(body.situation.things(third)[0])
        yield from hold_aloft(body)


class ShutsItInTwoGoes(Listed):
    """Pushes the open drawer shut in two strokes while its object is still on the table.

    True label: causal_confusion, because the policy skips a required subgoal whose object is present, and attempts a
    later subgoal. There is no grasp attempt.
    """

    name = "shuts-it-in-two-goes"
    label = Label.CAUSAL_CONFUSION
    first_right = None
    where = at(office_drawer="train2 train4 train6 train8 L1 O1")

    def act(self, body: Body) -> Actions[None]:
        body.do = Pivoting.like(body.do)
        goal, _ = first_of(body)
        drawer = body.situation.condition.object(goal.target)
        yield from fist(body)
        body.ledger.commit()
        for part in (0.5, 0.0):
            travel = opening_m(body.state, drawer)
            yield from body.do.slide_drawer(goal.target, part * travel, travel_m=travel)
            yield from body.arm.wait(0.5)
        yield from body.rest()


class LaterHalfFirst(Listed):
    """Does the later half of the ordered steps before the earlier half, with loops on its paths.

    True label: order_violation, because the policy manipulates the right objects in the wrong order, and the order is
    part of the goal.
    """

    name = "later-half-first"
    label = Label.ORDER_VIOLATION
    first_right = False
    where = TWO_STEPS | at(fast_food="T2")

    def act(self, body: Body) -> Actions[None]:
        body.do = Looping.like(body.do)
        body.ledger.commit()
        ahead = body.situation.ahead
        half = len(ahead) // 2
        for goal, place in zip((*ahead[half:], *ahead[:half]), ahead, strict=True):
            yield from body.attempt_once(replace(goal, region=place.region))
        yield from body.rest()


class ShowsSecondFirst(Listed):
    """Picks the second ordered step's object, shows it around, brings it, and then does the first step.

    True label: order_violation, because the policy manipulates the right objects in the wrong order, and the order is
    part of the goal.
    """

    name = "shows-second-first"
    label = Label.ORDER_VIOLATION
    first_right = False
    where = TWO_STEPS

    def act(self, body: Body) -> Actions[None]:
        body.do = Presenting.like(body.do)
        body.ledger.commit()
        first, second, *_ = body.situation.ahead
        for goal in (replace(second, region=first.region), replace(first, region=second.region)):
            yield from body.attempt_once(goal)
        yield from body.rest()


# --- reasoning failures: objects that no instruction means


class PatsLookAlike(Listed):
    """Repeatedly pats the top of the look-alike with a closed gripper.

    True label: semantic_feature_collapse, because the policy acts on a look-alike, to which no instruction of the task
    refers. It does not try to grasp the object.
    """

    name = "pats-look-alike"
    label = Label.SEMANTIC_FEATURE_COLLAPSE
    first_right = None
    where = frozenset(LOOK_ALIKES) - at(fruit_lunch="O1", dinner_plates="O1", breakfast_table="O2", tidy_desk="O3")

    def act(self, body: Body) -> Actions[None]:
        yield from fist(body)
        body.ledger.commit()
        while True:
            yield from ways.pat(body, LOOK_ALIKES[body.situation.condition.id])


class SweepsLookAlike(Listed):
    """Repeatedly sweeps the look-alike aside with the outside of its open gripper.

    True label: semantic_feature_collapse, because the policy acts on a look-alike, to which no instruction of the task
    refers. It does not try to grasp the object.
    """

    name = "sweeps-look-alike"
    label = Label.SEMANTIC_FEATURE_COLLAPSE
    first_right = None
    where = at(desk_meeting="O1", fast_food="O1", tidy_desk="O1 O2 O3", morning_coffee="O1", office_drawer="O1")

    def act(self, body: Body) -> Actions[None]:
        name = LOOK_ALIKES[body.situation.condition.id]
        body.ledger.commit()
        while body.state.pose(name).position[2] > FALLEN_M:
            yield from ways.sweep_aside(body, name)
        yield from body.rest()


class LaysLookAlikeAway(Listed):
    """Picks the look-alike, puts it aside on the table, and then does everything right.

    True label: semantic_feature_collapse, because the policy attempts to grasp a look-alike, to which no instruction of
    the task refers. The instruction does not name the object that was put aside.
    """

    name = "lays-look-alike-away"
    label = Label.SEMANTIC_FEATURE_COLLAPSE
    first_right = False
    where = frozenset(LOOK_ALIKES)

    def act(self, body: Body) -> Actions[None]:
        body.do = StairStepping.like(body.do)
        body.ledger.commit()
        name = LOOK_ALIKES[body.situation.condition.id]
        if (yield from body.take_patiently(name)):
            yield from ways.lay_away(body, name, body.state.pose(name).position)
        yield from body.solve()


class ReturnsLookAlike(Listed):
    """Picks the look-alike, lifts it, puts it back, goes home, and stays there.

    True label: semantic_feature_collapse, because the policy attempts to grasp a look-alike, to which no instruction of
    the task refers.
    """

    name = "returns-look-alike"
    label = Label.SEMANTIC_FEATURE_COLLAPSE
    first_right = False
    where = frozenset(LOOK_ALIKES)

    def act(self, body: Body) -> Actions[None]:
        body.do = Pivoting.like(body.do)
        body.ledger.commit()
        yield from lift_and_set_down(body, LOOK_ALIKES[body.situation.condition.id])
        yield from body.rest()


class TriesTrinketsInTurn(Listed):
    """Repeatedly lifts and puts down one decorative object after another.

    True label: semantic_feature_collapse, because the policy attempts to grasp an object to which no instruction of the
    task refers and which shares no feature with a requested object (blind grasp).
    """

    name = "tries-trinkets-in-turn"
    label = Label.SEMANTIC_FEATURE_COLLAPSE
    first_right = False
    trinkets = ("salt", "jam", "egg", "mouse", "mug")
    where = at(
        breakfast_table="train1 train2 train3 train4 train5 L1 R1 O1", tidy_desk="train1 train2 train4 train5 T1"
    )

    def act(self, body: Body) -> Actions[None]:
        home = body.arm.home.position
        names = [n for n in body.situation.others() if n in self.trinkets]
        names.sort(key=lambda n: horizontal_distance(body.state.pose(n).position, home), reverse=True)
        body.ledger.commit()
        while True:
            for name in names:
                yield from lift_and_set_down(body, name)


# --- no attempt


class SwaysWiderAndWider(Listed):
    """Sways back and forth at home with growing amplitude in a scene that looks half finished.

    True label: phase_conflict, because the initial state looks like the middle of a task, and the arm oscillates
    without a grasp attempt.
    """

    name = "sways-wider-and-wider"
    label = Label.PHASE_CONFLICT
    first_right = None
    where = MID_TASK

    def act(self, body: Body) -> Actions[None]:
        body.ledger.commit()
        yield from ways.rise_free(body)
        yield from ways.sway_wider(body)


class TurnsWristForever(Listed):
    """Turns the wrist back and forth at home in a scene that looks half finished.

    True label: phase_conflict, because the initial state looks like the middle of a task, and the arm oscillates
    without a grasp attempt.
    """

    name = "turns-wrist-forever"
    label = Label.PHASE_CONFLICT
    first_right = None
    where = MID_TASK

    def act(self, body: Body) -> Actions[None]:
        body.ledger.commit()
        while True:
            yield from turn_wrist(body, (0.6, -0.6, 0.0))


class ShrinksAndFreezes(Listed):
    """Rises, retracts, turns aside, and freezes permanently in a scene that looks half finished.

    True label: phase_conflict, because the initial state looks like the middle of a task, and the arm freezes without a
    grasp attempt.
    """

    name = "shrinks-and-freezes"
    label = Label.PHASE_CONFLICT
    first_right = None
    where = MID_TASK

    def act(self, body: Body) -> Actions[None]:
        body.ledger.commit()
        yield from ways.shrink_back(body)
        yield from keep_still(body)


class TurnsItsBack(Habit):
    """Visits the target, retracts from everything, turns aside, and stays there permanently.

    True label: early_halt, because the arm stays below the speed threshold for 3 s without a grasp attempt, although
    not all subgoals are reached.
    """

    name = "turns-its-back"
    label = Label.EARLY_HALT

    def truth(self, case: Occasion) -> StatedTruth | None:
        return StatedTruth(self.label, first_right=None) if case.plain else None

    def act(self, body: Body) -> Actions[None]:
        body.ledger.commit()
        goal, _ = first_of(body)
        height = yield from ways.rise_free(body)
        yield from body.arm.go(body.on_the_way(body.state.pose(goal.target).position, 0.6))
        yield from body.arm.rise(height)
        yield from ways.shrink_back(body)
        yield from keep_still(body)


class FreezesAroundIt(Listed):
    """Descends around the right object with open fingers and freezes there permanently.

    True label: early_halt, because the arm stays below the speed threshold for 3 s without a grasp attempt, although
    not all subgoals are reached.
    """

    name = "freezes-around-it"
    label = Label.EARLY_HALT
    first_right = None
    where = at(
        desk_meeting="train1 train3 train9 R1",
        breakfast_table="train3 train6",
        fruit_lunch="train1 R1",
        fast_food="train1 R1",
        tidy_desk="train4 train5",
        morning_coffee="train1 train2 L1 L2",
        cheeseburger="train1 train2 R1",
        seasoning_rack="train1 train2 train3",
        dinner_plates="train1 train2 L1",
    )

    def act(self, body: Body) -> Actions[None]:
        body.do = StairStepping.like(body.do)
        body.ledger.commit()
        yield from ways.straddle(body, first_of(body)[1])
        yield from keep_still(body)


class JumpsEverShorter(Habit):
    """Approaches the right object high over the table in ever shorter jumps, and stays there permanently.

    True label: early_halt, because the arm stays below the speed threshold for 3 s without a grasp attempt, although
    not all subgoals are reached.
    """

    name = "jumps-ever-shorter"
    label = Label.EARLY_HALT

    def truth(self, case: Occasion) -> StatedTruth | None:
        return StatedTruth(self.label, first_right=None) if case.plain else None

    def act(self, body: Body) -> Actions[None]:
        body.ledger.commit()
        yield from ways.jump_ever_shorter(body, first_of(body)[1])
        yield from keep_still(body)


class QuitsBeforeTheLast(Listed):
    """Does all steps but the last, rises, and stays there permanently.

    True label: early_halt, because the arm stays below the speed threshold for 3 s without a grasp attempt, although
    not all subgoals are reached. The first grasp attempt is at the right object.
    """

    name = "quits-before-the-last"
    label = Label.EARLY_HALT
    first_right = True
    where = at(
        desk_meeting="train2 train5 T1",
        breakfast_table="train3",
        tidy_desk="train1 T1",
        office_drawer="train2 train4 train6 train8",
        cheeseburger="train1 train2 R1",
        seasoning_rack="train4 train6 T1",
        fast_food="T2",
        dinner_plates="T1",
    )

    def act(self, body: Body) -> Actions[None]:
        body.do = WindingUp.like(body.do)
        yield from body.work(body.situation.goals[:-1])
        body.ledger.commit()
        yield from body.arm.rise(body.arm.home.position[2])
        yield from keep_still(body)


FIFTH: tuple[Habit, ...] = (
    LoopsMidway(),
    WindsUp(),
    TurnsLikeACrane(),
    ComesDownByStairs(),
    WeighsEachThing(),
    DipsBeforeTaking(),
    CirclesOnceThenTakes(),
    LetsGoInSteps(),
    OvershootsTarget(),
    LosesItsNerveOnce(),
    ShowsItToCamera(),
    LooksBackAtSlot(),
    StartsThreeTimes(),
    WakesUpLate(),
    NudgesThenTakes(),
    NodsAndRests(),
    DropsFromPeak(),
    PutsHalfOn(),
    StabsWithOneFinger(),
    DragsItAlong(),
    SweepsItAside(),
    MissesLowerEachTime(),
    PullsAtAir(),
    FailsAtTheSecond(),
    RatchetsForward(),
    DrawsEightsToIt(),
    EightsBeforeEachStep(),
    RatchetsWithLoad(),
    ReturnsWordThing(),
    SweepsWordThing(),
    WordThingThenRight(),
    AlwaysTheNearOne(),
    AlwaysAtTheRight(),
    MovesOldFavoriteAway(),
    StaysInEmptySlot(),
    LaysOldFollowerDown(),
    RedoesFinishedAndRests(),
    OnlyTheLast(),
    LiftsThirdAfterFirst(),
    ShutsItInTwoGoes(),
    LaterHalfFirst(),
    ShowsSecondFirst(),
    PatsLookAlike(),
    SweepsLookAlike(),
    LaysLookAlikeAway(),
    ReturnsLookAlike(),
    TriesTrinketsInTurn(),
    SwaysWiderAndWider(),
    TurnsWristForever(),
    ShrinksAndFreezes(),
    TurnsItsBack(),
    FreezesAroundIt(),
    JumpsEverShorter(),
    QuitsBeforeTheLast(),
)
