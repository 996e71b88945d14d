"""Wrong object: an attempt at an object that another instruction means, where no more specific rule is proven."""

from __future__ import annotations

from betterbench.diagnosis.course import Course, Standing
from betterbench.diagnosis.verdict import Evidence


def find(course: Course) -> Evidence | None:
    """Return the first evidence of a wrong object, or None."""
    for step in course.steps:
        if step.standing is Standing.OTHER or (step.standing is Standing.EMPTY):
            text = f"It goes for {course.describe(step)} although {course.asked_for(step)}."
            return course.at_step("object_of_another_instruction", text, step)
    return None
