"""Lexical-kinematic shortcut: the hand goes where the instruction's word led in training, to another object."""

from __future__ import annotations

from betterbench.diagnosis.course import Course, Standing, Step
from betterbench.diagnosis.verdict import Evidence


def find(course: Course) -> Evidence | None:
    """Return the evidence of the first attempt, or None if it does not follow the word to a wrong object."""
    step = course.steps[0] if course.steps else None
    if step is None or step.standing not in (Standing.LATER, Standing.REPEATED, Standing.OTHER):
        return None
    word = word_of(course, step)
    if word is None or step.grasp.slot not in course.regime.word_slots.get(word, ()):
        return None
    text = (
        f"The first attempt goes to slot {step.grasp.slot!r}, where {word!r} was picked in training, "
        f"although {course.describe(step)} is not what it means here."
    )
    return course.at_step("word_leads_to_trained_slot", text, step)


def word_of(course: Course, step: Step) -> str | None:
    """Return the word of the subgoal that was due at an attempt; where none was left, of the first subgoal."""
    goals = course.goals
    if not goals:
        return None
    return goals[step.goal if step.goal is not None else 0].word
