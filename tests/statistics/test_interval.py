"""Laws and published values of the intervals of one rate."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.looping import each

from betterbench.errors import InvalidInputError
from betterbench.statistics import Rate, clopper_pearson_interval, wilson_interval
from betterbench.statistics.interval import Interval, normal_quantile

METHODS = (wilson_interval, clopper_pearson_interval)


@st.composite
def counts(draw: st.DrawFn) -> tuple[int, int]:
    n = draw(st.integers(1, 400))
    return draw(st.integers(0, n)), n


def coverage(intervals: list[Interval], n: int, rates: np.ndarray) -> np.ndarray:
    """Return the exact probability that the interval holds the rate, by summation over all outcomes."""
    from scipy import stats

    mass = stats.binom.pmf(np.arange(n + 1)[None, :], n, rates[:, None])
    inside = np.array([[low <= p <= high for low, high in intervals] for p in rates])
    return np.asarray((mass * inside).sum(axis=1))


@each("n", [1, 5, 20, 60])
@each("confidence", [0.9, 0.95])
def test_clopper_pearson_covers_every_rate(n: int, confidence: float) -> None:
    intervals = [clopper_pearson_interval(k, n, confidence=confidence) for k in range(n + 1)]
    assert coverage(intervals, n, np.linspace(0.001, 0.999, 499)).min() >= confidence


@pytest.mark.parametrize("n", [10, 20, 60])
def test_wilson_covers_the_level_on_average(n: int) -> None:
    intervals = [wilson_interval(k, n) for k in range(n + 1)]
    covered = coverage(intervals, n, np.linspace(0.0005, 0.9995, 1000))
    assert 0.945 <= covered.mean() <= 0.96
    assert covered.min() >= 0.82  # its known weak spot lies close to 0 and 1


@given(counts())
def test_wilson_ends_solve_the_score_equation(kn: tuple[int, int]) -> None:
    k, n = kn
    low, high = wilson_interval(k, n)
    z = normal_quantile(0.95)
    for end in ([low] if k else []) + ([high] if k < n else []):
        assert abs(k / n - end) == pytest.approx(z * (end * (1 - end) / n) ** 0.5, rel=1e-9)


@given(counts())
def test_clopper_pearson_ends_leave_half_the_error_in_each_tail(kn: tuple[int, int]) -> None:
    from scipy import stats

    k, n = kn
    low, high = clopper_pearson_interval(k, n)
    if k:
        assert stats.binom.sf(k - 1, n, low) == pytest.approx(0.025, rel=1e-6)
    if k < n:
        assert stats.binom.cdf(k, n, high) == pytest.approx(0.025, rel=1e-6)


@pytest.mark.parametrize("interval", METHODS)
@given(kn=counts())
def test_success_and_failure_mirror_each_other(interval, kn: tuple[int, int]) -> None:
    k, n = kn
    low, high = interval(k, n)
    mirrored = interval(n - k, n)
    assert (low, high) == pytest.approx((1 - mirrored.high, 1 - mirrored.low), abs=1e-9)
    assert 0.0 <= low <= k / n <= high <= 1.0


@pytest.mark.parametrize("interval", METHODS)
@pytest.mark.parametrize("n", [3, 20, 101])
def test_ends_grow_with_successes_and_width_with_confidence(interval, n: int) -> None:
    ends = [interval(k, n) for k in range(n + 1)]
    for before, after in itertools.pairwise(ends):
        assert before.low < after.low
        assert before.high < after.high
    for k in range(n + 1):
        wide, narrow = interval(k, n, confidence=0.99), interval(k, n, confidence=0.8)
        assert wide.high - wide.low > narrow.high - narrow.low


@pytest.mark.parametrize("interval", METHODS)
def test_more_trials_narrow_the_interval(interval) -> None:
    widths = [high - low for low, high in (interval(m * 7, m * 20) for m in (1, 2, 5, 20))]
    assert widths == sorted(widths, reverse=True)


@each(
    "k, low, high",
    [
        (0, 0.0, 0.161),
        (1, 0.009, 0.236),
        (7, 0.181, 0.567),
        (10, 0.299, 0.701),
        (13, 0.433, 0.819),
        (17, 0.640, 0.948),
        (19, 0.764, 0.991),
        (20, 0.839, 1.0),
    ],
)
def test_wilson_of_twenty_trials(k: int, low: float, high: float) -> None:
    assert wilson_interval(k, 20) == pytest.approx((low, high), abs=5e-4)


@pytest.mark.parametrize(("k", "low", "high"), [(0, 0.0, 0.168), (13, 0.408, 0.846)])
def test_clopper_pearson_of_twenty_trials(k: int, low: float, high: float) -> None:
    assert clopper_pearson_interval(k, 20) == pytest.approx((low, high), abs=5e-4)


def test_a_rate_without_trials_knows_nothing() -> None:
    rate = Rate(0, 0)
    assert (rate.value, rate.low, rate.high) == (None, 0.0, 1.0)
    assert Rate(0, 0, method="clopper_pearson").interval == (0.0, 1.0)


def test_a_rate_writes_its_interval_out() -> None:
    form = Rate(7, 20).to_json()
    assert (form["k"], form["n"], form["value"], form["method"]) == (7, 20, 0.35, "wilson")
    assert (form["low"], form["high"]) == wilson_interval(7, 20)
    assert Rate(13, 20, method="clopper_pearson").interval == clopper_pearson_interval(13, 20)


@pytest.mark.parametrize(("k", "n"), [(-1, 3), (4, 3), (0, -1)])
def test_impossible_counts_are_refused(k: int, n: int) -> None:
    with pytest.raises(InvalidInputError, match="impossible"):
        Rate(k, n)


@pytest.mark.parametrize("confidence", [0.0, 1.0, 95.0, float("nan")])
def test_impossible_levels_are_refused(confidence: float) -> None:
    for attempt in (wilson_interval, clopper_pearson_interval):
        with pytest.raises(InvalidInputError, match=r"confidence: .* strictly between 0 and 1"):
            attempt(1, 2, confidence=confidence)
    with pytest.raises(InvalidInputError, match="confidence"):
        Rate(1, 2, confidence=confidence)


def test_an_unknown_method_is_refused_with_the_known_ones() -> None:
    with pytest.raises(InvalidInputError, match="wilson, clopper_pearson"):
        Rate(1, 2, method="wald")  # type: ignore[arg-type]
