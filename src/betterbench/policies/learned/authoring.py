"""Public names for a file that adds a learner (see docs/adding-a-learner.md). Importing them requires torch."""

from betterbench.policies.learned.families import Capacity, learner
from betterbench.policies.learned.network import LearnerNetwork
from betterbench.policies.learned.tokens import POSE_NUMBERS, TOOL_NUMBERS
from betterbench.policies.learned.vocabulary import ABSENT, UNKNOWN, Vocabulary

__all__ = [
    "ABSENT",
    "POSE_NUMBERS",
    "TOOL_NUMBERS",
    "UNKNOWN",
    "Capacity",
    "LearnerNetwork",
    "Vocabulary",
    "learner",
]
