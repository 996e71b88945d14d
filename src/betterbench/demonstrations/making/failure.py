"""Kinds of failure of an attempt at a demonstration, and their meaning."""

from __future__ import annotations

from typing import Literal

FailureKind = Literal[
    "no free way",
    "missed grasp",
    "dropped",
    "misplaced",
    "harm",
    "time",
    "did not last",
    "outside support",
    "breakdown",
]

FAILURES: dict[FailureKind, str] = {
    "no free way": "No source could be transferred without a collision and within reach.",
    "missed grasp": "The gripper closed, but the object was not between the fingers.",
    "dropped": "The object slipped out of the gripper on the way.",
    "misplaced": "The object was released, but did not come to rest at its target.",
    "harm": "All subgoals were done, but another object moved or fell, or the order was wrong.",
    "time": "The step limit was reached.",
    "did not last": "The goal was met for the dwell time, but not afterward.",
    "outside support": "It succeeded, but with a pick or placement outside the certified training distribution.",
    "breakdown": "The program failed because of an error in betterbench.",
}
"""Meaning of each kind of failure."""


class AttemptFailedError(Exception):
    """Raised when an attempt can no longer succeed."""

    def __init__(self, kind: FailureKind, reason: str) -> None:
        super().__init__(reason)
        self.kind, self.reason = kind, reason
