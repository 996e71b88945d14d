"""Early halt: the arm stands still for good with subgoals open."""

from __future__ import annotations

from betterbench.diagnosis.course import Course
from betterbench.diagnosis.halts import find_halt
from betterbench.diagnosis.verdict import Evidence
from betterbench.tasks import Expected


def find(course: Course) -> Evidence | None:
    """Return the evidence of an early halt, or None."""
    if course.condition.expected is not Expected.SUCCEED:
        return None
    halt = find_halt(course)
    if halt is None:
        return None
    words = ", ".join(repr(course.goals[g].word) for g in course.open_goals(halt[0]))
    text = f"The arm stands still for good with {words} still to do."
    return course.evidence("still_with_open_subgoals", text, rows=halt)
