"""Agreement of two raters: Cohen's kappa."""

from __future__ import annotations

import pytest

from betterbench.errors import InvalidInputError
from betterbench.statistics import AgreementTable


def table(*rows, names=("accept", "fix", "reject")):
    return AgreementTable(names[: len(rows)], rows)


def test_a_worked_example():
    # 45/15/25/15 of 100: observed 0.6, expected 0.54 (Cohen's kappa 0.1304); by hand.
    found = table((45, 15), (25, 15))
    assert found.n == 100
    assert found.observed == pytest.approx(0.60)
    assert found.expected == pytest.approx(0.54)
    assert found.kappa == pytest.approx(0.06 / 0.46)


def test_the_interval_is_that_of_the_published_variance():
    # The example of Fleiss, Cohen and Everitt (1969): 200 items, kappa 0.429 with variance 0.002885.
    found = table((106, 10, 4), (22, 28, 10), (2, 12, 6))
    assert found.kappa == pytest.approx(0.429, abs=5e-4)
    low, high = found.interval()
    assert (high - low) / 2 / 1.959964 == pytest.approx(0.054, abs=5e-4)


def test_perfect_and_opposite_agreement():
    assert table((3, 0), (0, 4)).kappa == pytest.approx(1.0)
    assert table((0, 5), (5, 0)).kappa == pytest.approx(-1.0)
    assert table((2, 2), (2, 2)).kappa == pytest.approx(0.0)


def test_kappa_does_not_depend_on_the_order_of_raters_or_categories():
    rows = ((7, 2, 1), (3, 5, 0), (1, 1, 9))
    found = table(*rows)
    swapped = table(*zip(*rows, strict=True))
    order = (2, 0, 1)
    renamed = table(*(tuple(rows[i][j] for j in order) for i in order))
    assert swapped.kappa == pytest.approx(found.kappa)
    assert renamed.kappa == pytest.approx(found.kappa)
    assert renamed.interval() == pytest.approx(found.interval())


def test_without_a_difference_there_is_no_kappa():
    assert table((0, 0), (0, 0)).kappa is None
    assert table((8, 0), (0, 0)).kappa is None
    assert table((8, 0), (0, 0)).observed == 1.0
    assert table((8, 0), (0, 0)).interval() is None


def test_wrong_tables_are_refused():
    with pytest.raises(InvalidInputError, match="square"):
        AgreementTable(("a", "b"), ((1, 2),))
    with pytest.raises(InvalidInputError, match="negative"):
        table((1, -1), (0, 0))
    with pytest.raises(InvalidInputError, match="'maybe' is not a category"):
        AgreementTable.of_pairs([("accept", "maybe")], ("accept", "reject"))
    assert AgreementTable.of_pairs([("a", "b"), ("a", "a")], ("a", "b")).counts == ((1, 1), (0, 0))
