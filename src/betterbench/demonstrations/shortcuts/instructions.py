"""Test of whether complete instructions predict an outcome better than their single words and word pairs.

An outcome may depend on three or more words together, or on two words that occur together in too few demonstrations to
be tested as a pair. Testing complete instructions covers both cases. To avoid reporting a rule twice, demonstrations
are only compared if they agree in the words for which an association was already found.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from betterbench.demonstrations.shortcuts.association import Association, PermutationTest, codes_of, permutation_test

FEWEST_SAID = 2
"""Minimum number of demonstrations per instruction, because an instruction that occurs only once is not informative."""

_Ints = npt.NDArray[np.int64]
_Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class WholeTest:
    """Result of the test of complete instructions.

    Attributes:
        test: Association of the complete instruction with the outcome in all compared demonstrations, used to compute
            the smallest rule that the test would detect.
        beyond: Association among demonstrations that agree in the words for which an association was already found.
        share_told: Fraction of wrong guesses that are avoided if the outcome is guessed from the complete instruction
            instead of these words.
        rows: Indices of the demonstrations that were compared.
        instructions: Number of distinct instructions among them.
    """

    test: PermutationTest
    beyond: Association
    share_told: float
    rows: tuple[int, ...]
    instructions: int


def whole_test(
    instructions: Sequence[str], outcomes: Sequence[str], known: Sequence[str], draw: np.random.Generator
) -> WholeTest | None:
    """Test the association of complete instructions with an outcome. Return None if there is nothing to compare.

    Args:
        instructions: Instruction of each demonstration.
        outcomes: Outcome of each demonstration.
        known: Words in each demonstration's instruction for which an association was already found, as a string.
        draw: Random generator of the permutations.
    """
    times = Counter(instructions)
    rows = [i for i, text in enumerate(instructions) if times[text] >= FEWEST_SAID]
    texts, ends, strata = ([values[i] for i in rows] for values in (instructions, outcomes, known))
    if len(set(texts)) < 2 or len(set(ends)) < 2:
        return None
    test = permutation_test(texts, ends, draw)
    several = len(set(strata)) > 1
    beyond = permutation_test(texts, ends, draw, blocks=strata, within=True).found if several else test.found
    usual = _joint(*codes_of(strata), test.y, test.sizes[1])
    told = float(_avoided(_joint(test.x, test.sizes[0], test.y, test.sizes[1]), usual.max(axis=1).sum()))
    return WholeTest(test, beyond, told, tuple(rows), test.sizes[0])


def share_told(joint: _Ints) -> _Floats:
    """Return the fraction of wrong guesses that are avoided if the outcome is guessed from the category.

    A category consists of demonstrations with the same text, such as the same complete instruction.

    The baseline is to always guess the most frequent outcome. The outcome of each demonstration is guessed from the
    other demonstrations of its category (leave-one-out). Ties count as half right.

    Args:
        joint: (..., categories, outcomes) joint counts of one or more tables.

    Returns:
        Fraction for each table, shape (...).
    """
    return _avoided(joint, joint.sum(axis=-2).max(axis=-1))


def _joint(x: _Ints, nx: int, y: _Ints, ny: int) -> _Ints:
    return np.asarray(np.bincount(x * ny + y, minlength=nx * ny).reshape(nx, ny), dtype=np.int64)


def _avoided(joint: _Ints, usual: _Ints) -> _Floats:
    """Return the fraction of wrong guesses that are avoided if the outcome is guessed from the category.

    The baseline is a guess that is right in ``usual`` demonstrations.
    """
    ranked = np.sort(joint, axis=-1)
    most, second = ranked[..., -1:], ranked[..., -2:-1]
    rest = np.where(
        (joint == most) & (second < most), second, most
    )  # count of the most frequent other outcome in the category
    others = joint - 1
    right = np.where(others > rest, 1.0, np.where((others == rest) & (others > 0), 0.5, 0.0))
    wrong = joint.sum(axis=(-2, -1)) - usual
    avoided: _Floats = ((joint * right).sum(axis=(-2, -1)) - usual) / np.maximum(wrong, 1)
    return np.where(wrong > 0, avoided, 0.0)
