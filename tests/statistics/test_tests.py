"""Laws and published values of the hypothesis tests."""

from __future__ import annotations

import math

import numpy as np
import pytest
import scipy
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.looping import each

from betterbench.errors import InvalidInputError
from betterbench.statistics import (
    PairedTable,
    Rate,
    barnard_p,
    barnard_p_values,
    boschloo_p,
    chance_p,
    fisher_p,
    holm,
    mcnemar_p,
)


@each(
    "k, p",
    [(13, 0.26), (14, 0.12), (7, 0.26), (10, 1.0), (9, 0.82), (6, 0.12), (19, 4e-5), (1, 4e-5), (20, 1.9e-6)],
)
def test_the_coffee_table_against_guessing(k: int, p: float) -> None:
    assert chance_p(Rate(k, 20), chance=0.5) == pytest.approx(p, rel=0.05)


def test_chance_level_is_used() -> None:
    assert chance_p(Rate(5, 20), chance=0.25) == pytest.approx(1.0)
    assert chance_p(Rate(12, 20), chance=0.25) < 1e-3
    assert chance_p(Rate(0, 0), chance=0.5) == 1.0
    with pytest.raises(InvalidInputError, match="chance"):
        chance_p(Rate(1, 2), chance=50.0)


@pytest.mark.parametrize(("novel", "seen", "p"), [(1, 21, 2.2e-4), (3, 23, 2.2e-3), (0, 21, 2.4e-5)])
def test_the_composition_table_is_solid(novel: int, seen: int, p: float) -> None:
    rates = Rate(novel, 20), Rate(seen, 40)
    assert fisher_p(*rates) == pytest.approx(p, rel=0.03)
    assert boschloo_p(*rates) <= fisher_p(*rates)
    assert barnard_p(*rates) < 2.5 * p


def test_refspatial_cells() -> None:
    assert fisher_p(Rate(48, 100), Rate(38, 100)) == pytest.approx(0.20, abs=0.005)
    assert barnard_p(Rate(41, 100), Rate(9, 100)) == pytest.approx(2e-7, rel=0.3)


def test_published_differences_that_carry_less_than_they_seem_to() -> None:
    assert fisher_p(Rate(441, 1321), Rate(422, 1321)) == pytest.approx(0.46, abs=0.005)  # EgoPlan 33.38 to 31.95
    assert fisher_p(Rate(1948, 2000), Rate(1925, 2000)) == pytest.approx(0.047, abs=5e-4)  # LIBERO 97.4 to 96.25


@pytest.mark.parametrize(("k", "counterpart"), [(0, 4), (2, 8), (5, 12), (10, 17), (15, 20)])
def test_first_significant_counterpart_of_twenty_trials(k: int, counterpart: int) -> None:
    assert barnard_p(Rate(counterpart, 20), Rate(k, 20)) <= 0.05 < barnard_p(Rate(counterpart - 1, 20), Rate(k, 20))


def test_a_single_table_agrees_with_all_tables_and_with_scipy() -> None:
    table = barnard_p_values(12)
    for i, j in [(0, 3), (1, 7), (5, 6), (12, 2), (4, 4), (0, 0)]:
        p = barnard_p(Rate(i, 12), Rate(j, 12))
        assert p == pytest.approx(table[i, j] if (i, j) != (0, 0) else 1.0, abs=5e-4)
    for (i, n), (j, m) in [((1, 7), (6, 9)), ((0, 5), (4, 6)), ((3, 20), (12, 15))]:
        theirs = scipy.stats.barnard_exact([[i, j], [n - i, m - j]], n=128).pvalue
        assert barnard_p(Rate(i, n), Rate(j, m)) == pytest.approx(theirs, abs=1e-4)
        theirs = scipy.stats.boschloo_exact([[i, j], [n - i, m - j]], n=128).pvalue
        assert boschloo_p(Rate(i, n), Rate(j, m)) == pytest.approx(theirs, abs=1e-4)


@pytest.mark.parametrize("rate", [0.03, 0.3, 0.5, 0.77])
def test_false_alarms_stay_below_the_level(rate: float) -> None:
    n = 15
    mass = scipy.stats.binom.pmf(np.arange(n + 1), n, rate)
    p_values = barnard_p_values(n)
    for alpha in (0.01, 0.05, 0.2):
        assert mass @ (p_values <= alpha) @ mass <= alpha + 1e-4


@settings(max_examples=10, deadline=None)
@given(st.integers(1, 12), st.integers(1, 12), st.data())
def test_tests_do_not_care_about_order_or_about_naming_success(n: int, m: int, data: st.DataObject) -> None:
    a, b = Rate(data.draw(st.integers(0, n)), n), Rate(data.draw(st.integers(0, m)), m)
    flipped = Rate(n - a.k, n), Rate(m - b.k, m)
    for test in (barnard_p, boschloo_p, fisher_p):
        p = test(a, b)
        assert 0.0 <= p <= 1.0
        assert test(b, a) == pytest.approx(p, abs=1e-6)
        assert test(*flipped) == pytest.approx(p, abs=1e-6)


def test_nothing_to_tell_apart_gives_one() -> None:
    for test in (barnard_p, boschloo_p, fisher_p):
        assert test(Rate(0, 20), Rate(0, 20)) == test(Rate(5, 5), Rate(9, 9)) == test(Rate(0, 0), Rate(3, 4)) == 1.0


def test_mcnemar_counts_discordant_pairs_only() -> None:
    assert mcnemar_p(PairedTable(0, 6, 0, 0)) == pytest.approx(2 / 64)
    assert mcnemar_p(PairedTable(9, 0, 6, 50)) == pytest.approx(2 / 64)
    assert mcnemar_p(PairedTable(1, 12, 2, 5)) == pytest.approx(2 * (1 + 14 + 91) / 2**14)
    assert mcnemar_p(PairedTable(7, 3, 3, 7)) == mcnemar_p(PairedTable(5, 0, 0, 5)) == 1.0


@given(st.integers(0, 60), st.integers(0, 60))
def test_mcnemar_is_the_fair_binomial_test(b: int, c: int) -> None:
    expected = scipy.stats.binomtest(b, b + c, 0.5).pvalue if b + c else 1.0
    assert mcnemar_p(PairedTable(0, b, c, 0)) == pytest.approx(expected, rel=1e-9)


def test_pairs_are_counted() -> None:
    outcomes = [(True, True), (True, False), (True, False), (False, True), (False, False), (False, False)]
    assert PairedTable.from_outcomes(outcomes) == PairedTable(1, 2, 1, 2)
    with pytest.raises(InvalidInputError, match="only_second: -1"):
        PairedTable(0, 0, -1, 0)


def test_holm_by_hand() -> None:
    # sorted .005 .01 .03 .04 -> x4 .02, x3 .03, x2 .06, x1 .04 raised to .06
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx((0.03, 0.06, 0.06, 0.02))
    assert holm([0.5, 0.9]) == (1.0, 1.0)
    assert holm([]) == ()


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=20))
def test_holm_keeps_order_and_lies_between_raw_and_bonferroni(p_values: list[float]) -> None:
    adjusted = holm(p_values)
    for p, q in zip(p_values, adjusted, strict=True):
        assert p <= q <= min(1.0, p * len(p_values)) or math.isclose(q, p * len(p_values)) or q == max(adjusted)
        assert q >= p
    order = np.argsort(p_values, kind="stable")
    assert np.all(np.diff(np.array(adjusted)[order]) >= 0.0)
    assert min(adjusted) == pytest.approx(min(1.0, len(p_values) * min(p_values)))


@pytest.mark.parametrize("bad", [-0.1, 1.1, float("nan")])
def test_holm_refuses_what_is_no_probability(bad: float) -> None:
    with pytest.raises(InvalidInputError, match=r"p_values\[1\]"):
        holm([0.5, bad])
