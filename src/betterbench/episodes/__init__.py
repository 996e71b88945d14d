"""Episodes: one rollout of one mind in one scene, and what it leaves behind."""

from betterbench.episodes.describe import TrialContext, describe
from betterbench.episodes.episode import EpisodeResult, run_episode
from betterbench.episodes.observer import Observer

__all__ = ["EpisodeResult", "Observer", "TrialContext", "describe", "run_episode"]
