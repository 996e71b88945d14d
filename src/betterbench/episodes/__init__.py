"""Episodes: rollouts of a policy in a scene, with records."""

from betterbench.episodes.answers import POLICY_BOUNDARY, Question, Reply, answer
from betterbench.episodes.describe import TrialContext, describe
from betterbench.episodes.episode import EpisodeResult, Steps, append_row, episode_steps, run_episode
from betterbench.episodes.heap import settled_heap
from betterbench.episodes.observer import Observer, observation_of

__all__ = [
    "POLICY_BOUNDARY",
    "EpisodeResult",
    "Observer",
    "Question",
    "Reply",
    "Steps",
    "TrialContext",
    "answer",
    "append_row",
    "describe",
    "episode_steps",
    "observation_of",
    "run_episode",
    "settled_heap",
]
