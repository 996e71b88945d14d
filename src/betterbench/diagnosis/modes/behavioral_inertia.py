"""Behavioural inertia: a step that is frequent in training is begun unasked, or played without its object."""

from __future__ import annotations

from betterbench.diagnosis.course import Course, Standing, Step
from betterbench.diagnosis.verdict import Evidence
from betterbench.tasks import Regime


def find(course: Course) -> Evidence | None:
    """Return the first evidence of inertia, or None."""
    for number, step in enumerate(course.steps):
        evidence = _unasked(course, step, first=number == 0) or _empty(course, step)
        if evidence is not None:
            return evidence
    return None


def habit(regime: Regime) -> str | None:
    """Return the kind with which strictly most demonstrations begin, or None if there is no such kind."""
    ranked = regime.first_kinds
    if not ranked or (len(ranked) > 1 and ranked[0][1] == ranked[1][1]):
        return None
    return ranked[0][0]


def _unasked(course: Course, step: Step, *, first: bool) -> Evidence | None:
    """Return evidence if an attempt is at the kind that demonstrations begin with, which is not asked for now."""
    kind = habit(course.regime)
    if kind is None or step.at is None or course.kind(step.at) != kind:
        return None
    not_asked = step.standing is Standing.OTHER
    not_yet = first and step.standing is Standing.LATER
    if not (not_asked or not_yet):
        return None
    text = f"It begins with {course.describe(step)}, as most demonstrations did, although {course.asked_for(step)}."
    return course.at_step("most_frequent_first_step", text, step)


def _empty(course: Course, step: Step) -> Evidence | None:
    """Return evidence if the hand closes at an empty slot where training picked something."""
    slot = step.grasp.slot
    if step.standing is not Standing.EMPTY or slot is None:
        return None
    words = [g.word for g in course.goals if slot in course.regime.word_slots.get(g.word, ())]
    kinds = [k for k, slots in sorted(course.regime.kind_slots.items()) if slot in slots]
    if not words and not kinds:
        return None
    what = repr(words[0]) if words else f"the {' or the '.join(kinds)}"
    asked = course.asked_for(step)
    text = f"The hand closes on nothing at slot {slot!r}, where {what} was picked in training; {asked}."
    return course.at_step("air_grasp_at_memorised_slot", text, step)
