"""Comparison of a policy with the pretenders, i.e. with policies that lack the tested abilities.

The comparison has three parts: the pretenders' success rates as reference lines, the pretender with the most similar
outcomes, and the policy's margin over the best pretender on each variation.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from betterbench.diagnosis.measures.power_matrix import EXPERT, Ceiling, Key, PowerMatrix, power_cure, power_matrix_of
from betterbench.diagnosis.verdict import RunDiagnosis, TrialDiagnosis
from betterbench.errors import RecordError
from betterbench.statistics import Difference, Rate, newcombe_difference, paired_bootstrap
from betterbench.tasks import Axis, stream
from betterbench.tasks.labels import Kind
from betterbench.wording import listed


@dataclass(frozen=True, slots=True)
class ReferenceLine:
    """Success rates that a pretender (a policy without the tested ability) is expected to reach in a run.

    Attributes:
        pretender: Name of the pretender.
        scores: Expected success rate for each scope ("overall", "axis:temporal_extrapolation"). Each variation is
            weighted by its number of trials in the run.
    """

    pretender: str
    scores: dict[str, float]


@dataclass(frozen=True, slots=True)
class Likeness:
    """Agreement of a policy's outcomes with the outcomes of a policy without the tested ability (a pretender).

    Attributes:
        pretender: Name of the pretender.
        agreement: Fraction of the run's trials with the same outcome (success or failure) for both policies.
        low: Lower end of the 95 % confidence interval, from a bootstrap over variations.
        high: Upper end of the interval.
    """

    pretender: str
    agreement: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class Margin:
    """Difference between a policy's success rate on a variation and the shortcut ceiling of the variation.

    Attributes:
        task: Name of the task.
        variation: Name of the variation.
        rate: Success rate of the policy.
        ceiling: Shortcut ceiling, i.e. the best success rate of a policy without the tested ability.
        margin: Success rate minus ceiling, with Newcombe's confidence interval.
        control: Whether the variation is a control, on which all pretenders succeed.
    """

    task: str
    variation: str
    rate: Rate
    ceiling: Ceiling
    margin: Difference
    control: bool


@dataclass(frozen=True, slots=True)
class Standing:
    """Comparison of a policy with the pretenders, i.e. with policies that lack the tested abilities.

    Attributes:
        scores: Success rate of the policy for each scope, over the variations that the power matrix contains.
        lines: Reference lines of the pretenders and the expert, with the highest overall rate first.
        likenesses: Agreement of the policy with each pretender, with the most similar pretender first. The expert is
            not included.
        expert: Agreement of the policy with the expert, or None if there is no matrix.
        margins: One margin for each variation that is in both the run and the matrix.
        covered: Number of variation trials that the matrix covers, out of all variation trials.
        notice: Sentence that names the missing data and states how to obtain them. Empty if nothing is missing.
    """

    scores: dict[str, float]
    lines: tuple[ReferenceLine, ...]
    likenesses: tuple[Likeness, ...]
    expert: Likeness | None
    margins: tuple[Margin, ...]
    covered: Rate
    notice: str = ""

    @property
    def nearest(self) -> Likeness | None:
        """Pretender (policy without the tested ability) whose outcomes agree most with those of the run, or None."""
        return self.likenesses[0] if self.likenesses else None

    @property
    def rivals(self) -> tuple[str, ...]:
        """Other pretenders that agree with the run in exactly as many trials as the nearest pretender does."""
        best = self.nearest
        return tuple(x.pretender for x in self.likenesses[1:] if best is not None and x.agreement >= best.agreement)

    @property
    def proven(self) -> Rate:
        """Fraction of variations where the policy is significantly better than the shortcut ceiling.

        Controls are left out.
        """
        counted = [m for m in self.margins if not m.control]
        return Rate(sum(m.margin.low > 0.0 for m in counted), len(counted))

    def sentences(self) -> tuple[str, ...]:
        """Return sentences that summarize how the policy compares with the pretenders."""
        return (*_said(self), *((self.notice,) if self.notice else ()))

    def to_json(self) -> dict[str, Any]:
        """Return the JSON-serializable dict that ``better diagnose --json`` prints as ``power``."""
        return {
            "notice": self.notice,
            "covered": {"k": self.covered.k, "n": self.covered.n},
            "scores": self.scores,
            "reference_lines": [asdict(line) for line in self.lines],
            "nearest_pretender": None if self.nearest is None else asdict(self.nearest),
            "as_near": list(self.rivals),
            "expert": None if self.expert is None else asdict(self.expert),
            "likenesses": [asdict(x) for x in self.likenesses],
            "margins": [_margin_json(m) for m in self.margins],
        }


def standing_of(diagnosis: RunDiagnosis, matrix: PowerMatrix | None = None) -> Standing:
    """Compare the policy of a run with the pretenders, i.e. with policies that lack the tested abilities.

    For a run with ``--until-decided``, only the trials of the first round are used. Tasks are left out if they are not
    in the power matrix, or have changed since it was measured. The result has a notice that lists these tasks. If the
    matrix cannot be read, the notice says so, and no error is raised.

    Args:
        diagnosis: Diagnosis of the run.
        matrix: The power matrix. By default, it is the matrix of the run's suite.
    """
    varied = [t for t in diagnosis.even_trials if t.variation is not None and t.kind is not Kind.UNFINISHED]
    if matrix is None:
        try:
            matrix = power_matrix_of({t.task for t in varied})
        except RecordError as error:
            return _without(len(varied), f"The power matrix of the suite cannot be read: {error}")
    if matrix is None:
        cure = power_cure({t.task for t in varied})
        return _without(len(varied), f"This build has no power matrix, so there are no reference lines; {cure}.")
    mine = {t.task for t in varied}
    stale = [task for task in matrix.stale_tasks(diagnosis.versions) if task in mine]
    matrix = matrix.without(stale)
    known = set(matrix.cells.get(EXPERT, {})) or set(matrix.variations)
    trials = [t for t in varied if _key(t) in known]
    covered = Rate(len(trials), len(varied))
    notice = _notice(stale, sorted({t.task for t in varied if _key(t) not in known} - set(stale)))
    if not trials:
        return _without(len(varied), notice)
    likenesses = [found for name in matrix.pretenders if (found := _likeness(name, trials, matrix)) is not None]
    likenesses.sort(key=lambda x: (-x.agreement, x.pretender))
    lines = [ReferenceLine(name, scores) for name in matrix.cells if (scores := _line(name, trials, matrix))]
    lines.sort(key=lambda line: (-line.scores["overall"], line.pretender))
    return Standing(
        {scope: sum(t.success for t in members) / len(members) for scope, members in _scopes(trials)},
        tuple(lines),
        tuple(likenesses),
        _likeness(EXPERT, trials, matrix),
        tuple(_margins(trials, matrix)),
        covered,
        notice,
    )


def _without(trials: int, notice: str) -> Standing:
    return Standing({}, (), (), None, (), Rate(0, trials), notice)


def _key(trial: TrialDiagnosis) -> Key:
    return trial.task, trial.variation or ""


def _scopes(trials: Sequence[TrialDiagnosis]) -> Iterator[tuple[str, list[TrialDiagnosis]]]:
    yield "overall", list(trials)
    for axis in Axis:
        members = [t for t in trials if t.axis == axis.value]
        if members:
            yield f"axis:{axis.value}", members


def _line(name: str, trials: Sequence[TrialDiagnosis], matrix: PowerMatrix) -> dict[str, float]:
    """Return the success rates that a pretender is expected to reach, one for each scope.

    The result is empty if the power matrix lacks one of the variations in the run.
    """
    rates = _rates(name, trials, matrix)
    if rates is None:
        return {}
    return {scope: sum(rates[_key(t)] for t in members) / len(members) for scope, members in _scopes(trials)}


def _rates(name: str, trials: Sequence[TrialDiagnosis], matrix: PowerMatrix) -> dict[Key, float] | None:
    found = {key: matrix.cell(name, key) for key in dict.fromkeys(_key(t) for t in trials)}
    rates = {key: cell.k / cell.n for key, cell in found.items() if cell is not None and cell.n}
    return rates if len(rates) == len(found) else None


def _likeness(name: str, trials: Sequence[TrialDiagnosis], matrix: PowerMatrix) -> Likeness | None:
    """Return the agreement between the outcomes of a pretender and a run, or None if the matrix lacks a variation."""
    rates = _rates(name, trials, matrix)
    if rates is None:
        return None
    alike = [rates[_key(t)] if t.success else 1.0 - rates[_key(t)] for t in trials]
    found = paired_bootstrap(
        alike,
        [0.0] * len(alike),
        generator=stream("diagnosis", 0, f"bootstrap:likeness:{name}"),
        clusters=["/".join(_key(t)) for t in trials],
    )
    return Likeness(name, found.value or 0.0, found.low, found.high)


def _margins(trials: Sequence[TrialDiagnosis], matrix: PowerMatrix) -> Iterator[Margin]:
    n, k = Counter(_key(t) for t in trials), Counter(_key(t) for t in trials if t.success)
    for key in n:
        ceiling = matrix.ceiling(key)
        if ceiling is not None:
            rate = Rate(k[key], n[key])
            yield Margin(*key, rate, ceiling, newcombe_difference(rate, ceiling.rate), matrix.control(key))


def _notice(stale: Sequence[str], unknown: Sequence[str]) -> str:
    parts = []
    if stale:
        parts.append(f"it was measured on another version of {listed(stale)}")
    if unknown:
        parts.append(f"it does not contain {listed(unknown)}")
    if not parts:
        return ""
    cure = power_cure((*stale, *unknown))
    return f"The power matrix does not cover all trials of this run: {' and '.join(parts)}; {cure}."


def _said(standing: Standing) -> Iterator[str]:
    best = standing.nearest
    if best is None or standing.expert is None:
        return
    others = f" (equally near: {', '.join(standing.rivals)})" if standing.rivals else ""
    yield (
        f"Nearest pretender: {best.pretender}{others}, whose outcomes agree with this policy's outcomes in "
        f"{_share(best)} of the trials. The expert's outcomes agree in {_share(standing.expert)}."
    )
    proven = standing.proven
    if proven.n:
        yield (
            f"On {proven.k} of {proven.n} variations its success rate is significantly above that of every pretender "
            f"that the variation is designed to expose."
        )


def _share(x: Likeness) -> str:
    return f"{100 * x.agreement:.0f} % ({100 * x.low:.0f} to {100 * x.high:.0f})"


def _margin_json(m: Margin) -> dict[str, Any]:
    return {
        "task": m.task,
        "variation": m.variation,
        "k": m.rate.k,
        "n": m.rate.n,
        "ceiling": {"pretender": m.ceiling.pretender, "k": m.ceiling.rate.k, "n": m.ceiling.rate.n},
        "margin": m.margin.value,
        "low": m.margin.low,
        "high": m.margin.high,
        "control": m.control,
    }
