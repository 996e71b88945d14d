"""Exact tests of counts against guessing."""

from __future__ import annotations

import pytest
import scipy

from betterbench.errors import InvalidInputError
from betterbench.statistics import guessing_p


def test_guesses_with_different_chances_are_counted_exactly():
    assert guessing_p(0, []) == 1.0
    assert guessing_p(0, [0.3, 0.9]) == 1.0
    assert guessing_p(2, [0.3, 0.9]) == pytest.approx(0.27)
    assert guessing_p(1, [0.3, 0.9]) == pytest.approx(1 - 0.7 * 0.1)
    assert guessing_p(7, [0.25] * 10) == pytest.approx(1 - scipy.stats.binom.cdf(6, 10, 0.25))
    assert guessing_p(1, [0.0]) == 0.0
    assert guessing_p(3, [1.0] * 3) == 1.0


@pytest.mark.parametrize(("right", "chances"), [(1, []), (-1, [0.5]), (1, [1.5])])
def test_impossible_counts_and_chances_of_guesses_are_refused(right, chances):
    with pytest.raises(InvalidInputError):
        guessing_p(right, chances)
