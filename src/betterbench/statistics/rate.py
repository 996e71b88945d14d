"""Success rates and their uncertainty."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from betterbench.errors import InvalidInputError
from betterbench.statistics.interval import (
    DEFAULT_CONFIDENCE,
    Interval,
    IntervalMethod,
    check_counts,
    check_fraction,
    clopper_pearson_interval,
    wilson_interval,
)

_METHODS = {"wilson": wilson_interval, "clopper_pearson": clopper_pearson_interval}


@dataclass(frozen=True, slots=True)
class Rate:
    """Success rate: ``k`` successes in ``n`` trials.

    Attributes:
        k: Number of successes.
        n: Number of trials. With 0 trials, the value is None and the interval is [0, 1].
        method: Method of the interval: "wilson" (default) or "clopper_pearson" (guaranteed coverage).
        confidence: Two-sided confidence level of the interval.
    """

    k: int
    n: int
    method: IntervalMethod = "wilson"
    confidence: float = DEFAULT_CONFIDENCE

    def __post_init__(self) -> None:
        """Raise InvalidInputError if the counts are impossible, the method is unknown or the level is out of range."""
        check_counts(self.k, self.n)
        check_fraction("confidence", self.confidence)
        if self.method not in _METHODS:
            raise InvalidInputError(
                "method", f"{self.method!r} is not an interval method", f"Use one of {', '.join(_METHODS)}"
            )

    @property
    def value(self) -> float | None:
        """Fraction of successes, or None if there are no trials."""
        return self.k / self.n if self.n else None

    @property
    def interval(self) -> Interval:
        """Confidence interval of the true rate."""
        return _METHODS[self.method](self.k, self.n, confidence=self.confidence)

    @property
    def low(self) -> float:
        """Lower end of the interval."""
        return self.interval.low

    @property
    def high(self) -> float:
        """Upper end of the interval."""
        return self.interval.high

    def to_json(self) -> dict[str, Any]:
        """Return the rate in JSON form, including its value and its interval."""
        return {**asdict(self), "value": self.value, "low": self.low, "high": self.high}
