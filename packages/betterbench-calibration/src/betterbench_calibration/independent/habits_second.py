"""Second part of the independent family, by an author who knew the suite and other habits but not the diagnosis."""

# ruff: noqa: D102 - truth and act are documented in the base class

from __future__ import annotations

from dataclasses import replace

from betterbench.geometry import Pose
from betterbench.tasks import Expected, Label
from betterbench_calibration.independent import oddities
from betterbench_calibration.independent.body import Body
from betterbench_calibration.independent.choices import (
    favorite_truth,
    habitual_thing,
    swappable,
    word_thing,
    word_truth,
)
from betterbench_calibration.independent.controller import Actions
from betterbench_calibration.independent.habit import Habit, PlainHabit
from betterbench_calibration.independent.occasion import Occasion
from betterbench_calibration.independent.truth import HONEST, StatedTruth

FLAT_CATEGORIES = frozenset({"fork", "spoon", "dinner_plate"})
"""Categories of flat objects, which lie on a rest in their slots or can be grasped only in their initial pose."""

WIDE_CATEGORIES = frozenset({"keyboard", "cereal_bowl"})
"""Categories of distractors that are hard to grasp because they are too wide for the gripper."""


def into_open_containers(case: Occasion) -> bool:
    """Return whether all objects go into containers that are open at the top (drawers are not)."""
    return all(g.relation == "inside" and case.condition.object(g.target).mount is None for g in case.ahead)


def first_relation(case: Occasion) -> str:
    """Return the relation of the first step."""
    return case.ahead[0].relation


def flat(case: Occasion) -> bool:
    """Return whether a flat object is requested."""
    return any(case.condition.object(n).category in FLAT_CATEGORIES for g in case.ahead for n in case.things(g))


def two_kinds(case: Occasion) -> bool:
    """Return whether a plain trial has two steps with different objects."""
    return case.plain and len(case.ahead) > 1 and case.ahead[0].reference != case.ahead[1].reference


# --- policies without a fault, with unusual motions


class SetsBackAndRetakes(PlainHabit):
    """Picks each object, puts it back in its slot, and picks it again before bringing it.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "sets-back-and-retakes"
    label = HONEST

    def act(self, body: Body) -> Actions[None]:
        def taking(name: str) -> Actions[bool]:
            if (yield from body.take(name)):
                yield from oddities.set_back(body)
                yield from body.arm.wait(0.5)
            return (yield from body.take(name))

        yield from oddities.each_step(body, taking)


class GlidesInAslant(PlainHabit):
    """Descends to each object at a slant, from the side of the robot, with open fingers along its sides.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "glides-in-aslant"
    label = HONEST

    def act(self, body: Body) -> Actions[None]:
        yield from oddities.each_step(body, lambda name: oddities.take_gliding_in(body, name))


class LetsGoHighIntoContainer(Habit):
    """Drops each object into its container from 6 cm higher than needed. Dropping is allowed there.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "lets-go-high-into-container"
    label = HONEST

    def truth(self, case: Occasion) -> StatedTruth | None:
        return StatedTruth(self.label, first_right=True) if case.plain and into_open_containers(case) else None

    def act(self, body: Body) -> Actions[None]:
        for goal in body.situation.ahead:
            names = body.situation.candidates(body.state, goal)
            if names and (yield from body.take(names[0])):
                yield from oddities.bring_shifted(body, names[0], goal, (0.0, 0.0, 0.06))
        yield from body.solve()


class CorrectsPlacement(Habit):
    """Puts the first object 6 cm too far out, looks at it, picks it up again and places it correctly.

    True label: success, because the policy corrects its bad placement. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "corrects-placement"
    label = HONEST

    def truth(self, case: Occasion) -> StatedTruth | None:
        if not case.plain or first_relation(case) not in ("beside", "on_ring"):
            return None
        return StatedTruth(self.label, first_right=True)

    def act(self, body: Body) -> Actions[None]:
        goal, name = body.situation.ahead[0], str(body.situation.first_thing())
        if (yield from body.take_patiently(name)):
            yield from oddities.bring_shifted(body, name, goal, oddities.outward(body, name, goal, 0.06))
            yield from body.do.hover(name, oddities.LOOK_GAP_M)
            yield from body.arm.wait(0.8)
        yield from body.solve()


class Stutters(PlainHabit):
    """Makes no mistake, but sometimes sends zero actions. They stop the arm and leave the gripper unchanged.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "stutters"
    label = HONEST

    def act(self, body: Body) -> Actions[None]:
        yield from oddities.stuttering(body, body.solve())


class Twitches(PlainHabit):
    """Does everything right, with twitches of up to 2.5 cm while the tool is high.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "twitches"
    label = HONEST

    def act(self, body: Body) -> Actions[None]:
        yield from oddities.twitching(body, body.solve())


class NervousFingers(PlainHabit):
    """Closes and opens the empty gripper halfway, high over the table and over each right object.

    True label: success, because the fingers are out of reach of everything. If such a trial fails, the label is timeout
    or execution_failure (rule 3 in ``truth.py``).
    """

    name = "nervous-fingers"
    label = HONEST

    def act(self, body: Body) -> Actions[None]:
        def taking(name: str) -> Actions[bool]:
            yield from body.do.hover(name, oddities.LOOK_GAP_M)
            yield from oddities.twiddle(body)
            return (yield from body.take(name))

        yield from oddities.twiddle(body)
        yield from oddities.each_step(body, taking)


class CreepsAtThings(PlainHabit):
    """Descends to each object and lifts it at 2 to 4 cm/s, and travels at normal speed.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "creeps-at-things"
    label = HONEST

    def act(self, body: Body) -> Actions[None]:
        def taking(name: str) -> Actions[bool]:
            yield from body.do.hover(name, 0.08)
            body.arm.tempo = 0.2
            held = yield from body.take(name)
            body.arm.tempo = 1.0
            return held

        yield from oddities.each_step(body, taking)


class InspectsEverything(PlainHabit):
    """Moves high over each loose object in turn, pauses for half a second, and then does its task.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "inspects-everything"
    label = HONEST

    def act(self, body: Body) -> Actions[None]:
        asked = [n for n in sorted(body.situation.asked) if n in body.situation.condition.layout]
        for name in (*body.situation.others(), *asked):
            yield from oddities.look_at(body, name)
        yield from body.solve()


class TapsThenTakes(PlainHabit):
    """Touches the first object from above with closed fingers, rises, opens them, and then takes it.

    True label: success, because the gripper closes far above the table. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "taps-then-takes"
    label = HONEST

    def act(self, body: Body) -> Actions[None]:
        yield from oddities.tap(body, str(body.situation.first_thing()))
        yield from body.solve()


class PutsDownHalfway(Habit):
    """Puts each object down on the table on its way, rests for a second, picks it again and brings it.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "puts-down-halfway"
    label = HONEST

    def truth(self, case: Occasion) -> StatedTruth | None:
        return StatedTruth(self.label, first_right=True) if case.plain and not flat(case) else None

    def act(self, body: Body) -> Actions[None]:
        def taking(name: str) -> Actions[bool]:
            if (yield from body.take(name)):
                x, y, _ = body.state.pose(name).position
                yield from oddities.put_down_at(body, name, body.free_spot(name, (x, 0.5 * y, 0.0)))
                yield from body.arm.wait(1.0)
            return (yield from body.take(name))

        yield from oddities.each_step(body, taking)


class LooksThenLeavesIt(Habit):
    """Looks at all objects from high above if nothing may be picked, goes home, and stays there.

    True label: correct_freeze or correct_refusal. No object may be picked, the policy makes no forbidden grasp, and the
    arm comes to rest.
    """

    name = "looks-then-leaves-it"
    label = HONEST

    def truth(self, case: Occasion) -> StatedTruth | None:
        if case.condition.expected is Expected.SUCCEED:
            return None
        return StatedTruth(self.label, first_right=None)

    def act(self, body: Body) -> Actions[None]:
        for name in body.situation.others():
            yield from oddities.look_at(body, name)
        yield from body.arm.go_home()
        yield from oddities.keep_still(body)


# --- execution failures


class LetsGoTooHigh(Habit):
    """Drops each object 20 cm above a target that is not a container, and goes home after the first miss.

    True label: execution_failure, because the target and the timing are right, but the object is dropped.
    """

    name = "lets-go-too-high"
    label = Label.EXECUTION_FAILURE

    def truth(self, case: Occasion) -> StatedTruth | None:
        if not case.plain or flat(case) or any(g.relation == "inside" for g in case.ahead):
            return None
        return StatedTruth(self.label, first_right=True)

    def act(self, body: Body) -> Actions[None]:
        body.ledger.commit()
        for goal in body.situation.ahead:
            name = body.situation.things(goal)[0]
            if not (yield from body.take_patiently(name)):
                break
            if not (yield from oddities.bring_shifted(body, name, goal, (0.0, 0.0, 0.20))):
                break
        yield from body.rest()


class PutsBeside(Habit):
    """Picks the right object, puts it down neatly 9 to 12 cm or more beyond its target, and goes home.

    True label: execution_failure, because the target and the timing are right, but the pose is wrong. Every placement
    has this error, regardless of the instruction.
    """

    name = "puts-beside"
    label = Label.EXECUTION_FAILURE

    def truth(self, case: Occasion) -> StatedTruth | None:
        if not case.plain or first_relation(case) not in ("beside", "on_plate", "on_ring"):
            return None
        return StatedTruth(
            self.label, first_right=True, debatable="a neat put at another place may look deliberate: inertia"
        )

    def act(self, body: Body) -> Actions[None]:
        goal, name = body.situation.ahead[0], str(body.situation.first_thing())
        body.ledger.commit()
        if (yield from body.take_patiently(name)):
            far = float(body.rng.uniform(0.09, 0.12))
            shift = oddities.outward(body, name, goal, far)
            yield from oddities.bring_shifted(body, name, goal, shift)
        yield from oddities.rest_unless_lucky(body, goal)


class CarriesIntoTarget(Habit):
    """Carries the right object so low that it hits the wall of its container or rack, and releases it there.

    True label: execution_failure, because the target and the timing are right, but there is a collision.
    """

    name = "carries-into-target"
    label = Label.EXECUTION_FAILURE

    def truth(self, case: Occasion) -> StatedTruth | None:
        if not case.plain or not (into_open_containers(case) or first_relation(case) == "in_hole"):
            return None
        return StatedTruth(self.label, first_right=True)

    def act(self, body: Body) -> Actions[None]:
        goal, name = body.situation.ahead[0], str(body.situation.first_thing())
        body.ledger.commit()
        if (yield from body.take_patiently(name)):
            yield from oddities.carry_into(body, name, goal)
        yield from oddities.rest_unless_lucky(body, goal)


class ClosesTooLittle(PlainHabit):
    """Repeatedly closes the gripper partly around the right object, lifts nothing, and makes the placing motion.

    True label: execution_failure, because the target and the timing are right, but the grasp misses. The fingers never
    touch the object.
    """

    name = "closes-too-little"
    label = Label.EXECUTION_FAILURE

    def truth(self, case: Occasion) -> StatedTruth | None:
        if not case.plain:
            return None
        return StatedTruth(
            self.label,
            first_right=True,
            debatable="a gripper that closes only partly may not count as an attempt, and the label is then timeout",
        )

    def act(self, body: Body) -> Actions[None]:
        goal, name = body.situation.ahead[0], str(body.situation.first_thing())
        yield from body.clear_the_way(goal)
        body.ledger.commit()
        while True:
            yield from oddities.close_in_part(body, name)
            yield from body.let_go_above(goal.target)


class LetsGoInFlight(PlainHabit):
    """Picks the right object and opens the gripper at full speed on the way, so that the object flies off.

    True label: execution_failure, because the target and the timing are right, but the object is dropped. The policy
    then stays at home.
    """

    name = "lets-go-in-flight"
    label = Label.EXECUTION_FAILURE

    def act(self, body: Body) -> Actions[None]:
        goal, name = body.situation.ahead[0], str(body.situation.first_thing())
        yield from body.clear_the_way(goal)
        if (yield from body.take_patiently(name)):
            target = body.state.pose(goal.target).position
            yield from body.arm.rise(body.arm.here.position[2] + 0.05)
            body.ledger.commit()
            yield from oddities.fling(body, target)
        yield from oddities.rest_unless_lucky(body, goal)


class SweepsAwayAfterPut(Habit):
    """Puts the first object at its target and drags it off again while retracting sideways.

    True label: execution_failure, because the target and the timing are right, but there is a collision. The policy
    then stays at home.
    """

    name = "sweeps-away-after-put"
    label = Label.EXECUTION_FAILURE

    def truth(self, case: Occasion) -> StatedTruth | None:
        if not case.plain or first_relation(case) not in ("beside", "layer"):
            return None
        return StatedTruth(self.label, first_right=True)

    def act(self, body: Body) -> Actions[None]:
        goal, name = body.situation.ahead[0], str(body.situation.first_thing())
        if (yield from body.take_patiently(name)):
            yield from oddities.put_and_sweep_away(body, name, goal)
        yield from oddities.rest_unless_lucky(body, goal)


class GivesUpAfterMisses(PlainHabit):
    """Closes the gripper twice 4 to 5 cm next to the right grasp, goes home, and stays there permanently.

    True label: execution_failure, because the pose is wrong. The misses are the earliest evidence, and the halt is
    their consequence.
    """

    name = "gives-up-after-misses"
    label = Label.EXECUTION_FAILURE

    def truth(self, case: Occasion) -> StatedTruth | None:
        if not case.plain:
            return None
        return StatedTruth(self.label, first_right=True, debatable="it also stands still with open subgoals")

    def act(self, body: Body) -> Actions[None]:
        name = str(body.situation.first_thing())
        x, y, _ = body.emptiest_side(name, float(body.rng.uniform(0.04, 0.05)))
        up = body.height(name) + 0.01 - body.do.choose_hold(name).tool.position[2]
        body.ledger.commit()
        for side in (1.0, -1.0):
            yield from body.do.pick(name, shift=(side * x, side * y, up))
            yield from body.arm.open()
        yield from body.rest()


class LetsGoAtOnce(PlainHabit):
    """Repeatedly picks the right object and releases it at a few centimeters height.

    True label: execution_failure, because the target and the timing are right, but the object is dropped. The policy
    never carries the object anywhere.
    """

    name = "lets-go-at-once"
    label = Label.EXECUTION_FAILURE

    def act(self, body: Body) -> Actions[None]:
        goal, name = body.situation.ahead[0], str(body.situation.first_thing())
        yield from body.clear_the_way(goal)
        body.ledger.commit()
        while True:
            yield from body.take_patiently(name)
            yield from body.arm.go(body.arm.here.translated(z=-0.05))
            yield from body.arm.open()
            yield from body.arm.go_home()


class DropsFirstAndGoesOn(Habit):
    """Drops the first object on the way, and does the other steps as if it had brought that object.

    True label: execution_failure, because the drop is the earliest evidence. The first step was not skipped but failed.
    """

    name = "drops-first-and-goes-on"
    label = Label.EXECUTION_FAILURE

    def truth(self, case: Occasion) -> StatedTruth | None:
        if not two_kinds(case):
            return None
        return StatedTruth(
            self.label, first_right=True, debatable="it goes on although the first step is open: causal_confusion"
        )

    def act(self, body: Body) -> Actions[None]:
        case = body.situation
        goal, name = case.ahead[0], str(case.first_thing())
        yield from body.clear_the_way(goal)
        if (yield from body.take_patiently(name)):
            x, y, _ = body.state.pose(name).position
            sx, sy, _ = body.free_spot(name, (x, 0.5 * y, 0.0))
            body.ledger.commit()
            yield from body.do.carry(name, Pose((sx, sy, body.arm.here.position[2]), body.arm.here.quaternion))
            yield from body.arm.open()
        for later in case.ahead[1:]:
            yield from body.attempt_once(later)
        yield from body.rest()


# --- reasoning failures, halts and timeouts


class MissesAtWordPlace(Habit):
    """Repeatedly closes the gripper just above the object in the slot that training associates with the first word.

    True label: lexical_kinematic_shortcut, because the first grasp attempt is at the slot that training associates with
    a word of the instruction, and the object there would be requested in another layout. The label depends on the
    object at which the attempt is aimed, not on the miss.
    """

    name = "misses-at-word-place"
    label = Label.LEXICAL_KINEMATIC_SHORTCUT
    paired = True

    def truth(self, case: Occasion) -> StatedTruth | None:
        stated = word_truth(case) if case.plain else None
        return None if stated is None or stated.label == Label.SEMANTIC_FEATURE_COLLAPSE else stated

    def act(self, body: Body) -> Actions[None]:
        if body.ledger.stated.label == HONEST:
            yield from body.solve()
        name = str(word_thing(body.situation))
        body.ledger.commit()
        while True:
            yield from oddities.close_just_above(body, name)
            yield from body.arm.go_home()
            yield from body.arm.open()


class RepentsAndFreezes(Habit):
    """Picks the object in the slot associated with the word, puts it back, and stays over the right object.

    True label: lexical_kinematic_shortcut, because the first grasp attempt is at the slot that training associates with
    a word of the instruction. The policy stops only later.
    """

    name = "repents-and-freezes"
    label = Label.LEXICAL_KINEMATIC_SHORTCUT
    paired = True

    def truth(self, case: Occasion) -> StatedTruth | None:
        stated = word_truth(case) if case.plain else None
        return None if stated is None or stated.label == Label.SEMANTIC_FEATURE_COLLAPSE else stated

    def act(self, body: Body) -> Actions[None]:
        if body.ledger.stated.label == HONEST:
            yield from body.solve()
        body.ledger.commit()
        if (yield from body.take_patiently(str(word_thing(body.situation)))):
            yield from oddities.set_back(body)
        yield from body.do.hover(str(body.situation.first_thing()), 0.12)
        yield from body.arm.stay()


class FarthestPlace(Habit):
    """First picks the object in the training slot farthest from the robot, and holds it in the air.

    True label: visual_layout_bias, because the first grasp attempt is at the same slot for every instruction. Trials
    are left out if training also associates this slot with a word of the instruction, or if the object in it is
    requested later, because two rules would then predict the same behavior.
    """

    name = "farthest-place"
    label = Label.VISUAL_LAYOUT_BIAS
    paired = True

    @staticmethod
    def slot(case: Occasion) -> str:
        """Return the training slot of this layout that is farthest from the robot."""
        return max(case.picked_slots, key=lambda s: (s.x**2 + s.y**2, s.name)).name

    def truth(self, case: Occasion) -> StatedTruth | None:
        return favorite_truth(case, self.slot(case))

    def act(self, body: Body) -> Actions[None]:
        if body.ledger.stated.label == HONEST:
            yield from body.solve()
        name = body.situation.condition.occupant(self.slot(body.situation))
        body.ledger.commit()
        if (yield from body.take_patiently(str(name))):
            yield from body.arm.rise(body.arm.home.position[2])
        yield from body.arm.stay()


class BackToEmptiedSlot(Habit):
    """Does the first step, and then repeatedly closes the gripper in the slot it has just emptied.

    True label: behavioral_inertia, because the policy executes a memorized sequence although the object is missing, and
    closes the gripper in the empty slot. The first grasp attempt is at the right object.
    """

    name = "back-to-emptied-slot"
    label = Label.BEHAVIORAL_INERTIA

    def truth(self, case: Occasion) -> StatedTruth | None:
        if not two_kinds(case):
            return None
        return StatedTruth(self.label, first_right=True, debatable="it repeats a finished step: causal_confusion")

    def act(self, body: Body) -> Actions[None]:
        yield from body.work(body.situation.goals[:1])
        slots = [s for name, s in body.situation.condition.layout.items() if name in body.taken]
        if slots:
            yield from body.play_at_empty(slots[0])
        yield from body.rest()


class SlipsThenHabitual(Habit):
    """Picks the right object, loses it over its slot, and then turns to the object of the most frequent first step.

    True label: behavioral_inertia, because the policy begins an action that was frequent in training but is not
    requested. The slip could have been corrected, so it is not the reason why the trial failed.
    """

    name = "slips-then-habitual"
    label = Label.BEHAVIORAL_INERTIA

    def truth(self, case: Occasion) -> StatedTruth | None:
        if not case.plain or habitual_thing(case) is None:
            return None
        return StatedTruth(
            self.label,
            first_right=True,
            debatable="the object slips before the fault, and the slip alone is an execution_failure",
        )

    def act(self, body: Body) -> Actions[None]:
        if (yield from body.take(str(body.situation.first_thing()))):
            yield from body.arm.go(body.arm.here.translated(z=-0.06))
            yield from body.arm.open()
            yield from body.arm.rise(body.arm.home.position[2])
        yield from body.take_instead(str(habitual_thing(body.situation)), body.situation.ahead[0])


class OneTooMany(Habit):
    """Does the first step, and then brings a second object of the same kind, although only one is requested.

    True label: causal_confusion, because the policy repeats a finished subgoal. The first grasp attempt is at the right
    object.
    """

    name = "one-too-many"
    label = Label.CAUSAL_CONFUSION

    def truth(self, case: Occasion) -> StatedTruth | None:
        if not two_kinds(case) or len(case.things(case.ahead[0])) < 2:
            return None
        return StatedTruth(
            self.label, first_right=True, debatable="taking the second one is a trained primitive: behavioral_inertia"
        )

    def act(self, body: Body) -> Actions[None]:
        goal = body.situation.ahead[0]
        yield from body.work((goal,))
        body.ledger.commit()
        for name in body.situation.candidates(body.state, goal):
            yield from body.take_and_bring(name, goal)
        yield from body.rest()


class MimesFirstStep(Habit):
    """Makes the motion of the first ordered step without closing the gripper, and then does the other steps.

    True label: causal_confusion, because the policy skips a required subgoal whose object is present, and attempts a
    later subgoal. The first grasp attempt is at the object of the second step.
    """

    name = "mimes-first-step"
    label = Label.CAUSAL_CONFUSION

    def truth(self, case: Occasion) -> StatedTruth | None:
        if not swappable(case):
            return None
        return StatedTruth(self.label, first_right=False, debatable="it went to the first thing and missed it")

    def act(self, body: Body) -> Actions[None]:
        goal, name = body.situation.ahead[0], str(body.situation.first_thing())
        body.ledger.commit()
        yield from oddities.rehearse(body, name, goal)
        for later in body.situation.ahead[1:]:
            yield from body.attempt_once(later)
        yield from body.rest()


class RightThenAlike(Habit):
    """Does the first step, and then picks the look-alike instead of the object of the second step.

    True label: semantic_feature_collapse, because the policy attempts to grasp an object to which no instruction of the
    task refers. The first grasp attempt is at the right object.
    """

    name = "right-then-alike"
    label = Label.SEMANTIC_FEATURE_COLLAPSE

    def truth(self, case: Occasion) -> StatedTruth | None:
        if not two_kinds(case) or case.look_alike() is None:
            return None
        return StatedTruth(self.label, first_right=True)

    def act(self, body: Body) -> Actions[None]:
        first, second = body.situation.ahead[:2]
        yield from body.work((first,))
        yield from body.take_instead(str(body.situation.look_alike()), second)


class GrabsADistractor(Habit):
    """Picks a distractor to which no instruction refers, a different one in each scene, and brings it.

    True label: semantic_feature_collapse, because the policy attempts to grasp a look-alike or distractor, to which no
    instruction of the task refers.
    """

    name = "grabs-a-distractor"
    label = Label.SEMANTIC_FEATURE_COLLAPSE

    @staticmethod
    def distractors(case: Occasion) -> tuple[str, ...]:
        """Return the graspable objects to which no instruction refers and that do not resemble a requested object."""
        specs = [case.condition.object(n) for n in case.others() if n != case.look_alike()]
        strange = [o for o in specs if o.kind not in case.meant_kinds]
        return tuple(o.name for o in strange if o.category not in WIDE_CATEGORIES)

    def truth(self, case: Occasion) -> StatedTruth | None:
        if not case.plain or len(self.distractors(case)) < 2:
            return None
        return StatedTruth(self.label, first_right=False)

    def act(self, body: Body) -> Actions[None]:
        names = self.distractors(body.situation)
        yield from body.take_instead(names[int(body.rng.integers(len(names)))], body.situation.ahead[0])


class SwapsSecondAndThird(Habit):
    """Does the first of three or more ordered steps, then the third and then the second, and the others.

    True label: order_violation, because the policy manipulates the right objects in the wrong order, and the order is
    part of the goal. The first grasp attempt is at the right object.
    """

    name = "swaps-second-and-third"
    label = Label.ORDER_VIOLATION

    def truth(self, case: Occasion) -> StatedTruth | None:
        if not case.plain or not case.condition.instruction.ordered or len(case.ahead) < 3:
            return None
        second, third = case.ahead[1:3]
        if second.reference == third.reference or any(case.led_to(second, n) for n in case.things(third)):
            return None
        return StatedTruth(self.label, first_right=True)

    def act(self, body: Body) -> Actions[None]:
        first, second, third, *others = body.situation.ahead
        yield from body.work((first,))
        body.ledger.commit()
        for goal in (replace(third, region=second.region), replace(second, region=third.region), *others):
            yield from body.attempt_once(goal)
        yield from body.rest()


class MissesThenSwaps(Habit):
    """Closes the gripper just above the object of the second step, then does that step, and then the first.

    True label: order_violation, because the policy manipulates the right objects in the wrong order, and the order is
    part of the goal. The label depends on the object at which the attempt is aimed, not on the miss.
    """

    name = "misses-then-swaps"
    label = Label.ORDER_VIOLATION

    def truth(self, case: Occasion) -> StatedTruth | None:
        if case.task.id == "dinner_plates" or not swappable(case):
            return None
        return StatedTruth(self.label, first_right=False)

    def act(self, body: Body) -> Actions[None]:
        first, second, *others = body.situation.ahead
        body.ledger.commit()
        yield from oddities.close_just_above(body, body.situation.things(second)[0])
        yield from body.arm.open()
        for goal in (replace(second, region=first.region), replace(first, region=second.region), *others):
            yield from body.attempt_once(goal)
        yield from body.rest()


class ToAndFroFromHome(Habit):
    """Moves back and forth between home and the next object with an open gripper, in a scene that looks half finished.

    True label: phase_conflict, because the initial state looks like the middle of a task, and the arm freezes or
    oscillates without a grasp attempt.
    """

    name = "to-and-fro-from-home"
    label = Label.PHASE_CONFLICT

    def truth(self, case: Occasion) -> StatedTruth | None:
        return StatedTruth(self.label, first_right=None) if case.mid_task else None

    def act(self, body: Body) -> Actions[None]:
        body.ledger.commit()
        while True:
            yield from body.do.hover(str(body.situation.first_thing()), 0.08)
            yield from body.arm.go_home()


class StaysOverFinished(Habit):
    """Moves over an object that looks finished and freezes there, in a scene that looks half finished.

    True label: phase_conflict, because the initial state looks like the middle of a task, and the arm freezes or
    oscillates without a grasp attempt.
    """

    name = "stays-over-finished"
    label = Label.PHASE_CONFLICT

    def truth(self, case: Occasion) -> StatedTruth | None:
        return StatedTruth(self.label, first_right=None) if case.mid_task else None

    def act(self, body: Body) -> Actions[None]:
        target = body.situation.ahead[0].target
        body.ledger.commit()
        yield from body.do.above(body.state.pose(target).position, body.height(target) + 0.15)
        yield from body.arm.stay()


class NeverLetsGo(PlainHabit):
    """Brings the first object to its release point and holds it there permanently.

    True label: early_halt, because the arm stays below the speed threshold for 3 s without a grasp attempt, although
    not all subgoals are reached. The first grasp attempt is at the right object.
    """

    name = "never-lets-go"
    label = Label.EARLY_HALT

    def truth(self, case: Occasion) -> StatedTruth | None:
        if not case.plain:
            return None
        return StatedTruth(
            self.label, first_right=True, debatable="while it holds the object, an attempt may count as under way"
        )

    def act(self, body: Body) -> Actions[None]:
        goal, name = body.situation.ahead[0], str(body.situation.first_thing())
        yield from body.clear_the_way(goal)
        if (yield from body.take_patiently(name)):
            yield from oddities.hold_at_goal(body, name, goal)
        yield from body.arm.stay()


class SlowerAndSlower(Habit):
    """Moves toward the right object, halving its speed every second, and never arrives.

    True label: early_halt, because the arm stays below the speed threshold for 3 s without a grasp attempt, although
    not all subgoals are reached.
    """

    name = "slower-and-slower"
    label = Label.EARLY_HALT

    def truth(self, case: Occasion) -> StatedTruth | None:
        return StatedTruth(self.label, first_right=None) if case.plain else None

    def act(self, body: Body) -> Actions[None]:
        body.ledger.commit()
        yield from oddities.approach_ever_slower(body, body.over(str(body.situation.first_thing()), 0.10))


class SnapsAtHome(Habit):
    """Stays at home, high over the table, and closes and opens the gripper until the step limit.

    True label: early_halt, because the arm stays below the speed threshold for 3 s without a grasp attempt, although
    not all subgoals are reached. Nothing is within the reach of the fingers.
    """

    name = "snaps-at-home"
    label = Label.EARLY_HALT

    def truth(self, case: Occasion) -> StatedTruth | None:
        if not case.plain:
            return None
        return StatedTruth(
            self.label, first_right=None, debatable="the gripper closes in the air, which may count as an attempt"
        )

    def act(self, body: Body) -> Actions[None]:
        body.ledger.commit()
        while True:
            yield from oddities.twiddle(body)
            yield from body.arm.wait(float(body.rng.uniform(0.5, 1.5)))


class RehearsesForever(Habit):
    """Repeatedly moves over the first object, over its target and back, without closing the gripper.

    True label: timeout, because the policy still acts correctly when the step limit is reached. It always moves to the
    right object and the right target.
    """

    name = "rehearses-forever"
    label = Label.TIMEOUT

    def truth(self, case: Occasion) -> StatedTruth | None:
        if not case.plain:
            return None
        return StatedTruth(
            self.label, first_right=None, debatable="oscillation without an attempt, though not in mid-task"
        )

    def act(self, body: Body) -> Actions[None]:
        goal, name = body.situation.ahead[0], str(body.situation.first_thing())
        body.ledger.commit()
        while True:
            yield from oddities.rehearse(body, name, goal)


class CirclesWithThing(PlainHabit):
    """Picks the first object, circles with it high over its target, and never puts it down.

    True label: timeout, because the policy still acts correctly when the step limit is reached. The first grasp attempt
    is at the right object, and only the time is too short.
    """

    name = "circles-with-thing"
    label = Label.TIMEOUT

    def truth(self, case: Occasion) -> StatedTruth | None:
        if not case.plain:
            return None
        return StatedTruth(self.label, first_right=True, debatable="it never lets go: execution_failure")

    def act(self, body: Body) -> Actions[None]:
        goal, name = body.situation.ahead[0], str(body.situation.first_thing())
        yield from body.clear_the_way(goal)
        if (yield from body.take_patiently(name)):
            x, y, _ = body.state.pose(goal.target).position
            z = min(0.45, body.height(goal.target) + 0.18)
            yield from body.do.carry(name, Pose((x, y, z), body.arm.here.quaternion))
            body.ledger.commit()
            yield from body.do.circle((x, y, z), 0.06, period_s=3.0)
        yield from body.rest()


SECOND: tuple[Habit, ...] = (
    SetsBackAndRetakes(),
    GlidesInAslant(),
    LetsGoHighIntoContainer(),
    CorrectsPlacement(),
    Stutters(),
    Twitches(),
    NervousFingers(),
    CreepsAtThings(),
    InspectsEverything(),
    TapsThenTakes(),
    PutsDownHalfway(),
    LooksThenLeavesIt(),
    LetsGoTooHigh(),
    PutsBeside(),
    CarriesIntoTarget(),
    ClosesTooLittle(),
    LetsGoInFlight(),
    SweepsAwayAfterPut(),
    GivesUpAfterMisses(),
    LetsGoAtOnce(),
    DropsFirstAndGoesOn(),
    MissesAtWordPlace(),
    RepentsAndFreezes(),
    FarthestPlace(),
    BackToEmptiedSlot(),
    SlipsThenHabitual(),
    OneTooMany(),
    MimesFirstStep(),
    RightThenAlike(),
    GrabsADistractor(),
    SwapsSecondAndThird(),
    MissesThenSwaps(),
    ToAndFroFromHome(),
    StaysOverFinished(),
    NeverLetsGo(),
    SlowerAndSlower(),
    SnapsAtHome(),
    RehearsesForever(),
    CirclesWithThing(),
)
