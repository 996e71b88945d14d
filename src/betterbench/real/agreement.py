"""Agreement between raters: Cohen's kappa for each pair of raters, and the trials on which they disagree."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from betterbench.real.outcomes import OUTCOMES
from betterbench.real.record import RealTrial, Role
from betterbench.statistics.agreement import AgreementTable
from betterbench.statistics.interval import Interval

_WIDTH = 1e-9
"""Minimum width at which a confidence interval is shown."""


@dataclass(frozen=True, slots=True)
class Rater:
    """Person who entered outcomes, and the role of this person (operator or judge)."""

    name: str
    role: Role

    def __str__(self) -> str:
        """Return the name of the rater, followed by the role if the rater was an operator."""
        return self.name if self.role == "judge" else f"{self.name} (operator)"


@dataclass(frozen=True, slots=True)
class Disagreement:
    """A trial for which two raters entered different outcomes."""

    code: str
    first: str
    second: str


@dataclass(frozen=True, slots=True)
class PairAgreement:
    """Agreement between two raters.

    Attributes:
        first: First rater.
        second: Second rater.
        table: Contingency table of the trials that both raters rated: number of trials by outcome of the first rater
            (rows) and of the second rater (columns).
        disagreements: Trials for which the two raters entered different outcomes, in the order of the plan.
    """

    first: Rater
    second: Rater
    table: AgreementTable
    disagreements: tuple[Disagreement, ...]

    @property
    def is_blind(self) -> bool:
        """Whether both raters are judges, who see only the video and not the condition or the policy."""
        return self.first.role == self.second.role == "judge"

    @property
    def interval(self) -> Interval | None:
        """Confidence interval of Cohen's kappa; None if kappa is not defined or its variance is 0.

        The variance is 0 if the raters agree in all trials, or if one rater always entered the same outcome. The
        interval would then have zero width even with very few trials.
        """
        found = self.table.interval()
        return None if found is None or found.high - found.low < _WIDTH else found

    @property
    def sentence(self) -> str:
        """Sentence with the number of trials with equal outcomes, and with Cohen's kappa and its interval."""
        n = self.table.n
        text = f"{self.first} and {self.second} entered the same outcome in {n - len(self.disagreements)} of {n} trials"
        kappa, interval = self.table.kappa, self.interval
        if kappa is None:
            return f"{text}; kappa is undefined, because all outcomes are the same."
        if interval is None:
            why = "they agree in all trials" if not self.disagreements else "their outcomes vary too little"
            return f"{text}; Cohen's kappa {kappa:.2f}, without an interval, because {why}."
        return f"{text}; Cohen's kappa {kappa:.2f} (95 % interval {interval.low:.2f} to {interval.high:.2f})."

    def to_json(self) -> dict[str, Any]:
        """Return the agreement as a JSON-serializable dict."""
        interval = self.interval
        return {
            "first": str(self.first),
            "second": str(self.second),
            "n": self.table.n,
            "same": self.table.n - len(self.disagreements),
            "kappa": self.table.kappa,
            "low": None if interval is None else interval.low,
            "high": None if interval is None else interval.high,
            "disagreements": [{"trial": d.code, "first": d.first, "second": d.second} for d in self.disagreements],
        }


def agreements_of(trials: Iterable[RealTrial]) -> tuple[PairAgreement, ...]:
    """Return the agreement of every pair of raters who rated at least one trial in common.

    Only trials rated by both raters are compared. Pairs of judges come before pairs with the operator.
    """
    seen: dict[Rater, dict[str, str]] = {}
    order: list[str] = []
    for trial in trials:
        order.append(trial.code)
        for entry in trial.entries:
            if entry.decision.kind == "seen":
                seen.setdefault(Rater(entry.author, entry.role), {})[trial.code] = entry.decision.outcome
    raters = sorted(seen, key=lambda rater: (rater.role != "judge", rater.name))
    categories, found = [outcome.name for outcome in OUTCOMES], []
    for first, second in itertools.combinations(raters, 2):
        if first.role == second.role == "operator":
            continue
        both = [code for code in order if code in seen[first] and code in seen[second]]
        if both:
            pairs = [(seen[first][code], seen[second][code]) for code in both]
            apart = [Disagreement(code, a, b) for code, (a, b) in zip(both, pairs, strict=True) if a != b]
            table = AgreementTable.of_pairs(pairs, categories)
            found.append(PairAgreement(first, second, table, tuple(apart)))
    return tuple(found)
