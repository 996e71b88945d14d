"""Everything that the file of a learner is written with; see docs/adding-a-learner.md. It needs torch."""

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
