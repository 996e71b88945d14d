"""Laws of the compact letter display."""

from __future__ import annotations

import itertools
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from betterbench.errors import InvalidInputError
from betterbench.statistics import compact_letters


def matrix(n: int, pairs: set[tuple[int, int]]) -> list[list[bool]]:
    return [[(i, j) in pairs or (j, i) in pairs for j in range(n)] for i in range(n)]


@st.composite
def matrices(draw: st.DrawFn) -> list[list[bool]]:
    n = draw(st.integers(0, 9))
    return matrix(n, {pair for pair in itertools.combinations(range(n), 2) if draw(st.booleans())})


def carried(text: str) -> set[str]:
    return set(re.findall(r"[A-Za-z]\d*", text))


@given(matrices())
def test_two_items_share_a_letter_exactly_when_they_are_not_told_apart(different: list[list[bool]]) -> None:
    letters = [carried(text) for text in compact_letters(different)]
    assert all(letters)
    for i, j in itertools.combinations(range(len(letters)), 2):
        assert bool(letters[i] & letters[j]) is not different[i][j]


@given(matrices())
def test_no_letter_is_part_of_another_and_all_are_named_in_order(different: list[list[bool]]) -> None:
    texts = compact_letters(different)
    names = sorted(set().union(*(carried(t) for t in texts)) if texts else set())
    groups = [{i for i, text in enumerate(texts) if name in carried(text)} for name in names]
    assert not any(a <= b for a, b in itertools.permutations(groups, 2))
    assert names == list("abcdefghijklmnopqrstuvwxyz")[: len(names)]  # 9 items carry at most 27 letters, 3 to the 9/3
    assert [min(g) for g in groups] == sorted(min(g) for g in groups)


def test_examples_as_they_are_printed() -> None:
    assert compact_letters([]) == ()
    assert compact_letters(matrix(3, set())) == ("a", "a", "a")
    assert compact_letters(matrix(2, {(0, 1)})) == ("a", "b")
    assert compact_letters(matrix(3, {(0, 2)})) == ("a", "ab", "b")
    assert compact_letters(matrix(4, {(0, 2), (0, 3), (1, 3)})) == ("a", "ab", "bc", "c")
    everyone = set(itertools.combinations(range(54), 2))
    assert compact_letters(matrix(54, everyone))[50:] == ("Y", "Z", "a1", "b1")


@pytest.mark.parametrize(
    ("different", "text"),
    [
        ([[False, True]], "not square"),
        ([[True]], "differs from itself"),
        ([[False, True], [False, False]], r"different\[1\]\[0\].*symmetric"),
    ],
)
def test_what_is_no_matrix_of_verdicts_is_refused(different: list[list[bool]], text: str) -> None:
    with pytest.raises(InvalidInputError, match=text):
        compact_letters(different)
