"""Classes and functions that the file of a new failure mode can import. See docs/adding-a-failure-mode.md."""

from betterbench.diagnosis.analysis.episode_analysis import AttemptTarget, EpisodeAnalysis
from betterbench.diagnosis.exposure import Exposure
from betterbench.diagnosis.failure_mode import FailureMode, TrialView
from betterbench.diagnosis.verdict import Evidence
from betterbench.tasks.labels import Kind, Label, new_label
from betterbench.tasks.thresholds import THRESHOLDS, threshold

__all__ = [
    "THRESHOLDS",
    "AttemptTarget",
    "EpisodeAnalysis",
    "Evidence",
    "Exposure",
    "FailureMode",
    "Kind",
    "Label",
    "TrialView",
    "new_label",
    "threshold",
]
