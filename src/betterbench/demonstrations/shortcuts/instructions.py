"""Test of complete instructions: their information about an outcome beyond single words and word pairs.

Three or more words may determine an outcome together, or two words in too few demonstrations to test the pair. A test
of the complete instruction covers both. If words or pairs already determine an outcome, demonstrations are compared
only if they agree in these words, so that no rule is found twice.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from betterbench.demonstrations.shortcuts.association import Association, PermutationTest, codes_of, permutation_test

FEWEST_SAID = 2
"""Minimum number of demonstrations per instruction; an instruction that occurs once carries no information."""

_Ints = npt.NDArray[np.int64]
_Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class WholeTest:
    """The test of complete instructions against an outcome.

    Attributes:
        test: The unconditional association, with which planted rules are compared.
        beyond: The association among demonstrations that agree in the words already found.
        share_told: Fraction of the errors made by the best guess from these words that the complete instruction avoids.
        rows: Indices of the demonstrations that were compared.
        instructions: Number of different instructions among them.
    """

    test: PermutationTest
    beyond: Association
    share_told: float
    rows: tuple[int, ...]
    instructions: int


def whole_test(
    instructions: Sequence[str], outcomes: Sequence[str], known: Sequence[str], draw: np.random.Generator
) -> WholeTest | None:
    """Return the test of complete instructions against an outcome, or None if there is nothing to compare.

    Args:
        instructions: Each demonstration's instruction.
        outcomes: Each demonstration's outcome.
        known: For each demonstration, the words with a finding that it contains, as a string.
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
    """Return the fraction of errors made by guessing the most frequent outcome that guessing by category avoids.

    Each demonstration is guessed from the others of its category (leave-one-out); ties count as half right.

    Args:
        joint: (..., categories, outcomes) how often each category goes with each outcome, in one table or in many.

    Returns:
        The share of each table, shape (...).
    """
    return _avoided(joint, joint.sum(axis=-2).max(axis=-1))


def _joint(x: _Ints, nx: int, y: _Ints, ny: int) -> _Ints:
    return np.asarray(np.bincount(x * ny + y, minlength=nx * ny).reshape(nx, ny), dtype=np.int64)


def _avoided(joint: _Ints, usual: _Ints) -> _Floats:
    """Return the share of errors avoided by guesses from the category; other guesses are right ``usual`` times."""
    ranked = np.sort(joint, axis=-1)
    most, second = ranked[..., -1:], ranked[..., -2:-1]
    rest = np.where((joint == most) & (second < most), second, most)  # most frequent other outcome of the category
    others = joint - 1
    right = np.where(others > rest, 1.0, np.where((others == rest) & (others > 0), 0.5, 0.0))
    wrong = joint.sum(axis=(-2, -1)) - usual
    avoided: _Floats = ((joint * right).sum(axis=(-2, -1)) - usual) / np.maximum(wrong, 1)
    return np.where(wrong > 0, avoided, 0.0)
