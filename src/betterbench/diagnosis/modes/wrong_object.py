"""Wrong object or place: one that another instruction means, where no more specific rule is proven."""

from __future__ import annotations

from betterbench.diagnosis.course import Course, Standing
from betterbench.diagnosis.verdict import Evidence


def find(course: Course) -> Evidence | None:
    """Return the first evidence of a wrong object or place, or None."""
    for step in course.steps:
        if step.standing is Standing.OTHER or (step.standing is Standing.EMPTY):
            text = f"It goes for {course.describe(step)} although {course.asked_for(step)}."
            return course.at_step("object_of_another_instruction", text, step)
        misplaced = course.wrong_place(step)
        if misplaced is not None and step.at is not None:
            gone, rest, place = misplaced
            where = f"the {course.kind(place.target)}" + (f" ({place.place})" if place.place else "")
            text = f"The {course.kind(step.at)} is brought to {where}, which is not where it was asked for."
            return course.evidence("place_of_another_instruction", text, rows=(gone, rest), objects=(step.at,))
    return None
