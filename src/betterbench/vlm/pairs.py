"""Differences between paired scores of items, with tests that account for clusters of dependent items."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from fractions import Fraction

from betterbench.statistics import (
    Difference,
    PairedTable,
    mcnemar_p,
    paired_bootstrap,
    sign_flip_p,
    wider_paired_difference,
)
from betterbench.tasks.randomness import stream


def _is_binary(pairs: Sequence[tuple[Fraction, Fraction]]) -> bool:
    return all(score in (0, 1) for pair in pairs for score in pair)


def paired_difference(pairs: Sequence[tuple[Fraction, Fraction]], clusters: Sequence[str], purpose: str) -> Difference:
    """Return the mean difference between paired scores, with an interval that accounts for clusters of dependent items.

    Args:
        pairs: First and second score of each pair, each between 0 and 1.
        clusters: Name of the cluster of each pair.
        purpose: Name of the comparison. The random seed of the bootstrap is derived from it.
    """
    generator = stream("static steps", 0, f"bootstrap:{purpose}")
    if _is_binary(pairs):
        outcomes = [(a == 1, b == 1) for a, b in pairs]
        strata = [""] * len(pairs)
        return wider_paired_difference(outcomes, generator=generator, strata=strata, clusters=clusters)
    first, second = ([float(pair[side]) for pair in pairs] for side in (0, 1))
    return paired_bootstrap(first, second, generator=generator, clusters=clusters)


def paired_p(pairs: Sequence[tuple[Fraction, Fraction]], clusters: Sequence[str], purpose: str) -> tuple[float, str]:
    """Return the p-value and the name of a paired test that accounts for clusters of dependent items."""
    if len(set(clusters)) == len(clusters) and _is_binary(pairs):
        return mcnemar_p(PairedTable.from_outcomes((a == 1, b == 1) for a, b in pairs)), "McNemar, exact"
    sums: dict[str, Fraction] = defaultdict(Fraction)
    for (a, b), cluster in zip(pairs, clusters, strict=True):
        sums[cluster] += a - b
    differing = [float(value) for value in sums.values() if value]
    p = sign_flip_p(differing, generator=stream("static steps", 0, f"flips:{purpose}"))
    return p, "sign flips of clusters"
