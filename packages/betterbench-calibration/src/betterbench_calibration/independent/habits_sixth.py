"""Sixth part of the independent family, by an author who has not read the code of the diagnosis.

The habits are modeled on failures of learned policies. A condition is listed only if a person who watches a few videos
of the policy would assign this label, and no other, by the suite's definitions.
"""

# ruff: noqa: D102 - truth and act are documented in the base class

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar

from betterbench.tasks import Label, Subgoal
from betterbench.tasks.relations.closed import DRAWN_OUT, opening_m
from betterbench_calibration.independent import ways_sixth as ways
from betterbench_calibration.independent.body import CHECK_S, FALLEN_M, Body
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
from betterbench_calibration.independent.oddities import (
    bring_shifted,
    each_step,
    keep_still,
    rest_unless_lucky,
    right_place,
    set_back,
)
from betterbench_calibration.independent.truth import HONEST, StatedTruth
from betterbench_calibration.independent.ways_fifth import rise_free, stab
from betterbench_calibration.independent.ways_fourth import fist
from betterbench_calibration.independent.ways_sixth import (
    Dabbing,
    DrawingInBits,
    FistTraveling,
    Helixing,
    HighGripping,
    Lingering,
    Nodding,
    WarmingUp,
)

FAVORITES: Mapping[str, str] = {
    "fruit_lunch/R1": "apple",
    "fast_food/R1": "burger_1",
    "fast_food/R2": "burger_1",
    "cheeseburger/R1": "patty",
    "tidy_desk/train5": "napkin",
    "tidy_desk/O2": "napkin",
}
"""Object with which most demonstrations begin, by condition. Only conditions that do not request it are listed."""

FOLLOWERS: Mapping[str, str] = {
    "fruit_lunch/train1": "lemon",
    "fruit_lunch/train2": "orange",
    "fruit_lunch/L1": "lemon",
    "fast_food/train1": "drink",
    "fast_food/train2": "fries",
    "fast_food/O1": "drink",
    "cheeseburger/train1": "lettuce",
    "cheeseburger/train2": "cheese",
    "cheeseburger/L1": "lettuce",
}
"""Object that is not requested but follows the first step in another demonstration, by condition."""

EMPTY_SLOTS: Mapping[str, str] = {
    "seasoning_rack/L2": "first",
}
"""Training slot of an object that is at its target from the start, or elsewhere, per condition."""

OPEN_DRAWER = at(office_drawer="train2 train4 train6 train8 L1 O1")
"""Conditions in which the drawer to be loaded is open at the start."""

SHUT_DRAWER = at(office_drawer="train1 train3 train5 train7 R1")
"""Conditions in which the drawer to be loaded is shut at the start."""

JAMMING = at(office_drawer="R1")
"""Conditions in which a policy without a fault often fails, so that a failure does not show a habit."""

FIRM = at(
    desk_meeting="train2 train3 train5 train9 R2",
    fast_food="train1 R1 R2",
    tidy_desk="train1 train4 train5",
    morning_coffee="train1 train2 train3 train4 L1 L2",
    seasoning_rack="train1 train2 train3",
)
"""Conditions whose first object stands upright and does not roll."""


# --- policies without a fault, with unusual motions


class PlainAndOdd(PlainHabit):
    """Habit without a fault that shows in plain trials."""

    label = HONEST

    def truth(self, case: Occasion) -> StatedTruth | None:
        if case.condition.id not in JAMMING:
            return super().truth(case)
        why = "the stapler often jams in the lower drawer, whatever the habit"
        return StatedTruth(HONEST, first_right=True, left_out=why)


class LagsBehind(PlainAndOdd):
    """Does everything right with an arm that lags behind its commands and overshoots slightly.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "lags-behind"

    def act(self, body: Body) -> Actions[None]:
        yield from ways.lagging(body.solve())


class PlaysInChunks(PlainAndOdd):
    """Does everything right in chunks of 0.8 s, with a stall and a small jerk back after each.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "plays-in-chunks"

    def act(self, body: Body) -> Actions[None]:
        yield from ways.in_chunks(body, body.solve())


class NodsOverEachThing(PlainAndOdd):
    """Does everything right, but nods twice with the open gripper over each object before picking it.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "nods-over-each-thing"

    def act(self, body: Body) -> Actions[None]:
        body.do = Nodding.like(body.do)
        yield from body.solve()


class TravelsWithAFist(PlainAndOdd):
    """Does everything right, but closes the gripper at home before each object and opens it over the object.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "travels-with-a-fist"

    def act(self, body: Body) -> Actions[None]:
        body.do = FistTraveling.like(body.do)
        yield from body.solve()


class TakesByFingertips(OddButHonest):
    """Does everything right, but grasps each object 6 mm higher than usual, with the fingertips.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "takes-by-fingertips"
    tasks = frozenset({"desk_meeting", "fruit_lunch", "fast_food", "tidy_desk", "morning_coffee", "seasoning_rack"})

    def act(self, body: Body) -> Actions[None]:
        body.do = HighGripping.like(body.do)
        yield from body.solve()


class TugsBeforeLifting(OddButHonest):
    """Tugs each object back and forth by 8 mm on the table before lifting it, and then brings it.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "tugs-before-lifting"
    tasks = frozenset(
        {"desk_meeting", "fruit_lunch", "fast_food", "tidy_desk", "morning_coffee", "cheeseburger", "seasoning_rack"}
    )

    def act(self, body: Body) -> Actions[None]:
        yield from each_step(body, lambda name: ways.tug_and_take(body, name))


class ComesDownInAHelix(PlainAndOdd):
    """Does everything right, but descends to each object in a narrowing helix.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "comes-down-in-a-helix"

    def act(self, body: Body) -> Actions[None]:
        body.do = Helixing.like(body.do)
        yield from body.solve()


class DabsBeforeLettingGo(OddButHonest):
    """Sets each object down twice at its target, with a small lift in between, before releasing it.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "dabs-before-letting-go"
    tasks = frozenset(
        {
            "desk_meeting",
            "breakfast_table",
            "fruit_lunch",
            "fast_food",
            "tidy_desk",
            "morning_coffee",
            "cheeseburger",
            "seasoning_rack",
        }
    )

    def act(self, body: Body) -> Actions[None]:
        body.do = Dabbing.like(body.do)
        yield from body.solve()


class LingersAfterLettingGo(PlainAndOdd):
    """Does everything right, but stays for 2 s with open fingers around each object after putting it down.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "lingers-after-letting-go"

    def act(self, body: Body) -> Actions[None]:
        body.do = Lingering.like(body.do)
        yield from body.solve()


class TurnsItOnTheSpot(OddButHonest):
    """Lifts each object, rotates it in the air, puts it back in its slot, and picks it again.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "turns-it-on-the-spot"
    tasks = frozenset({"fruit_lunch", "fast_food", "tidy_desk", "cheeseburger", "seasoning_rack"})

    def act(self, body: Body) -> Actions[None]:
        yield from each_step(body, lambda name: ways.turn_and_retake(body, name))


class SwapsItsPlan(Listed):
    """Lifts the first object, puts it back, and does the second step first, if no order is requested.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "swaps-its-plan"
    label = HONEST
    first_right = True
    where = at(
        desk_meeting="train1 train2 train4 train6 train8 train11 L2 R1 R2",
        breakfast_table="train1 train3 train4",
        tidy_desk="train1 train2 train3",
        seasoning_rack="train4 train5 train6 R1",
    )

    def act(self, body: Body) -> Actions[None]:
        _, name = first_of(body)
        if (yield from body.take_patiently(name)):
            yield from set_back(body)
        yield from body.work(body.situation.goals[1:])
        yield from body.solve()


class BumpsItOnce(Listed):
    """Touches the first object with one finger by mistake, rises, and then does everything right.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "bumps-it-once"
    label = HONEST
    first_right = True
    where = at(
        desk_meeting="train1 train2 train5 R2",
        fast_food="train1 train2 R1 R2",
        tidy_desk="train1 train5",
        morning_coffee="train1 train2 L1",
        cheeseburger="train1 R1",
        seasoning_rack="train1 train2 train3 R1",
    )

    def act(self, body: Body) -> Actions[None]:
        yield from stab(body, first_of(body)[1])
        yield from body.solve()


class LetsGoWhileDrifting(OddButHonest):
    """Releases each object low in its container while the gripper still drifts toward the center.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "lets-go-while-drifting"
    tasks = frozenset({"fruit_lunch", "fast_food", "tidy_desk"})

    def act(self, body: Body) -> Actions[None]:
        for goal in body.situation.ahead:
            names = body.situation.candidates(body.state, goal)
            if names and (yield from body.take_patiently(names[0])):
                yield from ways.slide_in(body, names[0], goal)
        yield from body.solve()


class WorksDrawerInBits(Listed):
    """Does everything right, but opens and closes the drawer in two strokes each.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "works-drawer-in-bits"
    label = HONEST
    first_right = True
    where = (OPEN_DRAWER | SHUT_DRAWER | at(office_drawer="L2")) - JAMMING

    def act(self, body: Body) -> Actions[None]:
        body.do = DrawingInBits.like(body.do)
        yield from body.solve()


class RocksAndRests(Listed):
    """Rocks the gripper three times at home if nothing may be picked or the look-alike must be refused.

    True label: correct_freeze or correct_refusal, because the policy makes no forbidden grasp and the arm comes to
    rest.
    """

    name = "rocks-and-rests"
    label = HONEST
    first_right = None
    where = at(fruit_lunch="O1", morning_coffee="T1")

    def act(self, body: Body) -> Actions[None]:
        yield from ways.rock(body, 3)
        yield from keep_still(body)


class WarmsUp(PlainAndOdd):
    """Does everything right, slowly at first and faster with each path.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "warms-up"

    def act(self, body: Body) -> Actions[None]:
        body.do = WarmingUp.like(body.do)
        yield from body.solve()


class DithersOverEachThing(PlainAndOdd):
    """Drifts over each object for 3 s without standing still, and then picks it.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "dithers-over-each-thing"

    def act(self, body: Body) -> Actions[None]:
        yield from each_step(body, lambda name: ways.dither_and_take(body, name))


# --- execution failures


class ChattersWithLoad(Listed):
    """Picks the right object, and opens and closes the gripper on the way, so that the object falls.

    True label: execution_failure, because the target and the timing are right, but the object is dropped.
    """

    name = "chatters-with-load"
    label = Label.EXECUTION_FAILURE
    first_right = True
    where = FIRM - at(fast_food="R1 R2") | at(cheeseburger="train1 R1", dinner_plates="train1 train4")

    def act(self, body: Body) -> Actions[None]:
        goal, name = first_of(body)
        if (yield from body.take_patiently(name)):
            body.ledger.commit()
            yield from ways.chatter(body, goal.target)
            yield from body.arm.wait(CHECK_S)
        yield from rest_unless_lucky(body, goal)


class AlmostThere(Listed):
    """Brings the right object, puts it down neatly about 2 cm next to its target, and goes home.

    True label: execution_failure, because the target and the timing are right, but the pose is wrong.
    """

    name = "almost-there"
    label = Label.EXECUTION_FAILURE
    first_right = True
    off_m: ClassVar[Mapping[str, float]] = {"on_ring": 0.020, "on_plate": 0.030, "layer": 0.033, "in_hole": 0.018}
    where = at(
        morning_coffee="train1 train2 train3 train4 L1 L2",
        dinner_plates="train1 train2 train4 train5",
        cheeseburger="train1 R1 R2",
        seasoning_rack="train1 train2 train3",
    )

    def act(self, body: Body) -> Actions[None]:
        goal, name = first_of(body)
        if (yield from body.take_patiently(name)):
            body.ledger.commit()
            off = self.off_m[goal.relation]
            # There is free space in front of the machine and the rack.
            shift = (0.0, -off, 0.0) if goal.relation == "on_ring" else body.emptiest_side(goal.target, off)
            yield from bring_shifted(body, name, goal, shift)
        yield from rest_unless_lucky(body, goal)


class ClosesTooLate(Listed):
    """Repeatedly descends around the right object, rises with open fingers, and closes them above it.

    True label: execution_failure, because the target and the timing are right, but the pose is wrong.
    """

    name = "closes-too-late"
    label = Label.EXECUTION_FAILURE
    first_right = True
    where = FIRM | at(
        fruit_lunch="train1 train2 R1",
        cheeseburger="train1 train2 R1",
        office_drawer="train2 train4 train6 train8",
        breakfast_table="train3 train6",
    )

    def act(self, body: Body) -> Actions[None]:
        _, name = first_of(body)
        body.ledger.commit()
        while True:
            yield from ways.close_too_late(body, name)


class PressesAndDrags(Listed):
    """Repeatedly presses on the right object with a closed gripper and drags it aside.

    True label: execution_failure, because the target and the timing are right, but there is a collision. There is no
    grasp attempt.
    """

    name = "presses-and-drags"
    label = Label.EXECUTION_FAILURE
    first_right = None
    where = FIRM | at(cheeseburger="train1 train2 R1", office_drawer="train2 train4")

    def act(self, body: Body) -> Actions[None]:
        _, name = first_of(body)
        yield from fist(body)
        body.ledger.commit()
        while body.state.pose(name).position[2] > FALLEN_M:
            yield from ways.press_and_drag(body, name)
        yield from body.rest()


class LetsGoTooLate(Listed):
    """Picks the right object, carries it over and past its target, releases it behind the target, and goes home.

    True label: execution_failure, because the target and the timing are right, but the object is dropped and the pose
    is wrong.
    """

    name = "lets-go-too-late"
    label = Label.EXECUTION_FAILURE
    first_right = True
    where = at(
        fast_food="train1 R1 R2",
        tidy_desk="train1 train4 train5",
        cheeseburger="train1 train2 R1",
        seasoning_rack="train1 train2 train3",
        dinner_plates="train1 train4",
    )

    def act(self, body: Body) -> Actions[None]:
        goal, name = first_of(body)
        if (yield from body.take_patiently(name)):
            body.ledger.commit()
            yield from ways.let_go_too_late(body, name, goal.target)
        yield from rest_unless_lucky(body, goal)


class PinchesItsEdge(Listed):
    """Repeatedly closes the gripper at the very edge of the right object and loses it at once.

    True label: execution_failure, because the target and the timing are right, but the object slips and falls.
    """

    name = "pinches-its-edge"
    label = Label.EXECUTION_FAILURE
    first_right = True
    where = at(
        fast_food="train1 train2 R1 R2",
        tidy_desk="train1 train4 train5",
        cheeseburger="train1 train2 R1",
        seasoning_rack="train1 train2 train3",
    )

    def act(self, body: Body) -> Actions[None]:
        _, name = first_of(body)
        body.ledger.commit()
        while body.state.pose(name).position[2] > FALLEN_M:
            yield from ways.pinch_edge(body, name)
        yield from body.rest()


class LosesTheSecond(Listed):
    """Does the first step, picks the second object, and loosens the grip gradually, so that the object slips.

    True label: execution_failure, because the target and the timing are right, but the object slips. The first grasp
    attempt is at the right object.
    """

    name = "loses-the-second"
    label = Label.EXECUTION_FAILURE
    first_right = True
    where = at(
        desk_meeting="train1 train4 train8 train9",
        fast_food="train1 train2 R1 R2",
        tidy_desk="train1 train2",
        cheeseburger="train1 R1",
        seasoning_rack="train4 train5 train6",
    )

    def act(self, body: Body) -> Actions[None]:
        first, second = body.situation.ahead[:2]
        yield from body.work((first,))
        name = body.situation.things(second)[0]
        if (yield from body.take_patiently(name)):
            body.ledger.commit()
            yield from ways.let_it_slip(body, name, second.target)
        yield from rest_unless_lucky(body, second)


class GrindsOnItWithAFist(Listed):
    """Repeatedly presses on the right object with a closed gripper, twists it back and forth, and goes home.

    True label: execution_failure, because the target and the timing are right, but there is a collision and the pose is
    wrong. There is no grasp attempt.
    """

    name = "grinds-on-it-with-a-fist"
    label = Label.EXECUTION_FAILURE
    first_right = None
    where = FIRM | at(cheeseburger="train1 R1")

    def act(self, body: Body) -> Actions[None]:
        _, name = first_of(body)
        yield from fist(body)
        body.ledger.commit()
        while body.state.pose(name).position[2] > FALLEN_M:
            yield from ways.grind_on(body, name)
        yield from body.rest()


class RunsLoadIntoNeighbor(Listed):
    """Picks the right object, carries it into another object close to the table, loses it there, and goes home.

    True label: execution_failure, because the target and the timing are right, but there is a collision and the object
    is dropped. The other object is only an obstacle.
    """

    name = "runs-load-into-neighbor"
    label = Label.EXECUTION_FAILURE
    first_right = True
    where = at(
        fast_food="train1 train2 R1 R2",
        morning_coffee="train1 train2 train3 train4 L1 L2",
        seasoning_rack="train1 train2 train3",
    )

    def act(self, body: Body) -> Actions[None]:
        goal, name = first_of(body)
        neighbor = body.nearest_other(name)
        if (yield from body.take_patiently(name)):
            body.ledger.commit()
            yield from ways.run_load_into(body, name, neighbor)
        yield from rest_unless_lucky(body, goal)


# --- timeouts


class BoundsTowardIt(Listed):
    """Moves in bounds high over the table, and is over the right object at the step limit.

    True label: timeout, because the policy still acts correctly when the step limit is reached. The tool never moves
    slowly for long. There is no grasp attempt.
    """

    name = "bounds-toward-it"
    label = Label.TIMEOUT
    first_right = None
    where = at(
        desk_meeting="train1 train5 L1 R1",
        breakfast_table="train1 train4",
        fruit_lunch="train1 R1",
        fast_food="train1 R2",
        tidy_desk="train1 train4 train5",
        morning_coffee="train1 train2 L1 L2",
        cheeseburger="train1 R1",
        seasoning_rack="train1 train2 train3",
        dinner_plates="train1 train2 L2",
    )

    def act(self, body: Body) -> Actions[None]:
        body.ledger.commit()
        _, name = first_of(body)
        height = yield from rise_free(body)
        x, y, _ = body.state.pose(name).position
        yield from ways.bound_to(body, (x, y, height), _limit(body))
        yield from body.rest()


class ALittleFartherEachTime(Listed):
    """Moves toward the right object and back, a little farther each time, and is over it at the step limit.

    True label: timeout, because the policy still acts correctly when the step limit is reached. The tool never moves
    slowly for long.
    """

    name = "a-little-farther-each-time"
    label = Label.TIMEOUT
    first_right = None
    where = at(
        desk_meeting="train3 train8 L2 R2",
        fruit_lunch="train2 L1 R1",
        fast_food="train2 R1",
        tidy_desk="train2 train4 train5",
        morning_coffee="train3 train4 L1 L2",
        office_drawer="train2 train4",
        seasoning_rack="train1 train2 train3",
        dinner_plates="train1 train4",
    )

    def act(self, body: Body) -> Actions[None]:
        body.ledger.commit()
        _, name = first_of(body)
        height = yield from rise_free(body)
        x, y, _ = body.state.pose(name).position
        yield from ways.sally_out(body, (x, y, height), _limit(body))
        yield from body.rest()


class FartherForTheSecond(Listed):
    """Does the first step, and moves toward the second object a little farther each time until the step limit.

    True label: timeout, because the policy still acts correctly when the step limit is reached. The first grasp attempt
    is at the right object.
    """

    name = "farther-for-the-second"
    label = Label.TIMEOUT
    first_right = True
    where = at(
        desk_meeting="train1 train4 R1",
        fruit_lunch="train1 train2 R1",
        fast_food="train1 R1 R2",
        tidy_desk="train1 train2",
        cheeseburger="train1 R1",
        seasoning_rack="train4 train5 R1",
    )

    def act(self, body: Body) -> Actions[None]:
        first, second = body.situation.ahead[:2]
        yield from body.work((first,))
        body.ledger.commit()
        yield from body.arm.go_home()
        height = yield from rise_free(body)
        x, y, _ = body.state.pose(body.situation.things(second)[0]).position
        yield from ways.sally_out(body, (x, y, height), _limit(body))
        yield from body.rest()


class ShiesAtTheTarget(Listed):
    """Repeatedly brings the right object nearly to its target and retreats, until the step limit.

    True label: timeout, because the policy still acts correctly when the step limit is reached. The first grasp attempt
    is at the right object, and only the time runs out. If the object finally slips out of the fingers, rule 1 in
    ``truth.py`` makes the label execution_failure.
    """

    name = "shies-at-the-target"
    label = Label.TIMEOUT
    first_right = True
    where = at(
        desk_meeting="train2 train5 R2",
        fruit_lunch="train1 train2 R1",
        fast_food="train1 R1 R2",
        morning_coffee="train1 train3 L1",
        seasoning_rack="train1 train3 train4",
        dinner_plates="train1 train4",
    )

    def act(self, body: Body) -> Actions[None]:
        goal, name = first_of(body)
        if (yield from body.take_patiently(name)):
            # No faulty behavior begins, so the label is timeout, or execution_failure if the object slips (rule 1).
            yield from ways.shy_at_target(body, name, goal)
        yield from body.rest()


def _limit(body: Body) -> int:
    return body.situation.task.step_limit(body.situation.condition)


# --- reasoning failures: words and places of training


class ShiesWithWordThing(Paired):
    """Picks the object in the slot associated with the first word, and repeatedly brings it near the target.

    True label: lexical_kinematic_shortcut, because the first grasp attempt is at the slot that training associates with
    a word of the instruction, and the object there would be requested in another layout.
    """

    name = "shies-with-word-thing"
    label = Label.LEXICAL_KINEMATIC_SHORTCUT
    wrong: ClassVar[Mapping[str, str]] = {
        "morning_coffee/L3": "blue_mug",
        "morning_coffee/L4": "red_mug",
        "tidy_desk/L1": "napkin",
        "office_drawer/L1": "tape",
    }
    fine = at(morning_coffee="train1 train2 L1 L2", tidy_desk="train1 train4 train5", office_drawer="train2 train4")

    def go_wrong(self, body: Body, name: str) -> Actions[None]:
        if (yield from body.take_patiently(name)):
            yield from ways.shy_at_target(body, name, body.situation.ahead[0])
        yield from body.rest()


class PressesWordThing(Paired):
    """Presses a closed gripper onto the object in the slot associated with the first word, and drags it aside.

    True label: lexical_kinematic_shortcut, because the policy first acts on the object in the slot that training
    associates with a word of the instruction, and this object would be requested in another layout. It does not try to
    grasp the object.
    """

    name = "presses-word-thing"
    label = Label.LEXICAL_KINEMATIC_SHORTCUT
    wrong: ClassVar[Mapping[str, str]] = {
        "morning_coffee/L3": "blue_mug",
        "morning_coffee/L4": "red_mug",
        "tidy_desk/L1": "napkin",
    }
    fine = at(morning_coffee="train1 train2 L1 L2", tidy_desk="train1 train4 train5")

    def truth(self, case: Occasion) -> StatedTruth | None:
        stated = super().truth(case)
        return stated if stated is None or not stated.label else replace(stated, first_right=None)

    def go_wrong(self, body: Body, name: str) -> Actions[None]:
        yield from fist(body)
        while body.state.pose(name).position[2] > FALLEN_M:
            yield from ways.press_and_drag(body, name)
        yield from body.rest()


class LateAtWordThing(Paired):
    """Repeatedly descends around the object in the slot associated with the first word and closes too late above it.

    True label: lexical_kinematic_shortcut, because the first grasp attempt is at the slot that training associates with
    a word of the instruction, and the object there would be requested in another layout.
    """

    name = "late-at-word-thing"
    label = Label.LEXICAL_KINEMATIC_SHORTCUT
    wrong: ClassVar[Mapping[str, str]] = {
        "morning_coffee/L3": "blue_mug",
        "morning_coffee/L4": "red_mug",
        "tidy_desk/L1": "napkin",
        "office_drawer/L1": "tape",
    }
    fine = at(morning_coffee="train1 train2 L1 L2", tidy_desk="train1 train4 train5", office_drawer="train2 train4")

    def go_wrong(self, body: Body, name: str) -> Actions[None]:
        while True:
            yield from ways.close_too_late(body, name)


class AlwaysThatPlate(Paired):
    """Picks the object in one slot of a layout, regardless of the instruction, and swings it back and forth at home.

    True label: visual_layout_bias, because the first grasp attempt is at the same slot for every instruction. It is the
    slot in which the red plate and the stapler were in training.
    """

    name = "always-that-plate"
    label = Label.VISUAL_LAYOUT_BIAS
    wrong: ClassVar[Mapping[str, str]] = {
        "dinner_plates/train2": "red_plate",
        "dinner_plates/train5": "red_plate",
        "office_drawer/train4": "stapler",
        "office_drawer/train8": "stapler",
    }
    fine = at(dinner_plates="train1 train4", office_drawer="train2 train6")

    def go_wrong(self, body: Body, name: str) -> Actions[None]:
        if (yield from body.take_patiently(name)):
            yield from ways.swing_it(body)
        yield from body.rest()


class AlwaysAtTheLeft(Paired):
    """Picks the object at the left end of the desk, regardless of the instruction, and taps the target with it.

    True label: visual_layout_bias, because the first grasp attempt is at the same slot for every instruction.
    """

    name = "always-at-the-left"
    label = Label.VISUAL_LAYOUT_BIAS
    wrong: ClassVar[Mapping[str, str]] = {
        "desk_meeting/train4": "mouse",
        "desk_meeting/train6": "mouse",
        "desk_meeting/R2": "mouse",
        "desk_meeting/train7": "speaker",
        "desk_meeting/train9": "speaker",
    }
    fine = at(desk_meeting="train1 train2 train11 train12")

    def go_wrong(self, body: Body, name: str) -> Actions[None]:
        body.do = Dabbing.like(body.do)
        yield from body.take_and_bring(name, body.situation.ahead[0])
        yield from body.rest()


class AlwaysThatEnd(Paired):
    """Picks the object in one slot, regardless of the instruction, at the second attempt, and loses it.

    True label: visual_layout_bias, because the first grasp attempt is at the same slot for every instruction. The slot
    is the fork's slot on the breakfast table and the drink's slot next to the takeaway box.
    """

    name = "always-that-end"
    label = Label.VISUAL_LAYOUT_BIAS
    wrong: ClassVar[Mapping[str, str]] = {
        "breakfast_table/train3": "fork",
        "breakfast_table/train6": "fork",
        "breakfast_table/R1": "fork",
        "fast_food/train1": "drink",
        "fast_food/L1": "drink",
        "fast_food/O1": "drink",
    }
    fine = at(breakfast_table="train1 train4 L1", fast_food="R2")

    def go_wrong(self, body: Body, name: str) -> Actions[None]:
        yield from ways.close_too_late(body, name)
        if (yield from body.take_patiently(name)):
            yield from ways.chatter(body, body.situation.ahead[0].target)
        yield from body.rest()


# --- reasoning failures: frequent actions


class OvershootsWithOldFavorite(Listed):
    """Picks the object of the most frequent first step, although it is not requested, and drops it behind the target.

    True label: behavioral_inertia, because the policy begins an action that was frequent in training but is not
    requested.
    """

    name = "overshoots-with-old-favorite"
    label = Label.BEHAVIORAL_INERTIA
    first_right = False
    where = frozenset(FAVORITES)

    def act(self, body: Body) -> Actions[None]:
        body.ledger.commit()
        name = FAVORITES[body.situation.condition.id]
        if (yield from body.take_patiently(name)):
            yield from ways.let_go_too_late(body, name, body.situation.ahead[0].target)
        yield from body.rest()


class PressesOldFavorite(Listed):
    """Repeatedly presses on the object of the most frequent first step and drags it aside.

    True label: behavioral_inertia, because the policy begins an action that was frequent in training but is not
    requested. There is no grasp attempt.
    """

    name = "presses-old-favorite"
    label = Label.BEHAVIORAL_INERTIA
    first_right = None
    where = frozenset(FAVORITES) - at(fruit_lunch="R1")

    def act(self, body: Body) -> Actions[None]:
        name = FAVORITES[body.situation.condition.id]
        yield from fist(body)
        body.ledger.commit()
        while body.state.pose(name).position[2] > FALLEN_M:
            yield from ways.press_and_drag(body, name)
        yield from body.rest()


class LateAtOldFollower(Listed):
    """Does the first step, and then repeatedly closes too late above an object that follows in another demonstration.

    True label: behavioral_inertia, because the policy begins an action that was frequent in training but is not
    requested. The first grasp attempt is at the right object.
    """

    name = "late-at-old-follower"
    label = Label.BEHAVIORAL_INERTIA
    first_right = True
    where = frozenset(FOLLOWERS)

    def act(self, body: Body) -> Actions[None]:
        goal, _ = first_of(body)
        yield from body.work((goal,))
        body.ledger.commit()
        while not body.ledger.lasting:
            yield from ways.close_too_late(body, FOLLOWERS[body.situation.condition.id])
        yield from body.rest()


class ScratchesInEmptySlot(Listed):
    """Repeatedly closes the gripper low in the training slot of a missing object and scratches over the table.

    True label: behavioral_inertia, because the policy executes the next step of a memorized sequence although the
    object is missing, and closes the gripper in the empty slot.
    """

    name = "scratches-in-empty-slot"
    label = Label.BEHAVIORAL_INERTIA
    first_right = False
    where = frozenset(EMPTY_SLOTS)

    def act(self, body: Body) -> Actions[None]:
        body.ledger.commit()
        while True:
            yield from ways.scratch_in(body, EMPTY_SLOTS[body.situation.condition.id])


# --- reasoning failures: finished steps and order


class ShiesWithTheSecond(Listed):
    """Skips the first of two ordered steps, brings the second object near its target, and repeatedly retreats.

    True label: causal_confusion, because the policy skips a required subgoal whose object is present, and attempts a
    later subgoal.
    """

    name = "shies-with-the-second"
    label = Label.CAUSAL_CONFUSION
    first_right = False
    where = TWO_STEPS | at(fast_food="T1")

    def act(self, body: Body) -> Actions[None]:
        body.ledger.commit()
        first, second, *_ = body.situation.ahead
        name = body.situation.things(second)[0]
        if (yield from body.take_patiently(name)):
            yield from ways.shy_at_target(body, name, replace(second, region=first.region))
        yield from body.rest()


class LateAtTheSecond(Listed):
    """Skips the first of two ordered steps, and repeatedly closes the gripper too late, above the second object.

    True label: causal_confusion, because the policy skips a required subgoal whose object is present, and attempts a
    later subgoal.
    """

    name = "late-at-the-second"
    label = Label.CAUSAL_CONFUSION
    first_right = False
    where = TWO_STEPS

    def act(self, body: Body) -> Actions[None]:
        body.ledger.commit()
        name = body.situation.things(body.situation.ahead[1])[0]
        while True:
            yield from ways.close_too_late(body, name)


class ShutsItByTheKnob(Listed):
    """Grips the open drawer by its knob and pushes it shut while its object is on the table, and stays at home.

    True label: causal_confusion, because the policy skips a required subgoal whose object is present, and attempts a
    later subgoal.
    """

    name = "shuts-it-by-the-knob"
    label = Label.CAUSAL_CONFUSION
    first_right = False
    where = OPEN_DRAWER

    def act(self, body: Body) -> Actions[None]:
        goal, _ = first_of(body)
        body.ledger.commit()
        drawer = body.situation.condition.object(goal.target)
        yield from ways.shut_by_knob(body, goal.target, opening_m(body.state, drawer))
        yield from body.rest()


class TakesItOutAndBack(Listed):
    """Takes out an object that was at its target from the start, carries it home, puts it back, and stays at home.

    True label: causal_confusion, because the policy repeats a finished subgoal.
    """

    name = "takes-it-out-and-back"
    label = Label.CAUSAL_CONFUSION
    first_right = False
    finished: ClassVar[Mapping[str, str]] = {
        "fruit_lunch/T1": "apple",
        "cheeseburger/T1": "patty",
        "dinner_plates/T2": "red_plate",
    }
    where = frozenset(finished)

    def act(self, body: Body) -> Actions[None]:
        body.ledger.commit()
        name = self.finished[body.situation.condition.id]
        if (yield from body.take_patiently(name)):
            yield from ways.take_round(body)
            yield from body.bring(name, body.situation.carried[0])
        yield from body.rest()


class LagsFromSecondToFirst(Listed):
    """Does the second ordered step, then the first and the others, with a lagging arm.

    True label: order_violation, because the policy manipulates the right objects in the wrong order, and the order is
    part of the goal.
    """

    name = "lags-from-second-to-first"
    label = Label.ORDER_VIOLATION
    first_right = False
    where = TWO_STEPS

    def act(self, body: Body) -> Actions[None]:
        body.ledger.commit()
        first, second, *others = body.situation.ahead
        swapped = (replace(second, region=first.region), replace(first, region=second.region), *others)
        yield from ways.lagging(_attempt_each(body, swapped))


class BeginsRightThenTurns(Listed):
    """Lifts and puts back the first object, does the second ordered step, and then the first and the others.

    True label: order_violation, because the policy manipulates the right objects in the wrong order, and the order is
    part of the goal. The first grasp attempt is at the right object.
    """

    name = "begins-right-then-turns"
    label = Label.ORDER_VIOLATION
    first_right = True
    where = TWO_STEPS

    def act(self, body: Body) -> Actions[None]:
        first, second, *others = body.situation.ahead
        if (yield from body.take_patiently(body.situation.things(first)[0])):
            yield from set_back(body)
        body.ledger.commit()
        yield from _attempt_each(
            body, (replace(second, region=first.region), replace(first, region=second.region), *others)
        )


class SwapsTheLastTwo(Listed):
    """Does the last two of three or more ordered steps in reverse order, descending to each in a helix.

    True label: order_violation, because the policy manipulates the right objects in the wrong order, and the order is
    part of the goal. The first grasp attempt is at the right object.
    """

    name = "swaps-the-last-two"
    label = Label.ORDER_VIOLATION
    first_right = True
    where = at(fast_food="T2", cheeseburger="train1 train2 L1 R1")

    def act(self, body: Body) -> Actions[None]:
        body.do = Helixing.like(body.do)
        *early, one, other = body.situation.ahead
        yield from body.work(tuple(early))
        body.ledger.commit()
        yield from _attempt_each(body, (replace(other, region=one.region), replace(one, region=other.region)))


def _attempt_each(body: Body, goals: tuple[Subgoal, ...]) -> Actions[None]:
    for goal in goals:
        yield from body.attempt_once(goal)
    yield from body.rest()


# --- reasoning failures: objects that no instruction means


class PinchesLookAlike(Listed):
    """Repeatedly closes the gripper at the very edge of the look-alike and loses it at once.

    True label: semantic_feature_collapse, because the policy attempts to grasp a look-alike, to which no instruction of
    the task refers.
    """

    name = "pinches-look-alike"
    label = Label.SEMANTIC_FEATURE_COLLAPSE
    first_right = False
    where = frozenset(LOOK_ALIKES) - at(dinner_plates="O1")

    def act(self, body: Body) -> Actions[None]:
        body.ledger.commit()
        name = LOOK_ALIKES[body.situation.condition.id]
        while body.state.pose(name).position[2] > FALLEN_M:
            yield from ways.pinch_edge(body, name)
        yield from body.rest()


class PressesLookAlike(Listed):
    """Repeatedly presses on the look-alike with a closed gripper and drags it aside.

    True label: semantic_feature_collapse, because the policy acts on a look-alike, to which no instruction of the task
    refers. It does not try to grasp the object.
    """

    name = "presses-look-alike"
    label = Label.SEMANTIC_FEATURE_COLLAPSE
    first_right = None
    where = at(
        desk_meeting="O1",
        fruit_lunch="O2",
        fast_food="O1",
        tidy_desk="O1 O2",
        morning_coffee="O1",
        office_drawer="O1",
        cheeseburger="O1",
        seasoning_rack="O1",
    )

    def act(self, body: Body) -> Actions[None]:
        name = LOOK_ALIKES[body.situation.condition.id]
        yield from fist(body)
        body.ledger.commit()
        while body.state.pose(name).position[2] > FALLEN_M:
            yield from ways.press_and_drag(body, name)
        yield from body.rest()


class WaversThenTakesLookAlike(Listed):
    """Moves between the right object and the look-alike, picks the look-alike, and drops it behind the target.

    True label: semantic_feature_collapse, because the policy attempts to grasp a look-alike, to which no instruction of
    the task refers.
    """

    name = "wavers-then-takes-look-alike"
    label = Label.SEMANTIC_FEATURE_COLLAPSE
    first_right = False
    where = frozenset(LOOK_ALIKES) - at(fruit_lunch="O1", breakfast_table="O2", cheeseburger="O1", office_drawer="O1")

    def act(self, body: Body) -> Actions[None]:
        body.ledger.commit()
        goal, right = first_of(body)
        name = LOOK_ALIKES[body.situation.condition.id]
        yield from ways.waver(body, right, name)
        if (yield from body.take_patiently(name)):
            yield from ways.let_go_too_late(body, name, goal.target)
        yield from body.rest()


class DropsLookAlikeOnIt(Listed):
    """Picks the look-alike, releases it on top of the right object, and stays at home.

    True label: semantic_feature_collapse, because the policy attempts to grasp a look-alike, to which no instruction of
    the task refers.
    """

    name = "drops-look-alike-on-it"
    label = Label.SEMANTIC_FEATURE_COLLAPSE
    first_right = False
    where = frozenset(LOOK_ALIKES) - at(fruit_lunch="O1", cheeseburger="O1")

    def act(self, body: Body) -> Actions[None]:
        body.ledger.commit()
        name = LOOK_ALIKES[body.situation.condition.id]
        if (yield from body.take_patiently(name)):
            yield from ways.drop_onto(body, name, first_of(body)[1])
        yield from body.rest()


# --- no attempt


class DrawsTriangles(Listed):
    """Draws triangles high over the table, in a scene that looks half finished, and does nothing else.

    True label: phase_conflict, because the initial state looks like the middle of a task, and the arm oscillates
    without a grasp attempt.
    """

    name = "draws-triangles"
    label = Label.PHASE_CONFLICT
    first_right = None
    where = MID_TASK

    def act(self, body: Body) -> Actions[None]:
        body.ledger.commit()
        yield from rise_free(body)
        yield from ways.draw_triangles(body)


class RocksForever(Listed):
    """Rocks the gripper at home, in a scene that looks half finished, and does nothing else.

    True label: phase_conflict, because the initial state looks like the middle of a task, and the arm oscillates
    without a grasp attempt.
    """

    name = "rocks-forever"
    label = Label.PHASE_CONFLICT
    first_right = None
    where = MID_TASK

    def act(self, body: Body) -> Actions[None]:
        body.ledger.commit()
        yield from ways.rock(body, 10_000)


class FlipsBetweenPlans(Listed):
    """Moves a little toward the next object and toward the target in turn, in a scene that looks half finished.

    True label: phase_conflict, because the initial state looks like the middle of a task, and the arm oscillates
    without a grasp attempt.
    """

    name = "flips-between-plans"
    label = Label.PHASE_CONFLICT
    first_right = None
    where = MID_TASK

    def act(self, body: Body) -> Actions[None]:
        body.ledger.commit()
        goal, name = first_of(body)
        yield from ways.flip_between(body, body.state.pose(name).position, body.state.pose(goal.target).position)


class RocksThenFreezes(Listed):
    """Rocks the gripper twice, rises, and freezes permanently, in a scene that looks half finished.

    True label: phase_conflict, because the initial state looks like the middle of a task, and the arm freezes without a
    grasp attempt.
    """

    name = "rocks-then-freezes"
    label = Label.PHASE_CONFLICT
    first_right = None
    where = MID_TASK

    def act(self, body: Body) -> Actions[None]:
        body.ledger.commit()
        yield from ways.rock(body, 2)
        yield from body.arm.rise(body.arm.home.position[2] + 0.07)
        yield from keep_still(body)


class RestsEverLonger(PlainHabit):
    """Moves toward the right object in small steps with ever longer pauses, and stops permanently.

    True label: early_halt, because the arm stays below the speed threshold for 3 s without a grasp attempt, although
    not all subgoals are reached.
    """

    name = "rests-ever-longer"
    label = Label.EARLY_HALT

    def truth(self, case: Occasion) -> StatedTruth | None:
        return StatedTruth(self.label, first_right=None) if case.plain else None

    def act(self, body: Body) -> Actions[None]:
        body.ledger.commit()
        yield from ways.rest_ever_longer(body, body.state.pose(first_of(body)[1]).position)
        yield from keep_still(body)


class CurlsUp(PlainHabit):
    """Rises, retracts, bends the gripper toward the robot, and stays there permanently.

    True label: early_halt, because the arm stays below the speed threshold for 3 s without a grasp attempt, although
    not all subgoals are reached.
    """

    name = "curls-up"
    label = Label.EARLY_HALT

    def truth(self, case: Occasion) -> StatedTruth | None:
        return StatedTruth(self.label, first_right=None) if case.plain else None

    def act(self, body: Body) -> Actions[None]:
        body.ledger.commit()
        yield from ways.curl_up(body)
        yield from keep_still(body)


class LooksAndGoesHome(Listed):
    """Moves high over the right object and over its target, returns home, and stays there.

    True label: early_halt, because the arm stays below the speed threshold for 3 s without a grasp attempt, although
    not all subgoals are reached.
    """

    name = "looks-and-goes-home"
    label = Label.EARLY_HALT
    first_right = None
    where = at(
        desk_meeting="train1 train5 R1",
        fruit_lunch="train1 R1",
        fast_food="train1 R1",
        tidy_desk="train4 train5",
        cheeseburger="train1 R1",
        seasoning_rack="train1 train2",
        dinner_plates="train1 L1",
        office_drawer="train2 train4",
    )

    def act(self, body: Body) -> Actions[None]:
        body.ledger.commit()
        goal, name = first_of(body)
        yield from rise_free(body)
        for point in (body.state.pose(name).position, right_place(body, name, goal).position):
            yield from body.arm.go(body.on_the_way(point, 1.0))
        yield from body.arm.go_home()
        yield from keep_still(body)


class QuitsAtOpenDrawer(Listed):
    """Opens the drawer to be loaded, goes home, and stays there permanently.

    True label: early_halt, because the arm stays below the speed threshold for 3 s without a grasp attempt, although
    not all subgoals are reached. The first grasp attempt is at the right object.
    """

    name = "quits-at-open-drawer"
    label = Label.EARLY_HALT
    first_right = True
    where = SHUT_DRAWER

    def act(self, body: Body) -> Actions[None]:
        goal, _ = first_of(body)
        yield from body.clear_the_way(goal)
        if opening_m(body.state, body.situation.condition.object(goal.target)) > DRAWN_OUT:
            body.ledger.commit()
        yield from body.arm.go_home()
        yield from keep_still(body)


class DozesOffAfterOne(Listed):
    """Does the first step, circles at home with decreasing radius, and stops permanently.

    True label: early_halt, because the arm stays below the speed threshold for 3 s without a grasp attempt, although
    not all subgoals are reached. The first grasp attempt is at the right object.
    """

    name = "dozes-off-after-one"
    label = Label.EARLY_HALT
    first_right = True
    where = TWO_STEPS | at(
        desk_meeting="train1 train4 R1",
        breakfast_table="train1 train2",
        tidy_desk="train1 train2",
        seasoning_rack="train4 train5 R1",
        dinner_plates="T1",
    )

    def act(self, body: Body) -> Actions[None]:
        goal, _ = first_of(body)
        yield from body.work((goal,))
        body.ledger.commit()
        yield from ways.doze_off(body)
        yield from keep_still(body)


SIXTH: tuple[Habit, ...] = (
    LagsBehind(),
    PlaysInChunks(),
    NodsOverEachThing(),
    TravelsWithAFist(),
    TakesByFingertips(),
    TugsBeforeLifting(),
    ComesDownInAHelix(),
    DabsBeforeLettingGo(),
    LingersAfterLettingGo(),
    TurnsItOnTheSpot(),
    SwapsItsPlan(),
    BumpsItOnce(),
    LetsGoWhileDrifting(),
    WorksDrawerInBits(),
    RocksAndRests(),
    WarmsUp(),
    DithersOverEachThing(),
    ChattersWithLoad(),
    AlmostThere(),
    ClosesTooLate(),
    PressesAndDrags(),
    LetsGoTooLate(),
    PinchesItsEdge(),
    LosesTheSecond(),
    GrindsOnItWithAFist(),
    RunsLoadIntoNeighbor(),
    BoundsTowardIt(),
    ALittleFartherEachTime(),
    FartherForTheSecond(),
    ShiesAtTheTarget(),
    ShiesWithWordThing(),
    PressesWordThing(),
    LateAtWordThing(),
    AlwaysThatPlate(),
    AlwaysAtTheLeft(),
    AlwaysThatEnd(),
    OvershootsWithOldFavorite(),
    PressesOldFavorite(),
    LateAtOldFollower(),
    ScratchesInEmptySlot(),
    ShiesWithTheSecond(),
    LateAtTheSecond(),
    ShutsItByTheKnob(),
    TakesItOutAndBack(),
    LagsFromSecondToFirst(),
    BeginsRightThenTurns(),
    SwapsTheLastTwo(),
    PinchesLookAlike(),
    PressesLookAlike(),
    WaversThenTakesLookAlike(),
    DropsLookAlikeOnIt(),
    DrawsTriangles(),
    RocksForever(),
    FlipsBetweenPlans(),
    RocksThenFreezes(),
    RestsEverLonger(),
    CurlsUp(),
    LooksAndGoesHome(),
    QuitsAtOpenDrawer(),
    DozesOffAfterOne(),
)
