"""Mutual information between two lists of names, and what a permutation test says of it."""

from __future__ import annotations

import math
from collections.abc import Hashable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

PERMUTATIONS = 9999
"""Permutations of a test: the smallest p-value is 1 / 10,000, which stands a correction for a hundred tests."""
_CHUNK = 2_000_000
"""Numbers that are permuted at once."""

_Ints = npt.NDArray[np.int64]
_Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Association:
    """How strongly two things go together.

    Attributes:
        bits: Mutual information [bit].
        expected_bits: Its mean over the permutations: what chance alone gives.
        strength: 1 if one of the two follows from the other, 0 if they go together no more than by chance: the mutual
            information less the expected one, over the smaller of the two entropies less the expected one.
        p_value: Share of the permutations, counting the data itself, with at least as much mutual information.
        n: Observations.
    """

    bits: float
    expected_bits: float
    strength: float
    p_value: float
    n: int


def codes_of(values: Sequence[Hashable]) -> tuple[_Ints, int]:
    """Return a number for each value, in order of their texts, and how many there are."""
    order = {value: i for i, value in enumerate(sorted(set(values), key=str))}
    return np.array([order[value] for value in values], dtype=np.int64), len(order)


def entropy_bits(counts: _Floats) -> float:
    """Return the entropy of counts [bit]."""
    shares = counts[counts > 0] / counts.sum()
    return max(0.0, float(-(shares * np.log2(shares)).sum()))


def association(
    first: Sequence[Hashable],
    second: Sequence[Hashable],
    draw: np.random.Generator,
    *,
    blocks: Sequence[Hashable] | None = None,
    within: bool = False,
) -> Association:
    """Return how two lists of equal length go together.

    Args:
        first: A value per observation.
        second: The other value per observation.
        draw: Where permutations are drawn from.
        blocks: To which demonstration each observation belongs. Without ``within``, whole demonstrations exchange their
            first values, so that what one demonstration repeats is no evidence; all its first values must be equal.
        within: Exchange the first values inside each block instead: of the steps of a demonstration.
    """
    x, nx = codes_of(first)
    y, ny = codes_of(second)
    n = len(x)
    joint = np.bincount(x * ny + y, minlength=nx * ny).reshape(nx, ny).astype(np.float64)
    hx, hy = entropy_bits(joint.sum(axis=1)), entropy_bits(joint.sum(axis=0))
    bits = max(0.0, hx + hy - entropy_bits(joint.ravel()))
    smaller = min(hx, hy)
    if smaller <= 0.0:
        return Association(0.0, 0.0, 0.0, 1.0, n)
    found = _permuted_bits((x, y), (nx, ny), draw, _grouped(blocks, n), within=within)
    expected = float(found.mean())
    at_least = int((found >= bits - 1e-9).sum())
    room = smaller - expected
    strength = (bits - expected) / room if room > 1e-9 else 0.0
    return Association(
        round(bits, 6),
        round(expected, 6),
        round(min(1.0, max(0.0, strength)), 6),
        (1 + at_least) / (1 + PERMUTATIONS),
        n,
    )


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
    logs = np.zeros(n + 1)
    counts = np.arange(1, n + 1)
    logs[1:] = counts * np.log2(counts)  # c log2 c: entropies of counts follow from sums of these
    margins = logs[np.bincount(x, minlength=nx)].sum() + logs[np.bincount(y, minlength=ny)].sum()
    per_block = x[np.unique(block, return_index=True)[1]]
    varying_margin = not within and len(per_block) != n
    todo = PERMUTATIONS
    while todo:
        rows = min(todo, max(1, _CHUNK // max(n, nx * ny)))
        if within:
            keys = draw.random((rows, n)) + block  # sorting by these shuffles inside each block
            order = np.argsort(block, kind="stable")
            mixed = np.empty((rows, n), dtype=np.int64)
            mixed[:, order] = x[np.argsort(keys, axis=1)]
        else:
            mixed = per_block[np.argsort(draw.random((rows, len(per_block))), axis=1)][:, block]
        cells = mixed * ny + y + (np.arange(rows) * (nx * ny))[:, None]
        joint = np.bincount(cells.ravel(), minlength=rows * nx * ny).reshape(rows, nx, ny)
        if varying_margin:  # demonstrations of different lengths move the counts of x
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
    """Return how each of several features goes with an outcome, with p-values that count all features at once.

    The p-value is the share of the permutations of the outcome in which any feature reaches as much (Westfall and
    Young's single-step maximum).

    Args:
        presence: (episodes, features) whether an episode has a feature.
        outcome: The outcome of each episode.
        draw: Where permutations are drawn from.
    """
    y, ny = codes_of(outcome)
    n = len(y)
    has = presence.astype(np.float32)
    logs = np.zeros(n + 1)
    logs[1:] = np.arange(1, n + 1) * np.log2(np.arange(1, n + 1))
    totals, with_feature = np.bincount(y, minlength=ny), presence.sum(axis=0)
    margin_y = logs[totals].sum()
    margin_x = logs[with_feature] + logs[n - with_feature]
    hy = math.log2(n) - margin_y / n
    hx = math.log2(n) - margin_x / n

    def bits_of(labels: _Ints) -> _Floats:
        """Return the mutual information of every feature for each row of labels, shape (rows, features)."""
        both = np.zeros((labels.shape[0], presence.shape[1]))
        for label in range(ny):
            joint = np.rint((labels == label).astype(np.float32) @ has).astype(np.int64)
            both += logs[joint] + logs[totals[label] - joint]
        found: _Floats = np.maximum(0.0, (both + logs[n] - margin_x - margin_y) / n)
        return found

    bits = bits_of(y[None, :])[0]
    rows = max(1, _CHUNK // n)
    chunks = [min(rows, PERMUTATIONS - start) for start in range(0, PERMUTATIONS, rows)]
    permuted = np.concatenate([bits_of(y[np.argsort(draw.random((c, n)), axis=1)]) for c in chunks])
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
    return found
