"""Format numbers for sentences and table cells: percentages with counts, and differences with intervals."""

from __future__ import annotations

from dataclasses import dataclass, replace
from decimal import Decimal
from fractions import Fraction

from betterbench.diagnosis.verdict import Metric, RunDiagnosis
from betterbench.statistics import Rate, percent, round_half_up
from betterbench.statistics.wording import minus, signed

MISSING = "not measured"
"""Text that is shown instead of a missing number."""

THIN = "\N{NARROW NO-BREAK SPACE}"


@dataclass(frozen=True, slots=True)
class Figure:
    """Number for a page, a CSV file or LaTeX, stored as a fraction. The value is None if there is no number.

    Attributes:
        low: Lower end of the 95 % interval.
        high: Upper end of the 95 % interval.
        k: Numerator; None if the number is not a single rate.
        n: Denominator or number of pairs; None for numbers without a denominator, such as a chance level.
        difference: Whether the number is a difference of rates. It is then shown in percentage points, with its sign.
        noun: Noun for the counted units ("trials", "pairs", "attempts").
        sides: For a difference, the two rates.
    """

    value: float | None = None
    low: float | None = None
    high: float | None = None
    k: int | None = None
    n: int | None = None
    difference: bool = False
    noun: str = "trials"
    p_value: float | None = None
    sides: tuple[Figure, Figure] | None = None

    @classmethod
    def of(cls, metric: Metric | None, *, difference: bool = False, noun: str = "trials") -> Figure:
        """Convert a metric to a Figure. For a missing metric, the value is None."""
        if metric is None:
            return cls(difference=difference, noun=noun)
        low, high = (metric.low, metric.high) if metric.value is not None else (None, None)
        return cls(metric.value, low, high, metric.k, metric.n, difference, noun, metric.p_value)

    @classmethod
    def of_rate(cls, rate: Rate) -> Figure:
        """Convert a rate to a Figure. If there are no trials, the value and the interval are None."""
        if rate.value is None:
            return cls(k=rate.k, n=rate.n)
        return cls(rate.value, rate.low, rate.high, rate.k, rate.n)

    @classmethod
    def gap(cls, diagnosis: RunDiagnosis, scope: str) -> Figure:
        """Return the illusion gap: success rate of training trials minus that of variation trials with the same seeds.

        The two rates are stored with the gap.

        Args:
            diagnosis: Diagnosis of the run.
            scope: Variations to include, such as "overall" or an axis.
        """
        names = ("illusion_gap", "twin_success_rate", "paired_success_rate")
        gap, twins, paired = (diagnosis.metric(name, scope) for name in names)
        figure = cls.of(gap, difference=True, noun="pairs")
        if figure.missing or twins is None or paired is None:
            return figure
        return replace(figure, sides=(cls.of(twins, noun="pairs"), cls.of(paired, noun="pairs")))

    @property
    def digits(self) -> int:
        """Number of decimal places that makes the printed difference agree with the two printed rates.

        It is the smallest such number, and 0 for a number that is not a difference.
        """
        if self.sides is None or self.value is None:
            return 0
        for digits in range(3):
            twins, paired = (_rounded_rate(side.k, side.n, side.value or 0.0, digits) for side in self.sides)
            if twins - paired == _rounded_rate(None, None, self.value, digits):
                return digits
        return 0

    def from_sides(self) -> str:
        """Return the two rates of a difference, e.g. "twins 67 %, variations 56 %".

        Return "" if there are none.
        """
        if self.sides is None or self.missing:
            return ""
        twins, paired = (side.with_unit(self.digits) for side in self.sides)
        return f"twins {twins}, variations {paired}"

    @property
    def missing(self) -> bool:
        """Whether there is no number to show."""
        return self.value is None

    def number(self, digits: int = 0) -> str:
        """Return the number without its unit, in percent or percentage points ("62", "+3", "−47.5").

        Return "–" if it is missing.
        """
        if self.value is None:
            return "–"
        rounded = _rounded_rate(self.k, self.n, self.value, max(digits, self.digits))
        return signed(rounded) if self.difference else minus(rounded)

    def with_unit(self, digits: int = 0) -> str:
        """Return the number with its unit ("62 %", "38 points"). Return "not measured" if it is missing."""
        if self.value is None:
            return MISSING
        if self.difference:
            return f"{self.number(digits)} points"
        return f"{self.number(digits)}{THIN}%"

    def count(self) -> str:
        """Return the counts from which the number is computed ("149/240", "240 pairs", "no trials")."""
        if self.n is None:
            return "" if self.value is None else "by chance"
        if self.n == 0:
            return f"no {self.noun}"
        if self.k is not None:
            return f"{self.k}/{self.n}"
        return f"{self.n} {self.noun.removesuffix('s') if self.n == 1 else self.noun}"

    def interval(self, digits: int = 0) -> str:
        """Return the ends of the 95 % interval ("31 to 45"). Return "" if there is no interval."""
        if self.low is None or self.high is None:
            return ""
        low, high = round_half_up(100 * self.low, digits), round_half_up(100 * self.high, digits)
        return f"{minus(low)} to {minus(high)}"

    def sentence(self) -> str:
        """Return the number with its counts and its interval, e.g. "62 % (149/240), 95 % interval 56 to 68"."""
        if self.value is None:
            return self.count() or MISSING
        ends = f", 95{THIN}% interval {self.interval()}" if self.interval() else ""
        sides = f"; {self.from_sides()}" if self.sides else ""
        return f"{self.with_unit()} ({self.count()}{sides}){ends}"


def _rounded_rate(k: int | None, n: int | None, value: float, digits: int) -> Decimal:
    """Return the rounded percentage. It is computed from the counts if they are known, otherwise from the value."""
    if k is not None and n and 0 <= k <= n and abs(k / n - value) < 1e-9:
        exact = percent(k, n, digits=digits)
        if exact is not None:
            return exact
    return round_half_up(Fraction(100) * Fraction(f"{value:.12g}"), digits)
