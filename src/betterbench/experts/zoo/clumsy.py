"""``zoo:clumsy``: the right decision, a bad hand."""

from __future__ import annotations

from betterbench.experts.mind import Situation
from betterbench.experts.skills import Fumble
from betterbench.tasks import stream


def clumsiness(situation: Situation) -> Fumble:
    """Return how the hand fails in an episode: it drops the object in mid-air, or it closes beside it.

    Which of the two, and how far beside, is drawn from the trial's own stream.
    """
    draw = stream(situation.task.id, situation.seed, "clumsy")
    if draw.random() < 0.5:
        return Fumble(drop=True)
    return Fumble(miss_by_m=float(draw.uniform(0.006, 0.012)))
