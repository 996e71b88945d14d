"""Tables as LaTeX: booktabs without vertical lines. All texts are escaped."""

from __future__ import annotations

import math
from collections.abc import Sequence

from betterbench.quoting import latex_text
from betterbench.report.tables.paper import PaperTable
from betterbench.report.tables.table import Scalar, Table
from betterbench.report.wording import Figure
from betterbench.statistics import round_half_up

_LONG_TABLE = 40
"""From this number of rows, a table is written as a longtable, so that it can continue on the next page."""


def table_to_latex(table: Table) -> str:
    """Return a plain table as a booktabs tabular, or as a longtable if it has many rows."""
    columns = "".join("r" if _numeric(table, i) else "l" for i in range(len(table.columns)))
    header = _row([latex_text(column.replace("_", " ")) for column in table.columns])
    rows = [_row([_cell(value) for value in row]) for row in table.rows]
    label = f"tab:better_{table.name}"
    if len(rows) >= _LONG_TABLE:
        lines = [
            "% needs the packages booktabs and longtable",
            rf"\begin{{longtable}}{{{columns}}}",
            rf"\caption{{{latex_text(table.caption)}}}\label{{{label}}} \\",
            r"\toprule",
            header,
            r"\midrule",
            r"\endfirsthead",
            r"\toprule",
            header,
            r"\midrule",
            r"\endhead",
            r"\bottomrule",
            r"\endfoot",
            *rows,
            r"\end{longtable}",
        ]
        return "\n".join(lines) + "\n"
    body = [rf"\begin{{tabular}}{{{columns}}}", r"\toprule", header, r"\midrule", *rows, r"\bottomrule"]
    return _floated([*body, r"\end{tabular}"], table.caption, label)


def paper_table_to_latex(table: PaperTable) -> str:
    """Return a table of the BeTTER paper in the layout of the paper, with counts and 95 % intervals."""
    groups, rules, at = [], [], 2
    for group in table.groups:
        end = at + group.span - 1
        groups.append(rf"\multicolumn{{{group.span}}}{{c}}{{{latex_text(group.title)}}}")
        rules.append(rf"\cmidrule(lr){{{at}-{end}}}")
        at = end + 1
    lines = [
        rf"\begin{{tabular}}{{l{'c' * len(table.columns)}}}",
        r"\toprule",
        " & ".join([" ", *groups]).strip() + r" \\",
        " ".join(rules),
        _row(["Model", *(latex_text(column.title) for column in table.columns)]),
        r"\midrule",
    ]
    before = table.rows[0].source if table.rows else ""
    for row in table.rows:
        if row.source != before:
            lines.append(r"\midrule")
            before = row.source
        name = latex_text(row.name) + (r" (paper, $n=20$)" if row.source == "paper" else "")
        lines.append(_row([name, *(_figure(figure) for figure in row.figures)]))
    lines += [r"\bottomrule", r"\end{tabular}"]
    return _floated(lines, table.caption, f"tab:better_{table.name}")


def _row(cells: Sequence[str]) -> str:
    """Return one line of a tabular from its LaTeX cells.

    LaTeX treats a bracket or an asterisk that follows the end of a row or a rule as an argument, even on a new line. An
    empty group in front of the row's text prevents this.
    """
    line = " & ".join(cells) + r" \\"
    return f"{{}}{line}" if line.lstrip(" ~").startswith(("[", "*")) else line


def _floated(lines: Sequence[str], caption: str, label: str) -> str:
    """Return a tabular inside a table float, with caption and label."""
    head = [
        "% needs the package booktabs",
        r"\begin{table}[t]",
        r"\centering",
        rf"\caption{{{latex_text(caption)}}}",
        rf"\label{{{label}}}",
    ]
    return "\n".join([*head, *lines, r"\end{table}"]) + "\n"


def _figure(figure: Figure) -> str:
    """Return a number as LaTeX, with its count and interval in small print."""
    if figure.missing:
        return "--"
    number = latex_text(figure.number(1)) + ("" if figure.difference else r"\,\%")
    count, ends = latex_text(figure.count()), latex_text(figure.interval(1))
    small = ", ".join(part for part in (count, f"[{ends.replace(' to ', ', ')}]" if ends else "") if part)
    return rf"{number} {{\scriptsize ({small})}}" if small else number


def _numeric(table: Table, column: int) -> bool:
    """Return whether a column contains only numbers."""
    values = [row[column] for row in table.rows if row[column] is not None]
    return bool(values) and all(isinstance(v, int | float) and not isinstance(v, bool) for v in values)


def _cell(value: Scalar) -> str:
    """Return the text of a table cell. Fractions are rounded to four decimals."""
    if value is None:
        return "--"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return latex_text(str(round_half_up(value, 4))) if math.isfinite(value) else "--"
    return latex_text(str(value))
