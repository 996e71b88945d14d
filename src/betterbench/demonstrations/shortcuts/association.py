"""Mutual information between two categorical variables, with a permutation test."""

from __future__ import annotations

import math
from collections.abc import Hashable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

PERMUTATIONS = 9999
"""Number of permutations per test.

The smallest possible p-value is 1 / 10,000, which is still significant after a correction for a hundred tests.
"""
_CHUNK = 2_000_000
"""Maximum number of values that are permuted in one batch, to bound the memory."""

_LOW_BITS = 11
"""Number of low bits of a raw 64-bit draw that are not used for a random number in [0, 1)."""

_Ints = npt.NDArray[np.int64]
_Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Association:
    """Strength and significance of the association between two categorical variables.

    Attributes:
        bits: Mutual information [bit].
        expected_bits: Mean mutual information over the permutations, i.e. the value expected by chance [bit].
        strength: 1 if one variable determines the other, 0 if the association is not above chance: (mutual information
            - expected mutual information) / (smaller of the two entropies - expected mutual information).
        p_value: Fraction of the permutations that have at least as much mutual information as the data. The data itself
            counts as one of the permutations.
        n: Number of observations.
    """

    bits: float
    expected_bits: float
    strength: float
    p_value: float
    n: int


def codes_of(values: Sequence[Hashable]) -> tuple[_Ints, int]:
    """Return the index of each value among the sorted distinct values, and the number of distinct values."""
    order = {value: i for i, value in enumerate(sorted(set(values), key=str))}
    return np.array([order[value] for value in values], dtype=np.int64), len(order)


def entropy_bits(counts: _Floats) -> float:
    """Return the entropy [bit] of the distribution that is proportional to the given counts."""
    shares = counts[counts > 0] / counts.sum()
    return max(0.0, float(-(shares * np.log2(shares)).sum()))


@dataclass(frozen=True, slots=True)
class PermutationTest:
    """Permutation test of one question: the observed values, and the mutual information under permutations.

    Attributes:
        x: (n,) code of the first variable's value in each observation.
        y: (n,) code of the second variable's value in each observation.
        sizes: Number of distinct values of the first variable, and of the second.
        block: (n,) index of the demonstration that each observation belongs to.
        within: Whether the values of the first variable are permuted within each demonstration.
        null: (PERMUTATIONS,) mutual information of each permutation [bit].
        found: Association found in the data.
    """

    x: _Ints
    y: _Ints
    sizes: tuple[int, int]
    block: _Ints
    within: bool
    null: _Floats
    found: Association


def association(
    first: Sequence[Hashable],
    second: Sequence[Hashable],
    draw: np.random.Generator,
    *,
    blocks: Sequence[Hashable] | None = None,
    within: bool = False,
) -> Association:
    """Test two categorical variables for an association.

    Args:
        first: Value of the first variable in each observation.
        second: Value of the second variable in each observation, as many as in ``first``.
        draw: Random generator of the permutations.
        blocks: Demonstration that each observation belongs to. Without ``within``, the first variable's values are
            permuted between complete demonstrations, so that repetitions in one demonstration are not counted as
            evidence. All observations of a demonstration must then have the same first value.
        within: Whether to permute the first variable's values within each demonstration instead, for questions about
            the steps of a demonstration.
    """
    return permutation_test(first, second, draw, blocks=blocks, within=within).found


def permutation_test(
    first: Sequence[Hashable],
    second: Sequence[Hashable],
    draw: np.random.Generator,
    *,
    blocks: Sequence[Hashable] | None = None,
    within: bool = False,
) -> PermutationTest:
    """Test two variables like :func:`association`, but also return the observed values and all permutations."""
    x, nx = codes_of(first)
    y, ny = codes_of(second)
    n = len(x)
    joint = np.bincount(x * ny + y, minlength=nx * ny).reshape(nx, ny).astype(np.float64)
    hx, hy = entropy_bits(joint.sum(axis=1)), entropy_bits(joint.sum(axis=0))
    bits = max(0.0, hx + hy - entropy_bits(joint.ravel()))
    smaller = min(hx, hy)
    block = _grouped(blocks, n)
    if smaller <= 0.0:
        nothing = Association(0.0, 0.0, 0.0, 1.0, n)
        return PermutationTest(x, y, (nx, ny), block, within, np.zeros(PERMUTATIONS), nothing)
    found = _permuted_bits((x, y), (nx, ny), draw, block, within=within)
    expected = float(found.mean())
    at_least = int((found >= bits - 1e-9).sum())
    room = smaller - expected
    strength = (bits - expected) / room if room > 1e-9 else 0.0
    result = Association(
        round(bits, 6),
        round(expected, 6),
        round(min(1.0, max(0.0, strength)), 6),
        (1 + at_least) / (1 + PERMUTATIONS),
        n,
    )
    return PermutationTest(x, y, (nx, ny), block, within, found, result)


def random_orders(draw: np.random.Generator, rows: int, n: int, block: _Ints | None = None) -> _Ints:
    """Return random permutations of the indices 0 to n - 1, one per row, as a (rows, n) array.

    The result is the same as ``np.argsort(draw.random((rows, n)), axis=1)``.

    If ``block`` is given, it contains the block of each index (n,). The blocks are then in ascending order in every
    row, and only the order within each block is random, as in ``np.argsort(draw.random((rows, n)) + block, axis=1)``.

    The random number of an index consists of the upper 53 bits of a raw draw of PCG64. For up to 2,048 indices, the
    block, the random number and the index are packed into one integer, in this order. Sorting these integers takes a
    fifth to three quarters of the CPU time of ``argsort``. The bits of the block displace the lowest bits of the random
    number, which would also be lost in a floating-point sum.
    """
    if n > 1 << _LOW_BITS or not isinstance(draw.bit_generator, np.random.PCG64):
        return np.argsort(draw.random((rows, n)) + (0 if block is None else block), axis=1)
    drawn = draw.bit_generator.random_raw(rows * n).reshape(rows, n)
    low = np.uint64((1 << _LOW_BITS) - 1)
    place = np.arange(n, dtype=np.uint64)
    block_bits = 0 if block is None else int(block.max()).bit_length()
    if block is not None and block_bits:
        drawn >>= np.uint64(block_bits)
        place |= block.astype(np.uint64) << np.uint64(64 - block_bits)
    drawn &= ~low
    drawn |= place
    drawn.sort(axis=1)
    drawn &= low
    return drawn.view(np.int64)


def shuffled_inside(x: _Ints, block: _Ints, rows: int, draw: np.random.Generator) -> _Ints:
    """Return copies of the values ``x``, each shuffled within the blocks, as a (rows, n) array."""
    sorted_by_block = x[random_orders(draw, rows, len(x), block)]
    if (block[1:] >= block[:-1]).all():
        return sorted_by_block
    mixed = np.empty((rows, len(x)), dtype=np.int64)
    mixed[:, np.argsort(block, kind="stable")] = sorted_by_block
    return mixed


def joint_counts(mixed: _Ints, y: _Ints, sizes: tuple[int, int]) -> _Ints:
    """Count the joint occurrences of the values of two variables in every permutation.

    Args:
        mixed: (rows, n) permuted codes of the first variable.
        y: (n,) codes of the second variable.
        sizes: Numbers of distinct values (nx, ny).

    Returns:
        Counts as a (rows, nx, ny) array.
    """
    (rows, _), (nx, ny) = mixed.shape, sizes
    cells = mixed * ny
    cells += y
    cells += (np.arange(rows) * (nx * ny))[:, None]
    return np.bincount(cells.ravel(), minlength=rows * nx * ny).reshape(rows, nx, ny)


def counts_log_counts(n: int) -> _Floats:
    """Return c log2 c for each count c from 0 to n.

    These terms are used to compute the entropy of a distribution of counts.
    """
    logs = np.zeros(n + 1)
    logs[1:] = np.arange(1, n + 1) * np.log2(np.arange(1, n + 1))
    return logs


def _grouped(blocks: Sequence[Hashable] | None, n: int) -> _Ints:
    if blocks is None:
        return np.arange(n)
    order = {block: i for i, block in enumerate(dict.fromkeys(blocks))}
    return np.array([order[block] for block in blocks], dtype=np.int64)


def _permuted_bits(
    xy: tuple[_Ints, _Ints], sizes: tuple[int, int], draw: np.random.Generator, block: _Ints, *, within: bool
) -> _Floats:
    """Return the mutual information [bit] of every permutation, shape (PERMUTATIONS,)."""
    (x, y), (nx, ny), found = xy, sizes, []
    n = len(x)
    logs = counts_log_counts(n)
    margins = logs[np.bincount(x, minlength=nx)].sum() + logs[np.bincount(y, minlength=ny)].sum()
    per_block = x[np.unique(block, return_index=True)[1]]
    varying_margin = not within and len(per_block) != n
    todo = PERMUTATIONS
    while todo:
        rows = min(todo, max(1, _CHUNK // max(n, nx * ny)))
        if within:
            mixed = shuffled_inside(x, block, rows, draw)
        else:
            mixed = per_block[random_orders(draw, rows, len(per_block))]
            if len(per_block) != n:
                mixed = mixed[:, block]
        joint = joint_counts(mixed, y, (nx, ny))
        if varying_margin:  # permuting demonstrations of different lengths changes the counts of x
            margin = logs[joint.sum(axis=2)].sum(axis=1) + logs[np.bincount(y, minlength=ny)].sum()
        else:
            margin = np.full(rows, margins)
        found.append((logs[joint].sum(axis=(1, 2)) + logs[n] - margin) / n)
        todo -= rows
    bits: _Floats = np.maximum(0.0, np.concatenate(found))
    return bits


def strongest_of(
    presence: npt.NDArray[np.bool_], outcome: Sequence[Hashable], draw: np.random.Generator
) -> list[Association]:
    """Test features like :func:`features_test`, but return only the associations."""
    return features_test(presence, outcome, draw)[0]


def features_test(
    presence: npt.NDArray[np.bool_], outcome: Sequence[Hashable], draw: np.random.Generator
) -> tuple[list[Association], _Floats]:
    """Test each of several features for an association with an outcome.

    The p-values are corrected for the number of features. The p-value of a feature is the fraction of permutations of
    the outcome in which any feature has at least as much mutual information (single-step maxT of Westfall and Young).

    Args:
        presence: (episodes, features) mask of the features that each episode has.
        outcome: Outcome of each episode.
        draw: Random generator of the permutations.

    Returns:
        The association of each feature, and for each permutation the largest mutual information of any feature [bit],
        as a (PERMUTATIONS,) array.
    """
    y, ny = codes_of(outcome)
    n = len(y)
    has = presence.astype(np.float32)
    logs = counts_log_counts(n)
    totals, with_feature = np.bincount(y, minlength=ny), presence.sum(axis=0)
    # Terms c log2 c of each possible count and of the remaining count.
    terms = [logs[: total + 1] + logs[total::-1] for total in totals.tolist()]
    margin_y = logs[totals].sum()
    margin_x = logs[with_feature] + logs[n - with_feature]
    hy = math.log2(n) - margin_y / n
    hx = math.log2(n) - margin_x / n

    def bits_of(labels: _Ints) -> _Floats:
        """Return the mutual information of every feature with each row of outcomes, as a (rows, features) array.

        Args:
            labels: (rows, episodes) outcome of each episode, in several permutations.
        """
        both = np.zeros((labels.shape[0], presence.shape[1]))
        for label in range(ny):
            # Sums of ones are exact in float32.
            joint = ((labels == label).astype(np.float32) @ has).astype(np.int32)
            both += terms[label].take(joint)
        found: _Floats = np.maximum(0.0, (both + logs[n] - margin_x - margin_y) / n)
        return found

    bits = bits_of(y[None, :])[0]
    rows = max(1, _CHUNK // n)
    chunks = [min(rows, PERMUTATIONS - start) for start in range(0, PERMUTATIONS, rows)]
    permuted = np.concatenate([bits_of(y[random_orders(draw, c, n)]) for c in chunks])
    expected, most = permuted.mean(axis=0), permuted.max(axis=1)
    found = []
    for i in range(presence.shape[1]):
        room = min(hx[i], hy) - expected[i]
        strength = (bits[i] - expected[i]) / room if room > 1e-9 else 0.0
        p = (1 + int((most >= bits[i] - 1e-9).sum())) / (1 + PERMUTATIONS)
        found.append(
            Association(
                round(float(bits[i]), 6),
                round(float(expected[i]), 6),
                round(min(1.0, max(0.0, float(strength))), 6),
                p,
                n,
            )
        )
    return found, most
