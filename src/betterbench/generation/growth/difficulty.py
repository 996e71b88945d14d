"""Difficulty of a certified task, based on the time that the scripted expert takes."""

from __future__ import annotations

import statistics
from collections.abc import Iterable
from enum import StrEnum

from betterbench.certification.certificate import TrialCertificate
from betterbench.sim.scenes import CONTROL_RATE_HZ


class Difficulty(StrEnum):
    """Level of difficulty of a task, computed by :func:`difficulty_of`."""

    EASY = "easy"
    MEDIUM = "medium"
    HARD = "hard"


EASY_BELOW_S, HARD_FROM_S = 10.0, 17.0
"""Median times of the scripted expert that separate the levels of difficulty [s].

Tasks with one mug or plate take 7 to 8 s. Tasks with two items, spices or desk objects take 14 to 16 s. Tasks with
drawers or stacks of layers take 18 to 21 s. The limits lie between these groups.
"""


def median_s(trials: Iterable[TrialCertificate]) -> float:
    """Return the expert's median time over the trials of variations [s].

    Variations where the expert has nothing to do are ignored. If no trial is left, return 0.
    """
    steps = [trial.steps for trial in trials if not trial.training and not trial.watched]
    return statistics.median(steps) / CONTROL_RATE_HZ if steps else 0.0


def difficulty_of(trials: Iterable[TrialCertificate]) -> Difficulty:
    """Return the level of difficulty of a task, based on the expert's times in the certified trials."""
    seconds = median_s(trials)
    if seconds < EASY_BELOW_S:
        return Difficulty.EASY
    return Difficulty.MEDIUM if seconds < HARD_FROM_S else Difficulty.HARD
