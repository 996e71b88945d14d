"""Phase conflict: the initial state looks like the middle of a demonstration, and the policy freezes or wanders."""

from __future__ import annotations

import numpy as np

from betterbench.diagnosis.exposure import Exposure
from betterbench.diagnosis.failure_mode import FailureMode, TrialView
from betterbench.diagnosis.halts import find_halt, travel
from betterbench.diagnosis.verdict import Evidence
from betterbench.tasks import THRESHOLDS, Expected
from betterbench.tasks.labels import Label


def _exposed(x: Exposure) -> bool:
    """The initial state looks like the middle of a demonstration, and something is to be done."""
    return x.test.mid_task_look and x.test.expected is Expected.SUCCEED


@FailureMode(
    Label.PHASE_CONFLICT,
    short="phase",
    definition="The start looks like the middle of a demonstration, and the arm freezes or wanders without an attempt.",
    conclusion="It freezes or wanders when the scene looks half finished.",
    finding="Freezes or wanders where the scene looks like the middle of a demonstration",
    exposed_by=_exposed,
)
def _find(trial: TrialView) -> Evidence | None:
    """Return the evidence of a phase conflict. An episode with an attempt has none."""
    episode = trial.episode
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
