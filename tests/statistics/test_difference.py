"""Laws and published values of differences of rates."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from betterbench.errors import InvalidInputError
from betterbench.statistics import (
    PairedTable,
    Rate,
    delta_success_rate,
    newcombe_difference,
    newcombe_paired_difference,
    paired_bootstrap,
    wilson_interval,
)

RATES = st.integers(1, 60).flatmap(lambda n: st.builds(Rate, st.integers(0, n), st.just(n)))
TABLES = st.builds(PairedTable, *[st.integers(0, 30)] * 4)


@pytest.mark.parametrize(
    ("novel", "seen", "low", "high"),
    [(1, 21, -0.626, -0.236), (3, 23, -0.596, -0.165), (0, 21, -0.671, -0.305)],
)
def test_newcombe_of_the_composition_table(novel: int, seen: int, low: float, high: float) -> None:
    difference = newcombe_difference(Rate(novel, 20), Rate(seen, 40))
    assert (difference.low, difference.high) == pytest.approx((low, high), abs=6e-4)
    assert difference.excludes_zero


def test_newcombe_of_the_egoplan_drop_does_not_exclude_zero() -> None:
    difference = newcombe_difference(Rate(441, 1321), Rate(422, 1321))
    assert (difference.low_pp, difference.high_pp) == pytest.approx((-2.1, 5.0), abs=0.05)
    assert not difference.excludes_zero


@pytest.mark.parametrize(("novel", "seen", "printed"), [(1, (12, 9), -47.5), (3, (15, 8), -42.5), (0, (13, 8), -52.5)])
def test_delta_success_rate_of_the_composition_table(novel: int, seen: tuple[int, int], printed: float) -> None:
    difference = delta_success_rate(Rate(novel, 20), [Rate(k, 20) for k in seen])
    assert difference.value_pp == pytest.approx(printed)
    assert difference.low_pp < printed < difference.high_pp < 0.0


@given(RATES, RATES)
def test_newcombe_is_antisymmetric_and_holds_its_value(a: Rate, b: Rate) -> None:
    there, back = newcombe_difference(a, b), newcombe_difference(b, a)
    assert there.value is not None
    assert back.value is not None
    assert (there.value, there.low, there.high) == pytest.approx((-back.value, -back.high, -back.low), abs=1e-12)
    assert -1.0 <= there.low <= there.value <= there.high <= 1.0


@given(RATES, RATES)
def test_delta_against_one_seen_condition_is_newcombe(a: Rate, b: Rate) -> None:
    delta, newcombe = delta_success_rate(a, [b]), newcombe_difference(a, b)
    assert (delta.value, delta.low, delta.high) == (newcombe.value, newcombe.low, newcombe.high)


def test_delta_weighs_conditions_and_not_trials() -> None:
    assert delta_success_rate(Rate(0, 10), [Rate(10, 10), Rate(0, 1000)]).value == -0.5


@pytest.mark.parametrize(("p1", "p2"), [(0.1, 0.1), (0.5, 0.5), (0.9, 0.5), (0.95, 0.05)])
def test_newcombe_covers_the_true_difference(p1: float, p2: float) -> None:
    from scipy import stats

    n = 20
    mass = np.outer(stats.binom.pmf(range(n + 1), n, p1), stats.binom.pmf(range(n + 1), n, p2))
    covered = 0.0
    for i in range(n + 1):
        for j in range(n + 1):
            d = newcombe_difference(Rate(i, n), Rate(j, n))
            covered += mass[i, j] * (d.low <= p1 - p2 <= d.high)
    assert covered >= 0.93


def test_paired_newcombe_of_the_published_example() -> None:
    # Newcombe, Statistics in Medicine 17, 1998, 2635-2650: 36, 12, 2, 0 gives 0.0569 to 0.3404 by method 10.
    difference = newcombe_paired_difference(PairedTable(36, 12, 2, 0))
    assert (difference.value, difference.low, difference.high) == pytest.approx((0.2, 0.0569, 0.3404), abs=5e-5)


@given(TABLES)
def test_paired_newcombe_is_antisymmetric(table: PairedTable) -> None:
    there = newcombe_paired_difference(table)
    swapped = PairedTable(table.both, table.only_second, table.only_first, table.neither)
    back = newcombe_paired_difference(swapped)
    assert (there.low, there.high) == pytest.approx((-back.high, -back.low), abs=1e-12)
    if table.n:
        assert there.value is not None
        assert there.low <= there.value <= there.high


def test_pairs_that_agree_make_the_paired_interval_narrower() -> None:
    paired = newcombe_paired_difference(PairedTable(20, 4, 1, 15))
    independent = newcombe_difference(Rate(24, 40), Rate(21, 40))
    assert paired.value == pytest.approx(independent.value)
    assert paired.high - paired.low < 0.7 * (independent.high - independent.low)


def test_without_trials_nothing_is_known() -> None:
    for difference in (
        newcombe_difference(Rate(0, 0), Rate(1, 2)),
        delta_success_rate(Rate(1, 2), [Rate(1, 2), Rate(0, 0)]),
        newcombe_paired_difference(PairedTable(0, 0, 0, 0)),
        paired_bootstrap([], [], generator=np.random.default_rng(0)),
    ):
        assert (difference.value, difference.low, difference.high) == (None, -1.0, 1.0)
        assert difference.value_pp is None


def test_delta_needs_something_to_compare_with() -> None:
    with pytest.raises(InvalidInputError, match="seen: expected the rate of at least one"):
        delta_success_rate(Rate(1, 2), [])


def test_bootstrap_repeats_with_its_seed_whatever_the_order() -> None:
    rng = np.random.default_rng(5)
    first, second = rng.integers(0, 2, 60).tolist(), rng.integers(0, 2, 60).tolist()
    strata, clusters = [f"task{i % 3}" for i in range(60)], [f"seed{i // 6}" for i in range(60)]
    shuffled = rng.permutation(60).tolist()

    def interval(order: list[int]) -> object:
        return paired_bootstrap(
            [first[i] for i in order],
            [second[i] for i in order],
            generator=np.random.default_rng(1),
            strata=[strata[i] for i in order],
            clusters=[clusters[i] for i in order],
        )

    assert interval(list(range(60))) == interval(shuffled)


def test_bootstrap_agrees_with_the_exact_bootstrap_distribution() -> None:
    from scipy import stats

    # 40 pairs that are all 0 or +1 resample to a binomial with rate 14/40.
    difference = paired_bootstrap([1] * 14 + [0] * 26, [0] * 40, generator=np.random.default_rng(0))
    low, high = stats.binom.ppf([0.025, 0.975], 40, 14 / 40) / 40
    assert difference.value == pytest.approx(0.35)
    assert (difference.low, difference.high) == pytest.approx((low, high), abs=0.026)


def test_bootstrap_keeps_strata_and_draws_whole_clusters() -> None:
    first, second = [1.0] * 20 + [0.0] * 20, [0.0] * 40
    names = ["a"] * 20 + ["b"] * 20
    rng = np.random.default_rng(0)
    fixed = paired_bootstrap(first, second, generator=rng, strata=names)
    assert fixed.low == fixed.high == fixed.value == 0.5
    clustered = paired_bootstrap(first, second, generator=rng, clusters=names)
    assert (clustered.low, clustered.high) == (0.0, 1.0)
    free = paired_bootstrap(first, second, generator=rng)
    assert 0.3 <= free.low < 0.4
    assert 0.6 < free.high <= 0.7


def test_bootstrap_refuses_what_does_not_pair_up() -> None:
    rng = np.random.default_rng(0)
    with pytest.raises(InvalidInputError, match="cannot be paired"):
        paired_bootstrap([1], [1, 0], generator=rng)
    with pytest.raises(InvalidInputError, match="second: a score is not between"):
        paired_bootstrap([1], [float("nan")], generator=rng)
    with pytest.raises(InvalidInputError, match="strata: 1 names for 2 pairs"):
        paired_bootstrap([1, 0], [1, 0], generator=rng, strata=["a"])
    with pytest.raises(InvalidInputError, match="resamples"):
        paired_bootstrap([1], [1], generator=rng, resamples=0)


def test_json_form_of_a_difference() -> None:
    form = newcombe_difference(Rate(1, 20), Rate(0, 20)).to_json()
    assert form["value"] == 0.05
    assert form["low"] == pytest.approx(
        0.05 - ((0.05 - wilson_interval(1, 20).low) ** 2 + 0.161125**2) ** 0.5, abs=1e-4
    )
