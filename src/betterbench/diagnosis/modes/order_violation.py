"""Order violation: the policy handles the correct objects in the wrong order although the order is part of the goal."""

from __future__ import annotations

import itertools

import numpy as np

from betterbench.diagnosis.analysis.episode_analysis import AttemptTarget, EpisodeAnalysis, Step
from betterbench.diagnosis.exposure import Exposure
from betterbench.diagnosis.failure_mode import FailureMode, TrialView, sharper_by_rule
from betterbench.diagnosis.verdict import Evidence
from betterbench.tasks.labels import Label


def _exposed(x: Exposure) -> bool:
    """Return whether the goal requires an order of steps that does not occur in training.

    If the usual first step of training violates this order, the result is False, because such a step is behavioral
    inertia.
    """
    sequence = tuple(kind for goal in x.goals for kind in sorted(x.kinds(goal))[:1])
    still_open = {kind for goal in x.open_goals for kind in x.kinds(goal)}
    early = {kind for goal in x.open_goals[1:] for kind in x.kinds(goal)} - {x.trained.habit}
    new = sequence not in x.trained.sequences
    return x.test.instruction.ordered and new and len(still_open) > 1 and bool(early - x.kinds(x.open_goals[0]))


@FailureMode(
    Label.ORDER_VIOLATION,
    short="order",
    definition="The policy handles the correct objects in the wrong order, and the order is part of the goal.",
    conclusion="It handles the correct objects in the wrong order.",
    sharper=sharper_by_rule(
        {
            "memorized_order": "It continues with the step that came next in training, although the instruction has "
            "another order.",
        }
    ),
    finding="Handles the correct objects in the wrong order",
    exposed_by=_exposed,
)
def _find(trial: TrialView) -> Evidence | None:
    episode = trial.episode
    if not episode.instruction.ordered:
        return None
    before: Step | None = None
    for step in episode.decisions:
        late = step.goal if step.target is AttemptTarget.LATER else None
        if late is not None and episode.attempted_after(late, step.grasp.start):
            done = None if before is None or before.at is None else episode.kind(before.at)
            trained = done is not None and _followed(episode, done, step)
            habit = f"; in training {episode.describe(step, slots=False)} came next after the {done}" if trained else ""
            text = (
                f"It goes for {episode.describe(step)} before {episode.asked_words(late)}, "
                f"which comes first and is attempted later{habit}."
            )
            return episode.at_step("memorized_order" if trained else "attempted_in_wrong_order", text, step)
        if not episode.trace.is_drawer(step.at):
            before = step
    return _completed_in_wrong_order(episode)


def _followed(episode: EpisodeAnalysis, done: str, step: Step) -> bool:
    """Return whether the attempted object directly followed an object of the given kind in any demonstration."""
    if step.at is None:
        return False
    pair = (done, episode.kind(step.at))
    return any(pair in itertools.pairwise(sequence) for sequence in episode.trained.sequences)


def _completed_in_wrong_order(episode: EpisodeAnalysis) -> Evidence | None:
    """Return evidence if a step is completed before an earlier step of the instruction, regardless of the cause."""
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
    text = f"{episode.asked_words(g)} is done before a step that comes earlier in the instruction."
    return episode.evidence("completed_in_wrong_order", text, rows=(row, row), objects=episode.meant[g])
