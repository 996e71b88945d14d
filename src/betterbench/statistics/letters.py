"""Compact letter display: many pairwise verdicts as one short text per item."""

from __future__ import annotations

from collections.abc import Sequence
from string import ascii_letters

from betterbench.errors import InvalidInputError


def compact_letters(different: Sequence[Sequence[bool]]) -> tuple[str, ...]:
    """Return letters such that two items share one exactly when they are not told apart.

    This is the insert-and-absorb algorithm (Piepho, Journal of Computational and Graphical Statistics 13, 2004,
    456-466): all items begin with one letter; for every pair that differs, each letter that both carry is split into
    one without the first and one without the second, and a letter whose items all carry another one is dropped.

    Args:
        different: Whether item ``i`` and item ``j`` were told apart, shape (n, n), symmetric, False on the diagonal.

    Returns:
        One text per item, its letters in alphabetical order. Letters are named in the order of the first item that
        carries them, so the first item always carries "a"; after "Z" they go on with "a1".
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
    """Return the groups that are not inside another one."""
    distinct = list(dict.fromkeys(groups))
    return [g for g in distinct if not any(g < other for other in distinct)]


def _letter(number: int) -> str:
    """Return the name of a letter."""
    turn, place = divmod(number, len(ascii_letters))
    return ascii_letters[place] + (str(turn) if turn else "")


def _check(different: Sequence[Sequence[bool]]) -> None:
    """Refuse an input that is not a matrix of pairwise verdicts."""
    n = len(different)
    if any(len(row) != n for row in different):
        raise InvalidInputError("different", "the matrix is not square", "Give one row and one column per item")
    for i in range(n):
        if different[i][i]:
            raise InvalidInputError(f"different[{i}][{i}]", "an item differs from itself", "Leave the diagonal False")
        for j in range(i):
            if different[i][j] != different[j][i]:
                problem = f"it is not what different[{j}][{i}] is"
                raise InvalidInputError(f"different[{i}][{j}]", problem, "Give a symmetric matrix")
