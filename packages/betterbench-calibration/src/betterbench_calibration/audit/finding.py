"""Findings: what was printed, what comes out when it is computed again, and what follows."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any

TableCell = tuple[str, str]
"""Row and column of a number."""


class Verdict(StrEnum):
    """What a check says about a printed number or claim; the worst first."""

    BROKEN = "does not hold"
    UNSUPPORTED = "not supported by n trials"
    UNKNOWN = "cannot be checked"
    HOLDS = "holds"

    @property
    def rank(self) -> int:
        """Place in the order from worst to best."""
        return list(Verdict).index(self)


@dataclass(frozen=True, slots=True)
class ClaimSupport:
    """What the trials behind a claim can carry.

    Attributes:
        p_value: Its two-sided p-value.
        p_holm: The same, corrected for all claims of the rule.
        low_pp: Lower end of the 95 % interval [percent or percentage points].
        high_pp: Upper end of the interval.
        p_fisher: P-value of Fisher's exact test of two rates, for comparison; None where there is one rate only.
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
    """What one check says about one number, or about one claim.

    Attributes:
        rule: Name of the rule that was checked ("grid", "mean").
        row: Row it is about; empty for the table as a whole.
        cell: Column it is about, or the claim in a few words.
        covers: Numbers that the check reads: a misprint in any of them may change the verdict.
        unnoticed: How many wrong single digits of these numbers would pass the check.
        misprints: How many wrong single digits these numbers could have.
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
        """Return the JSON form."""
        form = asdict(self)
        del form["covers"]
        form["unnoticed_misprints"], form["possible_misprints"] = form.pop("unnoticed"), form.pop("misprints")
        return form
