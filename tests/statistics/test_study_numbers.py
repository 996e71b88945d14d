"""Ranking, sign flips, and two differences against each other: known values, limits and coverage."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from betterbench.errors import InvalidInputError
from betterbench.statistics import (
    Difference,
    Rate,
    difference_of,
    newcombe_difference,
    ranking_area,
    ratio_of,
    sign_flip_p,
)


def test_the_area_is_the_share_of_pairs_in_the_right_order():
    scores, happened = [0.9, 0.8, 0.8, 0.1, 0.3], [True, False, True, False, False]
    yes = [s for s, h in zip(scores, happened, strict=True) if h]
    no = [s for s, h in zip(scores, happened, strict=True) if not h]
    expected = np.mean([(a > b) + 0.5 * (a == b) for a, b in itertools.product(yes, no)])
    found = ranking_area(scores, happened)
    assert found.value == pytest.approx(expected)
    assert found.low < found.value < found.high
    assert ranking_area([1, 1, 1, 1], [True, False] * 2).value == 0.5
    assert ranking_area([1.0, 2.0], [True, True]).value is None
    perfect = ranking_area(range(10), [False] * 5 + [True] * 5)
    assert (perfect.value, perfect.high) == (1.0, 1.0)
    assert perfect.low < 0.8
    with pytest.raises(InvalidInputError, match="3 scores for 1"):
        ranking_area([1, 2, 3], [True])


def test_the_interval_of_the_area_holds_the_true_area():
    draw, held = np.random.default_rng(0), 0
    for _ in range(300):
        yes, no = draw.normal(1.0, 1.0, 12), draw.normal(0.0, 1.0, 12)
        found = ranking_area([*yes, *no], [True] * 12 + [False] * 12)
        held += found.low <= 0.760 <= found.high  # the normal distribution function of 1 / sqrt(2)
    assert held >= 0.92 * 300


def test_sign_flips_count_all_signs():
    draw = np.random.default_rng(0)
    assert sign_flip_p([0.3, 0.5], generator=draw) == pytest.approx(0.5)
    assert sign_flip_p([1.0] * 6, generator=draw) == pytest.approx(2 / 64)
    assert sign_flip_p([0.2, -0.2], generator=draw) == 1.0
    assert sign_flip_p([], generator=draw) == 1.0
    values = draw.normal(0.3, 1.0, 16)
    exact = sign_flip_p(values, generator=draw)
    assert sign_flip_p([*values, 0.0], generator=draw) == pytest.approx(exact, abs=0.01)  # drawn, and the same


def test_a_ratio_holds_what_its_difference_allows():
    left, before = newcombe_difference(Rate(9, 30), Rate(3, 30)), newcombe_difference(Rate(28, 30), Rate(2, 30))
    found = ratio_of(left, before)
    assert found.value == pytest.approx((6 / 30) / (26 / 30))
    assert -0.2 < found.low < found.value < found.high < 0.6
    assert ratio_of(before, before).value == pytest.approx(1.0)
    assert ratio_of(before, left) is None or left.low > 0.0
    assert ratio_of(left, Difference(0.1, -0.1, 0.3, "")) is None
    assert ratio_of(Difference(None, -1.0, 1.0, ""), before) is None
    sharp = Difference(0.5, 0.5, 0.5, "")
    assert ratio_of(Difference(0.2, 0.1, 0.3, ""), sharp).low == pytest.approx(0.2)
    assert ratio_of(Difference(0.2, 0.1, 0.3, ""), sharp).high == pytest.approx(0.6)


def test_intervals_of_differences_add_in_quadrature():
    found = difference_of(Difference(0.5, 0.2, 0.6, ""), Difference(0.1, 0.0, 0.5, ""))
    assert (found.value, found.low, found.high) == pytest.approx((0.4, 0.4 - 0.5, 0.4 + 0.1 * 2**0.5))
    assert difference_of(Difference(None, -1.0, 1.0, ""), found).value is None
