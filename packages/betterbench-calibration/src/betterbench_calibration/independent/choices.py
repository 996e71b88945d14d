"""Decisions that several habits share, such as the choice of the object in a training slot."""

from __future__ import annotations

from dataclasses import replace

from betterbench.tasks import Expected, Label, Subgoal
from betterbench_calibration.independent.occasion import Occasion
from betterbench_calibration.independent.truth import HONEST, StatedTruth


def word_thing(case: Occasion) -> str | None:
    """Return the object in the slot that training associates with the first word of the instruction.

    Return None if there is no such slot, or more than one.
    """
    slot = case.word_slot(case.ahead[0]) if case.ahead else None
    return None if slot is None else case.condition.occupant(slot)


def word_truth(case: Occasion) -> StatedTruth | None:
    """Return the true label of a policy that first takes the object returned by :func:`word_thing`."""
    name = word_thing(case)
    if name is None or case.condition.expected is Expected.STAY_STILL:
        return None
    if name in case.things(case.ahead[0]):
        return StatedTruth(HONEST, first_right=True)
    kind = case.condition.object(name).kind
    label = Label.LEXICAL_KINEMATIC_SHORTCUT
    if name in case.asked:
        return StatedTruth(label, first_right=False, left_out="the object there is requested later")
    if kind in case.trained.kind_slots:
        return StatedTruth(label, first_right=False)
    if kind in case.meant_kinds:
        return StatedTruth(label, first_right=False, left_out="instructions name the object there only as a target")
    return StatedTruth(Label.SEMANTIC_FEATURE_COLLAPSE, first_right=False)


def favorite_truth(case: Occasion, slot: str) -> StatedTruth | None:
    """Return the true label of a policy that first takes the object in the given slot in every trial."""
    name = case.condition.occupant(slot)
    if case.condition.expected is not Expected.SUCCEED or not case.ahead:
        return None
    if name in case.things(case.ahead[0]):
        return StatedTruth(HONEST, first_right=True)
    why = ""
    if name is None:
        return None
    if name in case.asked:
        why = "the object there is requested later"
    elif any(slot in case.trained.word_slots.get(g.word, ()) for g in case.ahead):
        why = "a word of the instruction led there too"
    habitual = case.condition.object(name).kind == case.trained.habit
    also = "it also begins with the most frequent first step: behavioral_inertia" if habitual else ""
    return StatedTruth(Label.VISUAL_LAYOUT_BIAS, first_right=False, debatable=also, left_out=why)


def habitual_truth(case: Occasion) -> StatedTruth | None:
    """Return the true label of a policy that always begins with the most frequent first step in training."""
    if habitual_thing(case) is not None:
        return StatedTruth(Label.BEHAVIORAL_INERTIA, first_right=False)
    if not case.plain:
        return None
    right = case.condition.object(str(case.first_thing())).kind == case.trained.habit
    return StatedTruth(HONEST, first_right=True) if right else None


def habitual_thing(case: Occasion) -> str | None:
    """Return an object with which most demonstrations begin, or None if the scene contains none.

    Objects that the instruction requests do not count.
    """
    kind = case.trained.habit
    if case.condition.expected is not Expected.SUCCEED or kind is None or not case.ahead:
        return None
    for name in case.others():
        spec = case.condition.object(name)
        if spec.kind == kind and not any(case.led_to(g, name) for g in case.ahead):
            return name
    return None


def emptied_slot(case: Occasion) -> str | None:
    """Return a slot that is empty because its object in the base condition is missing or already at its target."""
    for goal in case.carried:
        here = case.condition.resolve(goal.reference)
        for name in case.base.resolve(goal.reference):
            slot = case.base.layout.get(name)
            gone = name not in here or name in case.condition.preplaced
            if slot is not None and gone and case.condition.occupant(slot) is None:
                return slot
    return None


def vacated_slot(case: Occasion) -> str | None:
    """Return the slot that the first object has in the base condition, if this slot is empty here."""
    for goal in case.ahead:
        for name in case.things(goal):
            slot = case.base.layout.get(name)
            if slot is not None and slot != case.condition.layout[name] and case.condition.occupant(slot) is None:
                return slot
    return None


def swappable(case: Occasion) -> bool:
    """Return whether only a wrong order would explain a swap of the first two steps.

    The steps must have different objects and a prescribed order.
    """
    if not case.plain or not case.condition.instruction.ordered or len(case.ahead) < 2:
        return False
    first, second = case.ahead[:2]
    names = case.things(second)
    different = first.reference != second.reference and bool(case.things(first)) and bool(names)
    return different and not any(case.led_to(first, n) for n in names)


def done_thing(case: Occasion) -> str | None:
    """Return a requested object that is at its target at the start, or None."""
    for goal in case.carried:
        if case.begun(goal):
            return next(n for n in case.condition.resolve(goal.reference) if n in case.condition.preplaced)
    return None


def trained_goal(case: Occasion, goal: Subgoal, kind: str | None = None) -> Subgoal | None:
    """Return the step with the target that its object has in training.

    Return None if the object has several targets in training, or the same target as in the step. If ``kind`` is given,
    the target of objects of that kind is used.
    """
    kind = case.condition.object(case.condition.resolve(goal.reference)[0]).kind if kind is None else kind
    places = case.trained.kind_targets.get(kind, ())
    if goal.relation == "layer" or len(places) != 1:
        return None
    target_kind, _, region = places[0]
    target = next((o.name for o in case.condition.objects if o.kind == target_kind), None)
    if target is None or (target, region) == (goal.target, goal.region):
        return None
    return replace(goal, target=target, region=region)


def moved_target(case: Occasion, goal: Subgoal) -> bool:
    """Return whether the target of a step is in a different slot than in the base condition."""
    here, there = case.condition.layout.get(goal.target), case.base.layout.get(goal.target)
    return here is not None and there is not None and here != there


def unasked_step(case: Occasion) -> tuple[str, Subgoal] | None:
    """Return an object that another demonstration picks after the first step, and the subgoal for placing it.

    Return None if there is no such object.
    """
    if not case.plain or len(case.ahead) < 2:
        return None
    first = case.condition.object(case.things(case.ahead[0])[0]).kind
    followers = {s[i + 1] for s in case.trained.sequences for i in range(len(s) - 1) if s[i] == first}
    for name in case.others():
        kind = case.condition.object(name).kind
        if kind in followers and not any(case.led_to(g, name) for g in case.ahead):
            return name, trained_goal(case, case.ahead[1], kind) or case.ahead[1]
    return None
