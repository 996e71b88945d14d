"""Timeout: nothing was done wrong, and the step limit is reached with something left to do."""

from __future__ import annotations

from betterbench.diagnosis.episode_analysis import EpisodeAnalysis, Means
from betterbench.diagnosis.failure_mode import FailureMode, TrialView
from betterbench.diagnosis.verdict import Evidence
from betterbench.statistics.wording import listed
from betterbench.tasks.labels import Label


@FailureMode(
    Label.TIMEOUT,
    short="timeout",
    definition="Every attempt was right, or nothing else was gone for, and the step limit was reached.",
    conclusion="It does the right things, but runs out of time.",
    finding="Does the right things until the step limit ends the trial",
)
def _find(trial: TrialView) -> Evidence | None:
    """Return the evidence of a timeout, if nothing else explains the trial."""
    if not trial.unexplained or not trial.out_of_time:
        return None
    episode = trial.episode
    last = episode.trace.rows - 1
    words = listed(episode.open_words(last))
    tail = f"; asked for and still to do: {words}" if words else ""
    return episode.evidence(
        "step_limit", f"The step limit is reached {_course(episode, last)}{tail}.", rows=(last, last)
    )


def _course(episode: EpisodeAnalysis, last: int) -> str:
    """Return a clause that says on which course the policy was."""
    held = int(episode.trace.held[last])
    if held >= 0:
        return f"with the {episode.kind(held)} in the gripper"
    stay = next((s for s in episode.others if s.means is Means.STAY and s.at is not None), None)
    if stay is not None and stay.at is not None:
        return f"while the open gripper stays over the {episode.kind(stay.at)}, the right target"
    return "although every attempt was right" if episode.steps else "on the way to a first attempt"
