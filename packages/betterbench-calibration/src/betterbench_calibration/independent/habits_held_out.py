"""Held-out part of the independent family. Its habits are used once and not inspected while the diagnosis changes."""

# ruff: noqa: D102 - truth and act are documented in the base class

from __future__ import annotations

from betterbench.geometry import Pose, from_yaw
from betterbench.tasks import Expected, Label
from betterbench_calibration.independent.body import Body
from betterbench_calibration.independent.choices import (
    favorite_truth,
    moved_target,
    swappable,
    unasked_step,
    vacated_slot,
    word_thing,
    word_truth,
)
from betterbench_calibration.independent.controller import Actions
from betterbench_calibration.independent.habit import Habit, PlainHabit
from betterbench_calibration.independent.occasion import Occasion
from betterbench_calibration.independent.truth import HONEST, StatedTruth


class GlanceThenWordPlace(Habit):
    """Moves over the right object, turns away, and lifts the object in the slot that training associates with the word.

    True label: lexical_kinematic_shortcut, because the first grasp attempt is at the slot that training associates with
    a word of the instruction, and the object there would be requested in another layout. Hovering over the right object
    is not a grasp attempt. The policy never releases the held object.
    """

    name = "glance-then-word-place"
    label = Label.LEXICAL_KINEMATIC_SHORTCUT
    paired = True

    def truth(self, case: Occasion) -> StatedTruth | None:
        stated = word_truth(case) if case.plain else None
        return None if stated is None or stated.label == Label.SEMANTIC_FEATURE_COLLAPSE else stated

    def act(self, body: Body) -> Actions[None]:
        yield from body.do.hover(str(body.situation.first_thing()), 0.07)
        yield from body.arm.wait(0.5)
        if body.ledger.stated.label == HONEST:
            yield from body.solve()
        body.ledger.commit()
        if (yield from body.take_patiently(str(word_thing(body.situation)))):
            yield from body.arm.rise(body.arm.home.position[2])
        yield from body.arm.stay()


class NearestPlace(Habit):
    """First picks the object in the training slot nearest to the robot, regardless of the instruction.

    True label: visual_layout_bias, because the first grasp attempt is at the same slot for every instruction. Trials
    are left out if training also associates this slot with a word of the instruction, or if the object in it is
    requested later, because two rules would then predict the same behavior.
    """

    name = "nearest-place"
    label = Label.VISUAL_LAYOUT_BIAS
    paired = True

    @staticmethod
    def slot(case: Occasion) -> str:
        """Return the training slot of this layout that is nearest to the robot."""
        return min(case.picked_slots, key=lambda s: (s.x**2 + s.y**2, s.name)).name

    def truth(self, case: Occasion) -> StatedTruth | None:
        return favorite_truth(case, self.slot(case))

    def act(self, body: Body) -> Actions[None]:
        name = body.situation.condition.occupant(self.slot(body.situation))
        yield from body.take_whatever(str(name))


class BrokenOffAtAlike(Habit):
    """Repeatedly descends to the look-alike, and stops a few centimeters above it each time.

    True label: semantic_feature_collapse, because the policy acts on the wrong object, although it never closes the
    gripper.
    """

    name = "broken-off-at-alike"
    label = Label.SEMANTIC_FEATURE_COLLAPSE

    def truth(self, case: Occasion) -> StatedTruth | None:
        if case.look_alike() is None or case.condition.expected is not Expected.SUCCEED:
            return None
        return StatedTruth(
            self.label, first_right=None, debatable="the gripper never closes: timeout, or no attempt at all"
        )

    def act(self, body: Body) -> Actions[None]:
        body.ledger.commit()
        yield from body.approach_and_break_off(str(body.situation.look_alike()))


class MissedAlike(Habit):
    """Closes the gripper above the look-alike, picks it at the next try, and puts it down next to its slot.

    True label: semantic_feature_collapse, because the policy attempts to grasp an object to which no instruction of the
    task refers. The first closing already shows this, because it misses only in height.
    """

    name = "missed-alike"
    label = Label.SEMANTIC_FEATURE_COLLAPSE

    def truth(self, case: Occasion) -> StatedTruth | None:
        if case.look_alike() is None or case.condition.expected is not Expected.SUCCEED:
            return None
        return StatedTruth(self.label, first_right=False)

    def act(self, body: Body) -> Actions[None]:
        name = str(body.situation.look_alike())
        body.ledger.commit()
        up = body.height(name) + 0.015 - body.do.choose_hold(name).tool.position[2]
        yield from body.do.pick(name, shift=(0.0, 0.0, up))
        if (yield from body.take_patiently(name)):
            x, y, _ = body.free_direction(name)
            yield from body.arm.go(body.arm.here.translated(0.08 * x, 0.08 * y))
            yield from body.arm.go(body.arm.here.translated(z=-0.085), pace=0.5)
            yield from body.arm.open()
        yield from body.rest()


class RightThenOtherDemonstration(Habit):
    """Does the first step, and then the second step of another demonstration, although it is not requested here.

    True label: behavioral_inertia, because the policy begins an action that was frequent in training but is not
    requested. The first grasp attempt is at the right object.
    """

    name = "right-then-other-demonstration"
    label = Label.BEHAVIORAL_INERTIA

    def truth(self, case: Occasion) -> StatedTruth | None:
        return None if unasked_step(case) is None else StatedTruth(self.label, first_right=True)

    def act(self, body: Body) -> Actions[None]:
        found = unasked_step(body.situation)
        yield from body.work(body.situation.goals[:1])
        if found is not None:
            body.ledger.commit()
            yield from body.take_and_bring(*found)
        yield from body.rest()


class VacatedSlot(Habit):
    """Repeatedly closes the gripper in the empty slot where the first object was in training.

    True label: behavioral_inertia, because the policy executes a memorized sequence although the object is missing, and
    closes the gripper in the empty slot. The object is now elsewhere.
    """

    name = "vacated-slot"
    label = Label.BEHAVIORAL_INERTIA

    def truth(self, case: Occasion) -> StatedTruth | None:
        return StatedTruth(self.label, first_right=False) if vacated_slot(case) is not None else None

    def act(self, body: Body) -> Actions[None]:
        yield from body.play_at_empty(str(vacated_slot(body.situation)))


class AbsolutePut(Habit):
    """Picks the right object and puts it where its target was in training.

    True label: behavioral_inertia, because it executes the motion from training, which is not requested here. The
    placement is accurate, but at the wrong target.
    """

    name = "absolute-put"
    label = Label.BEHAVIORAL_INERTIA

    def truth(self, case: Occasion) -> StatedTruth | None:
        first = case.ahead[0] if case.plain and case.ahead else None
        if first is None or first.relation not in ("beside", "on_plate") or not moved_target(case, first):
            return None
        return StatedTruth(
            self.label,
            first_right=True,
            debatable="a placement at a wrong place is hard to tell from an inaccurate placement",
        )

    def act(self, body: Body) -> Actions[None]:
        case = body.situation
        for goal in case.ahead:
            name = case.things(goal)[0]
            if (yield from body.take_patiently(name)):
                body.ledger.commit()
                slot = case.task.slot(case.base.layout[goal.target])
                trained = Pose((slot.x, slot.y, 0.0), from_yaw(slot.yaw))
                yield from body.bring(name, goal, as_if_at=trained)
        yield from body.rest()


class SkipMiddle(Habit):
    """Does the first of three or more ordered steps, skips one that is not the last, and continues.

    True label: causal_confusion, because the policy skips a required subgoal whose object is present, and attempts a
    later subgoal.
    """

    name = "skip-middle"
    label = Label.CAUSAL_CONFUSION

    def truth(self, case: Occasion) -> StatedTruth | None:
        if not case.plain or not case.condition.instruction.ordered or len(case.ahead) < 3:
            return None
        return StatedTruth(self.label, first_right=True)

    def act(self, body: Body) -> Actions[None]:
        ahead = body.situation.ahead
        yield from body.work(ahead[: len(ahead) - 2])
        body.ledger.commit()
        yield from body.attempt_once(ahead[-1])
        yield from body.rest()


class TakeOutAgain(Habit):
    """Does the first step, and then repeatedly takes the object out of its target and puts it back.

    True label: causal_confusion, because the policy repeats a finished subgoal. The first grasp attempt is at the right
    object.
    """

    name = "take-out-again"
    label = Label.CAUSAL_CONFUSION

    def truth(self, case: Occasion) -> StatedTruth | None:
        if not case.plain or len(case.ahead) < 2:
            return None
        first, second = case.ahead[:2]
        return StatedTruth(self.label, first_right=True) if first.reference != second.reference else None

    def act(self, body: Body) -> Actions[None]:
        goal = body.situation.ahead[0]
        yield from body.work((goal,))
        body.ledger.commit()
        while True:
            names = body.situation.condition.resolve(goal.reference)
            name = next((n for n in names if n in body.taken), names[0])
            yield from body.take_and_bring(name, goal)


class LastFirst(Habit):
    """Does the last of three or more ordered steps first and then the others.

    True label: order_violation, because the policy manipulates the right objects in the wrong order, and the order is
    part of the goal.
    """

    name = "last-first"
    label = Label.ORDER_VIOLATION

    def truth(self, case: Occasion) -> StatedTruth | None:
        return StatedTruth(self.label, first_right=False) if swappable(case) and len(case.ahead) > 2 else None

    def act(self, body: Body) -> Actions[None]:
        *others, last = body.situation.ahead
        body.ledger.commit()
        yield from body.attempt_once(last)
        for goal in others:
            yield from body.attempt_once(goal)
        yield from body.rest()


class CircleOverAlike(Habit):
    """Circles about 10 cm above the look-alike with an open gripper, without pausing, until the step limit.

    True label: semantic_feature_collapse, because the policy acts on the wrong object all the time.
    """

    name = "circle-over-alike"
    label = Label.SEMANTIC_FEATURE_COLLAPSE

    def truth(self, case: Occasion) -> StatedTruth | None:
        if case.look_alike() is None or case.condition.expected is not Expected.SUCCEED:
            return None
        return StatedTruth(
            self.label, first_right=None, debatable="the gripper never closes: timeout, or no attempt at all"
        )

    def act(self, body: Body) -> Actions[None]:
        name = str(body.situation.look_alike())
        body.ledger.commit()
        yield from body.do.hover(name, 0.05)
        yield from body.do.circle(body.over(name, 0.05), 0.035)


class BrokenOffAtRight(Habit):
    """Repeatedly descends to the right object, and stops a few centimeters above it each time.

    True label: timeout, because the policy still acts correctly when the step limit is reached. It always moves to the
    right object but never closes the gripper.
    """

    name = "broken-off-at-right"
    label = Label.TIMEOUT

    def truth(self, case: Occasion) -> StatedTruth | None:
        if not case.plain:
            return None
        return StatedTruth(
            self.label, first_right=None, debatable="oscillation without an attempt, though not in mid-task"
        )

    def act(self, body: Body) -> Actions[None]:
        body.ledger.commit()
        yield from body.approach_and_break_off(str(body.situation.first_thing()))


class FrozenFromTheStart(Habit):
    """Does not move at all in a scene that looks like the middle of a task.

    True label: phase_conflict, because the initial state looks like the middle of a task, and the arm freezes.
    """

    name = "frozen-from-the-start"
    label = Label.PHASE_CONFLICT

    def truth(self, case: Occasion) -> StatedTruth | None:
        return StatedTruth(self.label, first_right=None) if case.mid_task else None

    def act(self, body: Body) -> Actions[None]:
        body.ledger.commit()
        yield from body.arm.stay()


class SwayToTarget(Habit):
    """Moves back and forth, empty, between the next object and its target, in a scene that looks half finished.

    True label: phase_conflict, because the initial state looks like the middle of a task, and the arm freezes or
    oscillates without a grasp attempt.
    """

    name = "sway-to-target"
    label = Label.PHASE_CONFLICT

    def truth(self, case: Occasion) -> StatedTruth | None:
        return StatedTruth(self.label, first_right=None) if case.mid_task else None

    def act(self, body: Body) -> Actions[None]:
        case = body.situation
        body.ledger.commit()
        thing, target = str(case.first_thing()), case.ahead[0].target
        z = max(body.height(thing), body.height(target)) + 0.12
        a, b = (body.state.pose(n).position for n in (thing, target))
        yield from body.do.sway((a[0], a[1], z), (b[0], b[1], z))


class FreezeCarrying(PlainHabit):
    """Picks the first object and stops permanently on the way to the target, with the object in the air.

    True label: early_halt, because the arm stays below the speed threshold for 3 s without a grasp attempt, although
    not all subgoals are reached. The first grasp attempt is at the right object.
    """

    name = "freeze-carrying"
    label = Label.EARLY_HALT

    def act(self, body: Body) -> Actions[None]:
        goal, name = body.situation.ahead[0], str(body.situation.first_thing())
        yield from body.clear_the_way(goal)
        if (yield from body.take_patiently(name)):
            yield from body.arm.rise(body.arm.here.position[2] + 0.06)
            body.ledger.commit()
            yield from body.arm.go(body.on_the_way(body.state.pose(goal.target).position, 0.4))
        yield from body.arm.stay()


class NeverStarts(Habit):
    """Moves a few centimeters at the start and stops permanently, in a scene that looks like the start of a task.

    True label: early_halt, because the arm stays below the speed threshold for 3 s without a grasp attempt, although
    not all subgoals are reached.
    """

    name = "never-starts"
    label = Label.EARLY_HALT

    def truth(self, case: Occasion) -> StatedTruth | None:
        return StatedTruth(self.label, first_right=None) if case.plain else None

    def act(self, body: Body) -> Actions[None]:
        x, y, _ = body.state.pose(str(body.situation.first_thing())).position
        body.ledger.commit()
        yield from body.arm.go(body.on_the_way((x, y, 0.0), 0.2))
        yield from body.arm.stay()


class MissAbove(PlainHabit):
    """Repeatedly closes the gripper fully 7 to 11 cm above the right object, and then makes the placing motion.

    True label: execution_failure, because the target and the timing are right, but the pose is wrong.
    """

    name = "miss-above"
    label = Label.EXECUTION_FAILURE

    def act(self, body: Body) -> Actions[None]:
        goal, name = body.situation.ahead[0], str(body.situation.first_thing())
        up = body.height(name) + float(body.rng.uniform(0.07, 0.11))
        body.ledger.commit()
        while True:
            up_m = up - body.do.choose_hold(name).tool.position[2]
            yield from body.do.pick(name, shift=(0.0, 0.0, up_m))
            yield from body.let_go_above(goal.target)


class MissByYaw(Habit):
    """Descends on a long object with the gripper rotated by 90 degrees, so that the fingers touch its top.

    True label: execution_failure, because the target and the timing are right, but the pose is wrong.
    """

    name = "miss-by-yaw"
    label = Label.EXECUTION_FAILURE

    def truth(self, case: Occasion) -> StatedTruth | None:
        if not case.plain or case.condition.object(str(case.first_thing())).category not in LONG_CATEGORIES:
            return None
        return StatedTruth(self.label, first_right=True)

    def act(self, body: Body) -> Actions[None]:
        name = str(body.situation.first_thing())
        yield from body.clear_the_way(body.situation.ahead[0])
        body.ledger.commit()
        while True:
            yield from body.press_crosswise(name)
            yield from body.arm.go_home()
            yield from body.arm.open()


LONG_CATEGORIES = frozenset({"fork", "spoon", "stapler", "crushed_can"})
"""Categories whose objects are longer than the gripper opens, or take a finger on their top crosswise."""


class PushRight(Habit):
    """Pushes the right object 12 cm along the table with closed fingers instead of taking it, then stays at home.

    True label: execution_failure, because the target and the timing are right, but the manipulation fails. There is no
    grasp attempt.
    """

    name = "push-right"
    label = Label.EXECUTION_FAILURE

    def truth(self, case: Occasion) -> StatedTruth | None:
        if not case.plain:
            return None
        return StatedTruth(
            self.label,
            first_right=None,
            debatable="a push may not count as an attempt, and an arm that then stays at home is an early_halt",
        )

    def act(self, body: Body) -> Actions[None]:
        name = str(body.situation.first_thing())
        body.ledger.commit()
        yield from body.do.push(name, body.free_direction(name), 0.12)
        yield from body.rest()


class SweepNeighbor(Habit):
    """Pushes through a neighboring object on the way to the right object, and then continues correctly.

    True label: execution_failure, because the target and the timing are right, but there is a collision. If the
    neighbor moves by less than 5 cm, the task can succeed.
    """

    name = "sweep-neighbor"
    label = Label.EXECUTION_FAILURE

    def truth(self, case: Occasion) -> StatedTruth | None:
        if not case.plain or not case.others():
            return None
        return StatedTruth(self.label, first_right=True, debatable="a push through a neighbor may look deliberate")

    def act(self, body: Body) -> Actions[None]:
        name = str(body.situation.first_thing())
        body.ledger.commit()
        yield from body.sweep_through(body.nearest_other(name), name)
        yield from body.solve()


class LooseGrip(PlainHabit):
    """Picks the right object and loosens the gripper by a few millimeters once the object is lifted, so that it slips.

    True label: execution_failure, because the target and the timing are right, but the object slips. The policy
    continues as if it still held the object.
    """

    name = "loose-grip"
    label = Label.EXECUTION_FAILURE

    def act(self, body: Body) -> Actions[None]:
        goal, name = body.situation.ahead[0], str(body.situation.first_thing())
        yield from body.clear_the_way(goal)
        if (yield from body.take_patiently(name)):
            body.ledger.commit()
            yield from body.arm.rise(body.arm.here.position[2] + 0.04)
            yield from body.arm.open(body.state.finger_width_m + 0.010)
            yield from body.let_go_above(goal.target)
        yield from body.rest()


class PondersAndDawdles(Habit):
    """Does everything right, but pauses for 4 to 6 s between motions, too long for the step limit.

    True label: timeout, because the policy still acts correctly when the step limit is reached. It continues correctly
    after each pause.
    """

    name = "ponders-and-dawdles"
    label = Label.TIMEOUT

    def truth(self, case: Occasion) -> StatedTruth | None:
        if not case.plain:
            return None
        return StatedTruth(
            self.label, first_right=True, debatable="taken literally, the definition makes a pause of 3 s an early_halt"
        )

    def act(self, body: Body) -> Actions[None]:
        body.ledger.commit()
        for goal in body.situation.ahead:
            name = body.situation.things(goal)[0]
            yield from body.ponder()
            yield from body.clear_the_way(goal)
            yield from body.do.hover(name, 0.10)
            yield from body.ponder()
            while not (yield from body.take(name)):
                yield from body.arm.open()
            yield from body.ponder()
            yield from body.arm.go_home()
            for _ in range(3):
                yield from body.ponder()
            yield from body.bring(name, goal)
        yield from body.solve()


class WideDetours(PlainHabit):
    """Visits two far corners of the workspace before each step, high above everything.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "wide-detours"
    label = HONEST

    def act(self, body: Body) -> Actions[None]:
        for goal in body.situation.goals:
            for side in (-1.0, 1.0):
                x, y = float(body.rng.uniform(0.38, 0.55)), side * float(body.rng.uniform(0.15, 0.28))
                yield from body.do.above((x, y, 0.0), 0.38)
            yield from body.work((goal,))
        yield from body.rest()


class TwoMissesThenRight(PlainHabit):
    """Closes the gripper twice about 4 to 5 cm next to the object, on different sides, then picks it.

    True label: success, because the misses are corrected. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "two-misses-then-right"
    label = HONEST

    def act(self, body: Body) -> Actions[None]:
        name = str(body.situation.first_thing())
        yield from body.clear_the_way(body.situation.ahead[0])
        x, y, _ = body.emptiest_side(name, float(body.rng.uniform(0.04, 0.05)))
        up = body.height(name) + 0.01 - body.do.choose_hold(name).tool.position[2]
        for side in (1.0, -1.0):
            yield from body.do.pick(name, shift=(side * x, side * y, up))
            body.ledger.mishap(name, "the gripper closed beside it")
            yield from body.arm.open()
        yield from body.solve()


class StopsWithThingInAir(PlainHabit):
    """Stops for 4 to 6 s with each object in the air over its target, then puts it down.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``).
    """

    name = "stops-with-thing-in-air"
    label = HONEST

    def act(self, body: Body) -> Actions[None]:
        for goal in body.situation.ahead:
            yield from body.clear_the_way(goal)
            name = body.situation.things(goal)[0]
            if (yield from body.take(name)):
                yield from body.arm.go_home()
                yield from body.arm.wait(float(body.rng.uniform(4.0, 6.0)))
                yield from body.bring(name, goal)
        yield from body.solve()


class LooksAtAlikeThenRight(Habit):
    """Descends over the look-alike with an open gripper, pauses, leaves it, and picks the right object.

    Only the grasp counts as an attempt. True label: success, because the behavior is not a fault. If such a trial
    fails, the label is timeout or execution_failure (rule 3 in ``truth.py``).
    """

    name = "looks-at-alike-then-right"
    label = HONEST

    def truth(self, case: Occasion) -> StatedTruth | None:
        return StatedTruth(self.label, first_right=True) if case.plain and case.look_alike() is not None else None

    def act(self, body: Body) -> Actions[None]:
        yield from body.do.hover(str(body.situation.look_alike()), 0.03)
        yield from body.arm.wait(1.0)
        yield from body.solve()


HELD_OUT: tuple[Habit, ...] = (
    GlanceThenWordPlace(),
    NearestPlace(),
    BrokenOffAtAlike(),
    MissedAlike(),
    RightThenOtherDemonstration(),
    VacatedSlot(),
    AbsolutePut(),
    SkipMiddle(),
    TakeOutAgain(),
    LastFirst(),
    CircleOverAlike(),
    BrokenOffAtRight(),
    FrozenFromTheStart(),
    SwayToTarget(),
    FreezeCarrying(),
    NeverStarts(),
    MissAbove(),
    MissByYaw(),
    PushRight(),
    SweepNeighbor(),
    LooseGrip(),
    PondersAndDawdles(),
    WideDetours(),
    TwoMissesThenRight(),
    StopsWithThingInAir(),
    LooksAtAlikeThenRight(),
)
