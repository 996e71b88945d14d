"""Matching of trials across runs, with notes about the trials that are left out."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from betterbench.comparison.side import Side
from betterbench.diagnosis import Kind, TrialDiagnosis
from betterbench.errors import InvalidInputError, RunConflictError
from betterbench.wording import plural

_DECISIVE = ("suite_version", "schema_version", "task_version:", "engine:", "robot", "control_rate_hz", "looks")
"""Conventions that define a trial. Results under different conventions of this kind cannot be compared."""

_CAMERAS = ("camera_preset", "render_quality")
"""Conventions that are ignored if a policy uses no images."""


@dataclass(frozen=True, slots=True)
class Matching:
    """Trials of several runs that are compared.

    Attributes:
        paired: Whether all runs have the same trials. If not, the runs have only conditions in common.
        trials: Trials of each run, in the order of the plan. If paired, all runs have the same keys in the same order.
        left_out: Number of trials of each run that are left out.
        notes: Notes on differences between the runs and on the trials that are left out.
    """

    paired: bool
    trials: tuple[tuple[TrialDiagnosis, ...], ...]
    left_out: tuple[int, ...]
    notes: tuple[str, ...]


def match_sides(sides: Sequence[Side], *, allow_mixed: bool = False) -> Matching:
    """Return the trials that all runs contain, matched by task, variation or condition, and seed.

    For a run with ``--until-decided``, only the trials of the first round are used, because the choice of all later
    trials depended on outcomes. Ambiguous trials are left out.

    Raises:
        RunConflictError: If versions, engines, robots or control rates differ and ``allow_mixed`` is False.
        InvalidInputError: If the runs have no condition in common.
    """
    notes = list(_clashes(sides, allow_mixed=allow_mixed))
    notes += [note for side in sides for note in _until_decided(side)]
    notes += [note for side in sides for note in _ambiguous(side)]
    sides = [replace(side, diagnosis=side.diagnosis.even()) for side in sides]
    by_key = [{t.key: t for t in s.diagnosis.trials} for s in sides]
    common = [key for key in by_key[0] if all(key in known for known in by_key[1:])]
    if common:
        trials = tuple(tuple(known[key] for key in common) for known in by_key)
    else:
        trials = _same_conditions(sides)
        notes.append(_unpaired_note(sides))
    left_out = tuple(len(s.diagnosis.trials) - len(kept) for s, kept in zip(sides, trials, strict=True))
    for side, kept, missing in zip(sides, trials, left_out, strict=True):
        if missing:
            other = "the other run does not plan" if len(sides) == 2 else "not every other run plans"
            what = "them" if common else "their conditions"
            notes.append(f"{missing} of {len(kept) + missing} trials of {side.name} are left out: {other} {what}.")
    for side, kept in zip(sides, trials, strict=True):
        notes += _broken(side, kept)
    return Matching(bool(common), trials, left_out, tuple(notes))


def _same_conditions(sides: Sequence[Side]) -> tuple[tuple[TrialDiagnosis, ...], ...]:
    """Return the trials of each run in the conditions that all runs have in common.

    Raises:
        InvalidInputError: If the runs have no condition in common.
    """
    names = [{_condition(t) for t in s.diagnosis.trials} for s in sides]
    shared = set.intersection(*names)
    if not shared:
        problem = "the runs have no condition in common"
        raise InvalidInputError("runs", problem, "Run the policies with the same --tasks, --variations and --seed")
    return tuple(tuple(t for t in s.diagnosis.trials if _condition(t) in shared) for s in sides)


def _condition(trial: TrialDiagnosis) -> tuple[str, str]:
    return trial.task, trial.variation or trial.condition


def _unpaired_note(sides: Sequence[Side]) -> str:
    text = (
        "The runs share no seed, so their trials are compared as independent ones, which is less sensitive. "
        "Run the policies with the same --seed to compare them trial by trial."
    )
    keys = [{t.key for t in s.diagnosis.trials} for s in sides]
    meeting = [
        f"{sides[i].name} and {sides[j].name}"
        for i, j in itertools.combinations(range(len(sides)), 2)
        if keys[i] & keys[j]
    ]
    if meeting:
        return f"{text} These pairs of runs share trials: {', '.join(meeting)}."
    return text


def _clashes(sides: Sequence[Side], *, allow_mixed: bool) -> Iterator[str]:
    """Yield a note for every convention (such as a version, engine or control rate) in which two runs differ.

    Raises:
        RunConflictError: If runs that differ in one of these conventions cannot be compared and ``allow_mixed`` is
            False.
    """
    for name in sorted(set().union(*(s.conventions for s in sides))):
        values = {s.name: s.conventions[name] for s in sides if name in s.conventions}
        if name in _CAMERAS:
            values = {side: value for side, value in values.items() if value != "None"}
        if len(set(values.values())) < 2:
            continue
        listed = ", ".join(f"{value!r} in {side}" for side, value in values.items())
        if name.startswith(_DECISIVE) and not allow_mixed:
            raise RunConflictError(
                f"{name} differs: {listed}. Repeat one of the runs under the same conventions, "
                "or use --allow-mixed and interpret the results with care."
            )
        yield f"{name} differs: {listed}."


def _until_decided(side: Side) -> Iterator[str]:
    """Yield a note about the trials that are left out of a run with ``--until-decided``."""
    decided = side.diagnosis.until_decided
    if decided is not None:
        first = plural(len(decided.first_seeds), "seed")
        chosen = plural(len(side.diagnosis.trials) - len(side.diagnosis.shown_trials), "trial")
        yield (
            f"{side.name} ran with --until-decided: only the trials of its first {first} are compared; {chosen} "
            f"whose selection depended on outcomes are left out."
        )


def _ambiguous(side: Side) -> Iterator[str]:
    """Yield a note about the ambiguous trials of a run."""
    trials = [t for t in side.diagnosis.shown_trials if t.ambiguous]
    if trials:
        yield f"{plural(len(trials), 'ambiguous trial')} of {side.name} cannot be right or wrong and are not compared."


def _broken(side: Side, trials: Sequence[TrialDiagnosis]) -> Iterator[str]:
    """Yield notes about the trials of a run that count as failures because they have no usable record."""
    unfinished = sum(t.key in side.unfinished for t in trials)
    lost = sum(t.record is None and t.key not in side.unfinished for t in trials)
    stopped = sum(t.kind is Kind.SYSTEM and t.record is not None for t in trials)
    n = len(trials)
    if unfinished:
        yield f"{unfinished}/{n} trials of {side.name} are not finished and count as failures; continue the run."
    if lost:
        yield f"{lost}/{n} trials of {side.name} have no record because of an error and count as failures."
    if stopped:
        yield f"{stopped}/{n} trials of {side.name} ended with a policy error and count as failures."
