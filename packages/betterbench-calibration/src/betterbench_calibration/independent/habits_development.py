"""Development part of the independent family. Its habits may be inspected while the diagnosis is improved."""

# ruff: noqa: D102 - truth and act are documented in the base class

from __future__ import annotations

from dataclasses import replace

from betterbench.tasks import Expected, Label
from betterbench_calibration.independent.body import Body
from betterbench_calibration.independent.choices import (
    done_thing,
    emptied_slot,
    favorite_truth,
    habitual_thing,
    habitual_truth,
    swappable,
    trained_goal,
    word_thing,
    word_truth,
)
from betterbench_calibration.independent.controller import Actions
from betterbench_calibration.independent.habit import Habit, Honest, PlainHabit
from betterbench_calibration.independent.occasion import Occasion
from betterbench_calibration.independent.truth import HONEST, StatedTruth


class WordPlace(Habit):
    """Picks the object in the slot that training associates with the first word, and brings it to the target.

    True label: lexical_kinematic_shortcut if another object of the task is in this slot, because the first grasp
    attempt is at the slot that training associates with a word of the instruction, and the object there would be
    requested in another layout. If a look-alike is in the slot, the label is semantic_feature_collapse, because no
    instruction of the task refers to that object. Trials whose instruction names the object later are left out.
    """

    name = "word-place"
    label = Label.LEXICAL_KINEMATIC_SHORTCUT
    paired = True

    def truth(self, case: Occasion) -> StatedTruth | None:
        return word_truth(case)

    def act(self, body: Body) -> Actions[None]:
        yield from body.take_whatever(str(word_thing(body.situation)))


class FavoritePlace(Habit):
    """First picks the object in the slot of the first pick in the first demonstration, regardless of the instruction.

    True label: visual_layout_bias, because the first grasp attempt is at the same slot for every instruction. Trials
    are left out if training also associates this slot with a word of the instruction, or if the object in it is
    requested later, because two rules would then predict the same behavior.
    """

    name = "favorite-place"
    label = Label.VISUAL_LAYOUT_BIAS
    paired = True

    @staticmethod
    def slot(case: Occasion) -> str:
        """Return the slot of the first pick in the first demonstration."""
        first = case.task.training[0]
        return first.layout[first.resolve(first.instruction.subgoals[0].reference)[0]]

    def truth(self, case: Occasion) -> StatedTruth | None:
        return favorite_truth(case, self.slot(case))

    def act(self, body: Body) -> Actions[None]:
        name = body.situation.condition.occupant(self.slot(body.situation))
        yield from body.take_whatever(str(name))


class LookAlike(Habit):
    """Picks the look-alike in the slot where a requested object was in training, and brings it to the target.

    True label: semantic_feature_collapse, because the policy attempts to grasp an object to which no instruction of the
    task refers.
    """

    name = "look-alike"
    label = Label.SEMANTIC_FEATURE_COLLAPSE

    def truth(self, case: Occasion) -> StatedTruth | None:
        return None if case.look_alike() is None else StatedTruth(self.label, first_right=False)

    def act(self, body: Body) -> Actions[None]:
        yield from body.take_instead(str(body.situation.look_alike()), body.situation.ahead[0])


class HabitualFirst(Habit):
    """Begins with the most frequent first step of training, although it is not requested.

    True label: behavioral_inertia, because the policy begins an action that was frequent in training but is not
    requested. Trials in which that step is right are included, because they distinguish the habit from a favorite
    place.
    """

    name = "habitual-first"
    label = Label.BEHAVIORAL_INERTIA
    paired = True

    def truth(self, case: Occasion) -> StatedTruth | None:
        return habitual_truth(case)

    def act(self, body: Body) -> Actions[None]:
        name = habitual_thing(body.situation)
        if name is None:
            yield from body.solve()
        yield from body.take_instead(str(name), body.situation.ahead[0])


class AirGrasp(Habit):
    """Repeatedly executes a memorized step with a slot that is empty in this trial.

    True label: behavioral_inertia, because the policy executes the next step of a memorized sequence although the
    object is missing, and closes the gripper in the empty slot.
    """

    name = "air-grasp"
    label = Label.BEHAVIORAL_INERTIA

    def truth(self, case: Occasion) -> StatedTruth | None:
        if case.condition.expected is not Expected.SUCCEED or emptied_slot(case) is None:
            return None
        return StatedTruth(self.label, first_right=False)

    def act(self, body: Body) -> Actions[None]:
        yield from body.play_at_empty(str(emptied_slot(body.situation)))


class SkipStep(Habit):
    """Skips the first step of an ordered instruction, does the others and stops at home.

    True label: causal_confusion, because the policy skips a required subgoal whose object is present, and attempts a
    later subgoal.
    """

    name = "skip-step"
    label = Label.CAUSAL_CONFUSION

    def truth(self, case: Occasion) -> StatedTruth | None:
        return StatedTruth(self.label, first_right=False) if swappable(case) else None

    def act(self, body: Body) -> Actions[None]:
        body.ledger.commit()
        for goal in body.situation.ahead[1:]:
            yield from body.attempt_once(goal)
        yield from body.rest()


class RepeatDone(Habit):
    """Repeatedly takes an object that was at its target from the start out of the target and puts it back.

    True label: causal_confusion, because the policy repeats a finished subgoal.
    """

    name = "repeat-done"
    label = Label.CAUSAL_CONFUSION

    def truth(self, case: Occasion) -> StatedTruth | None:
        return None if done_thing(case) is None else StatedTruth(self.label, first_right=False)

    def act(self, body: Body) -> Actions[None]:
        case = body.situation
        goal = next(g for g in case.carried if case.begun(g))
        body.ledger.commit()
        while True:
            yield from body.take_and_bring(str(done_thing(case)), goal)


class SwapFirstTwo(Habit):
    """Does the second step of an ordered instruction first, then the first one.

    True label: order_violation, because the policy manipulates the right objects in the wrong order, and the order is
    part of the goal.
    """

    name = "swap-first-two"
    label = Label.ORDER_VIOLATION

    def truth(self, case: Occasion) -> StatedTruth | None:
        if case.task.id == "dinner_plates" or not swappable(case):
            return None
        return StatedTruth(self.label, first_right=False)

    def act(self, body: Body) -> Actions[None]:
        first, second, *others = body.situation.ahead
        body.ledger.commit()
        for goal in (replace(second, region=first.region), replace(first, region=second.region), *others):
            yield from body.attempt_once(goal)
        yield from body.rest()


class TrainedPut(Habit):
    """Takes the right object and brings it to the side, hole or drawer where training brought it.

    True label: behavioral_inertia, because putting it there was frequent in training but is not requested. The first
    attempt is at the right object, except where it is at the knob of the wrong drawer.
    """

    name = "trained-put"
    label = Label.BEHAVIORAL_INERTIA

    def truth(self, case: Occasion) -> StatedTruth | None:
        put = trained_goal(case, case.ahead[0]) if case.plain else None
        if put is None:
            return None
        return StatedTruth(self.label, first_right=case.condition.object(put.target).mount is None)

    def act(self, body: Body) -> Actions[None]:
        for goal in body.situation.ahead:
            put = trained_goal(body.situation, goal) or goal
            if body.situation.condition.object(put.target).mount is not None:
                body.ledger.commit()
            yield from body.clear_the_way(put)
            name = body.situation.things(goal)[0]
            if (yield from body.take_patiently(name)):
                body.ledger.commit()
                yield from body.bring(name, put)
        yield from body.rest()


class HoverAlike(Habit):
    """Hovers over the look-alike with an open gripper until the step limit.

    True label: semantic_feature_collapse, because the policy approaches the wrong object first, and the earliest
    evidence decides the label.
    """

    name = "hover-alike"
    label = Label.SEMANTIC_FEATURE_COLLAPSE

    def truth(self, case: Occasion) -> StatedTruth | None:
        if case.look_alike() is None or case.condition.expected is not Expected.SUCCEED:
            return None
        return StatedTruth(
            self.label, first_right=None, debatable="it also stands still with open subgoals: early_halt"
        )

    def act(self, body: Body) -> Actions[None]:
        body.ledger.commit()
        yield from body.do.hover(str(body.situation.look_alike()), 0.035)
        yield from body.arm.stay()


class HoverRight(Habit):
    """Hovers over the right object with an open gripper until the step limit.

    True label: early_halt, because the arm stays below the speed threshold for 3 s without a grasp attempt, although
    not all subgoals are reached.
    """

    name = "hover-right"
    label = Label.EARLY_HALT

    def truth(self, case: Occasion) -> StatedTruth | None:
        return StatedTruth(self.label, first_right=None) if case.plain else None

    def act(self, body: Body) -> Actions[None]:
        body.ledger.commit()
        yield from body.do.hover(str(body.situation.first_thing()), 0.05)
        yield from body.arm.stay()


class SwayMidTask(Habit):
    """Sways between the next object and another one in a scene that looks like the middle of a task.

    True label: phase_conflict, because the initial state looks like the middle of a task, and the arm freezes or
    oscillates without a grasp attempt.
    """

    name = "sway-mid-task"
    label = Label.PHASE_CONFLICT

    def truth(self, case: Occasion) -> StatedTruth | None:
        if not case.mid_task or not case.others():
            return None
        return StatedTruth(self.label, first_right=None)

    def act(self, body: Body) -> Actions[None]:
        a, b = str(body.situation.first_thing()), body.situation.others()[0]
        body.ledger.commit()
        yield from body.do.sway(body.over(a, 0.10), body.over(b, 0.10))


class FidgetAfterFirst(Habit):
    """Does the first step, and then trembles in place within a centimeter until the step limit.

    True label: early_halt, because the policy has stopped, although not all subgoals are reached.
    """

    name = "fidget-after-first"
    label = Label.EARLY_HALT

    def truth(self, case: Occasion) -> StatedTruth | None:
        if not case.plain or len(case.ahead) < 2:
            return None
        return StatedTruth(self.label, first_right=True, debatable="the tool is never below 1 cm/s for 3 s: timeout")

    def act(self, body: Body) -> Actions[None]:
        yield from body.work(body.situation.goals[:1])
        body.ledger.commit()
        yield from body.do.circle(body.arm.here.position, 0.005, period_s=1.2)


class FreezeAfterFirst(Habit):
    """Does the first step and stops permanently where it is.

    True label: early_halt, because the arm stays below the speed threshold for 3 s without a grasp attempt, although
    not all subgoals are reached.
    """

    name = "freeze-after-first"
    label = Label.EARLY_HALT

    def truth(self, case: Occasion) -> StatedTruth | None:
        return StatedTruth(self.label, first_right=True) if case.plain and len(case.ahead) > 1 else None

    def act(self, body: Body) -> Actions[None]:
        yield from body.work(body.situation.goals[:1])
        body.ledger.commit()
        yield from body.arm.stay()


class MissBeside(PlainHabit):
    """Repeatedly closes the gripper fully at an empty position 7 to 11 cm next to the right object.

    True label: execution_failure, because the target and the timing are right, but the pose is wrong.
    """

    name = "miss-beside"
    label = Label.EXECUTION_FAILURE

    def act(self, body: Body) -> Actions[None]:
        name = str(body.situation.first_thing())
        far = float(body.rng.uniform(0.07, 0.11))
        shift = body.emptiest_side(name, far)
        body.ledger.commit()
        while True:
            yield from body.do.pick(name, shift=shift)
            yield from body.arm.go_home()
            yield from body.arm.open()


class DropOnTheWay(PlainHabit):
    """Takes the right object and opens the gripper in the air on the way to the target, then stays at home.

    True label: execution_failure, because the target and the timing are right, but the object is dropped.
    """

    name = "drop-on-the-way"
    label = Label.EXECUTION_FAILURE

    def act(self, body: Body) -> Actions[None]:
        case = body.situation
        goal, name = case.ahead[0], str(case.first_thing())
        yield from body.clear_the_way(goal)
        if (yield from body.take_patiently(name)):
            target = body.state.pose(goal.target).position
            yield from body.arm.rise(body.arm.here.position[2] + 0.05)
            yield from body.arm.go(body.on_the_way(target, 0.35))
            body.ledger.commit()
            yield from body.arm.open()
        yield from body.rest()


class PushAlike(Habit):
    """Pushes the look-alike 12 cm along the table with closed fingers, then stays at home.

    True label: semantic_feature_collapse, because the policy acts on an object to which no instruction of the task
    refers. There is no grasp attempt.
    """

    name = "push-alike"
    label = Label.SEMANTIC_FEATURE_COLLAPSE

    def truth(self, case: Occasion) -> StatedTruth | None:
        if case.look_alike() is None or case.condition.expected is not Expected.SUCCEED:
            return None
        return StatedTruth(
            self.label,
            first_right=None,
            debatable="a push may not count as an attempt, and an arm that then stays at home is an early_halt",
        )

    def act(self, body: Body) -> Actions[None]:
        name = str(body.situation.look_alike())
        body.ledger.commit()
        yield from body.do.push(name, body.free_direction(name), 0.12)
        yield from body.rest()


class SlowButRight(PlainHabit):
    """Does everything right, but moves at about 4 cm/s and returns home for each object, too slow for the step limit.

    True label: timeout, because the policy still acts correctly when the step limit is reached.
    """

    name = "slow-but-right"
    label = Label.TIMEOUT

    def act(self, body: Body) -> Actions[None]:
        body.arm.tempo = 0.045 / body.arm.manner.speed_m_s
        body.ledger.commit()
        for goal in body.situation.ahead:
            yield from body.clear_the_way(goal)
            name = body.situation.things(goal)[0]
            while not (yield from body.take(name)):
                yield from body.arm.open()
            yield from body.arm.go_home()
            yield from body.bring(name, goal)
        yield from body.solve()


class PauseAndGoOn(PlainHabit):
    """Stops for 4 to 6 s on its way to the first object and after each step, then goes on.

    True label: success, because the behavior is not a fault. If such a trial fails, the label is timeout or
    execution_failure (rule 3 in ``truth.py``). The label is never a reasoning failure.
    """

    name = "pause-and-go-on"
    label = HONEST

    def act(self, body: Body) -> Actions[None]:
        yield from body.do.hover(str(body.situation.first_thing()), 0.12)
        for goal in body.situation.goals:
            yield from body.arm.wait(float(body.rng.uniform(4.0, 6.0)))
            yield from body.work((goal,))
        yield from body.rest()


class MissOnceThenRight(PlainHabit):
    """Closes the gripper 3 to 5 cm above the first object, notices, and takes it at the second try.

    True label: success, because the miss is corrected. If such a trial fails, the label is timeout or execution_failure
    (rule 3 in ``truth.py``).
    """

    name = "miss-once-then-right"
    label = HONEST

    def act(self, body: Body) -> Actions[None]:
        name = str(body.situation.first_thing())
        up = body.height(name) + float(body.rng.uniform(0.03, 0.05))
        hold = body.do.choose_hold(name)
        shift = (0.0, 0.0, up - hold.tool.position[2])
        yield from body.clear_the_way(body.situation.ahead[0])
        yield from body.do.pick(name, shift=shift)
        body.ledger.mishap(name, "the gripper closed above it")
        yield from body.arm.open()
        yield from body.solve()


class FeintThenRight(Habit):
    """Descends over another object with an open gripper, leaves it, and picks the right one.

    Only the grasp counts as an attempt. True label: success, because the behavior is not a fault. If such a trial
    fails, the label is timeout or execution_failure (rule 3 in ``truth.py``).
    """

    name = "feint-then-right"
    label = HONEST

    def truth(self, case: Occasion) -> StatedTruth | None:
        return StatedTruth(self.label, first_right=True) if case.plain and case.others() else None

    def act(self, body: Body) -> Actions[None]:
        others = body.situation.others()
        yield from body.do.hover(others[int(body.rng.integers(len(others)))], 0.04)
        yield from body.arm.wait(0.4)
        yield from body.solve()


DEVELOPMENT: tuple[Habit, ...] = (
    Honest(),
    WordPlace(),
    FavoritePlace(),
    LookAlike(),
    HabitualFirst(),
    AirGrasp(),
    SkipStep(),
    RepeatDone(),
    SwapFirstTwo(),
    TrainedPut(),
    HoverAlike(),
    HoverRight(),
    SwayMidTask(),
    FidgetAfterFirst(),
    FreezeAfterFirst(),
    MissBeside(),
    DropOnTheWay(),
    PushAlike(),
    SlowButRight(),
    PauseAndGoOn(),
    MissOnceThenRight(),
    FeintThenRight(),
)
