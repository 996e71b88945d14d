"""Phase conflict: the policy does not recognize which step of the task is due.

As a result, the arm freezes before any attempt, or moves back and forth.
"""

from __future__ import annotations

import numpy as np

from betterbench.diagnosis.analysis.approaches import (
    closes_in_part,
    comes_down_to,
    comes_nearer,
    comes_shut,
    find_stays,
    returns_to,
    runs_into,
    to_and_fro,
)
from betterbench.diagnosis.analysis.episode_analysis import AttemptTarget, EpisodeAnalysis, Means, Step
from betterbench.diagnosis.analysis.halts import find_halt
from betterbench.diagnosis.analysis.paths import path_length
from betterbench.diagnosis.exposure import Exposure, absent_steps
from betterbench.diagnosis.failure_mode import FailureMode, TrialView, sharper_by_rule
from betterbench.diagnosis.verdict import Evidence
from betterbench.tasks import Expected, get_task
from betterbench.tasks.labels import Label
from betterbench.tasks.thresholds import DISPLACED
from betterbench.wording import listed


def _exposed(x: Exposure) -> bool:
    """Return whether the initial state looks like the middle of a demonstration and a step remains to be done.

    A later step also counts as remaining if its object is missing.
    """
    return x.test.mid_task_look and (x.test.expected is Expected.SUCCEED or x.lacks_later_step)


@FailureMode(
    Label.PHASE_CONFLICT,
    short="phase",
    definition="The initial state looks like the middle of a demonstration, and the arm freezes without an attempt. "
    "The label also applies if the empty gripper moves back and forth until the end, displaces no object and does not "
    "approach an instructed object.",
    conclusion="It does not recognize the due step: it freezes in half-finished scenes, or moves back and forth.",
    sharper=sharper_by_rule(
        {
            "freeze_in_mid_task_scene": "It freezes before its first grasp if the scene looks half finished: it "
            "does not recognize the due step.",
            "to_and_fro": "It moves back and forth without a grasp: it does not recognize the due step.",
        }
    ),
    finding="Freezes in a scene that looks half finished, or moves back and forth without an attempt",
    exposed_by=_exposed,
)
def _find(trial: TrialView) -> Evidence | None:
    """Find evidence that the arm freezes before any attempt, or moves back and forth after the last attempt."""
    episode = trial.episode
    halt = find_halt(episode)
    if episode.condition.mid_task_look and not episode.steps and halt is not None:
        text = "The scene looks like the middle of a demonstration, and the arm freezes without ever grasping."
        return episode.evidence("freeze_in_mid_task_scene", text, rows=halt)
    if halt is None and episode.condition.expected is Expected.STAY_STILL:
        return _oscillates(episode)
    if halt is not None or episode.condition.expected is not Expected.SUCCEED:
        return None
    if comes_down_to(episode.trace, episode.idle_from) in episode.wanted(episode.idle_from):
        return None  # the target is known, and the fault is that the gripper fails to close
    stay = next((step for step in episode.others if step.means is Means.STAY), None)
    if stay is not None:
        return _comes_and_goes(episode, stay)
    rows = to_and_fro(episode.trace, episode.idle_from)
    if rows is None or not episode.open_goals(rows[1]) or _goes_somewhere(episode, rows) or _all_asked(episode, rows):
        return None
    way = float(np.ptp(path_length(episode.trace.tool)[[*rows]]))
    where = f"between {listed(names)}" if (names := _names(episode, rows)) else "without a recognizable target"
    text = f"The empty gripper moves back and forth {where} until the end, {way:.1f} m in total, and never grasps."
    return episode.evidence("to_and_fro", text, rows=rows)


def _oscillates(episode: EpisodeAnalysis) -> Evidence | None:
    """Return evidence if the empty gripper moves back and forth although no step is left to do.

    In the paper, this is phase conflict II: the scene looks half finished, and the object of a training step is
    missing. If all training steps are finished, moving back and forth alone does not show that the policy mistakes the
    phase of the task.
    """
    condition = episode.condition
    if not condition.mid_task_look or episode.steps or not absent_steps(get_task(condition.task), condition):
        return None
    rows = to_and_fro(episode.trace, 0)
    if rows is None:
        return None
    way = float(np.ptp(path_length(episode.trace.tool)[[*rows]]))
    text = (
        "The scene looks like the middle of a demonstration, no step is left, and the empty gripper moves back and "
        f"forth until the end, {way:.1f} m in total."
    )
    return episode.evidence("to_and_fro", text, rows=rows)


def _goes_somewhere(episode: EpisodeAnalysis, rows: tuple[int, int]) -> bool:
    """Return whether the gripper moves an object aside or approaches a requested object after the last grasp."""
    first, last = min(rows[0], episode.idle_from), rows[1]
    shoves = any(shove.end >= first for shove in episode.shoves)
    way = episode.trace.positions[last] - episode.trace.positions[first]
    sweeps = bool(np.any(np.linalg.norm(way[list(episode.trace.items)], axis=-1) > DISPLACED))
    return shoves or sweeps or comes_nearer(episode.trace, rows, episode.wanted(rows[0]))


def _all_asked(episode: EpisodeAnalysis, rows: tuple[int, int]) -> bool:
    """Return whether the gripper passes over at least two objects, and each of them would be correct to grasp now.

    The result is also True if the gripper repeatedly visits a single such object, unless the scene looks half finished.
    In a half-finished scene, such visits count as moving back and forth.
    """
    over = {stay.object for stay in find_stays(episode.trace, rows[0])}
    if not over or not over <= set(episode.wanted(rows[0])):
        return False
    if len(over) > 1:
        return True
    back = any(returns_to(episode.trace, episode.idle_from, i) for i in over)
    return back and not episode.condition.mid_task_look


def _comes_and_goes(episode: EpisodeAnalysis, stay: Step) -> Evidence | None:
    """Return evidence if the open gripper repeatedly moves over the correct object and away again until the end."""
    if stay.at is None or stay.target is not AttemptTarget.ASKED or not episode.condition.mid_task_look:
        return None
    rows = returns_to(episode.trace, episode.idle_from, stay.at)
    ways = (comes_shut, runs_into, closes_in_part)
    failed = any(find(episode.trace, episode.idle_from, stay.at) is not None for find in ways)
    if rows is None or failed:
        return None
    text = (
        f"The open gripper repeatedly comes over the {episode.kind(stay.at)}, the correct object, and leaves again "
        "until the end, and never grasps."
    )
    return episode.evidence("to_and_fro", text, rows=rows, objects=(stay.at,))


def _names(episode: EpisodeAnalysis, rows: tuple[int, int]) -> list[str]:
    """Return phrases for the kinds of objects that the gripper moves back and forth over.

    The result is empty if there is only one kind.
    """
    over = dict.fromkeys(episode.kind(stay.object) for stay in find_stays(episode.trace, rows[0]))
    return [f"the {kind}" for kind in over] if len(over) > 1 else []
