"""Order violation: right objects in a wrong order, where the order is part of the goal."""

from __future__ import annotations

import numpy as np

from betterbench.diagnosis.episode_analysis import AttemptTarget, EpisodeAnalysis
from betterbench.diagnosis.exposure import Exposure
from betterbench.diagnosis.failure_mode import FailureMode, TrialView
from betterbench.diagnosis.verdict import Evidence
from betterbench.tasks.labels import Label


def _exposed(x: Exposure) -> bool:
    """The order is part of the goal, no demonstration had it, and no habit explains what may come too early."""
    sequence = tuple(kind for goal in x.goals for kind in sorted(x.kinds(goal))[:1])
    still_open = {kind for goal in x.open_goals for kind in x.kinds(goal)}
    early = {kind for goal in x.open_goals[1:] for kind in x.kinds(goal)} - {x.trained.habit}
    new = sequence not in x.trained.sequences
    return x.test.instruction.ordered and new and len(still_open) > 1 and bool(early - x.kinds(x.open_goals[0]))


@FailureMode(
    Label.ORDER_VIOLATION,
    short="order",
    definition="The right objects are handled in the wrong order where the order is part of the goal.",
    conclusion="It handles the right objects in the wrong order.",
    finding="Does the right things in the wrong order",
    exposed_by=_exposed,
)
def _find(trial: TrialView) -> Evidence | None:
    """Return the first evidence of a violated order."""
    episode = trial.episode
    if not episode.instruction.ordered:
        return None
    for step in episode.decisions:
        if step.target is AttemptTarget.LATER and step.goal is not None:
            if not episode.attempted_after(step.goal, step.grasp.start):
                continue
            text = (
                f"It goes for {episode.describe(step)} before {episode.asked_words(step.goal)}, "
                "which comes first and is attempted later."
            )
            return episode.at_step("attempted_in_wrong_order", text, step)
    return _completed_in_wrong_order(episode)


def _completed_in_wrong_order(episode: EpisodeAnalysis) -> Evidence | None:
    """Return evidence if a step is completed before an earlier one, however that came about."""
    done = episode.trace.done
    first = [int(np.argmax(column)) if column.any() else None for column in done.T]
    late: list[tuple[int, int]] = []
    for g, row in enumerate(first):
        if row is None:
            continue
        possible = episode.open_goals(row)
        if any(e > row if e is not None else j in possible for j, e in enumerate(first[:g])):
            late.append((row, g))
    if not late:
        return None
    row, g = min(late)
    text = f"{episode.asked_words(g)} is done before what comes earlier in the instruction."
    return episode.evidence("completed_in_wrong_order", text, rows=(row, row), objects=episode.meant[g])
