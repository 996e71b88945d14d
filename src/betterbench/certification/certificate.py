"""Certificate data: the result of each clause and the margins of each trial, summaries per condition, and JSON form."""

from __future__ import annotations

import functools
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from pydantic import TypeAdapter

from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.interface.actions import USUAL_ROBOT
from betterbench.json_form import read_form, sealed_form, strict_form
from betterbench.statistics import Rate
from betterbench.tasks import Expected, Looks, TrialId
from betterbench.tasks.interventions import resolve_condition

SCHEMA_VERSION = 1

CLAUSES: Mapping[str, str] = {
    "a": "the expert solves it within the step limit",
    "b": "every pick, placement and drawer move of the expert is inside the training distribution",
    "c": "the initial state is at rest and free of penetration",
    "d": "every requested object can be reached without a collision",
    "e": "the scene matches the premise of the instruction",
}
"""The five clauses of a certificate.

Together they show that every trial can be solved with motions known from training (law 2 of the benchmark).
"""


@strict_form
@dataclass(frozen=True, slots=True)
class Clause:
    """Result of checking one clause of a certificate: whether the clause holds, and an optional reason or remark."""

    passed: bool
    text: str = ""


@strict_form
@dataclass(frozen=True, slots=True)
class TrialCertificate:
    """Results of examining one trial.

    Attributes:
        condition: Name of the variation or of the training condition.
        clauses: Result for each clause of the certificate, by its letter "a" to "e".
        steps: Number of control steps in the expert's episode.
        penetration_mm: Depth of the deepest penetration between an object and another body in the initial state [mm],
            or 0 if there is none.
        drift_mm: Largest distance that an untouched object moves in the first 0.2 s [mm].
        joint_margin_rad: Smallest distance between an arm joint and its limit in the grasps planned for clause (d)
            [rad]. None if no grasp was planned.
        support_slack_mm: Smallest distance from the position of a pick or target to the border of the region in which
            this position varies in training [mm]. None if the expert touched nothing.
        watched: Whether the correct behavior is to touch nothing. If so, every episode runs until the step limit.
        primitives: Descriptions of the motion primitives in the expert's episode.
        expert_s: Wall-clock time of the expert's episode [s].
        total_s: Wall-clock time of the complete examination [s].
    """

    task: str
    condition: str
    training: bool
    seed: int
    clauses: Mapping[str, Clause]
    steps: int
    step_limit: int
    penetration_mm: float
    drift_mm: float
    joint_margin_rad: float | None
    support_slack_mm: float | None
    watched: bool = False
    primitives: tuple[str, ...] = ()
    expert_s: float = 0.0
    total_s: float = 0.0

    def __post_init__(self) -> None:
        """Raise ValueError if a clause is missing."""
        if set(self.clauses) != set(CLAUSES):
            msg = f"expected the clauses {sorted(CLAUSES)}, got {sorted(self.clauses)}"
            raise ValueError(msg)

    @property
    def passed(self) -> bool:
        """Whether all clauses hold."""
        return all(c.passed for c in self.clauses.values())

    @property
    def failed(self) -> tuple[str, ...]:
        """Letters of the clauses that do not hold."""
        return tuple(letter for letter in CLAUSES if not self.clauses[letter].passed)

    @property
    def key(self) -> TrialId:
        """ID of the trial."""
        return TrialId(self.task, self.condition, self.seed)


@strict_form
@dataclass(frozen=True, slots=True)
class CertificateVersions:
    """Versions with which a certificate was made. The certificate is valid only for these versions.

    The version of the suite determines the random streams. ``looks`` is the appearance of objects and rooms in the
    trials that were examined ("seen" or "unseen"), and ``robot`` is the name of the robot.
    """

    package: str
    suite: str
    engine: str
    tasks: Mapping[str, int]
    looks: Looks = "seen"
    robot: str = USUAL_ROBOT

    @property
    def words(self) -> str:
        """All versions as one text, for use in messages."""
        tasks = "".join(f", {name} {number}" for name, number in self.tasks.items())
        versions = f"betterbench {self.package}, suite {self.suite}, MuJoCo {self.engine}{tasks}"
        return f"{versions}, {self.looks} looks, robot {self.robot}"


@strict_form
@dataclass(frozen=True, slots=True)
class Certificate:
    """Complete certificate with all examined trials.

    Attributes:
        platform: Machine and operating system on which the trials were examined.
        trials: All trials, in the order of the plan.
        wall_s: Wall-clock time of all sessions together [s].
        workers: Number of worker processes in the last session.
    """

    versions: CertificateVersions
    platform: str
    trials: tuple[TrialCertificate, ...]
    wall_s: float
    workers: int
    schema_version: Literal[1] = 1
    form: Literal["betterbench certificate"] = "betterbench certificate"

    @property
    def seeds(self) -> tuple[int, ...]:
        """All seeds of the trials, sorted."""
        return tuple(sorted({t.seed for t in self.trials}))

    @property
    def passed(self) -> bool:
        """Whether all clauses hold for all trials."""
        return all(t.passed for t in self.trials)

    @property
    def ambiguous(self) -> tuple[TrialCertificate, ...]:
        """Trials whose instruction makes a false assumption about the scene, so that no outcome is right or wrong."""
        return tuple(t for t in self.trials if _is_ambiguous(t.task, t.condition))

    @property
    def solved(self) -> Rate:
        """Fraction of the trials that the expert solved.

        Ambiguous trials, which have no right outcome, do not count.
        """
        rest = [t for t in self.trials if not _is_ambiguous(t.task, t.condition)]
        return Rate(sum(t.clauses["a"].passed for t in rest), len(rest))

    @property
    def expert_s(self) -> float:
        """Mean wall-clock time that the expert needed per trial [s]."""
        return sum(t.expert_s for t in self.trials) / len(self.trials) if self.trials else 0.0

    def to_json(self) -> dict[str, Any]:
        """Return the certificate as a JSON-serializable dict.

        For human readers, the dict includes a summary per condition, which :meth:`from_json` ignores.
        """
        form = asdict(self)
        form["seeds"] = seed_ranges(self.seeds)
        form["clause_texts"] = dict(CLAUSES)
        form["summary"] = [asdict(s) for s in summaries(self.trials)]
        form["expert_s_per_trial"] = round(self.expert_s, 3)
        return form

    def sealed_json(self) -> dict[str, Any]:
        """Return the content of the certificate file: JSON with the version of the file format and a checksum."""
        return sealed_form({"version": 2, **self.to_json()})

    @classmethod
    def from_json(cls, form: object, *, where: str = "certificate") -> Certificate:
        """Parse a certificate given as JSON.

        Raises InvalidInputError if the JSON value is not a certificate of this schema version.
        """
        if not isinstance(form, dict) or form.get("form") != "betterbench certificate":
            raise InvalidInputError(
                where, "this is not a certificate", "Use a certificate.json written by better certify"
            )
        derived = ("seeds", "clause_texts", "summary", "expert_s_per_trial")
        form = {name: value for name, value in form.items() if name not in derived}
        return read_form(_CERTIFICATE, form, where=where, cure="Create it again with better certify")


_CERTIFICATE = TypeAdapter(Certificate)


@functools.cache
def _is_ambiguous(task: str, condition: str) -> bool:
    """Return whether the instruction of a condition makes a false assumption about the scene.

    Return False for an unknown condition.
    """
    try:
        return resolve_condition(task, condition).condition.expected is Expected.AMBIGUOUS
    except UnknownNameError:
        return False


@dataclass(frozen=True, slots=True)
class Summary:
    """Summary of the trials of one condition, with the smallest margins.

    Attributes:
        n: Number of trials.
        passed: Number of trials in which all clauses hold.
        clauses: Number of trials in which the clause holds, for each clause.
        steps_share: Largest number of steps in which the expert solved a trial, as a fraction of the step limit. None
            if the expert solved no trial, or if the episodes always run until the limit.
        notes: Remarks on clauses, without duplicates. If a clause fails in some trials, the remark contains the seed of
            one of them.
    """

    task: str
    condition: str
    training: bool
    n: int
    passed: int
    clauses: dict[str, int]
    steps_share: float | None
    penetration_mm: float
    drift_mm: float
    joint_margin_rad: float | None
    support_slack_mm: float | None
    expert_s: float
    notes: tuple[str, ...]


def summaries(trials: Iterable[TrialCertificate]) -> tuple[Summary, ...]:
    """Return one summary per condition, in the order in which the conditions first appear."""
    groups: dict[tuple[str, str], list[TrialCertificate]] = {}
    for t in trials:
        groups.setdefault((t.task, t.condition), []).append(t)
    return tuple(_summary(group) for group in groups.values())


def _summary(group: list[TrialCertificate]) -> Summary:
    first = group[0]
    solved = [t.steps / t.step_limit for t in group if t.clauses["a"].passed and not t.watched]
    margins = [t.joint_margin_rad for t in group if t.joint_margin_rad is not None]
    slacks = [t.support_slack_mm for t in group if t.support_slack_mm is not None]
    notes: dict[tuple[str, str, bool], int] = {}
    for t in group:
        for letter, clause in t.clauses.items():
            if clause.text:
                notes.setdefault((letter, clause.text, clause.passed), t.seed)
    return Summary(
        task=first.task,
        condition=first.condition,
        training=first.training,
        n=len(group),
        passed=sum(t.passed for t in group),
        clauses={letter: sum(t.clauses[letter].passed for t in group) for letter in CLAUSES},
        steps_share=round(max(solved), 4) if solved else None,
        penetration_mm=max(t.penetration_mm for t in group),
        drift_mm=max(t.drift_mm for t in group),
        joint_margin_rad=min(margins, default=None),
        support_slack_mm=min(slacks, default=None),
        expert_s=round(sum(t.expert_s for t in group) / len(group), 3),
        notes=tuple(
            f"({letter}) {text}" if ok else f"({letter}) fails, seed {seed}: {text}"
            for (letter, text, ok), seed in notes.items()
        ),
    )


def seed_ranges(seeds: Iterable[int]) -> str:
    """Format seeds as ranges, for example "0-19,23"."""
    ranges: list[list[int]] = []
    for seed in sorted(set(seeds)):
        if ranges and seed == ranges[-1][1] + 1:
            ranges[-1][1] = seed
        else:
            ranges.append([seed, seed])
    return ",".join(str(a) if a == b else f"{a}-{b}" for a, b in ranges)


def certificate_path(out: Path) -> Path:
    """Return the path of the certificate file in a folder."""
    return out / "certificate.json"
