"""Means of clustered scores."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from betterbench.errors import InvalidInputError
from betterbench.statistics import clustered_mean, wilson_interval


def test_own_clusters_give_about_wilsons_interval():
    scores = [Fraction(i % 4 == 0) for i in range(200)]
    found = clustered_mean(scores, [str(i) for i in range(200)])
    assert found.mean == Fraction(1, 4)
    expected = wilson_interval(50, 200)
    assert (found.low, found.high) == pytest.approx((expected.low, expected.high), abs=1e-3)


def test_perfectly_dependent_scores_count_once_per_cluster():
    scores = [Fraction(i // 10 % 2) for i in range(200)]
    found = clustered_mean(scores, [str(i // 10) for i in range(200)])
    expected = wilson_interval(10, 20)
    assert (found.low, found.high) == pytest.approx((expected.low, expected.high), abs=0.02)
    all_right = clustered_mean([Fraction(1)] * 200, [str(i // 10) for i in range(200)])
    assert all_right.low == pytest.approx(wilson_interval(20, 20).low)
    assert all_right.high == 1.0


def test_the_interval_covers_the_mean_of_clustered_scores():
    draw, held = np.random.default_rng(7), 0
    names = [str(i // 5) for i in range(200)]
    for _ in range(300):
        rates = draw.beta(0.6, 1.4, size=40)  # mean 0.3, strongly clustered
        scores = [Fraction(int(x)) for x in draw.random(200) < np.repeat(rates, 5)]
        found = clustered_mean(scores, names)
        held += found.low <= 0.3 <= found.high
    assert 0.91 <= held / 300 <= 0.99


def test_wrong_input_is_named():
    assert clustered_mean([], []).mean is None
    with pytest.raises(InvalidInputError, match="1 clusters for 2 scores"):
        clustered_mean([Fraction(1), Fraction(0)], ["a"])
    with pytest.raises(InvalidInputError, match="not between 0 and 1"):
        clustered_mean([Fraction(2)], ["a"])
