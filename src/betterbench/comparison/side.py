"""Sides: the runs that are compared, each with its diagnosis and the conventions it was made under."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from betterbench.diagnosis import RunDiagnosis, diagnose_run
from betterbench.errors import InvalidInputError
from betterbench.recording import RunFolder, run_names, told_apart
from betterbench.tasks import TrialId

_PLAIN = ("suite_version", "package_version", "robot", "action_space", "control_rate_hz", "looks")
"""Conventions that stand in a plan as one value."""


@dataclass(frozen=True, slots=True)
class Side:
    """One run in a comparison.

    Attributes:
        name: What it is called: the name that its policy declared, with the name of its folder where two are alike.
        unfinished: Keys of planned trials that neither ended nor broke down yet.
        conventions: Versions and conventions by name, of its plan and of its records.
    """

    name: str
    diagnosis: RunDiagnosis
    path: str = ""
    unfinished: frozenset[str] = frozenset()
    conventions: dict[str, str] = field(default_factory=dict)


def load_sides(paths: Sequence[Path], *, names: Sequence[str] = (), allow_mixed: bool = False) -> tuple[Side, ...]:
    """Read and diagnose the runs of a comparison, which are called by ``names`` if these are given.

    Raises:
        InvalidInputError: If fewer than two runs are given, or one of them twice, or the names do not fit.
        RecordError: If a run or a record cannot be read.
        RunConflictError: If a run mixes versions or engines and that is not allowed.
    """
    if len(paths) < 2:
        raise InvalidInputError("runs", f"{len(paths)} is not enough to compare", "Name at least two run folders")
    places = [path.resolve() for path in paths]
    twice = next((paths[i] for i, place in enumerate(places) if place in places[:i]), None)
    if twice is not None:
        raise InvalidInputError("runs", f"{twice} is given twice", "Name every run once")
    runs = [RunFolder.open(path) for path in paths]
    called = run_names(runs, names)
    return tuple(_load(run, name, allow_mixed=allow_mixed) for run, name in zip(runs, called, strict=True))


def name_sides(sides: Sequence[Side]) -> tuple[Side, ...]:
    """Return the sides with names that tell them apart: a folder is added where two runs are of one policy."""
    names = told_apart([s.diagnosis.policy for s in sides], [s.path for s in sides])
    return tuple(replace(s, name=name) for s, name in zip(sides, names, strict=True))


def side_conventions(plan: Any, versions: dict[str, str]) -> dict[str, str]:  # noqa: ANN401 -- JSON of a file
    """Return the conventions that a plan and the records made under it name.

    Args:
        plan: JSON form of a plan; what it lacks is left out.
        versions: Versions found in the records, which count where both name one.
    """
    found = {name: _shown(plan[name]) for name in _PLAIN if name in plan}
    for prefix, group in (("engine", "engine"), ("task_version", "task_versions")):
        listed = plan.get(group)
        if isinstance(listed, dict):
            found |= {f"{prefix}:{name}": _shown(value) for name, value in listed.items()}
    return found | versions


def _load(run: RunFolder, name: str, *, allow_mixed: bool) -> Side:
    diagnosis = diagnose_run(run, allow_mixed=allow_mixed, whole=True)
    ended = {str(TrialId(e.task, e.variation or e.condition, e.seed)) for e in run.entries()}
    unfinished = frozenset(t.key for t in diagnosis.trials if t.record is None and t.key not in ended)
    return Side(name, diagnosis, str(run.path), unfinished, side_conventions(run.plan, diagnosis.versions))


def _shown(value: object) -> str:
    return f"{value:g}" if isinstance(value, int | float) and not isinstance(value, bool) else str(value)
