"""Semantic feature collapse: the hand goes for an object that no instruction of the task means."""

from __future__ import annotations

from betterbench.diagnosis.course import Course, Standing, Step
from betterbench.diagnosis.modes.lexical_kinematic_shortcut import word_of
from betterbench.diagnosis.verdict import Evidence


def find(course: Course) -> Evidence | None:
    """Return the first evidence of a collapse, with what the object shares with the target, or None."""
    for step in course.steps:
        if step.standing is Standing.FOREIGN:
            shared = shares(course, step)
            common = f"the target's {', '.join(shared)}" if shared else "nothing with the target"
            text = (
                f"It goes for {course.describe(step)}, which no instruction of this task means, although "
                f"{_asked_for(course, step)}; it shares {common}."
            )
            return course.at_step("object_that_no_instruction_means", text, step, shared=shared)
    return None


def shares(course: Course, step: Step) -> tuple[str, ...]:
    """Return what the object of an attempt has in common with what was asked for: colour, shape, trained slot."""
    if step.at is None:
        return ()
    objects = course.trace.info.objects
    found = objects[step.at]
    absent = _absent(course)
    goal = absent if absent is not None else step.goal if step.goal is not None else 0
    targets = [objects[i] for i in course.meant[goal]] if course.meant else []
    shared = []
    if found.colour and any(found.colour == t.colour for t in targets):
        shared.append("colour")
    if found.shape and any(found.shape == t.shape for t in targets):
        shared.append("shape")
    word = word_of(course, step) if absent is None else course.goals[absent].word
    kind = course.goals[goal].reference.kind if course.goals else None
    slots = {*course.regime.word_slots.get(word or "", ()), *course.regime.kind_slots.get(kind or "", ())}
    if step.grasp.slot in slots or found.slot in slots:
        shared.append("slot")
    return tuple(shared)


def _absent(course: Course) -> int | None:
    """Return the first subgoal whose object is not in the scene: what is taken then stands in for that, or None."""
    return next((g for g, names in enumerate(course.meant) if not names), None)


def _asked_for(course: Course, step: Step) -> str:
    absent = _absent(course)
    return course.asked_for(step) if absent is None else f"{course.goals[absent].word!r} was asked for and is not there"
