"""Agreement between two raters of the same items, corrected for the agreement expected by chance."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from betterbench.errors import InvalidInputError
from betterbench.statistics.interval import DEFAULT_CONFIDENCE, Interval, normal_quantile


@dataclass(frozen=True, slots=True)
class AgreementTable:
    """Number of items for each pair of categories that two raters assigned.

    Attributes:
        categories: Names of the categories, in the order of rows and columns.
        counts: Numbers of items. Rows are the categories of the first rater, columns those of the second rater.
    """

    categories: tuple[str, ...]
    counts: tuple[tuple[int, ...], ...]

    def __post_init__(self) -> None:
        """Raise InvalidInputError if the table is not square or a count is negative."""
        size = len(self.categories)
        if size < 2 or len(self.counts) != size or any(len(row) != size for row in self.counts):
            problem = f"the table has {len(self.counts)} rows for {size} categories"
            raise InvalidInputError("counts", problem, "Pass a square table with at least two categories")
        if any(count < 0 for row in self.counts for count in row):
            raise InvalidInputError("counts", "a count is negative", "Use counts ≥ 0")

    @classmethod
    def of_pairs(cls, pairs: Iterable[tuple[str, str]], categories: Sequence[str]) -> AgreementTable:
        """Count the items. Each item is given as (category of the first rater, category of the second rater)."""
        index = {name: k for k, name in enumerate(categories)}
        counts = [[0] * len(index) for _ in index]
        for first, second in pairs:
            for name in (first, second):
                if name not in index:
                    cure = f"Use one of {', '.join(index)}"
                    raise InvalidInputError("pairs", f"{name!r} is not a category", cure)
            counts[index[first]][index[second]] += 1
        return cls(tuple(categories), tuple(map(tuple, counts)))

    @property
    def n(self) -> int:
        """Number of items."""
        return sum(map(sum, self.counts))

    @property
    def observed(self) -> float | None:
        """Fraction of items on which both raters agree. None if there are no items."""
        return sum(self.counts[k][k] for k in range(len(self.counts))) / self.n if self.n else None

    @property
    def expected(self) -> float | None:
        """Agreement to be expected if each rater chose categories independently with the observed frequencies.

        It is None if there are no items.
        """
        if not self.n:
            return None
        table = np.array(self.counts, dtype=float)
        return float(table.sum(axis=1) @ table.sum(axis=0)) / self.n**2

    @property
    def kappa(self) -> float | None:
        """Kappa of Cohen (1960): (observed - expected) / (1 - expected).

        It is None if there are no items. It is also None if both raters put every item into the same category, because
        chance alone would then explain the agreement.
        """
        observed, expected = self.observed, self.expected
        if observed is None or expected is None or 1.0 - expected < 1e-12:
            return None
        return (observed - expected) / (1.0 - expected)

    def interval(self, confidence: float = DEFAULT_CONFIDENCE) -> Interval | None:
        """Return the confidence interval of kappa from its large-sample variance (Fleiss, Cohen and Everitt, 1969).

        The interval is clipped to [-1, 1]. It is None if kappa is None. With few items, it is only an approximation.
        """
        kappa, expected = self.kappa, self.expected
        if kappa is None or expected is None:
            return None
        shares = np.array(self.counts, dtype=float) / self.n
        rows, columns = shares.sum(axis=1), shares.sum(axis=0)
        sums = columns[:, None] + rows[None, :]  # at (i, j): column fraction of i plus row fraction of j
        agree = float(np.sum(np.diag(shares) * (1.0 - (rows + columns) * (1.0 - kappa)) ** 2))
        apart = float(np.sum((shares - np.diag(np.diag(shares))) * sums**2)) * (1.0 - kappa) ** 2
        variance = (agree + apart - (kappa - expected * (1.0 - kappa)) ** 2) / (self.n * (1.0 - expected) ** 2)
        half = normal_quantile(confidence) * math.sqrt(max(0.0, variance))
        return Interval(max(-1.0, kappa - half), min(1.0, kappa + half))
