"""Behavioural inertia: a step that is frequent in training is begun unasked, or played without its object."""

from __future__ import annotations

import itertools

from betterbench.diagnosis.course import Course, Standing, Step
from betterbench.diagnosis.verdict import Evidence
from betterbench.tasks import Regime


def find(course: Course) -> Evidence | None:
    """Return the first evidence of inertia, or None."""
    before: Step | None = None
    for step in course.steps:
        evidence = (
            _unasked(course, step, first=before is None)
            or _next_in_line(course, before, step)
            or _memorised_place(course, step)
            or _memorised_drawer(course, step)
            or _empty(course, step)
        )
        if evidence is not None:
            return evidence
        if not any(step.at == drawer for drawer, _, _ in course.trace.drawers):
            before = step
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


def _next_in_line(course: Course, before: Step | None, step: Step) -> Evidence | None:
    """Return evidence if an attempt is at what followed the one before in training, and nobody asked for it."""
    if before is None or before.at is None or step.at is None or step.standing is not Standing.OTHER:
        return None
    pair = (course.kind(before.at), course.kind(step.at))
    if not any(pair in itertools.pairwise(sequence) for sequence in course.regime.sequences):
        return None
    text = (
        f"After the {pair[0]} it goes for {course.describe(step)}, as demonstrations did, although "
        f"{course.asked_for(step)}."
    )
    return course.at_step("memorised_next_step", text, step)


def _memorised_place(course: Course, step: Step) -> Evidence | None:
    """Return evidence if the right object is put where training put its kind, which is not where it was asked for."""
    found = course.wrong_place(step)
    if found is None or step.at is None:
        return None
    gone, rest, place = found
    kind, target = course.kind(step.at), course.kind(place.target)
    if not course.memorised(step.at, place):
        return None
    where = f"the {target}" + (f" ({place.place.replace('_', ' ')})" if place.place else "")
    text = f"The {kind} is brought to {where}, as in training, although it was asked for elsewhere."
    return course.evidence("memorised_place", text, rows=(gone, rest), objects=(step.at, place.target))


def _memorised_drawer(course: Course, step: Step) -> Evidence | None:
    """Return evidence if the hand moves the drawer into which training put what is asked for, and not the one named."""
    if step.at is None or step.standing is not Standing.OTHER or step.goal is None:
        return None
    if not any(step.at == drawer for drawer, _, _ in course.trace.drawers):
        return None
    due = {course.kind(i) for i in course.meant[step.goal]}
    if not any(course.kind(step.at) == target for kind in due for target, _, _ in course.regime.kind_places[kind]):
        return None
    text = f"It goes for {course.describe(step)}, as in training, although {course.asked_for(step)} elsewhere."
    return course.at_step("memorised_place", text, step)


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
