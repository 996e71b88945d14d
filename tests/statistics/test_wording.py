"""Numbers are written one way everywhere."""

from __future__ import annotations

import pytest

from betterbench.statistics import Rate
from betterbench.statistics.wording import counted, p_text, points
from betterbench.wording import listed, plural


@pytest.mark.parametrize(
    ("p", "text"),
    [
        (None, ""),
        (1.0, "p = 1.00"),
        (0.265, "p = 0.27"),
        (0.0474, "p = 0.047"),
        (0.0078125, "p = 0.0078"),
        (9e-4, "p < 0.001"),
    ],
)
def test_a_p_value_has_two_digits_that_count(p, text):
    assert p_text(p) == text


def test_halves_round_up_and_minus_is_a_minus():
    assert points(-0.12345, 2) == "\N{MINUS SIGN}12.35"
    assert points(-0.0004) == "0.0"
    assert points(0.5, 0) == "50"


def test_counts_and_lists():
    assert counted(Rate(45, 60)) == "45/60 (75.0 %)"
    assert counted(Rate(0, 0)) == "0/0"
    assert [listed(["a", "b", "c"][:n]) for n in range(4)] == ["", "a", "a and b", "a, b and c"]
    assert (plural(1, "trial"), plural(2, "trial"), plural(0, "entry", "entries")) == (
        "1 trial",
        "2 trials",
        "0 entries",
    )
