"""Compact letter display of significant pairwise differences."""

from __future__ import annotations

from collections.abc import Sequence
from string import ascii_letters

from betterbench.errors import InvalidInputError


def compact_letters(different: Sequence[Sequence[bool]]) -> tuple[str, ...]:
    """Return letters for each item such that two items share a letter if and only if they do not differ significantly.

    This is the insert-and-absorb algorithm (Piepho, Journal of Computational and Graphical Statistics 13, 2004,
    456-466): all items begin with one letter. For every pair that differs, each shared letter is split into a letter
    without the first item and a letter without the second. A letter is dropped if another letter covers all its items.

    Args:
        different: Whether items ``i`` and ``j`` differ significantly, shape (n, n), symmetric, False on the diagonal.

    Returns: One string per item, with its letters in alphabetical order. Letters are assigned in the order of the first
        item that has them, so the first item always has "a". After "Z" comes "a1".
    """
    n = len(different)
    _check(different)
    groups = [frozenset(range(n))] if n else []
    for i in range(n):
        for j in range(i + 1, n):
            if different[i][j]:
                split = [g - {k} for g in groups if {i, j} <= g for k in (i, j)]
                groups = _absorbed([g for g in groups if not {i, j} <= g] + split)
    ordered = sorted(groups, key=sorted)
    return tuple("".join(_letter(k) for k, group in enumerate(ordered) if i in group) for i in range(n))


def _absorbed(groups: Sequence[frozenset[int]]) -> list[frozenset[int]]:
    """Return the groups that are not subsets of another group."""
    distinct = list(dict.fromkeys(groups))
    return [g for g in distinct if not any(g < other for other in distinct)]


def _letter(number: int) -> str:
    turn, place = divmod(number, len(ascii_letters))
    return ascii_letters[place] + (str(turn) if turn else "")


def _check(different: Sequence[Sequence[bool]]) -> None:
    """Raise InvalidInputError if the input is not a matrix of pairwise verdicts."""
    n = len(different)
    if any(len(row) != n for row in different):
        raise InvalidInputError("different", "the matrix is not square", "Give one row and one column per item")
    for i in range(n):
        if different[i][i]:
            raise InvalidInputError(
                f"different[{i}][{i}]", "True would mean that an item differs from itself", "Leave the diagonal False"
            )
        for j in range(i):
            if different[i][j] != different[j][i]:
                problem = f"it differs from different[{j}][{i}]"
                raise InvalidInputError(f"different[{i}][{j}]", problem, "Give a symmetric matrix")
