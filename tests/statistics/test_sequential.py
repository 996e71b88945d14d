"""Laws of the sequential tests: errors stay below the level under peeking, and power is what was promised."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.daily import others_slow

from betterbench.errors import InvalidInputError
from betterbench.statistics import EProcess, discordant_e_process, two_rate_e_process

PAIRS = st.lists(st.tuples(st.booleans(), st.booleans()), max_size=60)
BOTH = (two_rate_e_process, discordant_e_process)
REPEATS = 1000


def independent(a: float, b: float, n: int, repeats: int = REPEATS) -> npt.NDArray[np.bool_]:
    generator = np.random.default_rng([round(100 * a), round(100 * b), n])
    return generator.random((repeats, n, 2)) < (a, b)


def decided(process: Callable[..., EProcess], trials: npt.NDArray[np.bool_]) -> npt.NDArray[np.float64]:
    """Returns after how many pairs each experiment is decided by somebody who looks after every one; else infinity."""
    ends = [process(map(tuple, pairs.tolist())).decided_at for pairs in trials]
    return np.array([math.inf if end is None else end for end in ends])


@pytest.mark.parametrize("process", BOTH)
@pytest.mark.parametrize("rate", others_slow([0.1, 0.5, 0.9, 0.95], 4))
def test_looking_after_every_pair_keeps_false_alarms_below_the_level(process, rate) -> None:
    share = np.mean(decided(process, independent(rate, rate, 200)) <= 200)
    assert 0.005 <= share <= 0.05


@pytest.mark.parametrize(
    ("a", "b", "power"),
    others_slow([(0.5, 0.9, (46, 91, 100, 100)), (0.3, 0.6, (17, 45, 83, 99)), (0.5, 0.7, (8, 17, 37, 76))], 3),
)
def test_power_by_20_50_100_and_200_pairs(a, b, power) -> None:
    trials = independent(a, b, 200)
    ends, paired = decided(two_rate_e_process, trials), decided(discordant_e_process, trials)
    for n, points in zip((20, 50, 100, 200), power, strict=True):
        assert 100 * np.mean(ends <= n) == pytest.approx(points, abs=4.5)
        assert np.mean(paired <= n) >= np.mean(ends <= n) - 0.02


def test_pairs_that_agree_often_are_decided_sooner_by_the_discordant_ones() -> None:
    draws = np.random.default_rng(1).random((REPEATS, 50, 1))
    nested = draws < (0.5, 0.7)  # the second solves what the first solves, and more
    assert np.mean(decided(discordant_e_process, nested) <= 50) > 0.8
    assert np.mean(decided(two_rate_e_process, nested) <= 50) < 0.2


def test_pairs_that_never_agree_need_the_discordant_test() -> None:
    first = np.random.default_rng(2).random((REPEATS, 100)) < 0.5
    opposed = np.stack([first, ~first], axis=-1)
    assert np.mean(decided(discordant_e_process, opposed) <= 100) <= 0.05
    assert np.mean(decided(two_rate_e_process, opposed) <= 100) > 0.1  # what its docstring warns of


@given(st.floats(0.01, 0.99), PAIRS)
def test_no_pair_is_expected_to_raise_the_evidence_without_a_difference(rate, past) -> None:
    for process in BOTH:
        now = process(past).value
        mean = 0.0
        for pair in [(a, b) for a in (False, True) for b in (False, True)]:
            chance = math.prod(rate if success else 1.0 - rate for success in pair)
            mean += chance * process([*past, pair]).value
        assert mean <= now * (1.0 + 1e-9)


@given(PAIRS)
def test_sides_are_alike_and_the_p_value_never_rises(pairs) -> None:
    for process in BOTH:
        found, swapped = process(pairs), process([(b, a) for a, b in pairs])
        assert found.logs == pytest.approx(swapped.logs)
        p_values = [process(pairs[:k]).p_value for k in range(len(pairs) + 1)]
        assert p_values == sorted(p_values, reverse=True)
        assert p_values[0] == 1.0
        assert (found.decided_at is not None) == (found.p_value <= 0.05 * (1.0 + 1e-12))


def test_by_hand() -> None:
    # The bet on the leading side is 1/2, then 3/4, then 5/6: the evidence 1, 3/2, 5/2.
    found = discordant_e_process([(True, False), (True, True), (True, False), (True, False)])
    assert [math.exp(log) for log in found.logs] == pytest.approx([1.0, 1.0, 1.5, 2.5])
    assert (found.n, found.decided_at) == (4, None)
    assert found.value == pytest.approx(2.5)
    assert found.p_value == pytest.approx(0.4)
    assert discordant_e_process([(True, False)] * 7).decided_at == 7
    # After one pair (1, 0): rates 1.18/1.36 and 0.18/1.36, their mean 1/2.
    second = two_rate_e_process([(True, False)] * 2).value
    assert second == pytest.approx((1.18 / 1.36 / 0.5) ** 2)


def test_without_pairs_nothing_is_known_and_much_evidence_does_not_overflow() -> None:
    assert (discordant_e_process([]).value, discordant_e_process([]).p_value) == (1.0, 1.0)
    assert math.isfinite(discordant_e_process([(True, False)] * 5000).value)
    with pytest.raises(InvalidInputError, match="alpha"):
        two_rate_e_process([], alpha=5.0)
