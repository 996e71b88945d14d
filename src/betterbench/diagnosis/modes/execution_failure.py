"""Execution failure: the right target at the right time, and then a bad hand."""

from __future__ import annotations

import numpy as np

from betterbench.diagnosis.course import Course, Standing, Step
from betterbench.diagnosis.limits import LIMITS
from betterbench.diagnosis.verdict import Evidence
from betterbench.geometry import tilt_of
from betterbench.tasks import Expected


def find(course: Course) -> Evidence | None:
    """Return the first failed execution that was not made good later, or None."""
    found = [e for step in course.steps if (e := _of_step(course, step)) is not None]
    found += [e for e in (_knocked(course), _undone(course), _forbidden_touch(course)) if e is not None]
    return min(found, key=lambda e: e.start_s, default=None)


def _of_step(course: Course, step: Step) -> Evidence | None:
    """Return what went wrong after one right decision, or None."""
    if step.standing is not Standing.ASKED or step.goal is None:
        return None
    word = course.goals[step.goal].word
    if course.completed_after(step.goal, step.grasp.end) or _brought_later(course, step):
        return None
    i = step.grasp.object
    if i is None:
        return course.at_step("missed_by_pose", f"The hand closes beside {word!r}, the right target.", step)
    drawer = any(i == found for found, _, _ in course.trace.drawers)
    if drawer and _moved_later(course, step, i):
        return None
    if not step.grasp.secured:
        if course.trace.left[-1, i] and course.trace.right[-1, i]:
            return None  # the episode ended with the object between the fingers: there was no time to lift it
        text = f"The hand closes on {word!r}, the right target, but does not lift it."
        return course.at_step("slipped", text, step)
    return _halfway(course, step, i) if drawer else _lost(course, step, i, word)


def _brought_later(course: Course, step: Step) -> bool:
    """Tell whether a later try for the same subgoal worked, and only the place was wrong: then the hand is not why.

    What was let go high above the place may have landed there by chance, unless the place is a container.
    """
    for later in course.steps:
        found = course.wrong_place(later)
        if found is None or later.at is None or later.grasp.start <= step.grasp.start or later.goal != step.goal:
            continue
        gone, rest, place = found
        heights = course.trace.positions[[gone, rest], later.at, 2]
        if place.relation == "inside" or heights[0] - heights[1] <= LIMITS.fall_height:
            return True
    return False


def _moved_later(course: Course, step: Step, drawer: int) -> bool:
    """Tell whether a drawer is as far out, or in, as the step needs it after all; one that is to be shut is not yet."""
    trace = course.trace
    if step.goal is not None and course.goals[step.goal].relation == "closed":
        return False
    openings = [trace.opening(row, drawer) for row in range(step.grasp.end, trace.rows)]
    if step.goal is not None and trace.targets[step.goal] == drawer:
        return max(openings) >= LIMITS.drawn_out
    return min(openings) <= LIMITS.pushed_in


def _halfway(course: Course, step: Step, drawer: int) -> Evidence | None:
    """Return evidence if the hand let go of a drawer on its way and nothing moved it on from there."""
    if course.trace.left[-1, drawer] and course.trace.right[-1, drawer]:
        return None  # the episode ended with the hand on it
    text = f"The hand moves the {course.kind(drawer)}, the right one, and leaves it halfway."
    return course.at_step("drawer_left_halfway", text, step)


def _lost(course: Course, step: Step, i: int, word: str) -> Evidence | None:
    """Return evidence if an object left the hand and came to rest at no place where a policy could want it."""
    trace, rows = course.trace, course.let_go(step)
    if rows is None:
        return None
    gone, rest = rows
    wanted = trace.placed(rest, i) is not None and not course.slipped(step)
    if wanted or trace.serves[rest, :, i].any():
        return None
    fall = float(trace.positions[gone, i, 2] - trace.positions[rest, i, 2])
    if fall > LIMITS.fall_height:
        how = "drops" if gone >= step.grasp.release else "loses"
        text = f"The hand {how} {word!r}, the right target, {100 * fall:.0f} cm above where it comes to rest."
        return course.evidence("dropped", text, rows=(gone, rest), objects=(i,))
    text = f"{word!r}, the right target, is let go outside the goal."
    return course.evidence("placed_outside_the_goal", text, rows=(gone, rest), objects=(i,))


def _knocked(course: Course) -> Evidence | None:
    """Return evidence if something that the task needs was knocked over or off the table without being grasped."""
    trace = course.trace
    grasped = {s.at for s in course.steps}
    needed = course.asked_indices | {i for i, o in enumerate(trace.info.objects) if o.role == "container"}
    found: list[tuple[int, int]] = []
    for i in sorted(needed - grasped):
        if trace.info.objects[i].fixed or trace.there[-1, i]:
            continue
        w2 = 1.0 - 2.0 * (trace.quaternions[:, i, 1] ** 2 + trace.quaternions[:, i, 2] ** 2)
        down = (w2 < np.cos(LIMITS.knocked_tilt)) | (trace.positions[:, i, 2] < -LIMITS.fallen_below)
        start = tuple(float(v) for v in trace.quaternions[0, i])
        if down.any() and tilt_of((start[0], start[1], start[2], start[3])) < LIMITS.knocked_tilt:
            found.append((int(np.argmax(down)), i))
    if not found:
        return None
    row, i = min(found)
    text = f"The {course.kind(i)} is knocked over without having been grasped."
    return course.evidence("collided", text, rows=(row, row), objects=(i,))


def _undone(course: Course) -> Evidence | None:
    """Return evidence if a subgoal that was done came undone for good; an attempt that did it is earlier evidence."""
    trace = course.trace
    found: list[tuple[int, int]] = []
    for g, goal in enumerate(course.goals):
        there = trace.serves[:, g, list(course.meant[g])].sum(axis=1) >= goal.count
        if trace.done[:, g].any() and there.any() and not there[-1]:
            found.append((int(np.flatnonzero(there)[-1]) + 1, g))
    if not found:
        return None
    row, g = min(found)
    text = f"{course.goals[g].word!r} was where it was asked for and is knocked away from there."
    return course.evidence("knocked_out_of_place", text, rows=(row, row), objects=course.meant[g])


def _forbidden_touch(course: Course) -> Evidence | None:
    """Return evidence if something that was to be left alone was touched without an attempt at it."""
    wrong = any(step.standing is not Standing.ASKED for step in course.steps)
    if course.condition.expected is Expected.SUCCEED or wrong:
        return None
    trace = course.trace
    touched = trace.left | trace.right
    if course.condition.expected is Expected.REFUSE:  # what is asked for and is there may be taken
        items = {i for i in trace.items if trace.info.objects[i].role != "drawer"} - course.asked_indices
        touched[:, [i for i in range(touched.shape[1]) if i not in items]] = False
    if not touched.any():
        return None
    row, i = (int(v) for v in np.argwhere(touched)[0])
    text = f"The hand brushes against the {course.kind(i)}, where nothing was to be touched."
    return course.evidence("collided", text, rows=(row, row), objects=(i,))
