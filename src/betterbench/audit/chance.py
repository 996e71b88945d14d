"""Rates against guessing: whether a choice among several was more than luck."""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from betterbench.audit.counts import count_behind
from betterbench.audit.finding import AuditFinding, ClaimSupport, Verdict
from betterbench.audit.form import Form
from betterbench.audit.table import AuditedTable
from betterbench.audit.wording import ALPHA, POINTS, ends, p_text
from betterbench.statistics import Rate, chance_p, holm, round_half_up

_chance = functools.lru_cache(maxsize=256)(chance_p)


@dataclass(frozen=True, slots=True)
class Chance:
    """Rates of a choice among several differ from guessing.

    Attributes:
        rows: Rows that are tested.
        columns: Columns that are tested.
        trials: Trials behind each cell.
        choices: Number of things to choose from.
        guess: Row that prints the rate of a guess, or an empty text.
    """

    rows: tuple[str, ...]
    columns: tuple[str, ...]
    trials: int
    choices: int
    guess: str

    @classmethod
    def read(cls, form: Form, table: AuditedTable) -> Chance:
        """Return the rule that a form describes."""
        guess = form.name("guess", table.row_names) if form.has("guess") else ""
        rows = form.names("rows", table.row_names, [r for r in table.row_names if r != guess])
        columns = form.names("columns", table.columns, table.columns)
        choices = form.count("choices")
        if choices < 2:
            raise form.wrong("choices", "one thing is no choice", "Write 2 or more")
        return cls(rows, columns, form.count("trials"), choices, guess)

    def findings(self, table: AuditedTable, paper: Mapping[str, AuditedTable]) -> Iterator[AuditFinding]:  # noqa: ARG002 - see AuditRule
        """Yield whether the guess is printed right, and one finding per cell."""
        if self.guess:
            yield from self._guesses(table)
        rates = {
            (r, c): Rate(*count)
            for r in self.rows
            for c in self.columns
            if (n := table.cell(r, c)) is not None and (count := count_behind(n, self.trials)) is not None
        }
        p_values = [_chance(rate, chance=1 / self.choices) for rate in rates.values()]
        for ((row, column), rate), p, corrected in zip(rates.items(), p_values, holm(p_values), strict=True):
            differs = corrected < ALPHA
            support = ClaimSupport("exact binomial", p, corrected, (rate.n,), POINTS * rate.low, POINTS * rate.high)
            why = (
                f"{rate.k}/{rate.n} {'differs' if differs else 'cannot be told'} from guessing among {self.choices}: "
                f"{p_text(p, corrected, len(p_values))}; 95 % interval {ends(support)}."
            )
            yield AuditFinding(
                table.name,
                "chance",
                row,
                column,
                str(table.cell(row, column)),
                f"{rate.k}/{rate.n}",
                Verdict.HOLDS if differs else Verdict.UNSUPPORTED,
                why,
                support=support,
            )

    def _guesses(self, table: AuditedTable) -> Iterator[AuditFinding]:
        for column in self.columns:
            printed = table.cell(self.guess, column)
            if printed is None:
                continue
            right = printed * self.choices == 100
            found = round_half_up(POINTS / self.choices, 2)
            yield AuditFinding(
                table.name,
                "chance",
                self.guess,
                column,
                str(printed),
                f"1/{self.choices} = {found}",
                Verdict.HOLDS if right else Verdict.BROKEN,
                f"Guessing among {self.choices} is right in one of {self.choices}.",
                ((self.guess, column),),
            )
