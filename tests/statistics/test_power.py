"""Laws and known values of power and of the smallest detectable difference."""

from __future__ import annotations

import pytest
import scipy

import betterbench.statistics.power as power_module
from betterbench.errors import InvalidInputError
from betterbench.statistics import (
    PairedTable,
    Rate,
    fisher_p,
    mcnemar_p,
    paired_power,
    smallest_paired_difference,
    smallest_unpaired_difference,
    unpaired_power,
)


@pytest.mark.parametrize(("a", "b", "power"), [(0.5, 0.7, 0.22), (0.5, 0.8, 0.49), (0.5, 0.9, 0.82), (0.8, 0.95, 0.29)])
def test_power_of_twenty_trials_an_arm(a: float, b: float, power: float) -> None:
    assert unpaired_power(20, a, b) == pytest.approx(power, abs=0.005)
    assert unpaired_power(20, b, a) == pytest.approx(unpaired_power(20, a, b))
    assert unpaired_power(20, 1 - a, 1 - b) == pytest.approx(unpaired_power(20, a, b))


def test_fishers_test_finds_less_with_the_same_trials() -> None:
    first, second = (scipy.stats.binom.pmf(range(21), 20, rate) for rate in (0.5, 0.7))
    found = [[fisher_p(Rate(i, 20), Rate(j, 20)) <= 0.05 for j in range(21)] for i in range(21)]
    assert first @ found @ second == pytest.approx(0.16, abs=0.005)


@pytest.mark.parametrize(("n", "points"), [(387, 10), (169, 15), (93, 20), (38, 30)])
def test_smallest_difference_from_one_half(n: int, points: float) -> None:
    found = smallest_unpaired_difference(n)
    assert found.value is not None
    assert 100 * found.value == pytest.approx(points, abs=1.0)


def test_exact_and_approximate_power_meet_at_the_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    exact = smallest_unpaired_difference(200).value
    monkeypatch.setattr(power_module, "EXACT_ARM_LIMIT", 100)
    approximate = smallest_unpaired_difference(200)
    assert exact is not None
    assert approximate.value == pytest.approx(exact, abs=0.002)
    assert "normal approximation" in approximate.assumption


@pytest.mark.parametrize(
    ("n", "difference", "opposite"), [(8, 0.5, 0.1), (12, 0.3, 0.0), (12, 0.2, 0.4), (6, 1.0, 0.0)]
)
def test_paired_power_is_the_sum_over_all_outcomes(n: int, difference: float, opposite: float) -> None:
    total = 0.0
    shares = (difference + opposite, opposite, max(0.0, 1 - difference - 2 * opposite))
    for b in range(n + 1):
        for c in range(n + 1 - b):
            if mcnemar_p(PairedTable(0, b, c, n - b - c)) <= 0.05:
                total += float(scipy.stats.multinomial.pmf((b, c, n - b - c), n, shares))
    assert paired_power(n, difference, opposite=opposite) == pytest.approx(total, abs=1e-9)


def test_five_pairs_never_reach_significance() -> None:
    assert smallest_paired_difference(5).value is None
    assert smallest_unpaired_difference(2).value is None
    assert paired_power(20, 0.0) == 0.0


@pytest.mark.parametrize("smallest", [smallest_paired_difference, smallest_unpaired_difference])
def test_more_trials_find_smaller_differences(smallest) -> None:
    values = [smallest(n).value for n in (10, 20, 40, 80)]
    assert all(v is not None for v in values)
    assert values == sorted(values, reverse=True)


def test_the_value_is_the_first_step_with_enough_power() -> None:
    paired = smallest_paired_difference(20, opposite=0.05)
    assert paired.value is not None
    assert paired_power(20, paired.value, opposite=0.05) >= 0.8 > paired_power(20, paired.value - 0.001, opposite=0.05)
    unpaired = smallest_unpaired_difference(20, reference=0.9)
    assert unpaired.value is not None
    assert unpaired_power(20, 0.9, 0.9 - unpaired.value) >= 0.8
    assert unpaired_power(20, 0.9, 0.9 - unpaired.value + 0.001) < 0.8
    assert paired.assumption == "exact McNemar test, if 5 % of the pairs differ the other way"
    assert smallest_paired_difference(20).assumption == "exact McNemar test, if no pair differs the other way"
    assert unpaired.assumption == "Barnard's test (exact), down from a rate of 90 %"


def test_pairs_that_flip_both_ways_hide_the_difference() -> None:
    clean, noisy = smallest_paired_difference(40).value, smallest_paired_difference(40, opposite=0.1).value
    assert clean is not None
    assert noisy is not None
    assert noisy > clean


def test_impossible_plans_are_refused() -> None:
    with pytest.raises(InvalidInputError, match="n: 0 trials"):
        smallest_paired_difference(0)
    with pytest.raises(InvalidInputError, match="alpha"):
        unpaired_power(20, 0.5, 0.7, alpha=5.0)
    with pytest.raises(InvalidInputError, match="power"):
        smallest_unpaired_difference(20, power=80.0)
    with pytest.raises(InvalidInputError, match="second"):
        unpaired_power(20, 0.5, 1.7)
    with pytest.raises(InvalidInputError, match="is impossible"):
        paired_power(20, 0.8, opposite=0.2)
    with pytest.raises(InvalidInputError, match="reference"):
        smallest_unpaired_difference(20, reference=2.0)
    with pytest.raises(InvalidInputError, match="opposite"):
        smallest_paired_difference(20, opposite=0.5)
