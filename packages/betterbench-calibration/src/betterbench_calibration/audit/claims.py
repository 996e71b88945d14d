"""Statistical tests of claims that two success rates differ."""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from betterbench.statistics import Rate, barnard_p, fisher_p, holm, newcombe_difference
from betterbench.statistics.wording import p_text
from betterbench_calibration.audit.counts import CountBehind, count_behind
from betterbench_calibration.audit.fields import (
    ColumnName,
    ColumnNames,
    NonEmptyText,
    RowName,
    WholeNumber,
    exact_fields,
)
from betterbench_calibration.audit.finding import AuditFinding, ClaimSupport, Verdict
from betterbench_calibration.audit.pooled import Pooled, recover_sizes
from betterbench_calibration.audit.table import AuditedTable
from betterbench_calibration.audit.wording import ALPHA, ends, shown_rate, tested

BARNARD_OUTCOMES = 1_000_000
"""Largest number of possible outcomes for which Barnard's test is used. The test evaluates all outcomes."""

_barnard = functools.lru_cache(maxsize=256)(barnard_p)


@dataclass(frozen=True, slots=True)
class ClaimComparison:
    """Comparison of two success rates from different trials. The difference is the first rate minus the second."""

    row: str
    claim: str
    first: Rate
    second: Rate


@exact_fields
@dataclass(frozen=True, slots=True)
class Composition:
    """Rule that the rate of the novel composition differs from the pooled rate of the seen compositions.

    Each row is tested with Barnard's exact test.

    Attributes:
        novel: Column of the novel composition.
        seen: Columns of the seen compositions.
        trials: Number of trials of each cell.
    """

    novel: ColumnName
    seen: ColumnNames
    trials: WholeNumber

    def findings(self, table: AuditedTable, paper: Mapping[str, AuditedTable]) -> Iterator[AuditFinding]:  # noqa: ARG002 - see AuditRule
        """Yield one finding per row."""
        compared = []
        for row in table.row_names:
            cells = [table.cell(row, c) for c in (self.novel, *self.seen)]
            counts = [c for n in cells if n is not None and (c := count_behind(n, self.trials)) is not None]
            if len(counts) < len(cells):
                continue
            seen = Rate(sum(c.k for c in counts[1:]), sum(c.n for c in counts[1:]))
            compared.append(
                ClaimComparison(row, f"{self.novel} against {', '.join(self.seen)}", Rate(*counts[0]), seen)
            )
        yield from compare_claims(table, "composition", compared)


@exact_fields
@dataclass(frozen=True, slots=True)
class Claim:
    """Claim in the text of the paper that two cells of a column differ.

    Attributes:
        claim: Claim in a few words.
        first: Row of the first number.
        second: Row of the number that is subtracted from the first number.
        column: Column of both numbers.
        trials: Number of trials of each cell, or 0 if it is recovered from ``parts``.
        parts: Columns whose numbers of trials add up to the number of trials of ``column``.
    """

    claim: NonEmptyText
    first: RowName
    second: RowName
    column: ColumnName
    trials: WholeNumber = 0
    parts: ColumnNames = ()

    def __post_init__(self) -> None:
        """Raise ValueError if a claim has both trials and parts, or neither."""
        if bool(self.trials) == bool(self.parts):
            raise ValueError("either trials or parts must be given")

    def count(self, table: AuditedTable, row: str) -> CountBehind | None:
        """Return the number of successes and trials of a row, or None if they cannot be recovered."""
        trials = self.trials
        if not trials:
            sizes = recover_sizes(tuple(Pooled(self.column, self.parts).rows(table).values()))
            trials = 0 if sizes is None else sizes.total
        printed = table.cell(row, self.column)
        return None if not trials or printed is None else count_behind(printed, trials)


@exact_fields
@dataclass(frozen=True, slots=True)
class Differences:
    """Rule that two cells differ as claimed. It is tested with Fisher's exact test and Newcombe's interval."""

    claims: Annotated[tuple[Claim, ...], Field(min_length=1)]

    def findings(self, table: AuditedTable, paper: Mapping[str, AuditedTable]) -> Iterator[AuditFinding]:  # noqa: ARG002 - see AuditRule
        """Yield one finding per claim."""
        compared = []
        for claim in self.claims:
            first, second = (claim.count(table, row) for row in (claim.first, claim.second))
            name = f"{claim.column}: {claim.claim}"
            if first is None or second is None:
                numbers = tuple(table.cell(r, claim.column) for r in (claim.first, claim.second))
                printed = " against ".join(map(str, numbers))
                why = "The counts behind the two numbers cannot be recovered."
                yield AuditFinding(table.name, "differences", claim.first, name, printed, "", Verdict.UNKNOWN, why)
                continue
            compared.append(ClaimComparison(claim.first, name, Rate(*first), Rate(*second)))
        yield from compare_claims(table, "differences", compared)


def compare_claims(table: AuditedTable, rule: str, compared: Sequence[ClaimComparison]) -> Iterator[AuditFinding]:
    """Yield one finding per comparison, with p-values that are corrected for the number of comparisons.

    The rule "composition" uses Barnard's test. The rule "differences" uses Fisher's test, which is slightly more
    conservative, but fast for thousands of trials.
    """
    outcomes = max(((c.first.n + 1) * (c.second.n + 1) for c in compared), default=0)
    barnard = rule == "composition" and outcomes <= BARNARD_OUTCOMES
    name = "Barnard's exact test" if barnard else "Fisher's exact test"
    fisher = [fisher_p(c.first, c.second) for c in compared]
    p_values = [_barnard(c.first, c.second) for c in compared] if barnard else fisher
    for c, p, corrected, plain in zip(compared, p_values, holm(p_values), fisher, strict=True):
        difference = newcombe_difference(c.first, c.second)
        differs = corrected < ALPHA
        trials = (c.first.n, c.second.n)
        support = ClaimSupport(name, p, corrected, trials, difference.low_pp, difference.high_pp, plain)
        also = f", Fisher {p_text(plain)}" if barnard else ""
        why = (
            f"{c.first.k}/{c.first.n} against {c.second.k}/{c.second.n}: {name} "
            f"{tested(p, corrected, len(compared))}{also}; 95 % interval of the difference {ends(support)} points"
        )
        why += "." if differs else "; results per trial, if published, could be paired."
        counts = f"{c.first.k}/{c.first.n}, {c.second.k}/{c.second.n}"
        verdict = Verdict.HOLDS if differs else Verdict.UNSUPPORTED
        printed = f"{shown_rate(c.first)} against {shown_rate(c.second)}"
        yield AuditFinding(table.name, rule, c.row, c.claim, printed, counts, verdict, why, support=support)
