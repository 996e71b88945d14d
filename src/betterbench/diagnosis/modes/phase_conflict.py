"""Phase conflict: the initial state looks like the middle of a demonstration, and the policy freezes or wanders."""

from __future__ import annotations

import numpy as np

from betterbench.diagnosis.episode_analysis import EpisodeAnalysis
from betterbench.diagnosis.halts import find_halt, travel
from betterbench.diagnosis.verdict import Evidence
from betterbench.tasks import THRESHOLDS


def find(episode: EpisodeAnalysis) -> Evidence | None:
    """Return the evidence of a phase conflict, or None. An episode with an attempt has none."""
    if not episode.condition.mid_task_look or episode.steps:
        return None
    halt = find_halt(episode)
    if halt is not None:
        text = "The scene looks like the middle of a demonstration, and the arm freezes without ever grasping."
        return episode.evidence("freeze_in_mid_task_scene", text, rows=halt)
    path = travel(episode.trace)
    if path[-1] <= THRESHOLDS.oscillation_travel:
        return None
    row = int(np.argmax(path > THRESHOLDS.oscillation_travel))
    text = f"The scene looks like the middle of a demonstration, and the arm wanders {path[-1]:.1f} m without grasping."
    return episode.evidence("wandering_in_mid_task_scene", text, rows=(row, episode.trace.rows - 1))
