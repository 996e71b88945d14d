"""Reasons why an attempt at a demonstration is not accepted."""

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
    "no free way": "No source could be carried over without a collision, or within reach.",
    "missed grasp": "The gripper closed, and the object was not between the fingers.",
    "dropped": "The object slipped out of the gripper on the way.",
    "misplaced": "The object was let go, and did not come to rest where the subgoal wants it.",
    "harm": "All subgoals were done, and something else was moved, fell or came in the wrong order.",
    "time": "The step limit was reached.",
    "did not last": "The goal was met and held for the dwell, and no longer held afterward.",
    "outside support": "It succeeded with a pick or a put that the certificate's training regime does not show.",
    "breakdown": "The program failed; this is an error of ours.",
}
"""Meaning of each kind of failure."""


class AttemptFailedError(Exception):
    """Error that ends an attempt that cannot succeed any more."""

    def __init__(self, kind: FailureKind, reason: str) -> None:
        super().__init__(reason)
        self.kind, self.reason = kind, reason
