"""Decimal rounding against the paper's tables."""

from __future__ import annotations

from decimal import ROUND_HALF_UP, Decimal
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from betterbench.errors import InvalidInputError
from betterbench.statistics import percent, round_half_up


@pytest.mark.parametrize(("value", "printed"), [("38.155", "38.16"), ("8.775", "8.78"), ("7.685", "7.69")])
def test_refspatial_means_need_half_up(value: str, printed: str) -> None:
    assert round_half_up(value, 2) == round_half_up(float(value), 2) == Decimal(printed)
    assert str(round_half_up(value, 2)) == printed


def test_float_noise_of_a_mean_does_not_decide() -> None:
    for cents in range(1000, 1200):
        mean = (cents / 100 + (cents + 1) / 100) / 2
        assert round_half_up(mean, 2) == Decimal(cents + 1) / 100


@given(st.decimals(-1_000_000, 1_000_000, places=6), st.integers(0, 5))
def test_agrees_with_the_decimal_module(value: Decimal, digits: int) -> None:
    expected = value.quantize(Decimal(1).scaleb(-digits), rounding=ROUND_HALF_UP)
    assert round_half_up(value, digits) == expected
    assert round_half_up(float(value), digits) == expected


def test_signs_and_sizes() -> None:
    assert str(round_half_up(-0.5, 0)) == "-1"
    assert str(round_half_up(-0.04, 1)) == "0.0"
    assert str(round_half_up(Fraction(2, 3), 3)) == "0.667"
    assert round_half_up(10**40, 2) == Decimal(10**40)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), "7,685", Decimal("NaN")])
def test_what_is_no_number_is_refused(value: float | str | Decimal) -> None:
    with pytest.raises(InvalidInputError, match="not a finite number"):
        round_half_up(value, 2)


def test_percentages_are_exact() -> None:
    assert str(percent(1, 3)) == "33.3"
    assert str(percent(1, 8, digits=0)) == "13"
    assert str(percent(484, 1314, digits=2)) == "36.83"
    assert percent(0, 0) is None
    with pytest.raises(InvalidInputError, match="digits"):
        percent(1, 3, digits=-1)
