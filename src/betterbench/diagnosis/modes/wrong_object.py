"""Wrong object or place: another instruction of the task names it, and no more specific rule is proven."""

from __future__ import annotations

from betterbench.diagnosis.analysis.episode_analysis import AttemptTarget
from betterbench.diagnosis.failure_mode import FailureMode, TrialView
from betterbench.diagnosis.verdict import Evidence
from betterbench.tasks.labels import Label
from betterbench.tasks.words import agreeing


@FailureMode(
    Label.WRONG_OBJECT,
    short="wrong object",
    definition="An attempt at an object or target of another instruction, without proof of a rule in this run.",
    conclusion="It goes for the wrong object; this run does not show why.",
    finding="Goes for a wrong object, by no proven rule",
)
def _find(trial: TrialView) -> Evidence | None:
    episode = trial.episode
    for step in episode.decisions:
        if step.target in (AttemptTarget.OTHER, AttemptTarget.EMPTY):
            text = f"It goes for {episode.describe(step)}, although {episode.asked_for(step)}."
            return episode.at_step("object_of_another_instruction", text, step)
        misplaced = episode.wrong_place(step)
        if misplaced is not None and step.at is not None:
            gone, rest, place = misplaced
            kind = episode.kind(step.at)
            text = (
                f"The {kind} {agreeing(kind, 'is', 'are')} brought to {episode.where(place.target, place.region)}, "
                f"although the instruction puts {agreeing(kind, 'it', 'them')} {episode.asked_where(step)}."
            )
            return episode.evidence("place_of_another_instruction", text, rows=(gone, rest), objects=(step.at,))
    return None
