"""Episodes: running a policy in a scene, and recording the result.

The public names are imported from their modules on first use, so that the process of a policy does not import a
simulator.
"""

from typing import TYPE_CHECKING

from betterbench.lazy_names import lazy_names

if TYPE_CHECKING:
    from betterbench.episodes.answers import POLICY_BOUNDARY, Question, Reply, answer
    from betterbench.episodes.description import TrialContext, describe
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

if not TYPE_CHECKING:
    __getattr__ = lazy_names(
        __name__,
        {
            "answers": ("POLICY_BOUNDARY", "Question", "Reply", "answer"),
            "description": ("TrialContext", "describe"),
            "episode": ("EpisodeResult", "Steps", "append_row", "episode_steps", "run_episode"),
            "heap": ("settled_heap",),
            "observer": ("Observer", "observation_of"),
        },
    )
