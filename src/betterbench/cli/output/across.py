"""Tables with results from several worlds, printed or written to files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from betterbench.cli.console import OUT, print_table
from betterbench.comparison.across import LIBERO_COLUMNS, WorldGap, WorldRow, WorldTable
from betterbench.jobs.durable import write_durably
from betterbench.report.tables.latex import table_to_latex
from betterbench.report.tables.table import Scalar, Table, to_csv
from betterbench.statistics import Rate, percent, round_half_up
from betterbench.statistics.wording import p_text, points
from betterbench.tasks.worlds.calvin import ChainSummary


def print_across(table: WorldTable, gaps: Sequence[WorldGap]) -> None:
    """Print Table 4 of the BeTTER paper for all worlds, comparisons of policies, and illusion gaps per world."""
    libero = [row for row in table.rows if row.suites]
    if libero:
        rows = [[shown, *(_rate(row.suites.get(name)) for row in libero)] for name, shown in LIBERO_COLUMNS.items()]
        rows.append(["Avg", *map(_average, libero)])
        title = "LIBERO, success in percent with 95 % intervals"
        print_table(["suite", *(row.policy for row in libero)], rows, title=title)
    chains = [(row.policy, row.chains) for row in table.rows if row.chains is not None]
    if chains:
        OUT.print()
        rows = [[str(i + 1), *(_rate(found.in_a_row[i]) for _, found in chains)] for i in range(5)]
        rows.append(["Avg Len", *(_length(found) for _, found in chains)])
        title = "CALVIN ABC→D, percent of chains with at least this many subtasks done in a row"
        print_table(["in a row", *(policy for policy, _ in chains)], rows, title=title)
        _print_subtasks(chains)
    if table.contrasts or table.chain_contrasts:
        OUT.print()
        print_table(
            ["policies", "suite", "difference, points", "p", "pairs"],
            _contrast_rows(table),
            title="the same initial states",
        )
    if gaps:
        OUT.print()
        columns = ["policy", "world", "change", "before, %", "after, %", "gap, points", "p", "pairs"]
        print_table(columns, [_gap_row(gap) for gap in gaps], title="illusion gaps: drop in success in a changed scene")
    if table.notes:
        OUT.print()
    for note in table.notes:
        OUT.print(note, markup=False, style="dim")


def write_across(table: WorldTable, gaps: Sequence[WorldGap], out: Path) -> tuple[Path, ...]:
    """Write the table and the gaps as CSV and LaTeX into a folder, and return the files."""
    made = []
    for plain in (_wide(table), _plain_contrasts(table), _plain_gaps(gaps)):
        if plain.rows:
            for suffix, text in ((".csv", to_csv(plain)), (".tex", table_to_latex(plain))):
                made.append(out / f"{plain.name}{suffix}")
                write_durably(made[-1], text.encode())
    return tuple(made)


def _average(row: WorldRow) -> str:
    average = row.average
    if average is None or average.value is None:
        return "–"
    low, high = round_half_up(100 * average.low, 1), round_half_up(100 * average.high, 1)
    return f"{round_half_up(100 * average.value, 2)} ({low} to {high})"


def _length(chains: ChainSummary) -> str:
    length = chains.length
    ends = f"{round_half_up(length.low, 2)} to {round_half_up(length.high, 2)}"
    return f"{round_half_up(length.value, 3)} ({ends})"


def _rate(rate: Rate | None) -> str:
    if rate is None or not rate.n:
        return "–"
    low, high = round_half_up(100 * rate.low, 1), round_half_up(100 * rate.high, 1)
    return f"{percent(rate.k, rate.n)} ({low} to {high}) {rate.k}/{rate.n}"


def _print_subtasks(chains: Sequence[tuple[str, ChainSummary]]) -> None:
    names = sorted({name for _, found in chains for name in found.subtasks})
    rows = [[name, *(_count(found.subtasks.get(name)) for _, found in chains)] for name in names]
    OUT.print()
    print_table(
        ["subtask", *(policy for policy, _ in chains)],
        rows,
        title="success in percent of the chains that reached the subtask",
    )


def _count(rate: Rate | None) -> str:
    return "–" if rate is None else f"{rate.k}/{rate.n}"


def _contrast_rows(table: WorldTable) -> list[list[str]]:
    rows = []
    for c in table.contrasts:
        where = LIBERO_COLUMNS.get(c.suite, "all four")
        d = c.difference
        shown = f"{points(d.value or 0.0)} ({points(d.low)} to {points(d.high)})"
        rows.append([f"{c.first} - {c.second}", f"LIBERO {where}", shown, _p(c.p_value), str(c.pairs)])
    for first, second, told in table.chain_contrasts:
        pair = f"{first} - {second}"
        for k, p in enumerate(told.p_values, 1):
            rows.append([pair, f"CALVIN {k}", "", _p(p), str(told.chains)])
        d = told.difference
        ends = f"{round_half_up(5 * d.low, 2)} to {round_half_up(5 * d.high, 2)}"
        length = f"{round_half_up(5 * (d.value or 0.0), 3)} subtasks ({ends})"
        rows.append([pair, "CALVIN Avg Len", length, "", str(told.chains)])
    return rows


def _gap_row(gap: WorldGap) -> list[str]:
    d = gap.difference
    return [
        gap.policy,
        gap.world if gap.world != "LIBERO-PRO" else f"{gap.world} {LIBERO_COLUMNS.get(gap.suite, gap.suite)}",
        gap.change,
        str(round_half_up(100 * gap.base, 1)),
        str(round_half_up(100 * gap.changed, 1)),
        f"{points(d.value or 0.0)} ({points(d.low)} to {points(d.high)})",
        "" if gap.p_value is None else _p(gap.p_value),
        str(gap.pairs),
    ]


def _p(value: float) -> str:
    return p_text(value).removeprefix("p = ").removeprefix("p ")


def _wide(table: WorldTable) -> Table:
    """Return Table 4 of the BeTTER paper with counts and confidence intervals, one row per policy."""
    columns = ["policy"]
    for name in LIBERO_COLUMNS:
        columns += [f"{name}_{part}" for part in ("k", "n", "percent", "low", "high")]
    columns += ["libero_average", "libero_average_low", "libero_average_high"]
    for i in range(1, 6):
        columns += [f"calvin_{i}_{part}" for part in ("k", "n", "percent", "low", "high")]
    columns += ["calvin_average_length", "calvin_average_length_low", "calvin_average_length_high"]
    rows = []
    for row in table.rows:
        cells: list[Scalar] = [row.policy]
        for name in LIBERO_COLUMNS:
            cells += _numbers(row.suites.get(name))
        a = row.average
        cells += [None] * 3 if a is None or a.value is None else [100 * a.value, 100 * a.low, 100 * a.high]
        for i in range(5):
            cells += _numbers(None if row.chains is None else row.chains.in_a_row[i])
        length = None if row.chains is None else row.chains.length
        cells += [None] * 3 if length is None else [length.value, length.low, length.high]
        rows.append(tuple(cells))
    caption = "LIBERO success and CALVIN ABC→D tasks in a row, percent, with 95 % intervals."
    return Table("table4", caption, tuple(columns), tuple(rows))


def _numbers(rate: Rate | None) -> list[Scalar]:
    if rate is None or rate.value is None:
        return [None] * 5
    return [rate.k, rate.n, 100 * rate.value, 100 * rate.low, 100 * rate.high]


def _plain_contrasts(table: WorldTable) -> Table:
    rows: list[tuple[Scalar, ...]] = []
    for c in table.contrasts:
        d = c.difference
        rows.append((c.first, c.second, c.suite, c.pairs, d.value, d.low, d.high, c.p_value))
    for first, second, told in table.chain_contrasts:
        rows += [
            (first, second, f"calvin_{k}", told.chains, None, None, None, p) for k, p in enumerate(told.p_values, 1)
        ]
        d = told.difference
        rows.append((first, second, "calvin_average_length_fifths", told.chains, d.value, d.low, d.high, None))
    columns = ("first", "second", "where", "pairs", "difference", "low", "high", "p_value")
    return Table("table4_pairs", "Two policies on the same initial states.", columns, tuple(rows))


def _plain_gaps(gaps: Sequence[WorldGap]) -> Table:
    rows = tuple(
        (
            g.policy, g.world, g.suite, g.change, g.base, g.changed, g.pairs, g.difference.value, g.difference.low,
            g.difference.high, g.p_value,
        )
        for g in gaps
    )  # fmt: skip
    columns = ("policy", "world", "suite", "change", "base", "changed", "pairs", "gap", "low", "high", "p_value")
    return Table("illusion_gaps", "Drop in success in a changed scene.", columns, rows)
