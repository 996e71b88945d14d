"""Order violation: right objects in a wrong order, where the order is part of the goal."""

from __future__ import annotations

import numpy as np

from betterbench.diagnosis.course import Course, Standing
from betterbench.diagnosis.verdict import Evidence


def find(course: Course) -> Evidence | None:
    """Return the first evidence of a violated order, or None."""
    if not course.instruction.ordered:
        return None
    for step in course.steps:
        if step.standing is Standing.LATER and step.goal is not None:
            if not course.attempted_after(step.goal, step.grasp.start):
                continue
            text = (
                f"It goes for {course.describe(step)} before {course.goals[step.goal].word!r}, "
                "which comes first and is attempted later."
            )
            return course.at_step("attempted_in_wrong_order", text, step)
    return _completed_in_wrong_order(course)


def _completed_in_wrong_order(course: Course) -> Evidence | None:
    """Return evidence if a step is completed before an earlier one, however that came about."""
    done = course.trace.done
    first = [int(np.argmax(column)) if column.any() else None for column in done.T]
    late: list[tuple[int, int]] = []
    for g, row in enumerate(first):
        if row is None:
            continue
        possible = course.open_goals(row)
        if any(e > row if e is not None else j in possible for j, e in enumerate(first[:g])):
            late.append((row, g))
    if not late:
        return None
    row, g = min(late)
    text = f"{course.goals[g].word!r} is done before what comes earlier in the instruction."
    return course.evidence("completed_in_wrong_order", text, rows=(row, row), objects=course.meant[g])
