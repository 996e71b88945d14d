"""Causal confusion: a required step is skipped although its object is there, or a finished one is repeated."""

from __future__ import annotations

from betterbench.diagnosis.episode_analysis import AttemptTarget
from betterbench.diagnosis.exposure import Exposure
from betterbench.diagnosis.failure_mode import FailureMode, TrialView
from betterbench.diagnosis.verdict import Evidence
from betterbench.tasks.labels import Label
from betterbench.tasks.training_distribution import on_table


def _exposed(x: Exposure) -> bool:
    """A step is done or repeated, fewer things are there than in the twin, or more steps are asked for than ever."""
    done = len(x.open_goals) < len(x.goals) and bool(x.test.preplaced)
    repeated = any(goal.count > 1 for goal in x.goals)
    fewer = len(on_table(x.test)) < len(on_table(x.base)) and not done
    return done or repeated or fewer or len(x.goals) > x.trained.longest


@FailureMode(
    Label.CAUSAL_CONFUSION,
    short="causal",
    definition="A required step whose object is present is skipped for a later step, or a finished step is repeated.",
    conclusion="It loses track of what has been done: it skips steps that are open or repeats finished ones.",
    finding="Skips a required step or repeats a finished one",
    exposed_by=_exposed,
)
def _find(trial: TrialView) -> Evidence | None:
    """Return the first evidence of causal confusion."""
    episode = trial.episode
    for step in episode.steps:
        if step.target is AttemptTarget.REPEATED:
            text = f"It goes for {episode.describe(step)}, although that step is done; {episode.asked_for(step)}."
            return episode.at_step("finished_step_repeated", text, step)
        if step.target is AttemptTarget.LATER and step.goal is not None:
            if episode.attempted_after(step.goal, step.grasp.start):
                continue
            text = (
                f"It goes for {episode.describe(step)} and never for {episode.goals[step.goal].word!r}, "
                "which comes first and is there."
            )
            return episode.at_step("required_step_skipped", text, step)
    return None
