"""Early halt: the arm stops and does not move again, although subgoals are unfinished."""

from __future__ import annotations

from collections.abc import Sequence

from betterbench.diagnosis.analysis.halts import find_halt, in_fingers
from betterbench.diagnosis.exposure import Exposure
from betterbench.diagnosis.failure_mode import FailureMode, TrialView
from betterbench.diagnosis.thresholds import SHARE_OF_ALL
from betterbench.diagnosis.verdict import Evidence, TrialDiagnosis
from betterbench.tasks import Expected
from betterbench.tasks.authoring.training_distribution import pairing
from betterbench.tasks.labels import Label
from betterbench.wording import listed


def _exposed(x: Exposure) -> bool:
    """Return whether the task can be done, but this combination of instruction and scene does not occur in training.

    Scenes that look half done do not count, because a halt before the first attempt is a phase conflict in them.
    """
    met = {pairing(condition) for condition in x.task.training}
    return x.test.expected is Expected.SUCCEED and not x.test.mid_task_look and pairing(x.test) not in met


def _sharper(trials: Sequence[TrialDiagnosis]) -> str:
    """Return a sentence if nearly all trials stopped before the first grasp attempt, or if nearly all stopped later."""
    never = sum(not trial.attempts for trial in trials)
    if never >= SHARE_OF_ALL * len(trials):
        return "It stops before its first grasp."
    return "It stops after part of the task." if never <= (1 - SHARE_OF_ALL) * len(trials) else ""


@FailureMode(
    Label.EARLY_HALT,
    short="halt",
    definition="The arm does not move for at least the last 3 s. Steps are unfinished, and no attempt is in progress.",
    conclusion="It stops before the task is done.",
    sharper=_sharper,
    finding="Stops for good with steps left to do",
    exposed_by=_exposed,
)
def _find(trial: TrialView) -> Evidence | None:
    episode = trial.episode
    if episode.condition.expected is not Expected.SUCCEED:
        return None
    halt = find_halt(episode)
    if halt is None:
        return None
    held = in_fingers(episode.trace, halt[1])
    how = "" if held is None else f" with the {episode.kind(held)} in the gripper"
    text = f"The arm stands still to the end{how}; steps left: {listed(episode.open_words(halt[0]))}."
    return episode.evidence("still_with_open_subgoals", text, rows=halt)
