"""Episodes: one rollout of one mind in one scene, and what it leaves behind."""

from betterbench.episodes.answers import Mind, Question, Reply, answer, policy_boundary
from betterbench.episodes.describe import TrialContext, describe
from betterbench.episodes.episode import EpisodeResult, Steps, episode_steps, run_episode
from betterbench.episodes.observer import Observer

__all__ = [
    "EpisodeResult",
    "Mind",
    "Observer",
    "Question",
    "Reply",
    "Steps",
    "TrialContext",
    "answer",
    "describe",
    "episode_steps",
    "policy_boundary",
    "run_episode",
]
