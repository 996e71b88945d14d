"""Wrong object: the policy attempts an object or target of another instruction, and no specific rule explains this."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from betterbench.diagnosis.analysis.episode_analysis import AttemptTarget, EpisodeAnalysis, Step
from betterbench.diagnosis.bindings import wrong_places
from betterbench.diagnosis.failure_mode import FailureMode, TrialView
from betterbench.diagnosis.thresholds import SHARE_OF_ALL
from betterbench.diagnosis.verdict import Evidence, TrialDiagnosis
from betterbench.tasks.labels import Label
from betterbench.tasks.words import agreeing


def _sharper(trials: Sequence[TrialDiagnosis]) -> str:
    """Return a sentence if the policy nearly always uses a wrong target, or nearly always goes for one kind of object.

    The kind of object is only named if the instructions of these trials ask for several other kinds.
    """
    if places := wrong_places(trials):
        return places
    (kind, times), *_ = Counter(trial.first_attempt_kind for trial in trials).most_common(1)
    requested = {trial.intended_kind for trial in trials if trial.first_attempt_kind == kind}
    if kind is None or times < SHARE_OF_ALL * len(trials) or len(requested) < 2:
        return ""
    return f"It goes for the {kind} where the instruction asks for another object."


@FailureMode(
    Label.WRONG_OBJECT,
    short="wrong object",
    definition="The policy attempts an object or target of another instruction, but the run has too little evidence "
    "to name the rule that it follows.",
    conclusion="It goes for the wrong object; this run does not show why.",
    sharper=_sharper,
    finding="Goes for a wrong object or target, by no proven rule",
)
def _find(trial: TrialView) -> Evidence | None:
    episode = trial.episode
    for step in episode.decisions:
        if (due := _due_elsewhere(episode, step)) is not None:
            text = (
                f"It goes for {episode.describe(step)}, although the instruction puts the {due} "
                f"{episode.asked_where(step)}."
            )
            return episode.at_step("place_of_another_instruction", text, step)
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


def _due_elsewhere(episode: EpisodeAnalysis, step: Step) -> str | None:
    """Return the kind of object to be picked now, if the attempt moves a drawer that is not this object's target.

    The result is None if the attempt does not move a wrong drawer.
    """
    if step.target is not AttemptTarget.OTHER or step.goal is None or not episode.trace.is_drawer(step.at):
        return None
    due = next(iter(episode.meant[step.goal]), None)
    return None if due is None or episode.trace.is_drawer(due) else episode.kind(due)
