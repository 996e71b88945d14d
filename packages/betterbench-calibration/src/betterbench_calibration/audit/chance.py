"""Tests of success rates against random guessing among several answers."""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from betterbench.statistics import Rate, chance_p, holm, round_half_up
from betterbench_calibration.audit.counts import count_behind
from betterbench_calibration.audit.fields import ColumnNames, RowName, RowNames, WholeNumber, exact_fields
from betterbench_calibration.audit.finding import AuditFinding, ClaimSupport, Verdict
from betterbench_calibration.audit.table import AuditedTable
from betterbench_calibration.audit.wording import ALPHA, POINTS, ends, tested

_chance = functools.lru_cache(maxsize=256)(chance_p)


@exact_fields
@dataclass(frozen=True, slots=True)
class Chance:
    """Rule that success rates differ from the rate of random guessing.

    Attributes:
        trials: Number of trials of each success rate.
        choices: Number of answers among which a random guess chooses.
        guess: Row with the printed success rate of guessing, or empty if there is none.
        rows: Rows to test. By default, all rows except ``guess``.
        columns: Columns to test. By default, all columns.
    """

    trials: WholeNumber
    choices: Annotated[WholeNumber, Field(ge=2)]
    guess: RowName = ""
    rows: RowNames = ()
    columns: ColumnNames = ()

    def findings(self, table: AuditedTable, paper: Mapping[str, AuditedTable]) -> Iterator[AuditFinding]:  # noqa: ARG002 - see AuditRule
        """Yield one finding per printed rate of guessing, and one finding per tested success rate."""
        if self.guess:
            yield from self._guesses(table)
        rates = {
            (r, c): Rate(*count)
            for r in self.rows or [row for row in table.row_names if row != self.guess]
            for c in self.columns or table.columns
            if (n := table.cell(r, c)) is not None and (count := count_behind(n, self.trials)) is not None
        }
        p_values = [_chance(rate, chance=1 / self.choices) for rate in rates.values()]
        for ((row, column), rate), p, corrected in zip(rates.items(), p_values, holm(p_values), strict=True):
            differs = corrected < ALPHA
            support = ClaimSupport("exact binomial", p, corrected, (rate.n,), POINTS * rate.low, POINTS * rate.high)
            why = (
                f"{rate.k}/{rate.n} {'differs' if differs else 'cannot be distinguished'} from guessing among "
                f"{self.choices}: "
                f"{tested(p, corrected, len(p_values))}; 95 % interval {ends(support)}."
            )
            verdict = Verdict.HOLDS if differs else Verdict.UNSUPPORTED
            cell = (row, column, str(table.cell(row, column)), f"{rate.k}/{rate.n}")
            yield AuditFinding(table.name, "chance", *cell, verdict, why, support=support)

    def _guesses(self, table: AuditedTable) -> Iterator[AuditFinding]:
        for column in self.columns or table.columns:
            printed = table.cell(self.guess, column)
            if printed is None:
                continue
            verdict = Verdict.HOLDS if printed * self.choices == 100 else Verdict.BROKEN
            found = f"1/{self.choices} = {round_half_up(POINTS / self.choices, 2)}"
            why = f"A guess among {self.choices} answers is right with probability 1/{self.choices}."
            cell = (self.guess, column)
            yield AuditFinding(table.name, "chance", *cell, str(printed), found, verdict, why, (cell,))
