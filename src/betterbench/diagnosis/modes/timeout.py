"""Timeout: the step limit is reached while subgoals are unfinished, and no attempt was wrong."""

from __future__ import annotations

from collections.abc import Sequence

from betterbench.diagnosis.analysis.approaches import comes_down_to, stays_above
from betterbench.diagnosis.analysis.episode_analysis import EpisodeAnalysis, Means
from betterbench.diagnosis.analysis.halts import in_fingers, kept_at_its_place
from betterbench.diagnosis.failure_mode import FailureMode, TrialView, sharper_by_rule
from betterbench.diagnosis.thresholds import SHARE_OF_ALL
from betterbench.diagnosis.verdict import OUTCOME_ALONE, Evidence, TrialDiagnosis
from betterbench.tasks.labels import Label
from betterbench.wording import listed

_BY_MECHANISM = sharper_by_rule(
    {
        OUTCOME_ALONE: "It does not reach the goal before the step limit.",
        "never_closes": "It goes for the correct objects, but its gripper never closes on them.",
        "does_not_close": "It goes for the correct objects, but its gripper does not close on them.",
        "never_descends": "It moves over the correct objects, but its gripper does not come down to them.",
        "never_opens": "It brings the correct objects to their target regions, but its gripper never opens there.",
    }
)


def _sharper(trials: Sequence[TrialDiagnosis]) -> str:
    """Return a sentence about the cause of the timeouts if nearly all trials have the same cause."""
    never = sum(not trial.attempts for trial in trials)
    before = "It runs out of time before its first grasp." if never >= SHARE_OF_ALL * len(trials) else ""
    return _BY_MECHANISM(trials) or before


@FailureMode(
    Label.TIMEOUT,
    short="timeout",
    definition="The step limit was reached, and the policy attempted no wrong object.",
    conclusion="It makes no mistake, but runs out of time.",
    sharper=_sharper,
    finding="Makes no wrong attempt, but reaches the step limit",
)
def _find(trial: TrialView) -> Evidence | None:
    if not trial.unexplained or not trial.out_of_time:
        return None
    episode = trial.episode
    last = episode.trace.rows - 1
    words = listed(episode.open_words(last))
    tail = f"; steps left: {words}" if words else ""
    rule, course = _stuck(episode) or ("step_limit", _course(episode, last))
    return episode.evidence(rule, f"The step limit is reached {course}{tail}.", rows=(last, last))


def _stuck(episode: EpisodeAnalysis) -> tuple[str, str] | None:
    """Return the rule and the clause for a gripper that is at the correct object or target but does not act there.

    The gripper does not close on the correct object, does not come down to it, or never releases it at the target
    region. The result is None if none of this is the case.
    """
    trace, first = episode.trace, episode.idle_from
    reached = comes_down_to(trace, first)
    if reached is not None and reached in episode.wanted(first):
        kind = episode.kind(reached)
        if not trace.closing.any():
            return "never_closes", f"with a gripper that came down to the {kind}, the correct object, and never closed"
        return (
            "does_not_close",
            f"with a gripper that came down to the {kind}, the correct object, and did not close on it",
        )
    stay = _stay(episode)
    if stay is not None and stays_above(trace, first, stay):
        return "never_descends", f"{_over(episode, stay)}, and does not come down to it"
    kept = kept_at_its_place(episode)
    if kept is None:
        return None
    kind = episode.kind(kept)
    return "never_opens", f"with the {kind} in a gripper that reached the target and never opened"


def _stay(episode: EpisodeAnalysis) -> int | None:
    """Return the object that the open gripper stays over, or None."""
    return next((s.at for s in episode.others if s.means is Means.STAY and s.at is not None), None)


def _over(episode: EpisodeAnalysis, i: int) -> str:
    return f"while the open gripper stays over the {episode.kind(i)}, the correct object"


def _course(episode: EpisodeAnalysis, last: int) -> str:
    """Describe what the policy was doing when the step limit was reached."""
    held = in_fingers(episode.trace, last)
    if held is not None:
        return f"with the {episode.kind(held)} in the gripper"
    stay = _stay(episode)
    if stay is not None:
        return _over(episode, stay)
    if not episode.steps and not episode.open_words(last):
        return "by an arm that had no step left and did not stay still"
    return "although every attempt was correct" if episode.steps else "on the way to a first attempt"
