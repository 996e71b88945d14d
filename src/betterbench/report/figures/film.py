"""Film strips. A film strip shows a few frames of a trial and of its training twin, next to the evidence in the report.

The training twin of a variation trial is the training trial with the same seed.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import zip_longest

from betterbench.diagnosis.verdict import Attempt, RunDiagnosis, TrialDiagnosis
from betterbench.errors import InvalidInputError
from betterbench.tasks.labels import Kind

LEAD_S = 1.0
"""Time from the frame before the evidence to the beginning of the evidence [s].

If the evidence is short, the frame after it is equally far from its end. Reaching over the table takes one to two
seconds, and a grasp takes a fifth of a second.
"""

ACTS = ("attempt", "evidence", "same step")
"""Captions of the main frame of a film. "same step" is used for a frame of the training twin that does not show a
grasp.
"""

_SIGNATURES = {b"\xff\xd8\xff": "image/jpeg", b"\x89PNG\r\n\x1a\n": "image/png"}
_KIND_RANK = {Kind.REASONING: 0, Kind.EXECUTION: 1, Kind.SYSTEM: 3, Kind.NONE: 2, Kind.UNFINISHED: 4}


def film_key(policy: str, trial: str) -> str:
    """Return the key that identifies the film strip of a trial ("fast_food/T1/3") among those of several policies."""
    return f"{policy} {trial}"


@dataclass(frozen=True, slots=True)
class Frame:
    """One image of a film strip: the simulated time [s], a JPEG or PNG file, and an optional caption."""

    time_s: float
    image: bytes
    caption: str = ""

    def __post_init__(self) -> None:
        if not any(self.image.startswith(signature) for signature in _SIGNATURES):
            raise InvalidInputError("image", "expected a JPEG or PNG file", "Encode the frame as JPEG or PNG")
        if not (math.isfinite(self.time_s) and self.time_s >= 0.0):
            raise InvalidInputError("time_s", f"{self.time_s!r} is not a valid time", "Use a time ≥ 0 s")

    @property
    def media_type(self) -> str:
        """Media type of the image, determined from the first bytes of the file."""
        return next(kind for signature, kind in _SIGNATURES.items() if self.image.startswith(signature))


@dataclass(frozen=True, slots=True)
class Film:
    """Film strip: frames of a trial ("fast_food/T1/3") and of its training twin.

    The training twin is the training trial with the same seed. ``evidence_s`` is the beginning and the end of the
    evidence for the diagnosis [s]. Frames within this interval are marked. ``clip`` is a video of both episodes side by
    side (H.264 in MP4). Browsers that cannot play the video show the frames.
    """

    policy: str
    trial: str
    frames: tuple[Frame, ...]
    twin: str | None = None
    twin_frames: tuple[Frame, ...] = ()
    evidence_s: tuple[float, float] | None = None
    clip: bytes | None = None

    @property
    def key(self) -> str:
        """Key that identifies this film strip among those of several policies."""
        return film_key(self.policy, self.trial)


@dataclass(frozen=True, slots=True)
class Showing:
    """Trial to show as a film strip, with the times to render [s] in increasing order and their captions.

    ``twin`` is the training trial with the same seed; None if the run has no record of it. ``evidence_s`` is the
    beginning and the end of the evidence [s].
    """

    policy: str
    trial: str
    twin: str | None
    times_s: tuple[float, ...]
    captions: tuple[str, ...]
    twin_times_s: tuple[float, ...]
    twin_captions: tuple[str, ...]
    evidence_s: tuple[float, float]

    @property
    def key(self) -> str:
        """Key that identifies the film strip among those of several policies."""
        return film_key(self.policy, self.trial)


def trials_worth_showing(diagnosis: RunDiagnosis, limit: int, *, repeats: bool = False) -> list[Showing]:
    """Return at most ``limit`` representative trials with the times to render, starting with the most informative.

    The trials are grouped by variation and label. One representative trial of each group is returned, see
    :func:`_representative_first`. With ``repeats``, the second trial of each group follows, then the third, and so on.
    Groups of reasoning failures come first, then execution failures, then solved trials. Larger groups come before
    smaller groups of the same kind. Trials without a record are left out.
    """
    if limit < 0:
        raise InvalidInputError("limit", f"{limit} is negative", "Use a number of at least 0")
    by_key = {trial.key: trial for trial in diagnosis.trials if trial.record is not None}
    groups: dict[tuple[str, str, str], list[TrialDiagnosis]] = defaultdict(list)
    for trial in by_key.values():
        if trial.variation is not None:
            groups[trial.task, trial.variation, trial.label.value].append(trial)
    order = sorted(groups.items(), key=lambda item: (_KIND_RANK[item[1][0].kind], -len(item[1]), item[0]))
    most = None if repeats else 1
    rounds = zip_longest(*(_representative_first(trials, by_key)[:most] for _, trials in order))
    chosen = [trial for one_each in rounds for trial in one_each if trial is not None]
    return [_showing(diagnosis.policy, trial, by_key) for trial in chosen[:limit]]


def failures_in_question(diagnosis: RunDiagnosis) -> list[TrialDiagnosis]:
    """Return all failed variation trials that have a record.

    For each of these trials, the report draws the path of the gripper on the initial image.
    """
    varied = [t for t in diagnosis.counted_trials if t.variation is not None and t.record is not None]
    return [t for t in varied if not t.success]


def _representative_first(trials: list[TrialDiagnosis], by_key: dict[str, TrialDiagnosis]) -> list[TrialDiagnosis]:
    """Sort trials so that the most representative trial comes first.

    The training twin of a trial is the training trial with the same seed. A trial ranks highest if its training twin
    succeeded, lower if the training twin failed, and lowest if there is no training twin. Among the trials with the
    highest rank, the one in which the evidence for the label begins at the median time comes first. All other trials
    are sorted by rank and then by seed.
    """

    def twin_rank(trial: TrialDiagnosis) -> int:
        twin = by_key.get(trial.twin_key or "")
        return 2 if twin is None else int(not twin.success)

    best = min(twin_rank(trial) for trial in trials)
    among = sorted((t for t in trials if twin_rank(t) == best), key=lambda t: (t.evidence.start_s, t.seed))
    first = among[(len(among) - 1) // 2]
    return [first, *sorted((t for t in trials if t is not first), key=lambda t: (twin_rank(t), t.seed))]


def _showing(policy: str, trial: TrialDiagnosis, by_key: dict[str, TrialDiagnosis]) -> Showing:
    """Choose the moments of a trial and of its training twin (the training trial with the same seed) to show.

    The moments of the trial are around its evidence. The moments of the training twin are around the corresponding step
    of the task.
    """
    start, end = trial.evidence.start_s, max(trial.evidence.start_s, trial.evidence.end_s)
    grasps = trial.kind is not Kind.NONE and any(attempt.start_s == start for attempt in trial.attempts)
    moments = _moments(start, end, trial.duration_s, "attempt" if grasps else "evidence")
    twin, shown = by_key.get(trial.twin_key or ""), dict[float, str]()
    if twin is not None:
        shown = _moments(*_same_step(trial, twin))
    key = None if twin is None else twin.key
    return Showing(
        policy,
        trial.key,
        key,
        tuple(moments),
        tuple(moments.values()),
        tuple(shown),
        tuple(shown.values()),
        (start, end),
    )


def _same_step(trial: TrialDiagnosis, twin: TrialDiagnosis) -> tuple[float, float, float, str]:
    """Return the interval in a training twin that corresponds to the evidence of a trial.

    The training twin is the training trial with the same seed.

    The interval is the twin's grasp of the object that the policy should have tried to grasp in the trial. If the twin
    has no such grasp, the grasp attempts are counted instead: if the evidence is about the n-th object in the trial,
    the interval is the grasp of the n-th object in the twin.

    Returns:
        Start and end of the interval [s], duration of the twin [s], and caption.
    """
    if not twin.attempts:
        return twin.evidence.start_s, max(twin.evidence.start_s, twin.evidence.end_s), twin.duration_s, "evidence"
    start = trial.evidence.start_s
    last = next((a for a in reversed(trial.attempts) if a.start_s <= start), None)
    firsts = _first_grasps(twin.attempts)
    chosen = last is not None and last.start_s == start
    about = trial.evidence.objects[0] if trial.evidence.objects else None
    if last is not None and about in firsts and (last.result != "distractor" if chosen else last.object == about):
        same, delay = firsts[about], start - last.start_s
        if delay:
            return same.start_s + delay, same.start_s + delay, twin.duration_s, "same step"
    else:
        before = len(_first_grasps([a for a in trial.attempts if a.start_s < start]))
        grasps = list(firsts.values()) or list(twin.attempts)
        same = grasps[min(before, len(grasps) - 1)]
    return same.start_s, max(same.start_s, same.end_s), twin.duration_s, "attempt"


def _first_grasps(attempts: Iterable[Attempt]) -> dict[str, Attempt]:
    """Return the first grasp attempt at each object, in order of time."""
    firsts: dict[str, Attempt] = {}
    for attempt in attempts:
        if attempt.object is not None:
            firsts.setdefault(attempt.object, attempt)
    return firsts


def _moments(start_s: float, end_s: float, duration_s: float, what: str) -> dict[float, str]:
    """Return up to five moments with their captions. Moments that are nearly equal are merged."""
    wanted: Iterable[tuple[float, str]] = (
        (start_s, what),
        (0.0, "start"),
        (duration_s, "end"),
        (end_s if end_s - start_s >= LEAD_S else end_s + LEAD_S, "after"),
        (start_s - LEAD_S if start_s > 2 * LEAD_S else start_s / 2, "reach" if what == "attempt" else "before"),
    )
    chosen: dict[float, str] = {}
    for time_s, caption in wanted:
        moment = round(min(max(time_s, 0.0), duration_s), 2)
        if all(abs(moment - other) >= 0.05 for other in chosen):
            chosen[moment] = caption
    return dict(sorted(chosen.items()))
