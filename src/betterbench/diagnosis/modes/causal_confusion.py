"""Causal confusion: a required step is skipped although its object is there, or a finished one is repeated."""

from __future__ import annotations

from betterbench.diagnosis.course import Course, Standing
from betterbench.diagnosis.verdict import Evidence


def find(course: Course) -> Evidence | None:
    """Return the first evidence of causal confusion, or None."""
    for step in course.steps:
        if step.standing is Standing.REPEATED:
            text = f"It goes for {course.describe(step)}, although that step is done; {course.asked_for(step)}."
            return course.at_step("finished_step_repeated", text, step)
        if step.standing is Standing.LATER and step.goal is not None:
            if course.attempted_after(step.goal, step.grasp.start):
                continue
            text = (
                f"It goes for {course.describe(step)} and never for {course.goals[step.goal].word!r}, "
                "which comes first and is there."
            )
            return course.at_step("required_step_skipped", text, step)
    return None
