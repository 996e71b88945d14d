"""Test whether a static score predicts the illusion gap of policies in simulation, using the rank correlation.

The illusion gap is the drop in a policy's success rate when the scene changes. The paper uses static evaluation of the
policy's model as a proxy for how well the policy understands scenes. If the proxy is valid, policies with a higher
static score or a smaller static illusion gap have a smaller illusion gap in simulation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from betterbench.diagnosis import RunDiagnosis
from betterbench.errors import InvalidInputError, RunConflictError
from betterbench.statistics import RankCorrelation, holm, rank_correlation
from betterbench.tasks.randomness import stream
from betterbench.vlm.stored import StoredRun

LEAST_POLICIES = 5
"""Minimum number of policies for a conclusion. With four policies, the exact test cannot reach p < 0.05."""


@dataclass(frozen=True, slots=True)
class PolicyPoint:
    """Results of one policy, in the static benchmark and in simulation.

    Attributes:
        name: Name of the policy.
        score: Headline number of the static benchmark, as a fraction.
        items: Number of items on which the score is based.
        static_gap: Static illusion gap (the drop in the static score when the scene changes), as a fraction. None if
            the run has no static illusion gap.
        gap: Illusion gap in simulation over all variations, as a fraction.
        low: Lower end of the confidence interval of ``gap``.
        high: Upper end of the confidence interval of ``gap``.
        pairs: Number of trial pairs (variation and training) on which the gap is based.
        training: Success rate in the training trials of the pairs.
        variation: Success rate in the variations of the pairs.
    """

    name: str
    score: float
    items: int
    static_gap: float | None
    gap: float
    low: float
    high: float
    pairs: int
    training: float | None
    variation: float | None


@dataclass(frozen=True, slots=True)
class Prediction:
    """Rank correlation between a number from static evaluation and the illusion gap in simulation.

    Attributes:
        predictor: "static score" or "static gap".
        correlation: Rank correlation over the policies.
        adjusted: p-value of the correlation after Holm's correction over the predictors.
        is_supported: Whether the correlation is significant and based on at least :data:`LEAST_POLICIES` policies.
    """

    predictor: str
    correlation: RankCorrelation
    adjusted: float
    is_supported: bool

    @property
    def sentence(self) -> str:
        """Result in words."""
        told = self.correlation
        if told.value is None:
            return f"{self.predictor}: all {told.n} policies have the same value, so there is no correlation."
        number = f"rank correlation {told.value:+.2f}, interval {told.low:+.2f} to {told.high:+.2f}"
        if told.n < LEAST_POLICIES:
            return (
                f"{self.predictor}: {told.n} policies are too few for a conclusion ({number}). At least "
                f"{LEAST_POLICIES} are needed, because even a perfect ranking of four has p = 0.083."
            )
        tested = f"{number}, p = {self.adjusted:.2g} after Holm"
        if not self.is_supported:
            return f"{self.predictor}: the {told.n} policies do not allow a conclusion ({tested})."
        direction = "smaller" if told.value < 0.0 else "larger"
        return f"{self.predictor}: it predicts the illusion gap. A higher value goes with a {direction} gap ({tested})."

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict."""
        return {**asdict(self), "correlation": self.correlation.to_json(), "sentence": self.sentence}


@dataclass(frozen=True, slots=True)
class PredictionTable:
    """Results of several policies in the static benchmark and in simulation, and their correlations.

    Attributes:
        warnings: Differences between the runs that limit the conclusion.
    """

    benchmark: str
    column: str
    policies: tuple[PolicyPoint, ...]
    predictions: tuple[Prediction, ...]
    warnings: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict. All rates in it are fractions."""
        return {**asdict(self), "predictions": [found.to_json() for found in self.predictions]}


def predictions_of(policies: Sequence[PolicyPoint], *, alpha: float = 0.05) -> tuple[Prediction, ...]:
    """Correlate the results of static evaluation with the illusion gap in simulation.

    The results are the static score and, if all policies have one, the static illusion gap.

    Args:
        policies: Results of each policy.
        alpha: Significance level of the tests, for both correlations together.

    Raises:
        InvalidInputError: If there are fewer than two policies.
    """
    if len(policies) < 2:
        raise InvalidInputError(
            "better compare", "a single policy cannot be ranked", "Pass the runs of several policies"
        )
    gaps = [policy.gap for policy in policies]
    predictors = {"static score": [policy.score for policy in policies]}
    static = [policy.static_gap for policy in policies if policy.static_gap is not None]
    if len(static) == len(policies):
        predictors["static gap"] = static
    found = {
        name: rank_correlation(values, gaps, generator=stream("static prediction", 0, name))
        for name, values in predictors.items()
    }
    adjusted = holm([told.p for told in found.values()])
    return tuple(
        Prediction(name, told, p, is_supported=told.n >= LEAST_POLICIES and p < alpha)
        for (name, told), p in zip(found.items(), adjusted, strict=True)
    )


def prediction_table(
    policies: Sequence[tuple[str | None, StoredRun, RunDiagnosis]], *, column: str = "parsed", alpha: float = 0.05
) -> PredictionTable:
    """Compare several policies in the static benchmark and in simulation.

    Args:
        policies: For each policy, its name, its run of ``better vlm``, and the diagnosis of its trials. If the name is
            None, the name in the diagnosis is used.
        column: Column of the scores: "strict", "parsed" or "extracted".
        alpha: Significance level of the tests.

    Raises:
        RunConflictError: If the runs of ``better vlm`` are on different benchmarks, or two policies have the same name.
        InvalidInputError: If there are fewer than two policies, or the trials of a policy have no illusion gap.
    """
    benchmarks = {run.benchmark.title: run for _, run, _ in policies}
    if len(benchmarks) > 1:
        names = " and ".join(f"{run.path} ({title})" for title, run in benchmarks.items())
        raise RunConflictError(f"{names} are runs on different benchmarks. Use runs on the same benchmark.")
    points = [_point(name or diagnosis.policy, run, diagnosis, column) for name, run, diagnosis in policies]
    double = next((p.name for i, p in enumerate(points) if p.name in {q.name for q in points[:i]}), None)
    if double is not None:
        raise RunConflictError(
            f"Two policies have the name {double!r}. Use --name to give each policy a different name."
        )
    warnings = []
    if len({run.head["data"] for _, run, _ in policies}) > 1:
        warnings.append("The models answered different questions, so their scores also differ in difficulty.")
    if len({frozenset(t.key for t in diagnosis.trials) for *_, diagnosis in policies}) > 1:
        warnings.append("The policies ran different trials, so their gaps also differ in difficulty.")
    return PredictionTable(
        next(iter(benchmarks)), column, tuple(points), predictions_of(points, alpha=alpha), tuple(warnings)
    )


def _point(name: str, run: StoredRun, diagnosis: RunDiagnosis, column: str) -> PolicyPoint:
    gap = diagnosis.metric("illusion_gap", "overall")
    if gap is None or gap.value is None or gap.low is None or gap.high is None:
        problem = "has no illusion gap, since it has no variation whose training condition was run with the same seed"
        raise InvalidInputError(name, problem, "Run `better eval` on training conditions and variations")
    rates = [diagnosis.metric(measure, "overall") for measure in ("twin_success_rate", "paired_success_rate")]
    training, variation = (None if metric is None else metric.value for metric in rates)
    static = run.static_gap(column)
    return PolicyPoint(
        name, run.headline[column], len(run.counted()), static, gap.value, gap.low, gap.high, gap.n, training, variation
    )
