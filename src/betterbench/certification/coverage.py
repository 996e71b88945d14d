"""Coverage of a certificate: the list of certified trials, in a compact form that is shipped with the suite."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any, Literal, NamedTuple

from pydantic import TypeAdapter

from betterbench.certification.certificate import Certificate, CertificateVersions, seed_ranges
from betterbench.errors import InvalidInputError, one_line
from betterbench.interface.actions import USUAL_ROBOT
from betterbench.json_form import form_errors, open_seal, read_bounded, read_form, strict_form
from betterbench.tasks import Looks, TrialId, built_in_suite
from betterbench.tasks.demonstrated import minor_version
from betterbench.tasks.suite_folder import CERTIFICATE
from betterbench.tasks.user_files import options_for, suite_file

SOLVED_SHARE = 0.95
"""Minimum fraction of a condition's trials that the expert must solve.

If the expert reaches this fraction, the unsolved trials are also certified, because these failures are assumed to be
failures of the expert, not of the scene. These trials are listed separately. Clauses (b) to (e) must hold in every
trial.
"""
MOST_SEEDS = 1_000_000
"""Largest seed that is allowed in a range.

Without a limit, expanding a range from an untrusted file could exhaust the memory.
"""
MAX_BYTES = 256 << 20
"""Size of the largest certificate file that is accepted [bytes]."""

FORM: Literal["betterbench coverage"] = "betterbench coverage"


class Gap(NamedTuple):
    """First trial that a certificate does not cover, with the reason.

    ``refused`` is True if the trial was examined with the current versions and failed. There is then no point in
    examining it again.
    """

    trial: TrialId
    reason: str
    refused: bool = False


@strict_form
@dataclass(frozen=True, slots=True)
class Seeds:
    """Seeds of one condition, given as ranges ("0-19,23").

    Attributes:
        certified: Seeds that are certified.
        unsolved: Certified seeds that the expert did not solve.
        refused: Seeds that were examined but not certified, by the letters of the clauses that failed.
    """

    certified: str = ""
    unsolved: str = ""
    refused: Mapping[str, str] | None = None


@strict_form
@dataclass(frozen=True, slots=True)
class Coverage:
    """Certified seeds of each condition ("fast_food/L1"), and the versions with which they were certified."""

    versions: CertificateVersions
    conditions: Mapping[str, Seeds]
    form: Literal["betterbench coverage"] = FORM

    @classmethod
    def of(cls, certificate: Certificate) -> Coverage:
        """Return the coverage of a certificate.

        A trial is covered if clauses (b) to (e) hold and the expert solved the trial or at least 95 % of the trials of
        its condition.
        """
        groups: dict[str, list[Any]] = {}
        for t in certificate.trials:
            groups.setdefault(f"{t.task}/{t.condition}", []).append(t)
        conditions = {}
        for name, trials in groups.items():
            solved = sum(t.clauses["a"].passed for t in trials)
            forgiven = solved >= SOLVED_SHARE * len(trials)
            good = {t.seed for t in trials if t.passed or (forgiven and t.failed == ("a",))}
            refused: dict[str, list[int]] = {}
            for t in trials:
                if t.seed not in good:
                    refused.setdefault("".join(t.failed), []).append(t.seed)
            conditions[name] = Seeds(
                seed_ranges(good),
                seed_ranges(t.seed for t in trials if t.seed in good and not t.passed),
                {letters: seed_ranges(seeds) for letters, seeds in refused.items()} or None,
            )
        return cls(certificate.versions, conditions)

    def only(self, current: CertificateVersions) -> Coverage:
        """Return a coverage that contains only some of the tasks.

        Args:
            current: Versions in use. The result contains only the tasks that are listed in these versions.

        Raises:
            InvalidInputError: If one of the tasks was certified with other versions.
        """
        for name, number in current.tasks.items():
            then = replace(self.versions, tasks={name: self.versions.tasks.get(name, 0)})
            now = replace(current, tasks={name: number})
            if then != now:
                problem = f"{name} was certified with {then.words}, but the versions in use are {now.words}"
                raise InvalidInputError("certificate", problem, "Certify this task again as well")
        kept = {name: seeds for name, seeds in self.conditions.items() if name.partition("/")[0] in current.tasks}
        return Coverage(current, kept)

    def joined(self, other: Coverage, tasks: Sequence[str]) -> Coverage:
        """Return the union of this coverage and the coverage of other tasks, in the order of ``tasks``."""
        numbers = {**self.versions.tasks, **other.versions.tasks}
        conditions = sorted(
            {**self.conditions, **other.conditions}.items(), key=lambda c: tasks.index(c[0].split("/")[0])
        )
        return Coverage(replace(self.versions, tasks=dict(sorted(numbers.items()))), dict(conditions))

    def to_json(self) -> dict[str, Any]:
        """Return the coverage as a JSON-serializable dict. Empty entries are left out."""
        form = asdict(self)
        form["conditions"] = {
            name: {key: value for key, value in seeds.items() if value} for name, seeds in form["conditions"].items()
        }
        return form

    def gap(
        self,
        trials: Iterable[TrialId],
        *,
        suite: str,
        engine: str,
        tasks: Mapping[str, int],
        looks: Looks = "seen",
        robot: str = USUAL_ROBOT,
    ) -> Gap | None:
        """Return the first trial that the certificate does not cover, with the reason.

        Return None if all trials are covered.
        """
        seeds = {name: parse_ranges(s.certified) for name, s in self.conditions.items()}
        stale = None
        if self.versions.suite != suite:
            stale = (
                f"the certificate was made for suite version {self.versions.suite}, but version {suite} is installed"
            )
        elif minor_version(self.versions.engine) != minor_version(engine):
            stale = f"the certificate was made with MuJoCo {self.versions.engine}, but MuJoCo {engine} is installed"
        elif self.versions.looks != looks:
            stale = f"the certificate covers the {self.versions.looks} looks, but the run uses the {looks} looks"
        elif self.versions.robot != robot:
            stale = f"the certificate is for the robot {self.versions.robot}, but the run uses {robot}"
        for trial in trials:
            name, here = f"{trial.task}/{trial.condition}", tasks[trial.task]
            made_for = self.versions.tasks.get(trial.task)
            if stale is not None:
                return Gap(trial, stale)
            if made_for is not None and made_for != here:
                reason = (
                    f"the certificate was made for version {made_for} of {trial.task}, but version {here} is installed"
                )
                return Gap(trial, reason)
            if trial.seed not in seeds.get(name, ()):
                return Gap(trial, *self._why(name, trial.seed))
        return None

    def unsolved(self, trials: Iterable[TrialId]) -> tuple[TrialId, ...]:
        """Return the given trials that are covered even though the expert did not solve them."""
        seeds = {name: parse_ranges(s.unsolved) for name, s in self.conditions.items() if s.unsolved}
        return tuple(t for t in trials if t.seed in seeds.get(f"{t.task}/{t.condition}", ()))

    def _why(self, name: str, seed: int) -> tuple[str, bool]:
        known = self.conditions.get(name)
        if known is None:
            return "the certificate contains no seed of this condition", False
        for letters, ranges in (known.refused or {}).items():
            if seed in parse_ranges(ranges):
                return f"it was examined and fails clause ({', '.join(letters)})", True
        return f"the certificate covers seeds {known.certified or 'none'}", False


_COVERAGE = TypeAdapter(Coverage)


def parse_ranges(text: str) -> frozenset[int]:
    """Parse ranges of seeds, for example "0-19,23". Raises InvalidInputError if the text is malformed."""
    found: set[int] = set()
    for part in text.split(",") if text else ():
        low, _, high = part.partition("-")
        ends = (low, high or low)
        if not all(e.isdecimal() and e.isascii() and len(e) <= 7 for e in ends) or int(ends[1]) > MOST_SEEDS:
            shown = one_line(part, most=80)
            raise InvalidInputError("seeds", f"{shown!r} is not a range of seeds", "Write ranges such as 0-19,23")
        found.update(range(int(ends[0]), int(ends[1]) + 1))
    return frozenset(found)


def packaged_coverage(suite: str = "better60") -> Coverage:
    """Return the coverage of the certificate that is packaged with a built-in suite."""
    file = resources.files("betterbench.certification").joinpath("data", packaged_name(suite))
    return _load(file, f"packaged certificate of {suite}")


def packaged_name(suite: str) -> str:
    """Return the file name of the certificate that is packaged with a built-in suite."""
    return f"{suite}.json"


def coverage_of(tasks: Iterable[str]) -> Coverage:
    """Return the coverage of the certificate that applies to the given tasks.

    The coverage of a suite in a folder is read from that folder. Otherwise, it is read from the package.

    Raises:
        InvalidInputError: If the certificate in the folder cannot be read.
    """
    tasks = tuple(tasks)
    own = suite_file(tasks, CERTIFICATE)
    return packaged_coverage(built_in_suite(tasks)) if own is None else load_coverage(own)


def load_coverage(path: Path) -> Coverage:
    """Read a coverage from a certificate, from the folder of a certificate, or from a coverage file.

    Raises InvalidInputError if the file cannot be read.
    """
    return _load(path / "certificate.json" if path.is_dir() else path, str(path))


def _load(file: Traversable | Path, where: str) -> Coverage:
    cure = "Use a certificate.json written by better certify"
    data = read_bounded(file, max_bytes=MAX_BYTES, cure=cure) if isinstance(file, Path) else file.read_bytes()
    form = open_seal(data, where=where, cure=cure, since=("version", 2))
    form.pop("version", None)
    if form.get("form") != FORM:
        return Coverage.of(Certificate.from_json(form, where=where))
    coverage = read_form(_COVERAGE, form, where=where, cure=cure)
    with form_errors(where, cure):
        for seeds in coverage.conditions.values():
            for text in (seeds.certified, seeds.unsolved, *(seeds.refused or {}).values()):
                parse_ranges(text)
    return coverage


def cure_for(
    gap: Gap,
    *,
    tasks: Iterable[str],
    first: int,
    trials: int,
    looks: Looks = "seen",
    robot: str = USUAL_ROBOT,
    unmeasured: Sequence[str] = (),
) -> str:
    """Return the remedy that an error message suggests for a trial that is not certified.

    Args:
        gap: Trial that is not certified, with the reason.
        tasks: All tasks of the run, because one certificate must cover the complete run. Empty if the run contains the
            whole suite.
        first: First seed of the run.
        trials: Number of trials per variation.
        looks: Appearance of objects and rooms in the run ("seen" or "unseen").
        robot: Name of the robot.
        unmeasured: Tasks defined in user files whose demonstrations must be measured first.
    """
    if gap.refused:
        return "Choose other seeds with --seed and --trials, or run the trials with --uncertified"
    named, arm = " ".join(("", *tasks)), f" --robot {robot}" if robot != USUAL_ROBOT else ""
    chosen = options_for(tasks) + (f" --tasks{named}" if named else "")
    seed = (f" --seed {first}" if first else "") + (f" --looks {looks}" if looks != "seen" else "") + arm
    first_measure = (
        f"better certify{options_for(unmeasured)} --tasks {' '.join(unmeasured)}{arm} --demonstrations 120, then "
    )
    return (
        f"Run {first_measure if unmeasured else ''}better certify{chosen} --trials {trials}{seed} --out "
        "runs/certificate and give it with --certificate runs/certificate, or run with --uncertified"
    )
