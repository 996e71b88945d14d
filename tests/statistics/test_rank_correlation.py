"""Rank correlations of few cases: exact tests, and intervals that stay wide."""

from __future__ import annotations

import math

import numpy as np
import pytest
import scipy

from betterbench.errors import InvalidInputError
from betterbench.statistics import rank_correlation


def found(first, second):
    return rank_correlation(first, second, generator=np.random.default_rng(0))


@pytest.mark.parametrize("n", [4, 6, 12])
def test_the_value_is_spearmans_with_ties(n):
    rng = np.random.default_rng(n)
    first, second = rng.integers(0, 5, n).astype(float), rng.normal(size=n)
    told = found(first, second)
    assert told.value == pytest.approx(scipy.stats.spearmanr(first, second).statistic)
    assert -1.0 <= told.low <= told.value <= told.high <= 1.0


@pytest.mark.parametrize("n", [2, 3, 4, 5, 6])
def test_a_perfect_ranking_of_n_cases_has_the_smallest_p_and_an_interval_with_a_width(n):
    told = found(range(n), [-v for v in range(n)])
    assert told.value == pytest.approx(-1.0)
    assert told.p == pytest.approx(min(1.0, 2.0 / math.factorial(n)))
    assert told.high > -1.0
    if n <= 3:
        assert (told.low, told.high) == (-1.0, 1.0)


def test_random_orders_agree_with_the_exact_test_of_many_cases():
    rng = np.random.default_rng(3)
    first = rng.normal(size=12)
    second = first + rng.normal(size=12)
    assert found(first, second).p == pytest.approx(scipy.stats.spearmanr(first, second).pvalue, abs=0.02)


def test_a_constant_quantity_has_no_correlation():
    told = found([1.0, 1.0, 1.0, 1.0, 1.0], range(5))
    assert (told.value, told.low, told.high, told.p) == (None, -1.0, 1.0, 1.0)


@pytest.mark.parametrize(("first", "second"), [([1.0], [1.0, 2.0]), ([1.0, math.nan], [1.0, 2.0])])
def test_values_that_cannot_be_ranked_are_refused(first, second):
    with pytest.raises(InvalidInputError):
        found(first, second)
