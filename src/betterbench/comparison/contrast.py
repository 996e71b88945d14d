"""Contrasts between two policies: the difference between their rates, with a confidence interval and a test."""

from __future__ import annotations

import functools
from dataclasses import asdict, dataclass
from typing import Any

from betterbench.diagnosis import TrialDiagnosis
from betterbench.statistics import (
    DetectableDifference,
    Difference,
    EProcess,
    PairedTable,
    Rate,
    barnard_p,
    boschloo_p,
    mcnemar_p,
    newcombe_difference,
    smallest_paired_difference,
    smallest_unpaired_difference,
    wider_paired_difference,
)
from betterbench.tasks import stream

BOSCHLOO_LIMIT = 300
"""Maximum number of trials per policy for which Boschloo's test is used.

With this number, the test takes 2 s. For larger samples, Barnard's test is used, which gives very similar results.
"""


_smallest_paired = functools.lru_cache(maxsize=256)(smallest_paired_difference)
_smallest_unpaired = functools.lru_cache(maxsize=256)(smallest_unpaired_difference)


@dataclass(frozen=True, slots=True)
class Contrast:
    """Comparison of two policies by one measure, within one scope.

    Attributes:
        measure: "success", a kind of failure, or a label.
        scope: Set of trials: "overall" (variations), "training", "axis:temporal_extrapolation", or the id of a task
            (its variations).
        first: Name of the first policy. The difference is its rate minus the rate of the second policy.
        second: Name of the second policy.
        first_rate: Rate of the first policy.
        second_rate: Rate of the second policy.
        table: Counts of the four kinds of pairs, or None if the trials are not paired.
        difference: Difference of the rates, with its confidence interval.
        test: Name of the test.
        p_value: p-value of the test.
        p_adjusted: p-value after Holm's correction over the family.
        family: Number of contrasts in the family. Their p-values are corrected together.
        different: Whether the rates differ significantly, i.e. ``p_adjusted`` is at most alpha and the interval
            excludes zero.
        smallest: Smallest difference that these trials could have detected, or None if it was not computed.
    """

    measure: str
    scope: str
    first: str
    second: str
    first_rate: Rate
    second_rate: Rate
    table: PairedTable | None
    difference: Difference
    test: str
    p_value: float
    p_adjusted: float
    family: int
    different: bool
    smallest: DetectableDifference | None = None

    @property
    def higher(self) -> str | None:
        """Name of the policy with the higher rate, or None if the rates are equal."""
        gap = (self.first_rate.value or 0.0) - (self.second_rate.value or 0.0)
        return None if gap == 0.0 else self.first if gap > 0.0 else self.second

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict."""
        form = {name: getattr(self, name) for name in self.__slots__}
        for name in ("first_rate", "second_rate", "difference"):
            form[name] = form[name].to_json()
        for name in ("table", "smallest"):
            form[name] = None if form[name] is None else asdict(form[name])
        return form


@dataclass(frozen=True, slots=True)
class Group:
    """Comparison of all policies by one measure, within one scope.

    Attributes:
        measure: "success", a kind of failure, or a label.
        scope: Set of trials, as in :class:`Contrast`.
        names: Names of the policies.
        rates: Rate of each policy.
        letters: Compact letter display: two policies share a letter if and only if they do not differ significantly.
            The policy with the highest rate has the letter "a".
        contrasts: Comparison of each pair of policies.
    """

    measure: str
    scope: str
    names: tuple[str, ...]
    rates: tuple[Rate, ...]
    letters: tuple[str, ...]
    contrasts: tuple[Contrast, ...]

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict."""
        sides = [
            {"name": name, "rate": rate.to_json(), "letters": letters}
            for name, rate, letters in zip(self.names, self.rates, self.letters, strict=True)
        ]
        contrasts = [c.to_json() for c in self.contrasts]
        return {"measure": self.measure, "scope": self.scope, "sides": sides, "contrasts": contrasts}


@dataclass(frozen=True, slots=True)
class SequentialContrast:
    """Sequential comparison of two policies' success rates. It is valid even while the runs are unfinished.

    Attributes:
        first: Name of the first policy.
        second: Name of the second policy.
        planned: Number of pairs of trials that are planned in both runs.
        table: Counts of the four kinds of pairs, up to the first pair that one of the runs has not finished.
        process: Evidence after each pair, at the level alpha divided by the number of contrasts.
        p_adjusted: p-value that is valid at any time, after Holm's correction over the pairs of policies.
        different: Whether ``p_adjusted`` is at most alpha.
    """

    first: str
    second: str
    planned: int
    table: PairedTable
    process: EProcess
    p_adjusted: float
    different: bool

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict."""
        return {
            "first": self.first,
            "second": self.second,
            "pairs": self.process.n,
            "planned": self.planned,
            "table": asdict(self.table),
            "e_value": self.process.value,
            "p_value": self.process.p_value,
            "p_adjusted": self.p_adjusted,
            "different": self.different,
            "decided_at": self.process.decided_at,
        }


Counted = tuple[tuple[TrialDiagnosis, bool], ...]
"""Trials, each with a flag that is True if the trial has the counted outcome."""


def rate_of(counted: Counted) -> Rate:
    """Return the fraction of trials that have the counted outcome."""
    return Rate(sum(happened for _, happened in counted), len(counted))


@dataclass(frozen=True, slots=True)
class OutcomeCounts:
    """Trials of two policies, each with a flag that is True if the trial has the counted outcome.

    Attributes:
        first: Trials of the first policy.
        second: Trials of the second policy. If the trials are paired, they are in the same order.
    """

    first: Counted
    second: Counted

    @property
    def rates(self) -> tuple[Rate, Rate]:
        """Rate of the counted outcome for each of the two policies."""
        return rate_of(self.first), rate_of(self.second)

    @property
    def outcomes(self) -> list[tuple[bool, bool]]:
        """Outcomes in each pair of trials, for the first and for the second policy."""
        return [(a, b) for (_, a), (_, b) in zip(self.first, self.second, strict=True)]

    @property
    def table(self) -> PairedTable:
        """Counts of the four kinds of pairs: both policies have the outcome, one of them has it, or neither."""
        return PairedTable.from_outcomes(self.outcomes)


def judged(tally: OutcomeCounts, *, paired: bool, purpose: str, confidence: float) -> tuple[Difference, str, float]:
    """Return the difference between the rates of the two policies, the name of the test, and its p-value."""
    if paired:
        difference = wider_paired_difference(
            tally.outcomes,
            generator=stream("comparison", 0, f"bootstrap:{purpose}"),
            strata=[t.task for t, _ in tally.first],
            clusters=[t.twin_key or t.key for t, _ in tally.first],
            confidence=confidence,
        )
        return difference, "exact McNemar", mcnemar_p(tally.table)
    a, b = tally.rates
    small = max(a.n, b.n) <= BOSCHLOO_LIMIT
    difference = newcombe_difference(a, b, confidence=confidence)
    return difference, "Boschloo" if small else "Barnard", (boschloo_p if small else barnard_p)(a, b)


def could_have_shown(tally: OutcomeCounts, *, paired: bool, alpha: float) -> DetectableDifference | None:
    """Return the smallest difference that these trials can detect with a power of 80 %, or None if there are no trials.

    For paired trials, the observed fraction of discordant pairs is assumed to be the true one. It matters because more
    pairs are needed if the policies fail in different trials.
    """
    a, b = tally.rates
    n = min(a.n, b.n)
    if n == 0:
        return None
    if not paired:
        pooled = round((a.k + b.k) / (a.n + b.n), 2)
        return _smallest_unpaired(n, reference=pooled, alpha=alpha)
    opposite = min(tally.table.only_first, tally.table.only_second) / n
    return _smallest_paired(n, opposite=min(0.49, round(opposite, 2)), alpha=alpha)
