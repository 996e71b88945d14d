"""Findings of the audit, each with a printed number, the recomputed number and a verdict."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any

TableCell = tuple[str, str]
"""Row and column of a number."""


class Verdict(StrEnum):
    """Verdict on a printed number or claim. The worst verdict is listed first."""

    BROKEN = "does not hold"
    UNSUPPORTED = "not supported by n trials"
    UNKNOWN = "cannot be checked"
    HOLDS = "holds"

    @property
    def rank(self) -> int:
        """Rank from worst to best."""
        return list(Verdict).index(self)


@dataclass(frozen=True, slots=True)
class ClaimSupport:
    """Statistical support of a claim by the number of its trials.

    Attributes:
        p_value: Two-sided p-value.
        p_holm: P-value after Holm's correction for all claims of the rule.
        low_pp: Lower end of the 95 % interval [percent or percentage points].
        high_pp: Upper end of the interval.
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
    """Finding of one check on a number or a claim.

    Attributes:
        rule: Name of the rule that was checked ("grid", "mean").
        row: Row of the number. It is empty for the complete table.
        cell: Column of the number, or the claim in a few words.
        covers: Numbers that the check reads. A misprint in any of them may change the verdict.
        unnoticed: Number of wrong single digits in these numbers that would pass the check.
        misprints: Number of possible wrong single digits in these numbers.
        support: The test behind a verdict on a claim, or None.
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
