"""Check of micro averages: an overall rate must equal the pooled rate of its parts.

The number of questions in each part is not printed. It is recovered from the percentages.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction

from betterbench.statistics import round_half_up
from betterbench_calibration.audit.counts import CountBehind, all_with_dropped, count_behind, with_percentage
from betterbench_calibration.audit.fields import ColumnName, ColumnNames, exact_fields
from betterbench_calibration.audit.finding import AuditFinding, TableCell, Verdict
from betterbench_calibration.audit.sums import missing_parts
from betterbench_calibration.audit.table import (
    AuditedTable,
    blindness,
    cached_by_digits,
    decimals,
    one_digit_apart,
    replaced,
)

LARGEST_SIZE = 1000
"""Largest size of a part that is tried [questions].

With two decimals, a size of 1000 fits one percentage in ten by chance. Far larger sizes would always fit.
"""

SHARE_OF_MISFITS = Fraction(1, 4)
"""Fraction of rows that a size may fail to reproduce, because some rows may contain misprints."""

MOST_CANDIDATES = 8
"""Maximum number of sizes per part that are combined with the sizes of other parts. The best sizes are used."""

MOST_COMBINATIONS = 20_000
"""Maximum number of combinations of sizes that are tried. If there are many parts, fewer sizes per part are used."""

PooledRow = tuple[tuple[Decimal, ...], Decimal]
"""Printed rates of the parts in a row, and the printed overall rate [percent]."""


@dataclass(frozen=True, slots=True)
class Sizes:
    """Number of questions in each part, recovered from the percentages.

    Attributes:
        parts: Size of each part, in the order of the columns.
        reproduced: Number of distinct rows whose parts and overall rate agree with these sizes.
        rows: Number of distinct rows in which all parts and the overall rate are printed.
    """

    parts: tuple[int, ...]
    reproduced: int
    rows: int

    @property
    def total(self) -> int:
        """Total number of questions."""
        return sum(self.parts)


@exact_fields
@dataclass(frozen=True, slots=True)
class Pooled:
    """Rule that, in each row, the column ``target`` is the micro average of the columns ``parts``."""

    target: ColumnName
    parts: ColumnNames

    def findings(self, table: AuditedTable, paper: Mapping[str, AuditedTable]) -> Iterator[AuditFinding]:  # noqa: ARG002 - see AuditRule
        """Yield one finding on the recovered sizes, and one finding per row."""
        rows = self.rows(table)
        sizes = recover_sizes(tuple(rows.values()))
        for name in table.row_names:
            printed = table.cell(name, self.target)
            if printed is not None and name not in rows:
                yield missing_parts(table, "pooled", name, self.target, printed)
        if sizes is None:
            yield self._no_sizes(table, rows)
            return
        yield self._about_sizes(table, sizes, rows)
        for name, row in rows.items():
            yield from self._judge(table, name, row, sizes)

    def rows(self, table: AuditedTable) -> dict[str, PooledRow]:
        """Return the rows in which the overall rate and all parts are printed, by name."""
        found: dict[str, PooledRow] = {}
        for name in table.row_names:
            whole = table.cell(name, self.target)
            parts = tuple(n for c in self.parts if (n := table.cell(name, c)) is not None)
            if whole is not None and len(parts) == len(self.parts):
                found[name] = (parts, whole)
        return found

    def _no_sizes(self, table: AuditedTable, rows: Mapping[str, PooledRow]) -> AuditFinding:
        why = f"No sizes of up to {LARGEST_SIZE} questions per part reproduce most of the rows."
        covers = tuple((r, c) for r in rows for c in (*self.parts, self.target))
        return AuditFinding(table.name, "pooled", "", self.target, "", "", Verdict.UNKNOWN, why, covers, 1, 1)

    def _about_sizes(self, table: AuditedTable, sizes: Sizes, rows: Mapping[str, PooledRow]) -> AuditFinding:
        plain = sum(
            round_half_up(sum(map(Fraction, parts), Fraction(0)) / len(parts), decimals(whole)) == whole
            for parts, whole in rows.values()
        )
        listed = " + ".join(str(n) for n in sizes.parts)
        why = (
            f"The smallest sizes that reproduce most rows are {listed} = {sizes.total}: {sizes.reproduced} of "
            f"{sizes.rows} distinct rows in every digit. The plain mean of the parts fits {plain}/{len(rows)} rows."
        )
        return AuditFinding(
            table.name, "pooled", "", self.target, "micro average", str(sizes.total), Verdict.HOLDS, why
        )

    def _judge(self, table: AuditedTable, name: str, row: PooledRow, sizes: Sizes) -> Iterator[AuditFinding]:
        parts, whole = row
        numbers: dict[TableCell, Decimal] = {(name, c): n for c, n in zip(self.parts, parts, strict=True)}
        numbers[(name, self.target)] = whole
        counts = [count_behind(p, n) for p, n in zip(parts, sizes.parts, strict=True)]
        misfits = [i for i, count in enumerate(counts) if count is None]
        if not misfits:
            pool = _pool([count for count in counts if count is not None])
            value = with_percentage(pool, decimals(whole))
            right = _prints(pool, whole)
            blind = _unnoticed(row, sizes.parts) if right else (0, 0)
            why = f"The parts are {', '.join(map(str, counts))}, together {value}{'' if right else f', not {whole}'}."
            verdict = Verdict.HOLDS if right else Verdict.BROKEN
            covers = tuple(numbers)
            yield AuditFinding(table.name, "pooled", name, self.target, str(whole), value, verdict, why, covers, *blind)
            return
        repaired, explanation = _explain(row, sizes, misfits)
        for i in misfits:
            yield AuditFinding(
                table.name,
                "pooled",
                name,
                self.parts[i],
                str(parts[i]),
                repaired.get(i, ""),
                Verdict.BROKEN,
                f"{parts[i]} is not a k/{sizes.parts[i]}. {explanation}",
                tuple(numbers),
            )


@cached_by_digits
def recover_sizes(rows: tuple[PooledRow, ...]) -> Sizes | None:
    """Return the sizes of the parts that reproduce most rows, or None if fewer than half of the rows are reproduced.

    Among equally good sizes, the smallest are returned. In each of ``rows``, all parts and the overall rate are
    printed. Equal rows count once.
    """
    distinct = tuple(dict.fromkeys(rows))
    if not distinct:
        return None
    allowed = int(SHARE_OF_MISFITS * len(distinct))
    candidates = [_fitting(tuple(parts[i] for parts, _ in distinct), allowed) for i in range(len(distinct[0][0]))]
    most = max(1, int(MOST_COMBINATIONS ** (1 / len(candidates))))
    best: Sizes | None = None
    for sizes in itertools.product(*(found[:most] for found in candidates)):
        found = Sizes(sizes, sum(_reproduces(row, sizes) for row in distinct), len(distinct))
        if best is None or (-found.reproduced, found.total) < (-best.reproduced, best.total):
            best = found
    return best if best is not None and 2 * best.reproduced >= best.rows else None


@cached_by_digits
def _fitting(column: tuple[Decimal, ...], allowed: int) -> tuple[int, ...]:
    """Return the sizes that reproduce all but ``allowed`` percentages of a column, starting with the best size."""
    scored = []
    for n in range(2, LARGEST_SIZE + 1):
        misfits = 0
        for printed in column:
            misfits += count_behind(printed, n) is None
            if misfits > allowed:
                break
        else:
            scored.append((misfits, n))
    return tuple(n for _, n in sorted(scored)[:MOST_CANDIDATES])


def _reproduces(row: PooledRow, sizes: tuple[int, ...]) -> bool:
    """Return whether the sizes reproduce the parts and the overall rate of a row."""
    parts, whole = row
    counts = [count for p, n in zip(parts, sizes, strict=True) if (count := count_behind(p, n)) is not None]
    return len(counts) == len(parts) and _prints(_pool(counts), whole)


@cached_by_digits
def _unnoticed(row: PooledRow, sizes: tuple[int, ...]) -> tuple[int, int]:
    """Return the number of misprints of one digit in a row that would not be detected, and of all such misprints."""
    parts, whole = row
    numbers = (*parts, whole)

    def holds(at: int, wrong: Decimal) -> bool:
        *others, last = replaced(numbers, at, wrong)
        return _reproduces((tuple(others), last), sizes)

    return blindness(numbers, holds)


def _pool(counts: list[CountBehind]) -> CountBehind:
    """Return the sum of several counts."""
    return CountBehind(sum(c.k for c in counts), sum(c.n for c in counts))


def _prints(count: CountBehind, printed: Decimal) -> bool:
    """Return whether a count rounds to a printed percentage."""
    return round_half_up(Fraction(100 * count.k, count.n), decimals(printed)) == printed


def _explain(row: PooledRow, sizes: Sizes, misfits: list[int]) -> tuple[dict[int, str], str]:
    """Return corrections of the parts that do not fit, by position, and an explanation.

    Two causes are tried: questions that are missing from the denominators of these parts, and one misprinted digit in a
    single part. The corrected row must also reproduce the overall rate.
    """
    parts, whole = row
    fitting = [
        count
        for i, (p, n) in enumerate(zip(parts, sizes.parts, strict=True))
        if i not in misfits and (count := count_behind(p, n)) is not None
    ]
    options = [all_with_dropped(parts[i], sizes.parts[i]) for i in misfits]
    few = math.prod(map(len, options)) <= MOST_COMBINATIONS
    tried = itertools.product(*options) if few else iter(())
    fewer = [counts for counts in tried if _prints(_pool([*fitting, *counts]), whole)]
    repaired: dict[int, str] = {}
    sentences = []
    if len(misfits) == 1:
        i, size = misfits[0], sizes.parts[misfits[0]]
        for k in range(size + 1):
            value = round_half_up(Fraction(100 * k, size), decimals(parts[i]))
            pool = _pool([*fitting, CountBehind(k, size)])
            if one_digit_apart(value, parts[i]) and _prints(pool, whole):
                repaired[i] = str(value)
                sentences.append(
                    f"One digit apart, {value} = {k}/{size} gives {with_percentage(pool, decimals(whole))} as printed: "
                    "very likely a misprint."
                )
    if fewer and not repaired:
        counts = max(fewer, key=lambda found: sum(c.n for c in found))
        missing = sum(sizes.parts[i] for i in misfits) - sum(c.n for c in counts)
        repaired |= {i: str(count) for i, count in zip(misfits, counts, strict=True)}
        pool = _pool([*fitting, *counts])
        listed = " and ".join(map(str, counts))
        sentences.append(
            f"The row fits with {missing} question{'s' * (missing != 1)} missing from the denominators, {listed}, "
            f"together {with_percentage(pool, decimals(whole))} as printed."
        )
    return repaired, " ".join(sentences) or "Neither one misprinted digit nor a few missing questions explain the row."
