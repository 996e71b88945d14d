"""Timeout: the right episode, and the step limit is reached; and the case of all steps done and yet no goal."""

from __future__ import annotations

from betterbench.diagnosis.episode_analysis import EpisodeAnalysis
from betterbench.diagnosis.verdict import Evidence
from betterbench.tasks import Expected


def find(episode: EpisodeAnalysis, *, limit_reached: bool) -> Evidence | None:
    """Return the evidence of a timeout, or None if the episode ended for another reason.

    Args:
        episode: The course of the episode.
        limit_reached: Whether the episode ended at its step limit.
    """
    if not limit_reached or _all_done_once(episode):
        return None
    last = episode.trace.rows - 1
    words = ", ".join(repr(episode.goals[g].word) for g in episode.open_goals(last))
    tail = f" with {words} still to do" if words else ""
    return episode.evidence("step_limit", f"The step limit is reached on the right course{tail}.", rows=(last, last))


def unexplained(episode: EpisodeAnalysis) -> Evidence:
    """Return the evidence of an execution that did every step and still missed the goal."""
    last = episode.trace.rows - 1
    text = "Every attempt was right, and yet the goal does not hold at the end."
    if episode.condition.expected is not Expected.SUCCEED:
        text = "Nothing wrong was grasped, and yet the arm did not come to rest or did not leave things alone."
    return episode.evidence("goal_not_held", text, rows=(last, last))


def _all_done_once(episode: EpisodeAnalysis) -> bool:
    done = episode.trace.done
    return bool(done.shape[1]) and bool(done.any(axis=0).all())
