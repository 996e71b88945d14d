"""Findings of the audit, each with a printed number, the recomputed number and a verdict."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any

TableCell = tuple[str, str]
"""Row and column of a number."""


class Verdict(StrEnum):
    """Verdict on a printed number or claim, from the worst to the best verdict."""

    BROKEN = "does not hold"
    UNSUPPORTED = "not supported by n trials"
    UNKNOWN = "cannot be checked"
    HOLDS = "holds"

    @property
    def rank(self) -> int:
        """Rank of the verdict. The worst verdict has rank 0."""
        return list(Verdict).index(self)


@dataclass(frozen=True, slots=True)
class ClaimSupport:
    """Result of the statistical test of a claim.

    Attributes:
        test: Name of the test.
        p_value: Two-sided p-value.
        p_holm: P-value after Holm's correction for all claims of the rule.
        trials: Number of trials of each compared rate.
        low_pp: Lower end of the 95 % interval [percent or percentage points].
        high_pp: Upper end of the 95 % interval [percent or percentage points].
        p_fisher: P-value from Fisher's exact test for two rates, for comparison, or None if there is only one rate.
    """

    test: str
    p_value: float
    p_holm: float
    trials: tuple[int, ...]
    low_pp: float
    high_pp: float
    p_fisher: float | None = None


@dataclass(frozen=True, slots=True)
class AuditFinding:
    """Result of one check of a number or a claim.

    Attributes:
        table: Name of the table.
        rule: Name of the rule that was checked ("grid", "mean").
        row: Row of the number. Empty if the finding concerns the complete table.
        cell: Column of the number, or the claim in a few words.
        printed: Number as printed.
        recomputed: Number as recomputed, or empty.
        verdict: Verdict on the number or claim.
        why: Explanation in one or more sentences.
        covers: Cells that the check uses. A misprint in any of them may change the verdict.
        unnoticed: Number of possible misprints of one digit in these cells that the check would not detect.
        misprints: Number of possible misprints of one digit in these cells.
        support: Result of the statistical test of a claim, or None.
    """

    table: str
    rule: str
    row: str
    cell: str
    printed: str
    recomputed: str
    verdict: Verdict
    why: str
    covers: tuple[TableCell, ...] = ()
    unnoticed: int = 0
    misprints: int = 0
    support: ClaimSupport | None = None

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict."""
        form = asdict(self)
        del form["covers"]
        form["unnoticed_misprints"], form["possible_misprints"] = form.pop("unnoticed"), form.pop("misprints")
        return form
