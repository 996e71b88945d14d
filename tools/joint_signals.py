"""Compare signals derived from joint states alone with the simulator state of the same trials.

The joint states, openings and commands of a simulated run of the SO-101 are read as if a real arm had recorded them,
but without the load of the motors. Encoder noise, another rate or the other unit can be simulated. The signals of
``betterbench.real.signals`` are compared with held objects, finger contacts and the diagnosis of the record.

Example:
    python tools/joint_signals.py runs/zoo_clumsy runs/zoo_phase --noise
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from betterbench.diagnosis import TrialDiagnosis, diagnose_run
from betterbench.diagnosis.analysis.approaches import to_and_fro
from betterbench.diagnosis.analysis.episode_analysis import analyze_episode
from betterbench.diagnosis.analysis.paths import runs_of
from betterbench.diagnosis.analysis.trace import trace_of
from betterbench.diagnosis.thresholds import JAW_FULLY_SHUT
from betterbench.interface.actions import SO101_DEGREES
from betterbench.real.labels import Judged, Setting, label_of
from betterbench.real.plan import ACTION_SPACES, Unit
from betterbench.real.record import Samples
from betterbench.real.signals import Closing, Grip, JointSignals, JointTrack, signals_of
from betterbench.records import Record, RunFolder, read_record
from betterbench.sim.robots.spec import robot
from betterbench.tasks import training_distribution_of
from betterbench.tasks.interventions.resolve import resolve_condition

ENCODER_DEGREES = 360.0 / 4096
"""Resolution of the servo's encoder."""
ENCODER_PERCENT = 100.0 * ENCODER_DEGREES / 110.0
"""The same for the gripper, whose travel is 110 degrees."""
EMPTY_M = 0.026
"""Opening into which no object of the fruit basket fits [m]."""
RESTS = ((3.0, 0.005), (8.0, 0.03))
"""Time at the end [s] and largest distance from the last position [m] of an arm at rest: still, or trembling."""
LEAST_HELD_S = 0.25
"""Shortest hold that is compared [s]. An object that slides out of the closing jaw may be held for a control step."""


def samples_of(record: Record, *, unit: Unit = "degrees", rate_hz: float = 20.0, noise: int | None = None) -> Samples:
    """Return the joint states of a simulated record as a real arm would record them.

    Args:
        record: Record of the SO-101, in any action space.
        unit: Unit of the samples.
        rate_hz: Rate of the samples; states between control steps are interpolated.
        noise: Seed of noise of one encoder step in each state, or None for no noise and no rounding.
    """
    jaw, end = robot("so101").jaw, record.time[-1]
    at = np.arange(int(end * rate_hz) + 1) / rate_hz
    opening = np.array([100.0 * jaw.share_at(width) for width in record.finger_width])
    degrees = np.degrees(record.joint_positions)
    state = np.stack([np.interp(at, record.time, c) for c in (*degrees.T, opening)], axis=1)
    # The command of a row is what the servos get until the next one.
    reference = np.vstack([record.ctrl[1:], record.ctrl[-1:]])
    grip = [100.0 * jaw.share_at(jaw.width_at_control(value)) for value in reference[:, -1]]
    asked = np.column_stack((np.vstack([degrees[1:], degrees[-1:]]), grip))
    command = asked[np.minimum(np.searchsorted(record.time, at, side="right") - 1, len(asked) - 1)]
    if noise is not None:
        rng, step = np.random.default_rng(noise), np.array([ENCODER_DEGREES] * 5 + [ENCODER_PERCENT])
        state = np.round(state / step + rng.uniform(-1.0, 1.0, state.shape)) * step
    if unit != "degrees":
        factor = np.array(SO101_DEGREES.scale[:5]) / np.array(ACTION_SPACES[unit].scale[:5])
        state[:, :5] *= factor
        command = np.concatenate((command[:, :5] * factor, command[:, 5:]), axis=1)
    load, no = np.full(state.shape, np.nan), np.zeros(len(at), dtype=np.bool_)
    return Samples(at, state, command, command.copy(), load, no, no.copy())


Spans = tuple[tuple[float, float], ...]
"""Times of first and last rows [s]."""


@dataclass(frozen=True, slots=True)
class Truth:
    """Ground truth about one trial, from the simulator state.

    Attributes:
        held: Times at which an object is held, except those in ``shut``.
        shut: As ``held``, but with the opening at ``jaw_fully_shut`` or less throughout, as if the jaw were empty. The
            jaw holds an object by its tip or edge, which joint states cannot show.
        touched: Times at which a finger touches any object.
        empty: Times at which the gripper closes to less than the width of any object without touching one.
        rests: Whether tool and fingers are at rest at the end (:data:`RESTS`).
        to_and_fro: Whether the simulated diagnosis finds motion back and forth until the end.
    """

    held: Spans
    shut: Spans
    touched: Spans
    empty: Spans
    rests: bool
    to_and_fro: bool


def truth_of(record: Record) -> Truth:
    """Return the ground truth about a recorded trial."""
    things, fingers = {o.name for o in record.metadata.scene.objects}, {"left_finger", "right_finger"}
    touched = np.array(
        [
            any(
                (a in fingers and b in things) or (b in fingers and a in things)
                for a, b, _ in record.state(row).contacts
            )
            for row in range(len(record.time))
        ]
    )
    closed = record.finger_width <= robot("so101").jaw.width_at_share(JAW_FULLY_SHUT / 100.0)
    holds = list(runs_of(record.held >= 0))
    held = _spans(record, [(a, b) for a, b in holds if not closed[a:b].all()])
    shut = _spans(record, [(a, b) for a, b in holds if closed[a:b].all()])
    touching, narrow = _spans(record, runs_of(touched)), _spans(record, runs_of(record.finger_width <= EMPTY_M))
    rests = any(_stays(record, seconds, within_m) for seconds, within_m in RESTS)
    resolved = resolve_condition(record.metadata.task, record.metadata.variation or record.metadata.condition)
    trace = trace_of(record, resolved.condition, step_limit=resolved.task.step_limit(resolved.condition))
    episode = analyze_episode(trace, resolved.condition, training_distribution_of(resolved.task), state=record.state)
    fro = not rests and to_and_fro(trace, episode.idle_from) is not None
    empty = tuple(span for span in narrow if not any(a <= span[1] and b >= span[0] for a, b in touching))
    return Truth(held, shut, touching, empty, rests, fro)


def _spans(record: Record, runs: Iterable[tuple[int, int]]) -> Spans:
    """Return the times of first and last rows of runs of rows."""
    return tuple((float(record.time[a]), float(record.time[b - 1])) for a, b in runs)


def _stays(record: Record, seconds: float, within_m: float) -> bool:
    """Return whether tool and fingers stay within a distance [m] during the last seconds."""
    last = record.time >= record.time[-1] - seconds
    away = np.linalg.norm(record.ee_position[last] - record.ee_position[-1], axis=1)
    return bool(record.time[-1] >= seconds and away.max() < within_m and np.ptp(record.finger_width[last]) < 0.001)


def _overlaps(closing: Closing, spans: Spans) -> bool:
    """Return whether a span overlaps the time from the closing until one second after it, or until the opening."""
    end = min(closing.let_go_s or np.inf, closing.end_s + 1.0)
    return any(a <= end and b >= closing.start_s for a, b in spans)


def compare(signals: JointSignals, truth: Truth) -> Iterator[tuple[str, bool]]:
    """Yield each comparison, and whether signal and truth agree."""
    held, shut = (tuple(s for s in spans if s[1] - s[0] >= LEAST_HELD_S) for spans in (truth.held, truth.shut))
    for span in held:
        yield (
            "object held: a closing on an object is found",
            any(c.holds and c.start_s <= span[1] and span[0] <= (c.let_go_s or np.inf) for c in signals.closings),
        )
    for span in shut:
        yield (
            "object held in a fully shut jaw: a closing on nothing is found",
            any(c.grip is Grip.NOTHING and _overlaps(c, (span,)) for c in signals.closings),
        )
    for span in truth.empty:
        yield (
            "jaw shut on nothing: a closing on nothing is found",
            any(c.grip is Grip.NOTHING and _overlaps(c, (span,)) for c in signals.closings),
        )
    for closing in signals.closings:
        if closing.holds:
            yield "closing on an object found: the fingers touch one", _overlaps(closing, truth.touched)
            if closing.let_go_s is not None and closing.lost_s is None:
                ends = [b for a, b in truth.touched if a <= closing.let_go_s and b >= closing.end_s]
                yield (
                    "release found: within 0.5 s of the last touch",
                    any(abs(b - closing.let_go_s) <= 0.5 for b in ends),
                )
        else:
            yield f"closing on {closing.grip.value} found: no object held", not _overlaps(closing, held)
    for what, found, true in (
        ("freeze", signals.freeze is not None, truth.rests),
        ("back and forth", signals.to_and_fro is not None, truth.to_and_fro),
    ):
        yield f"{what}: {'true, found' if true else 'false, not found'}", found == true


def judge_of(record: Record, trial: TrialDiagnosis) -> str:
    """Return the outcome that a judge with full knowledge of the trial would enter, by the documented definitions."""
    metadata = record.metadata
    condition = resolve_condition(metadata.task, metadata.variation or metadata.condition).condition
    asked = {n for goal in condition.instruction.subgoals for n in condition.resolve(goal.reference)}
    tried = [a.object for a in trial.attempts]
    others = {name for name in tried if name is not None and name not in asked}
    there = [condition.resolve(goal.reference) != () for goal in condition.instruction.subgoals]
    if all(there) and bool(record.subgoals[-1].all()) and not others:
        return "done"
    if bool((record.subgoals[-1] & ~record.subgoals[0]).any()) and not record.subgoals[-1].all():
        return "part"
    last = record.time >= record.time[-1] - 1.0
    if not tried and np.linalg.norm(record.ee_position[last] - record.ee_position[-1], axis=1).max() < 0.02:
        return "froze"
    if tried and tried[-1] is None:
        return "air_grasp"
    if trial.evidence.rule == "to_and_fro":
        return "oscillated"
    if others:
        return "wrong_object"
    if any(name in condition.layout for name in tried):
        return "missed"
    return "undid" if tried else "other"


def labels_of(folder: Path, *, noise: int) -> Iterator[tuple[str, str, str, str]]:
    """Yield the trial, the outcome of a perfect judge, the label of the simulated diagnosis, and that of joints."""
    for trial in diagnose_run(RunFolder.open(folder), whole=True).trials:
        if trial.record is None:
            continue
        record = read_record(folder / trial.record)
        signals = signals_of(JointTrack.of(samples_of(record, noise=noise), unit="degrees", rate_hz=20.0))
        outcome = judge_of(record, trial)
        judged = Judged(outcome, "", {"perfect": outcome}, None, ("no definition fits",))
        found = label_of(Setting.of(trial.task, trial.variation or trial.condition), signals, judged)
        yield trial.key, outcome, trial.label.value, found.name + (" !" if found.contradiction else "")


def main() -> None:
    """Print how often signals and ground truth agree."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", type=Path, nargs="+")
    parser.add_argument("--noise", action="store_true", help="noise of one encoder step")
    parser.add_argument("--rate", type=float, default=20.0)
    parser.add_argument("--unit", default="degrees", choices=sorted(ACTION_SPACES))
    parser.add_argument("--verbose", action="store_true")
    parser.add_argument("--labels", action="store_true", help="labels with a perfect judge instead of signals")
    given = parser.parse_args()
    if given.labels:
        crossed = Counter(row[1:] for folder in given.runs for row in labels_of(folder, noise=0))
        same = sum(count for (_, a, b), count in crossed.items() if a == b)
        print(f"{same} of {sum(crossed.values())} labels are those of the simulated diagnosis")
        for (outcome, simulated, label), count in sorted(crossed.items()):
            print(f"{count:5d}  judge: {outcome:13} simulated: {simulated:28} joints and judge: {label}")
        return
    found: Counter[tuple[str, bool]] = Counter()
    trials = 0
    for folder in given.runs:
        for path in sorted((folder / "records").rglob("*.parquet")):
            record, trials = read_record(path), trials + 1
            samples = samples_of(record, unit=given.unit, rate_hz=given.rate, noise=trials if given.noise else None)
            signals = signals_of(JointTrack.of(samples, unit=given.unit, rate_hz=given.rate))
            truth = truth_of(record)
            for what, agree in compare(signals, truth):
                found[what, agree] += 1
                if given.verbose and not agree:
                    print(path, what, *signals.closings, signals.freeze, signals.to_and_fro, truth, sep="\n    ")
    print(f"{trials} trials")
    for what in sorted({what for what, _ in found}):
        print(f"{found[what, True]:5d} of {found[what, True] + found[what, False]:5d}  {what}")


if __name__ == "__main__":
    main()
