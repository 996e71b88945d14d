"""Laws of the bets on a mean: a fair game under the null, few false alarms under peeking, intervals that cover."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from betterbench.errors import InvalidInputError
from betterbench.statistics import anytime_interval, evidence_above, evidence_below
from betterbench.statistics.betting import SIGNED, UNIT

REPEATS, LOOKS = 2000, 60


@pytest.mark.parametrize("mean", [0.1, 0.5, 0.8])
@pytest.mark.parametrize("evidence", [evidence_above, evidence_below])
def test_the_game_is_fair_at_the_edge_of_the_null_and_loses_inside_of_it(evidence, mean):
    def expected(true: float) -> float:
        return sum(
            math.prod(true if x else 1.0 - true for x in path) * evidence(path, mean)
            for path in itertools.product((0.0, 1.0), repeat=6)
        )

    inside = mean / 2.0 if evidence is evidence_above else (1.0 + mean) / 2.0
    assert expected(mean) == pytest.approx(1.0)
    assert expected(inside) < 1.0


@pytest.mark.parametrize("ties", [0.0, 0.6])
def test_the_game_on_pairs_is_fair_whatever_their_ties(ties):
    chances = {1.0: 0.6 * (1.0 - ties), 0.0: ties, -1.0: 0.4 * (1.0 - ties)}
    drop = chances[1.0] - chances[-1.0]
    expected = sum(
        math.prod(chances[x] for x in path) * evidence_below(path, drop, span=SIGNED)
        for path in itertools.product(chances, repeat=5)
    )
    assert expected == pytest.approx(1.0)


@pytest.mark.parametrize("rate", [0.05, 0.5, 0.9])
def test_looking_after_every_trial_keeps_false_alarms_below_the_level_and_the_interval_covering(rate):
    generator = np.random.default_rng([7, round(100 * rate)])
    counts = (generator.random((REPEATS, LOOKS)) < rate).cumsum(axis=1)
    above, below = np.ones((LOOKS + 1, LOOKS + 1)), np.ones((LOOKS + 1, LOOKS + 1))
    for n in range(1, LOOKS + 1):
        for k in range(n + 1):
            values = [1.0] * k + [0.0] * (n - k)
            above[n, k], below[n, k] = evidence_above(values, rate), evidence_below(values, rate)
    looks = np.arange(1, LOOKS + 1)
    most_above, most_below = above[looks, counts].max(axis=1), below[looks, counts].max(axis=1)
    assert np.mean(most_above >= 20.0) <= 0.05
    assert np.mean(most_below >= 20.0) <= 0.05
    missed = np.mean(np.maximum(most_above, most_below) >= 40.0)
    assert 0.0 < missed <= 0.05, "an interval that was looked at sixty times"


@given(st.lists(st.sampled_from([0.0, 0.5, 1.0]), max_size=12), st.floats(0.01, 0.99))
def test_the_interval_holds_what_no_bet_refutes(values, mean):
    low, high = anytime_interval(values)
    assert 0.0 <= low <= high <= 1.0
    refuted = max(evidence_above(values, mean), evidence_below(values, mean)) >= 40.0
    if abs(mean - low) > 1e-9 and abs(mean - high) > 1e-9:
        assert refuted == (not low < mean < high)


@given(st.lists(st.sampled_from([-1.0, 0.0, 1.0]), max_size=12))
def test_order_does_not_matter_and_signs_mirror(values):
    low, high = anytime_interval(values, span=SIGNED)
    assert anytime_interval(values[::-1], span=SIGNED) == (low, high)
    assert anytime_interval([-x for x in values], span=SIGNED) == pytest.approx((-high, -low))
    assert evidence_above(values, 0.25, span=SIGNED) == pytest.approx(
        evidence_below([-x for x in values], -0.25, span=SIGNED)
    )


def test_five_that_agree_reach_twenty_and_four_do_not():
    assert evidence_above([1.0] * 4, 0.5) < 20.0 <= evidence_above([1.0] * 5, 0.5)
    assert evidence_below([0.0] * 4, 0.5, span=SIGNED) < 20.0 <= evidence_below([0.0] * 5, 0.5, span=SIGNED)


def test_without_values_nothing_is_known():
    assert anytime_interval([]) == UNIT
    assert anytime_interval([], span=SIGNED) == SIGNED
    assert evidence_above([], 0.5) == evidence_below([], 0.5) == 1.0


@pytest.mark.parametrize(
    ("call", "where"),
    [
        (lambda: evidence_above([0.5, 1.5], 0.5), "values"),
        (lambda: evidence_below([math.nan], 0.5), "values"),
        (lambda: evidence_above([], 0.0), "mean"),
        (lambda: evidence_below([], 1.0), "mean"),
        (lambda: anytime_interval([2.0]), "values"),
        (lambda: anytime_interval([1.0], confidence=1.0), "confidence"),
    ],
)
def test_impossible_values_means_and_levels_are_refused(call, where):
    with pytest.raises(InvalidInputError, match=f"^{where}"):
        call()
