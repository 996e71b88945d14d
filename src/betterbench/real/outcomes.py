"""Outcomes that a person can enter for a trial: one key for each visible behavior.

The definitions mention neither conditions nor policies, so that the operator and a judge who sees only the video use
the same definitions. Whether a behavior is correct in a condition is derived from the task later.
"""

from __future__ import annotations

from dataclasses import dataclass

from betterbench.errors import UnknownNameError


@dataclass(frozen=True, slots=True)
class Outcome:
    """Visible behavior that a person can enter for a trial.

    Attributes:
        name: Name in the entries ("air_grasp").
        key: Key that enters the outcome on the pages.
        title: Short title.
        definition: Description of the behavior that a person must see to enter the outcome.
        scored: False if the trial is invalid and must be repeated.
    """

    name: str
    key: str
    title: str
    definition: str
    scored: bool = True


OUTCOMES = (
    Outcome(
        "done",
        "1",
        "did all that was asked",
        "Every object asked for lies in the basket at the end, and no other object was grasped or carried.",
    ),
    Outcome(
        "part",
        "2",
        "did a part and ended",
        "At least one object asked for was packed in this trial, another one still lies outside, and the arm stopped "
        "reaching for it.",
    ),
    Outcome(
        "froze",
        "3",
        "stood still",
        "The gripper never closed and no object was moved; at the end the arm stands still, or trembles within 2 cm.",
    ),
    Outcome(
        "air_grasp",
        "4",
        "grasped at nothing",
        "The gripper went down and closed at a place without an object, and this is what it did last.",
    ),
    Outcome(
        "oscillated",
        "5",
        "went back and forth",
        "The arm went at least three times between the same two places and grasped at neither.",
    ),
    Outcome(
        "wrong_object",
        "6",
        "took another object",
        "An object that was not asked for was lifted, or put into the basket.",
    ),
    Outcome(
        "missed",
        "7",
        "reached, but failed",
        "The arm reached for an object asked for and failed to grasp it, dropped it, or missed the basket.",
    ),
    Outcome(
        "undid",
        "8",
        "took out again",
        "An object that lay in the basket was grasped there, or taken out of the basket.",
    ),
    Outcome("other", "9", "something else", "None of these; the note says what."),
    Outcome(
        "invalid",
        "0",
        "not valid",
        "Scene, camera or arm were wrong, or a person interfered: the trial says nothing about the policy.",
        scored=False,
    ),
)
"""Outcomes in page order. If several outcomes apply, the person enters the first of them."""


def outcome_named(name: str) -> Outcome:
    """Return the outcome with the given name. Raise UnknownNameError if there is none."""
    for outcome in OUTCOMES:
        if outcome.name == name:
            return outcome
    raise UnknownNameError("outcome", name, [outcome.name for outcome in OUTCOMES])
