"""Detection of halts. The arm stays still or trembles in place until the end although subgoals are open."""

from __future__ import annotations

import numpy as np

from betterbench.diagnosis.analysis.approaches import comes_down_to, lowered, spans
from betterbench.diagnosis.analysis.episode_analysis import (
    AttemptTarget,
    EpisodeAnalysis,
    Means,
    Step,
    once_per_episode,
)
from betterbench.diagnosis.analysis.paths import resting_rows, runs_of, stays_in_place, still_rows
from betterbench.diagnosis.analysis.trace import Trace, place_middle
from betterbench.diagnosis.thresholds import (
    COME_TO_REST,
    FLICKER_TIME,
    OVER_GOAL,
    PAUSES_VARY,
    SEARCH_STEP,
    STAY_TIME,
    TREMBLE_TIME,
)
from betterbench.geometry import rotate
from betterbench.tasks import THRESHOLDS
from betterbench.tasks.judging.motion import Bools
from betterbench.tasks.relations import relation


@once_per_episode
def find_halt(episode: EpisodeAnalysis) -> tuple[int, int] | None:
    """Return the first and last row of the halt at the end of the episode, or None if the arm does not halt.

    In a halt, the arm rests for at least ``halt_time`` while subgoals are unfinished and no attempt is in progress.
    Closing the gripper far from all objects counts as an attempt. A subgoal does not count as unfinished if its object
    is at the target when the arm comes to rest. If the arm trembles in place, the halt must last for ``tremble_time``.
    Trembling over a requested object is not a halt.

    A pause after which the arm continues is not a halt. A final stop that is shorter than an earlier pause may itself
    be a pause, so it is not a halt either. In two situations, the arm has only halted if it does not move at all: it
    holds a correct object at its target region, or it has descended to a correct object with open fingers. If it moves
    in these situations, the fault is that the gripper does not open or close.
    """
    trace = episode.trace
    kept = kept_at_its_place(episode) is not None
    # A gripper that has reached the object to be grasped, or holds the object at its target, has only halted if it does
    # not move at all.
    arrived = kept or comes_down_to(trace, episode.idle_from) in episode.wanted(episode.idle_from)
    still = (resting_rows if arrived else still_rows)(trace.tool, trace.rate_hz)
    if not arrived and not any(s.means is Means.STAY and s.target is AttemptTarget.ASKED for s in episode.others):
        still[_in_place_from(trace) :] = True
    for step in episode.steps:
        still[step.grasp.start : step.grasp.end + 1] = False
        release = step.grasp.release  # an arm that releases an object has not halted yet
        still[release : release + trace.steps(THRESHOLDS.stop_time)] = False
    for closing in episode.on_nothing:  # an arm that closes its gripper has not halted yet, even if there is no object
        still[closing.start : closing.end + 1] = False
    last = max(
        (*(_busy_until(trace, s) for s in episode.steps), *(closing.end for closing in episode.on_nothing)), default=-1
    )
    needed = trace.steps(THRESHOLDS.halt_time)
    pauses: list[int] = []
    for start, stop in runs_of(still):
        begin = _rests_from(trace, max(start, last + 1), stop)
        if begin is not None and episode.open_goals(begin) and episode.open_goals(begin + needed - 1):
            return (begin, stop - 1) if stop - begin >= _usual(pauses, needed) else None
        pauses.append(stop - start)
    return None


def in_fingers(trace: Trace, row: int) -> int | None:
    """Return the index of the object in the gripper at a row of the trace, or None if the gripper is empty.

    A brief loss of contact does not count as a release.
    """
    rows = slice(max(0, row - trace.steps(FLICKER_TIME)), row + 1)
    held = [i for i in trace.held[rows].tolist() if i >= 0]
    return held[-1] if held else None


@once_per_episode
def kept_at_its_place(episode: EpisodeAnalysis) -> int | None:
    """Return the object that the closed gripper holds at its target region until the end, or None.

    The object may already be standing on the target. An object that is still being lowered does not count.
    """
    trace, last = episode.trace, episode.trace.rows - 1
    for g, goal in enumerate(episode.goals):
        if trace.done[last, g] or not relation(goal.relation).carried:
            continue
        for i in episode.meant[g]:
            gripped = (trace.held == i) | (trace.left[:, i] & trace.right[:, i])
            rows = spans(gripped, trace.steps(FLICKER_TIME))
            if not rows or rows[-1][1] < last - trace.steps(FLICKER_TIME) or not trace.closing[rows[-1][0] :].all():
                continue
            first = rows[-1][0]
            at = first + np.flatnonzero(_is_at_place(episode, i, g, first))
            # An object that is still being lowered over its target region has not arrived.
            if at.size >= trace.steps(STAY_TIME) and lowered(trace.positions[at, i, 2]) <= THRESHOLDS.begun_lift:
                return i
    return None


def _is_at_place(episode: EpisodeAnalysis, i: int, g: int, first: int) -> Bools:
    """Return whether an object is at or over the target region of a subgoal, for each row from ``first`` on."""
    trace, goal, t = episode.trace, episode.goals[g], episode.trace.targets[g]
    target = trace.info.objects[t]
    middle = place_middle(target, goal.relation, goal.region)
    regions = [r.half_size[:2] for r in target.regions if np.allclose(r.position[:2], middle[:2])]
    edge = np.max([(0.0, 0.0), *regions], axis=0)
    offsets = trace.positions[first:, i] - trace.positions[first:, t]
    turned = zip(trace.quaternions[first:, t].tolist(), offsets.tolist(), strict=True)
    inverse = [rotate((w, -x, -y, -z), offset) for (w, x, y, z), offset in turned]
    gaps = np.abs(np.array(inverse) - np.array(middle))[:, :2]
    found: Bools = (np.linalg.norm(gaps, axis=1) <= OVER_GOAL) | (gaps <= edge).all(axis=1)
    return found


def _usual(pauses: list[int], long: int) -> float:
    """Return the maximum length of a pause of this policy that is not a halt, in rows of the trace.

    This is the length of its longest pause so far, or more than that if the policy has made several long pauses.
    """
    return max(pauses, default=0) * (PAUSES_VARY if sum(p >= long for p in pauses) > 1 else 1.0)


def _rests_from(trace: Trace, start: int, stop: int) -> int | None:
    """Return the row from which the arm stays in place until the end, or None if it stays for too short a time.

    The arm may still be slowing down at this row.
    """
    last = stop - trace.steps(THRESHOLDS.halt_time)
    if start <= last and stays_in_place(trace.tool, trace.time, start):
        return start
    rows = range(start, last + 1, trace.steps(SEARCH_STEP))
    return next((row for row in rows if stays_in_place(trace.tool, trace.time, row, within=COME_TO_REST)), None)


def _in_place_from(trace: Trace) -> int:
    """Return the row from which the arm stays in place until the end, if it stays long enough to count as trembling.

    If there is no such row, return the number of rows of the trace.
    """
    for begin in range(0, trace.rows - trace.steps(TREMBLE_TIME), trace.steps(SEARCH_STEP)):
        if stays_in_place(trace.tool, trace.time, begin):
            return begin
    return trace.rows


def _busy_until(trace: Trace, step: Step) -> int:
    """Return the last row in which an attempt is still in progress, so that the arm has not halted.

    This is the row where the grasp ends. If the gripper then carried the object away, it is the row of the release.
    """
    release = step.grasp.release
    if not step.grasp.secured or release >= trace.rows:
        return step.grasp.end
    before = max(step.grasp.end, release - trace.steps(THRESHOLDS.halt_time))
    carried = float(np.linalg.norm(trace.tool[before : release + 1] - trace.tool[release], axis=1).max())
    return release if carried > THRESHOLDS.begun_lift else step.grasp.end
