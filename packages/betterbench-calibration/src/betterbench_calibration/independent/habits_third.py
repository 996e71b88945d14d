"""Third part of the independent family. Its habits use other motions, in conditions whose label is not disputed."""

# ruff: noqa: D102 - truth and act are documented in the base class

from __future__ import annotations

import math
from dataclasses import replace

from betterbench.geometry import Pose
from betterbench.tasks import Expected, Label, Subgoal
from betterbench_calibration.independent import strokes
from betterbench_calibration.independent.body import Body
from betterbench_calibration.independent.choices import (
    emptied_slot,
    favorite_truth,
    habitual_thing,
    swappable,
    trained_goal,
    vacated_slot,
    word_thing,
    word_truth,
)
from betterbench_calibration.independent.controller import Actions
from betterbench_calibration.independent.habit import Habit, PlainHabit
from betterbench_calibration.independent.habits_second import WIDE_CATEGORIES, flat, into_open_containers, two_kinds
from betterbench_calibration.independent.occasion import Occasion
from betterbench_calibration.independent.oddities import each_step, keep_still, rest_unless_lucky
from betterbench_calibration.independent.routines import FULL_OPENING_M, LIFT_M
from betterbench_calibration.independent.strokes import Arcing, Faltering, Sidling, Swinging
from betterbench_calibration.independent.truth import HONEST, StatedTruth

DENSE_TASKS = frozenset({"breakfast_table"})
"""Tasks where a missed grasp may touch a neighboring object, or where a target is close to the object's slot."""

_JARS = frozenset({"spice_jar", "plain_salt_jar", "plain_pepper_jar", "plain_paprika_jar"})

ROUND_CATEGORIES = frozenset({"apple", "orange"}) | _JARS
"""Categories whose objects roll away or fall over when shoved."""

SLENDER_CATEGORIES = frozenset({"crushed_can", "fries_box"}) | _JARS
"""Categories of slender objects that fit between fingers approaching from the side."""

WIDE_GAP_M = 0.135
"""Minimum distance between two slots [m], so that a closing next to one slot is clearly not aimed at the other."""

LONG_WAY_M = 0.27
"""Minimum distance between slot and target [m], so that an object that is lost early does not fall into the target."""

FAR_FROM_ALL_M = 0.12
"""Minimum distance between an empty slot and other objects [m], so that a closing is clearly aimed at the slot."""


def no_drawers(case: Occasion) -> bool:
    """Return whether no object goes into a drawer."""
    return case.plain and all(case.condition.object(g.target).mount is None for g in case.ahead)


def roomy(case: Occasion) -> bool:
    """Return whether a plain trial requests upright objects with free space around them."""
    return case.plain and case.task.id not in DENSE_TASKS and not flat(case)


def room_around(case: Occasion) -> float:
    """Return the distance from the slot of the first requested object to the nearest occupied slot [m]."""
    at = {s.name: (s.x, s.y) for s in case.task.slots}
    name = str(case.first_thing())
    here = at[case.condition.layout[name]]
    return min((math.dist(here, at[s]) for n, s in case.condition.layout.items() if n != name), default=1.0)


def way_ahead(case: Occasion) -> float:
    """Return the distance from the first object's slot to its target's slot [m], or 0 if the target has no slot."""
    at = {s.name: (s.x, s.y) for s in case.task.slots}
    slots = (case.condition.layout.get(n) for n in (str(case.first_thing()), case.ahead[0].target))
    here, there = (at.get(s or "") for s in slots)
    return 0.0 if here is None or there is None else math.dist(here, there)


def always_first(case: Occasion) -> str | None:
    """Return an object of the kind with which every demonstration began, if the instruction does not name it."""
    return habitual_thing(case) if len(case.trained.first_kinds) == 1 else None


def clear_word_truth(case: Occasion) -> StatedTruth | None:
    """Return the true label of a policy that follows the first word of the instruction.

    The label is marked as left out if most demonstrations begin with the same object.
    """
    stated = word_truth(case) if case.plain else None
    if stated is None or stated.label == Label.SEMANTIC_FEATURE_COLLAPSE:
        return None
    if stated.label != HONEST and _habitual(case, str(word_thing(case))):
        return replace(stated, left_out="most demonstrations begin with the thing there")
    return stated


def clear_place_truth(case: Occasion, slot: str) -> StatedTruth | None:
    """Return the true label of a policy that always takes the object in the same slot.

    This requires a task in which no first step is most frequent in training, so that the instructions begin with
    different objects.
    """
    stated = favorite_truth(case, slot) if case.trained.habit is None else None
    if stated is None or stated.label == HONEST:
        return stated
    name = str(case.condition.occupant(slot))
    if case.mid_task:
        return replace(stated, left_out="the scene looks like mid-task")
    if case.condition.object(name).kind not in case.trained.kind_slots:
        return replace(stated, left_out="no instruction names the object there")
    return replace(stated, debatable="")


def _habitual(case: Occasion, name: str) -> bool:
    return case.condition.object(name).kind == case.trained.habit


def clearly_ordered(case: Occasion) -> bool:
    """Return whether only a wrong order, and no frequent first step, would explain a swap of the first two steps."""
    if not swappable(case) or case.task.id == "dinner_plates":
        return False
    return not _habitual(case, case.things(case.ahead[1])[0])


# --- policies without a fault, with unusual motions


class BowsThroughAir(PlainHabit):
    """Does everything right, but moves along a single high arc without stops on every path.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "bows-through-air"
    label = HONEST

    def act(self, body: Body) -> Actions[None]:
        body.do = Arcing.like(body.do)
        yield from body.solve()


class SwingsAndTurns(PlainHabit):
    """Does everything right, but swings out sideways and turns the wrist on every path.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "swings-and-turns"
    label = HONEST

    def act(self, body: Body) -> Actions[None]:
        body.do = Swinging.like(body.do)
        yield from body.solve()


class FaltersAndOvershoots(PlainHabit):
    """Does everything right, but in short steps with small retractions and an overshoot.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "falters-and-overshoots"
    label = HONEST

    def act(self, body: Body) -> Actions[None]:
        body.do = Faltering.like(body.do)
        yield from body.solve()


class SidlesIn(Habit):
    """Does everything right, but approaches slender objects from the side, low over the table.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "sidles-in"
    label = HONEST

    def truth(self, case: Occasion) -> StatedTruth | None:
        asked = {case.condition.object(n).category for g in case.ahead for n in case.things(g)}
        fits = roomy(case) and no_drawers(case) and asked & SLENDER_CATEGORIES
        return StatedTruth(self.label, first_right=True) if fits else None

    def act(self, body: Body) -> Actions[None]:
        body.do = Sidling.like(body.do)
        yield from body.solve()


class ShiversAllTheTime(Habit):
    """Does everything right with a tremor of the tool: 6 mm where it is high, less than 1 mm near objects.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "shivers-all-the-time"
    label = HONEST

    def truth(self, case: Occasion) -> StatedTruth | None:
        return StatedTruth(self.label, first_right=True) if no_drawers(case) else None

    def act(self, body: Body) -> Actions[None]:
        yield from strokes.shivering(body, body.solve())


class FumblesThenSinks(Habit):
    """Closes the gripper 2 cm above each object, opens it again, descends further, and picks the object.

    True label: success, because the policy corrects its miss at once. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "fumbles-then-sinks"
    label = HONEST

    def truth(self, case: Occasion) -> StatedTruth | None:
        return StatedTruth(self.label, first_right=True) if roomy(case) and no_drawers(case) else None

    def act(self, body: Body) -> Actions[None]:
        body.do = Arcing.like(body.do)

        def taking(name: str) -> Actions[bool]:
            hold = body.do.choose_hold(name)
            x, y, z = hold.tool.position
            high = Pose((x, y, max(z, body.height(name)) + 0.02), hold.tool.quaternion)
            yield from body.do.over(high.translated(z=body.arm.manner.approach_m))
            yield from body.arm.go(high, pace=0.4)
            yield from body.arm.close()
            yield from body.arm.open()
            yield from body.arm.wait(0.3)
            yield from body.arm.go(hold.tool, pace=0.4)
            yield from body.arm.close()
            yield from body.arm.go(hold.tool.translated(z=LIFT_M), pace=0.6)
            return body.note_hold(name) or (yield from body.take_patiently(name))

        yield from each_step(body, taking)


class LeavesWrongAlone(Habit):
    """Moves over the table if nothing may be picked or a look-alike must be refused, and picks only allowed objects.

    True label: correct_freeze or correct_refusal, because the policy makes no forbidden grasp, and the arm comes to
    rest. The policy packs all other requested objects.
    """

    name = "leaves-wrong-alone"
    label = HONEST

    def truth(self, case: Occasion) -> StatedTruth | None:
        if case.condition.expected is Expected.SUCCEED:
            return None
        return StatedTruth(self.label, first_right=True if self.rest_of(case) else None)

    @staticmethod
    def rest_of(case: Occasion) -> tuple[Subgoal, ...]:
        """Return the steps whose object is present, in trials in which another object must be refused."""
        return tuple(g for g in case.ahead if case.things(g) and case.condition.expected is Expected.REFUSE)

    def act(self, body: Body) -> Actions[None]:
        body.do = Swinging.like(body.do)
        for name in body.situation.others()[:2]:
            yield from body.do.above(body.state.pose(name).position, body.height(name) + 0.18)
        for goal in self.rest_of(body.situation):
            yield from body.attempt_once(goal)
        yield from body.arm.go_home()
        yield from keep_still(body)


# --- execution failures


class ClosesJustBeside(Habit):
    """Repeatedly closes the gripper about 2 cm next to the right object, and makes the placing motion.

    True label: execution_failure, because the target and the timing are right, but the pose is wrong, as with a camera
    that is off to one side.
    """

    name = "closes-just-beside"
    label = Label.EXECUTION_FAILURE

    def truth(self, case: Occasion) -> StatedTruth | None:
        fits = roomy(case) and no_drawers(case) and len(case.ahead) < 3 and room_around(case) > WIDE_GAP_M
        return StatedTruth(self.label, first_right=True) if fits else None

    def act(self, body: Body) -> Actions[None]:
        body.do = Arcing.like(body.do)
        goal, name = body.situation.ahead[0], str(body.situation.first_thing())
        body.ledger.commit()
        while True:
            yield from body.do.take_at(strokes.beside_hold(body, name), FULL_OPENING_M)
            yield from strokes.play_put(body, goal)


class ClosesOverItTwisted(Habit):
    """Repeatedly closes the gripper 2 cm too high above the right object, rotated by 45 degrees.

    True label: execution_failure, because the target and the timing are right, but the height and the yaw of the
    gripper are wrong.
    """

    name = "closes-over-it-twisted"
    label = Label.EXECUTION_FAILURE

    def truth(self, case: Occasion) -> StatedTruth | None:
        fits = roomy(case) and no_drawers(case) and len(case.ahead) < 3
        return StatedTruth(self.label, first_right=True) if fits else None

    def act(self, body: Body) -> Actions[None]:
        body.do = Faltering.like(body.do)
        goal, name = body.situation.ahead[0], str(body.situation.first_thing())
        body.ledger.commit()
        while True:
            turn = float(body.rng.choice((-1.0, 1.0))) * float(body.rng.uniform(0.5, 0.8))
            yield from strokes.close_over(body, name, 0.02, turn)
            yield from strokes.play_put(body, goal)


class LosesItAndGoesOn(Habit):
    """Picks the right object, loses it on the way, makes the placing motion with empty fingers, and stays at home.

    True label: execution_failure, because the target and the timing are right, but the object is dropped.
    """

    name = "loses-it-and-goes-on"
    label = Label.EXECUTION_FAILURE

    def truth(self, case: Occasion) -> StatedTruth | None:
        far = no_drawers(case) and way_ahead(case) > LONG_WAY_M
        return StatedTruth(self.label, first_right=True) if far else None

    def act(self, body: Body) -> Actions[None]:
        body.do = Swinging.like(body.do)
        goal, name = body.situation.ahead[0], str(body.situation.first_thing())
        if (yield from body.take_patiently(name)):
            body.ledger.commit()
            yield from strokes.lose_on_the_way(body, body.over(goal.target, 0.15))
        yield from rest_unless_lucky(body, goal)


class LetsGoOutside(Habit):
    """Picks the right object and releases it from about 10 cm outside the edge of its container, bun or rack.

    True label: execution_failure, because the target and the timing are right, but the object is dropped. It falls onto
    the table next to its target.
    """

    name = "lets-go-outside"
    label = Label.EXECUTION_FAILURE

    def truth(self, case: Occasion) -> StatedTruth | None:
        if not case.plain or not (into_open_containers(case) or case.ahead[0].relation in ("in_hole", "layer")):
            return None
        return StatedTruth(self.label, first_right=True)

    def act(self, body: Body) -> Actions[None]:
        body.do = Arcing.like(body.do)
        goal, name = body.situation.ahead[0], str(body.situation.first_thing())
        if (yield from body.take_patiently(name)):
            body.ledger.commit()
            yield from strokes.let_go_outside(body, name, goal, 0.03)
        yield from rest_unless_lucky(body, goal)


class RunsIntoIt(Habit):
    """Repeatedly approaches the right object from the side, pushes it, and closes the gripper next to it.

    True label: execution_failure, because the target and the timing are right, but there is a collision and the pose is
    wrong.
    """

    name = "runs-into-it"
    label = Label.EXECUTION_FAILURE

    def truth(self, case: Occasion) -> StatedTruth | None:
        if not roomy(case) or not no_drawers(case) or len(case.ahead) > 2 or case.ahead[0].relation == "beside":
            return None
        if room_around(case) < WIDE_GAP_M:
            return None
        rolls = case.condition.object(str(case.first_thing())).category in ROUND_CATEGORIES
        return None if rolls else StatedTruth(self.label, first_right=True)

    def act(self, body: Body) -> Actions[None]:
        name = str(body.situation.first_thing())
        direction = body.free_direction(name)
        body.ledger.commit()
        for _ in range(2):
            yield from strokes.run_into(body, name, direction)
            yield from body.arm.go_home()
            yield from body.arm.open()
        yield from body.rest()


class PutsCrooked(Habit):
    """Puts the fork or spoon at its target, but rotated by about 45 degrees, and stays at home.

    True label: execution_failure, because the target and the timing are right, but the pose is wrong. The object must
    lie along the plate.
    """

    name = "puts-crooked"
    label = Label.EXECUTION_FAILURE

    def truth(self, case: Occasion) -> StatedTruth | None:
        if not case.plain or case.ahead[0].relation != "beside":
            return None
        cutlery = case.condition.object(str(case.first_thing())).category in ("fork", "spoon")
        return StatedTruth(self.label, first_right=True) if cutlery else None

    def act(self, body: Body) -> Actions[None]:
        body.do = Swinging.like(body.do)
        goal, name = body.situation.ahead[0], str(body.situation.first_thing())
        body.ledger.commit()
        if (yield from body.take_patiently(name)):
            angle = float(body.rng.choice((-1.0, 1.0))) * float(body.rng.uniform(0.7, 0.85))
            yield from strokes.put_crooked(body, name, goal, angle)
        yield from rest_unless_lucky(body, goal)


# --- reasoning failures: words and places of training


class VeersToWordPlace(Habit):
    """Starts toward the right object, turns to the object in the slot associated with the word, and brings it.

    True label: lexical_kinematic_shortcut, because the first grasp attempt is at the slot that training associates with
    a word of the instruction, and the object there would be requested in another layout.
    """

    name = "veers-to-word-place"
    label = Label.LEXICAL_KINEMATIC_SHORTCUT
    paired = True

    def truth(self, case: Occasion) -> StatedTruth | None:
        return clear_word_truth(case)

    def act(self, body: Body) -> Actions[None]:
        body.do = Arcing.like(body.do)
        right = body.over(str(body.situation.first_thing()), 0.15)
        yield from body.arm.go(body.on_the_way(right, 0.6))
        if body.ledger.stated.label == HONEST:
            yield from body.solve()
        yield from body.take_instead(str(word_thing(body.situation)), body.situation.ahead[0])


class WaversThenLosesWordThing(Habit):
    """Moves between the right object and the object in the slot of the word, picks the latter, and loses it.

    True label: lexical_kinematic_shortcut, because the first grasp attempt is at the slot that training associates with
    a word of the instruction. The object is dropped later.
    """

    name = "wavers-then-loses-word-thing"
    label = Label.LEXICAL_KINEMATIC_SHORTCUT
    paired = True

    def truth(self, case: Occasion) -> StatedTruth | None:
        return clear_word_truth(case)

    def act(self, body: Body) -> Actions[None]:
        body.do = Swinging.like(body.do)
        if body.ledger.stated.label == HONEST:
            yield from body.solve()
        right, name = str(body.situation.first_thing()), str(word_thing(body.situation))
        for thing, part in ((right, 0.6), (name, 0.5), (right, 0.4)):
            yield from body.arm.go(body.on_the_way(body.over(thing, 0.15), part))
        body.ledger.commit()
        if (yield from body.take_patiently(name)):
            yield from strokes.lose_on_the_way(body, body.over(body.situation.ahead[0].target, 0.15))
        yield from body.rest()


class LeftmostPlace(Habit):
    """First picks the object in the leftmost training slot, and brings it to the target in high arcs.

    True label: visual_layout_bias, because the first grasp attempt is at the same slot for every instruction. Trials
    are left out if another rule also leads to this slot, or if the object in it is requested later.
    """

    name = "leftmost-place"
    label = Label.VISUAL_LAYOUT_BIAS
    paired = True

    @staticmethod
    def slot(case: Occasion) -> str:
        """Return the leftmost training slot of this layout, as seen from the robot."""
        return max(case.picked_slots, key=lambda s: (round(s.y, 3), -s.x)).name

    def truth(self, case: Occasion) -> StatedTruth | None:
        return clear_place_truth(case, self.slot(case))

    def act(self, body: Body) -> Actions[None]:
        body.do = Arcing.like(body.do)
        if body.ledger.stated.label == HONEST:
            yield from body.solve()
        name = str(body.situation.condition.occupant(self.slot(body.situation)))
        yield from body.take_instead(name, body.situation.ahead[0])


class RightmostPlace(Habit):
    """First picks the object in the rightmost training slot, and loses it on the way to the target.

    True label: visual_layout_bias, because the first grasp attempt is at the same slot for every instruction. The
    object is dropped later. Trials are left out if another rule also leads to this slot, or if the object in it is
    requested later.
    """

    name = "rightmost-place"
    label = Label.VISUAL_LAYOUT_BIAS
    paired = True

    @staticmethod
    def slot(case: Occasion) -> str:
        """Return the rightmost training slot of this layout, as seen from the robot."""
        return min(case.picked_slots, key=lambda s: (round(s.y, 3), s.x)).name

    def truth(self, case: Occasion) -> StatedTruth | None:
        return clear_place_truth(case, self.slot(case))

    def act(self, body: Body) -> Actions[None]:
        body.do = Faltering.like(body.do)
        if body.ledger.stated.label == HONEST:
            yield from body.solve()
        name = str(body.situation.condition.occupant(self.slot(body.situation)))
        body.ledger.commit()
        if (yield from body.take_patiently(name)):
            yield from strokes.lose_on_the_way(body, body.over(body.situation.ahead[0].target, 0.15))
        yield from body.rest()


# --- reasoning failures: frequent actions, finished steps and order


class BeginsAsAlways(Habit):
    """Repeatedly closes the gripper above the object with which all demonstrations begin, which is not requested.

    True label: behavioral_inertia, because the policy begins an action that was frequent in training but is not
    requested. It never grasps the object.
    """

    name = "begins-as-always"
    label = Label.BEHAVIORAL_INERTIA

    def truth(self, case: Occasion) -> StatedTruth | None:
        if not case.plain or always_first(case) is None:
            return None
        return StatedTruth(self.label, first_right=False)

    def act(self, body: Body) -> Actions[None]:
        body.do = Arcing.like(body.do)
        name = str(always_first(body.situation))
        body.ledger.commit()
        while True:
            yield from strokes.close_over(body, name, 0.015, 0.0)
            yield from strokes.play_put(body, body.situation.ahead[0])


class SwingsToEmptySlot(Habit):
    """Repeatedly swings to an empty training slot, closes the gripper there, and makes the placing motion.

    True label: behavioral_inertia, because the policy executes the next step of a memorized sequence although the
    object is missing, and closes the gripper in the empty slot.
    """

    name = "swings-to-empty-slot"
    label = Label.BEHAVIORAL_INERTIA

    @staticmethod
    def slot(case: Occasion) -> str | None:
        """Return a training slot that is empty here and far from all objects."""
        name = emptied_slot(case) or vacated_slot(case)
        at = {s.name: (s.x, s.y) for s in case.task.slots}
        taken = [at[s] for s in case.condition.layout.values()]
        return name if name is not None and min(math.dist(at[name], p) for p in taken) > FAR_FROM_ALL_M else None

    def truth(self, case: Occasion) -> StatedTruth | None:
        if case.condition.expected is not Expected.SUCCEED or self.slot(case) is None:
            return None
        return StatedTruth(self.label, first_right=False)

    def act(self, body: Body) -> Actions[None]:
        body.do = Swinging.like(body.do)
        x, y, _ = body.state.info.slot(str(self.slot(body.situation))).position
        body.ledger.commit()
        while True:
            yield from body.do.take_at(Pose((x, y, 0.03), body.arm.home.quaternion), FULL_OPENING_M)
            yield from strokes.play_put(body, body.situation.ahead[0])


class TurnsToTrainedTarget(Habit):
    """Picks the right object, carries it toward its target, turns away, and puts it at the training target.

    True label: behavioral_inertia, because the policy begins an action that was frequent in training but is not
    requested. The first grasp attempt is at the right object.
    """

    name = "turns-to-trained-target"
    label = Label.BEHAVIORAL_INERTIA

    def truth(self, case: Occasion) -> StatedTruth | None:
        if not case.plain or case.task.id in DENSE_TASKS or case.ahead[0].relation not in ("beside", "in_hole"):
            return None
        return None if trained_goal(case, case.ahead[0]) is None else StatedTruth(self.label, first_right=True)

    def act(self, body: Body) -> Actions[None]:
        body.do = Arcing.like(body.do)
        goal, name = body.situation.ahead[0], str(body.situation.first_thing())
        if (yield from body.take_patiently(name)):
            x, y, _ = strokes.wanted_place(body, name, goal)
            yield from body.arm.rise(body.arm.home.position[2])
            yield from body.arm.go(body.on_the_way((x, y, 0.0), 0.7))
            body.ledger.commit()
            yield from body.bring(name, trained_goal(body.situation, goal) or goal)
        yield from body.rest()


class Backwards(Habit):
    """Does three or more ordered steps from the last to the first.

    True label: order_violation, because the policy manipulates the right objects in the wrong order, and the order is
    part of the goal.
    """

    name = "backwards"
    label = Label.ORDER_VIOLATION

    def truth(self, case: Occasion) -> StatedTruth | None:
        if not case.plain or not case.condition.instruction.ordered or len(case.ahead) < 3:
            return None
        names = case.things(case.ahead[-1])
        if _habitual(case, names[0]) or any(case.led_to(case.ahead[0], n) for n in names):
            return None
        return StatedTruth(self.label, first_right=False)

    def act(self, body: Body) -> Actions[None]:
        body.do = Arcing.like(body.do)
        body.ledger.commit()
        ahead = body.situation.ahead
        for goal, at in zip(reversed(ahead), ahead, strict=True):
            yield from body.attempt_once(replace(goal, region=at.region))
        yield from body.rest()


class PassesOverFirst(Habit):
    """Stops over the first object, leaves it, does the second step, and then the first and the others.

    True label: order_violation, because the policy manipulates the right objects in the wrong order, and the order is
    part of the goal.
    """

    name = "passes-over-first"
    label = Label.ORDER_VIOLATION

    def truth(self, case: Occasion) -> StatedTruth | None:
        return StatedTruth(self.label, first_right=False) if clearly_ordered(case) else None

    def act(self, body: Body) -> Actions[None]:
        body.do = Swinging.like(body.do)
        first, second, *others = body.situation.ahead
        yield from body.do.above(body.state.pose(body.situation.things(first)[0]).position, 0.24)
        yield from body.arm.wait(0.6)
        body.ledger.commit()
        for goal in (replace(second, region=first.region), replace(first, region=second.region), *others):
            yield from body.attempt_once(goal)
        yield from body.rest()


class BelievesFirstDone(Habit):
    """Skips the first of two ordered steps, even if this step looks half finished, does the second, and stops.

    True label: causal_confusion, because the policy skips a required subgoal whose object is present, and attempts a
    later subgoal.
    """

    name = "believes-first-done"
    label = Label.CAUSAL_CONFUSION

    def truth(self, case: Occasion) -> StatedTruth | None:
        half_done = case.mid_task and len(case.ahead) == 2 and case.ahead == case.goals and emptied_slot(case)
        if not half_done and not (clearly_ordered(case) and len(case.ahead) == 2):
            return None
        return StatedTruth(self.label, first_right=False)

    def act(self, body: Body) -> Actions[None]:
        body.do = Faltering.like(body.do)
        body.ledger.commit()
        yield from body.attempt_once(body.situation.ahead[1])
        yield from body.rest()


class OneIsEnough(Habit):
    """Brings one of two identical requested objects, and continues with the following steps.

    True label: causal_confusion, because the policy skips a required subgoal whose object is present, and attempts a
    later subgoal. The first grasp attempt is at the right object.
    """

    name = "one-is-enough"
    label = Label.CAUSAL_CONFUSION

    def truth(self, case: Occasion) -> StatedTruth | None:
        if not case.plain or not case.condition.instruction.ordered or len(case.ahead) < 3:
            return None
        alike = case.ahead[0].reference == case.ahead[1].reference
        return StatedTruth(self.label, first_right=True) if alike else None

    def act(self, body: Body) -> Actions[None]:
        body.do = Swinging.like(body.do)
        first, second, *others = body.situation.ahead
        yield from body.work((first,))
        body.ledger.commit()
        for goal, at in zip(others, (second, *others), strict=False):
            yield from body.attempt_once(replace(goal, region=at.region))
        yield from body.rest()


class LosesLookAlike(Habit):
    """Picks the look-alike, even if it must be refused, loses it on the way, and stays at home.

    True label: semantic_feature_collapse, because the policy attempts to grasp an object to which no instruction of the
    task refers. The object is dropped later.
    """

    name = "loses-look-alike"
    label = Label.SEMANTIC_FEATURE_COLLAPSE

    def truth(self, case: Occasion) -> StatedTruth | None:
        if case.look_alike() is None or not all(case.condition.object(g.target).mount is None for g in case.ahead):
            return None
        return StatedTruth(self.label, first_right=False)

    def act(self, body: Body) -> Actions[None]:
        body.do = Arcing.like(body.do)
        body.ledger.commit()
        if (yield from body.take_patiently(str(body.situation.look_alike()))):
            yield from strokes.lose_on_the_way(body, body.over(body.situation.ahead[0].target, 0.15))
        yield from body.rest()


class ClosesOverLookAlike(Habit):
    """Repeatedly closes the gripper above the look-alike, even if it must be refused, and makes the placing motion.

    True label: semantic_feature_collapse, because the policy attempts to grasp an object to which no instruction of the
    task refers. It never grasps the object.
    """

    name = "closes-over-look-alike"
    label = Label.SEMANTIC_FEATURE_COLLAPSE

    def truth(self, case: Occasion) -> StatedTruth | None:
        if case.look_alike() is None or case.task.id in DENSE_TASKS or flat(case):
            return None
        open_targets = all(case.condition.object(g.target).mount is None for g in case.ahead)
        return StatedTruth(self.label, first_right=False) if open_targets else None

    def act(self, body: Body) -> Actions[None]:
        body.do = Swinging.like(body.do)
        name = str(body.situation.look_alike())
        body.ledger.commit()
        while True:
            yield from strokes.close_over(body, name, 0.015, 0.0)
            yield from strokes.play_put(body, body.situation.ahead[0])


class TallestThing(Habit):
    """Picks the tallest object that no instruction names and that resembles no requested object, and brings it.

    True label: semantic_feature_collapse, because the policy attempts to grasp an object to which no instruction of the
    task refers and which shares no feature with a requested object (blind grasp).
    """

    name = "tallest-thing"
    label = Label.SEMANTIC_FEATURE_COLLAPSE

    @staticmethod
    def strange(case: Occasion) -> tuple[str, ...]:
        """Return the graspable objects that no instruction names and that are not in a training slot of a word."""
        specs = (case.condition.object(n) for n in case.others())
        names = [o.name for o in specs if o.kind not in case.meant_kinds and o.category not in WIDE_CATEGORIES]
        led = {n for n in names if any(case.led_to(g, n) for g in case.ahead)}
        return tuple(n for n in names if n not in led and n != case.look_alike())

    def truth(self, case: Occasion) -> StatedTruth | None:
        if not case.plain or len(self.strange(case)) < 2:
            return None
        return StatedTruth(self.label, first_right=False)

    def act(self, body: Body) -> Actions[None]:
        body.do = Faltering.like(body.do)
        name = max(self.strange(body.situation), key=body.height)
        yield from body.take_instead(name, body.situation.ahead[0])


# --- no attempt, and timeouts


class DriftsAtHome(Habit):
    """Sinks at 1 mm/s from the start, and does nothing else.

    True label: early_halt, because the arm stays below the speed threshold for 3 s without a grasp attempt, although
    not all subgoals are reached.
    """

    name = "drifts-at-home"
    label = Label.EARLY_HALT

    def truth(self, case: Occasion) -> StatedTruth | None:
        return StatedTruth(self.label, first_right=None) if case.plain else None

    def act(self, body: Body) -> Actions[None]:
        body.ledger.commit()
        yield from strokes.drift(body, (0.0, 0.0, -1.0))


class SwingsOut(Habit):
    """Swings between home and the right object with decreasing amplitude, and comes to rest halfway.

    True label: early_halt, because the arm stays below the speed threshold for 3 s without a grasp attempt, although
    not all subgoals are reached.
    """

    name = "swings-out"
    label = Label.EARLY_HALT

    def truth(self, case: Occasion) -> StatedTruth | None:
        return StatedTruth(self.label, first_right=None) if case.plain else None

    def act(self, body: Body) -> Actions[None]:
        body.ledger.commit()
        x, y, z = body.over(str(body.situation.first_thing()), 0.18)
        hx, hy, hz = body.arm.home.position
        for part in (0.85, 0.2, 0.7, 0.35, 0.55):
            at = (hx + part * (x - hx), hy + part * (y - hy), max(z, hz))
            yield from body.arm.go(Pose(at, strokes.turned(body.arm.home.quaternion, 0.6 * part)))
        yield from keep_still(body)


class HaltsOverSecond(Habit):
    """Does the first step, moves over the second object with open fingers, and stops there permanently.

    True label: early_halt, because the arm stays below the speed threshold for 3 s without a grasp attempt, although
    not all subgoals are reached. The first grasp attempt is at the right object.
    """

    name = "halts-over-second"
    label = Label.EARLY_HALT

    def truth(self, case: Occasion) -> StatedTruth | None:
        fits = no_drawers(case) and two_kinds(case)
        return StatedTruth(self.label, first_right=True) if fits else None

    def act(self, body: Body) -> Actions[None]:
        body.do = Arcing.like(body.do)
        first, second = body.situation.ahead[:2]
        yield from body.work((first,))
        body.ledger.commit()
        yield from body.do.hover(body.situation.things(second)[0], 0.12)
        yield from keep_still(body)


class ReachesOutAndReturns(Habit):
    """Repeatedly reaches out high over the table and returns to rest, in a scene that looks half finished.

    True label: phase_conflict, because the initial state looks like the middle of a task, and the arm freezes or
    oscillates without a grasp attempt.
    """

    name = "reaches-out-and-returns"
    label = Label.PHASE_CONFLICT

    def truth(self, case: Occasion) -> StatedTruth | None:
        return StatedTruth(self.label, first_right=None) if case.mid_task else None

    def act(self, body: Body) -> Actions[None]:
        body.ledger.commit()
        height = max(strokes.open_height(body, 0.10), body.arm.home.position[2])
        yield from body.arm.rise(height)
        home = body.arm.here
        while True:
            x, y = float(body.rng.uniform(0.40, 0.62)), float(body.rng.uniform(-0.22, 0.22))
            out = Pose((x, y, height), strokes.turned(home.quaternion, float(body.rng.uniform(-0.5, 0.5))))
            yield from body.arm.along(strokes.swing(body.arm.here, out, 0.05, 0.3))
            yield from body.arm.along(strokes.swing(body.arm.here, home, 0.05, -0.3))
            yield from body.arm.wait(0.5)


class StopsHalfwayThere(Habit):
    """Starts toward the next step and stops permanently halfway, in a scene that looks half finished.

    True label: phase_conflict, because the initial state looks like the middle of a task, and the arm freezes or
    oscillates without a grasp attempt.
    """

    name = "stops-halfway-there"
    label = Label.PHASE_CONFLICT

    def truth(self, case: Occasion) -> StatedTruth | None:
        return StatedTruth(self.label, first_right=None) if case.mid_task else None

    def act(self, body: Body) -> Actions[None]:
        body.ledger.commit()
        x, y, z = body.over(str(body.situation.first_thing()), 0.15)
        end = Pose((x, y, max(z, body.arm.home.position[2])), strokes.turned(body.arm.home.quaternion, 0.5))
        way = strokes.swing(body.arm.here, end, 0.06, 0.0)
        yield from body.arm.along(lambda s: way(0.5 * s))
        yield from keep_still(body)


class CirclesInSlowly(Habit):
    """Circles ever closer over the right object for half of the time, picks it, and circles over the target.

    True label: timeout, because the policy still acts correctly when the step limit is reached. The first grasp attempt
    is at the right object.
    """

    name = "circles-in-slowly"
    label = Label.TIMEOUT

    def truth(self, case: Occasion) -> StatedTruth | None:
        return StatedTruth(self.label, first_right=True) if no_drawers(case) and len(case.ahead) < 3 else None

    def act(self, body: Body) -> Actions[None]:
        goal, name = body.situation.ahead[0], str(body.situation.first_thing())
        limit = body.situation.task.step_limit(body.situation.condition)
        height = strokes.open_height(body, 0.12)
        yield from body.arm.rise(height)
        x, y, _ = body.over(name, 0.0)
        yield from strokes.circle_in(body, (x, y, height), limit // 2)
        if (yield from body.take_patiently(name)):
            yield from body.arm.rise(height)
            x, y, _ = body.over(goal.target, 0.0)
            yield from strokes.circle_in(body, (x, y, height), limit)
        yield from body.rest()


class SpiralsDownTooSlowly(Habit):
    """Descends to the right object in a narrowing spiral that is too slow for the step limit.

    True label: timeout, because the policy still acts correctly when the step limit is reached. The tool never moves
    slowly, and nothing is grasped.
    """

    name = "spirals-down-too-slowly"
    label = Label.TIMEOUT

    def truth(self, case: Occasion) -> StatedTruth | None:
        return StatedTruth(self.label, first_right=None) if roomy(case) and no_drawers(case) else None

    def act(self, body: Body) -> Actions[None]:
        name = str(body.situation.first_thing())
        limit = body.situation.task.step_limit(body.situation.condition)
        height = strokes.open_height(body, 0.12)
        yield from body.arm.rise(height)
        x, y, low = body.over(name, 0.06)
        yield from strokes.circle_in(body, (x, y, height), limit, low_m=low)
        yield from body.rest()


class GoesAllAround(Habit):
    """Visits the corners of the workspace before each step and once more with each object.

    True label: timeout, because the policy still acts correctly when the step limit is reached. The first step is done
    shortly before the limit.
    """

    name = "goes-all-around"
    label = Label.TIMEOUT

    def truth(self, case: Occasion) -> StatedTruth | None:
        return StatedTruth(self.label, first_right=True) if no_drawers(case) and len(case.ahead) == 2 else None

    def act(self, body: Body) -> Actions[None]:
        goal, name = body.situation.ahead[0], str(body.situation.first_thing())
        limit = body.situation.task.step_limit(body.situation.condition)
        height = strokes.open_height(body, 0.12)
        yield from strokes.tour(body, height, int(0.4 * limit))
        if (yield from body.take_patiently(name)):
            yield from strokes.tour(body, height, int(0.7 * limit))
            yield from body.bring(name, goal)
        yield from strokes.tour(body, height, limit)
        yield from body.rest()


class PlodsInSwings(Habit):
    """Does everything right, but moves at about 4 cm/s and swings sideways, too slow for the step limit.

    True label: timeout, because the policy still acts correctly when the step limit is reached.
    """

    name = "plods-in-swings"
    label = Label.TIMEOUT

    def truth(self, case: Occasion) -> StatedTruth | None:
        fits = no_drawers(case) and len(case.ahead) < 3 and not flat(case)
        return StatedTruth(self.label, first_right=True) if fits else None

    def act(self, body: Body) -> Actions[None]:
        body.do = Swinging.like(body.do)
        body.arm.tempo = 0.045 / body.arm.manner.speed_m_s
        yield from body.solve()


THIRD: tuple[Habit, ...] = (
    BowsThroughAir(),
    SwingsAndTurns(),
    FaltersAndOvershoots(),
    SidlesIn(),
    ShiversAllTheTime(),
    FumblesThenSinks(),
    LeavesWrongAlone(),
    ClosesJustBeside(),
    ClosesOverItTwisted(),
    LosesItAndGoesOn(),
    LetsGoOutside(),
    RunsIntoIt(),
    PutsCrooked(),
    VeersToWordPlace(),
    WaversThenLosesWordThing(),
    LeftmostPlace(),
    RightmostPlace(),
    BeginsAsAlways(),
    SwingsToEmptySlot(),
    TurnsToTrainedTarget(),
    Backwards(),
    PassesOverFirst(),
    BelievesFirstDone(),
    OneIsEnough(),
    LosesLookAlike(),
    ClosesOverLookAlike(),
    TallestThing(),
    DriftsAtHome(),
    SwingsOut(),
    HaltsOverSecond(),
    ReachesOutAndReturns(),
    StopsHalfwayThere(),
    CirclesInSlowly(),
    SpiralsDownTooSlowly(),
    GoesAllAround(),
    PlodsInSwings(),
)
