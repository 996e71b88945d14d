"""Early halt: the arm stands still for good with subgoals open."""

from __future__ import annotations

from betterbench.diagnosis.episode_analysis import EpisodeAnalysis
from betterbench.diagnosis.halts import find_halt
from betterbench.diagnosis.verdict import Evidence
from betterbench.tasks import Expected


def find(episode: EpisodeAnalysis) -> Evidence | None:
    """Return the evidence of an early halt, or None."""
    if episode.condition.expected is not Expected.SUCCEED:
        return None
    halt = find_halt(episode)
    if halt is None:
        return None
    words = ", ".join(repr(episode.goals[g].word) for g in episode.open_goals(halt[0]))
    text = f"The arm stands still for good with {words} still to do."
    return episode.evidence("still_with_open_subgoals", text, rows=halt)
