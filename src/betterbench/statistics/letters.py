"""Compact letter display: items without a common letter differ significantly from each other."""

from __future__ import annotations

from collections.abc import Sequence
from string import ascii_letters

from betterbench.errors import InvalidInputError


def compact_letters(different: Sequence[Sequence[bool]]) -> tuple[str, ...]:
    """Assign letters to items such that two items share a letter if and only if they do not differ significantly.

    This is the insert-and-absorb algorithm (Piepho, Journal of Computational and Graphical Statistics 13, 2004,
    456-466). At first, all items have the same letter. For every pair that differs, each letter that the two items
    share is split into a letter without the first item and a letter without the second item. A letter is dropped if
    another letter covers all its items.

    Args:
        different: Whether items ``i`` and ``j`` differ significantly (n, n). Symmetric, with False on the diagonal.

    Returns:
        One string per item, with its letters in alphabetical order. Letters are assigned in the order of the first item
        that has them, so the first item always has "a". The letter after "Z" is "a1".
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
    """Return the groups that are not subsets of another group, without duplicates."""
    distinct = list(dict.fromkeys(groups))
    return [g for g in distinct if not any(g < other for other in distinct)]


def _letter(number: int) -> str:
    turn, place = divmod(number, len(ascii_letters))
    return ascii_letters[place] + (str(turn) if turn else "")


def _check(different: Sequence[Sequence[bool]]) -> None:
    """Raise InvalidInputError if the argument is not a symmetric matrix with False on its diagonal."""
    n = len(different)
    if any(len(row) != n for row in different):
        raise InvalidInputError("different", "the matrix is not square", "Pass one row and one column for each item")
    for i in range(n):
        if different[i][i]:
            raise InvalidInputError(
                f"different[{i}][{i}]", "True would mean that an item differs from itself", "Leave the diagonal False"
            )
        for j in range(i):
            if different[i][j] != different[j][i]:
                problem = f"it differs from different[{j}][{i}]"
                raise InvalidInputError(f"different[{i}][{j}]", problem, "Use a symmetric matrix")
