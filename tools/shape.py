"""Print measurements of the code: sizes, functions, names, task and asset files, packages, imports, start-up times.

Examples:
    python tools/shape.py                          print the tables
    python tools/shape.py --against ../old         print each number before (../old) and after
    python tools/shape.py --write-docs --times     write the tables into docs/contributing.md

The numbers are only informative; no check depends on them. ``tools/code_measures.py`` describes how
everything is counted.
"""

from __future__ import annotations

import argparse
import os
import re
import resource
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from code_measures import Function, Shape, measure

LONG = 60
"""A function of more lines is long."""

TIMED_RUNS = 2
"""Number of runs per verb, of which the fastest counts: the first run may have to compile modules."""
BEGIN, END = "<!-- shape:begin -->", "<!-- shape:end -->"
PAGE = Path("docs/contributing.md")


@dataclass(frozen=True)
class Measure:
    """One number of the summary.

    Attributes:
        name: Name of the measurement.
        value: The number.
        where: Source of the number, if one or a few places can be named.
        unit: Written after the number.
    """

    name: str
    value: float
    where: str = ""
    unit: str = ""

    @property
    def text(self) -> str:
        """The number with its unit; whole numbers have thousands separators."""
        return f"{self.value:,}{self.unit}" if isinstance(self.value, int) else f"{self.value:.1f}{self.unit}"


@dataclass(frozen=True)
class Table:
    """A table with named rows, so that two tables can be merged.

    Attributes:
        title: Heading.
        columns: Column headings; the first is the heading of the row names, the second the heading of the compared
            number.
        rows: The cells of each row without its name.
    """

    title: str
    columns: tuple[str, ...]
    rows: Mapping[str, tuple[str, ...]]


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the tables that the command line requests.

    Args:
        arguments: Command line without the program name; default: the process's command line.

    Returns:
        Exit status: 0, or 2 if a checkout cannot be measured.
    """
    options = _parser().parse_args(arguments)
    try:
        return _run(options)
    except (OSError, ValueError, subprocess.CalledProcessError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2


def _run(options: argparse.Namespace) -> int:
    shape = measure(options.root)
    tables = tables_of(shape, options.root, times=options.times)
    if options.write_docs:
        write_docs(options.root / PAGE, as_markdown(tables))
        return 0
    if options.against is not None:
        before = tables_of(measure(options.against), options.against, times=options.times)
        tables = [merged(old, new) for old, new in zip(before, tables, strict=True)]
    print(as_markdown(tables) if options.markdown else as_text(tables))
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description="Print the shape of the code.")
    parser.add_argument("--root", type=Path, default=Path(__file__).parents[1], help="checkout to measure")
    parser.add_argument("--markdown", action="store_true", help="print the tables as Markdown")
    parser.add_argument("--times", action="store_true", help="measure the start-up time of each verb too (slow)")
    action = parser.add_mutually_exclusive_group()
    action.add_argument("--against", type=Path, help="older checkout: print each number before and after")
    action.add_argument("--write-docs", action="store_true", help=f"write the tables into {PAGE}")
    return parser


# -------------------------------------------------------------------------------------------------------- measures


def summary(shape: Shape) -> list[Measure]:
    """Return the figures for the complete checkout."""
    code = sorted((f for f in shape.functions if not f.data), key=lambda f: -f.lines)
    long = [f for f in code if f.lines > LONG]
    longest = code[0] if code else Function("", 0, 0, data=False)
    deepest = max(shape.functions, key=lambda f: f.nesting, default=longest)
    upward = [f"{p.name} → {target}" for p in shape.packages for target in p.upward]
    return [
        Measure("files", shape.files),
        Measure("lines", shape.lines),
        Measure("lines of docstrings", 100 * shape.docstring_lines / max(shape.lines, 1), unit=" %"),
        Measure("functions and methods", len(shape.functions)),
        Measure("lines of the longest function", longest.lines, longest.name),
        Measure(f"functions of more than {LONG} lines", len(long)),
        Measure("deepest nesting", deepest.nesting, deepest.name),
        Measure("public names in several files", len(shape.repeated)),
        Measure("lines of all task files", sum(shape.tasks.values())),
        Measure("imports against the layers", len(upward), ", ".join(upward)),
    ]


def task_files(shape: Shape) -> list[Measure]:
    """Return the length of each task file."""
    return [Measure(name, lines, unit=" lines") for name, lines in shape.tasks.items()]


def asset_files(shape: Shape) -> list[Measure]:
    """Return the length of each asset file that is listed."""
    return [Measure(name, lines, unit=" lines") for name, lines in shape.assets.items()]


# ---------------------------------------------------------------------------------------------------------- tables


def tables_of(shape: Shape, root: Path, *, times: bool = False) -> list[Table]:
    """Return all tables of a checkout.

    Args:
        shape: Its measurements.
        root: Its folder.
        times: Whether to run the checkout's command line for the table of start-up times.
    """
    tables = [
        _summary(shape),
        _long_functions(shape),
        Table("Public names in several files", ("name", "files", "where"), dict(_repeated_rows(shape))),
        _file_lengths("Task files", task_files(shape)),
        _file_lengths("Asset files", asset_files(shape)),
        _packages(shape),
    ]
    return [*tables, _start_up(root)] if times else tables


def _summary(shape: Shape) -> Table:
    rows = {m.name: (m.text, m.where) for m in summary(shape)}
    return Table("Summary", ("measure", "value", "where"), rows)


def _file_lengths(title: str, files: Sequence[Measure]) -> Table:
    rows = {m.name: (m.text.removesuffix(m.unit),) for m in files}
    return Table(title, ("file", "lines"), rows)


def _long_functions(shape: Shape) -> Table:
    long = sorted((f for f in shape.functions if f.lines > LONG), key=lambda f: (f.data, -f.lines, f.name))
    rows = {f.name: (str(f.lines), "pure data" if f.data else "") for f in long}
    return Table(f"Functions of more than {LONG} lines", ("function", "lines", "kind"), rows)


def _repeated_rows(shape: Shape) -> Iterator[tuple[str, tuple[str, ...]]]:
    for name, paths in shape.repeated.items():
        yield name, (str(len(paths)), ", ".join(paths))


def _packages(shape: Shape) -> Table:
    rows: dict[str, tuple[str, ...]] = {}
    for p in shape.packages:
        arrows = ", ".join(f"**{name}** (against the layers)" if name in p.upward else name for name in p.imports)
        rows[p.name] = (f"{p.lines:,}", str(p.files), arrows, p.purpose.replace("``", "`"))
    return Table("Packages, from the top down", ("package", "lines", "files", "imports", "purpose"), rows)


def merged(before: Table, after: Table) -> Table:
    """Return one table with the compared number before and after; the other columns come from ``after``."""
    name, value, *rest = after.columns
    rows: dict[str, tuple[str, ...]] = {}
    for key in [*after.rows, *(k for k in before.rows if k not in after.rows)]:
        old, new = before.rows.get(key, ("–",)), after.rows.get(key, ("–", *("" for _ in rest)))
        rows[key] = (old[0], *new)
    return Table(after.title, (name, f"{value} before", f"{value} after", *rest), rows)


# -------------------------------------------------------------------------------------------------- start-up times


def _start_up(root: Path) -> Table:
    rows = {f"better {verb}".strip(): (f"{_seconds(root, verb):.2f}",) for verb in ["", *verbs(root)]}
    return Table("Start-up time of --help", ("command", "CPU seconds"), rows)


def verbs(root: Path) -> list[str]:
    """Return the verbs of a checkout's command line, as its ``--help`` lists them in braces.

    Raises:
        ValueError: If the help has no such list.
    """
    text = re.sub(r"\x1b\[[0-9;]*m", "", _help(root, ""))
    found = re.search(r"\{\s*([a-z][\w-]*(?:\s*,\s*[a-z][\w-]*)*)\s*\}", text)
    if found is None:
        raise ValueError(f"`better --help` of {root} lists no verbs in braces:\n{text}")
    return re.split(r"\s*,\s*", found[1])


def _seconds(root: Path, verb: str) -> float:
    """Return the CPU seconds, user and system, of the fastest of several runs of ``better VERB --help``."""
    taken = []
    for _ in range(TIMED_RUNS):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        _help(root, verb)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        taken.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    return min(taken)


def _help(root: Path, verb: str) -> str:
    """Return the output of ``better VERB --help`` in a checkout, without colors and with wide lines."""
    path = os.pathsep.join(filter(None, (str((root / "src").resolve()), os.environ.get("PYTHONPATH"))))
    environ = {**os.environ, "PYTHONPATH": path, "COLUMNS": "1000", "NO_COLOR": "1"}
    command = [sys.executable, "-m", "betterbench.cli", *([verb] if verb else []), "--help"]
    return subprocess.run(command, env=environ, check=True, stdout=subprocess.PIPE, text=True).stdout


# ---------------------------------------------------------------------------------------------------------- output


def as_text(tables: Sequence[Table]) -> str:
    """Return tables for a terminal, with aligned columns and a note for tables without rows."""
    return "\n\n".join("\n".join(_text_lines(table)) for table in tables)


def _text_lines(table: Table) -> Iterator[str]:
    yield table.title
    if not table.rows:
        yield "  none"
        return
    cells = [table.columns, *((name, *row) for name, row in table.rows.items())]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    for row in cells:
        yield ("  " + "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True))).rstrip()


def as_markdown(tables: Sequence[Table]) -> str:
    """Return tables for a page, each below a heading of the third level."""
    return "\n\n".join("\n".join(_markdown_lines(table)) for table in tables)


def _markdown_lines(table: Table) -> Iterator[str]:
    yield from (f"### {table.title}", "")
    if not table.rows:
        yield "None."
        return
    yield _markdown_row(table.columns)
    yield "|" + "---|" * len(table.columns)
    for name, row in table.rows.items():
        yield _markdown_row((name if table.columns[0] == "measure" else f"`{name}`", *row))


def _markdown_row(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def write_docs(page: Path, text: str) -> None:
    """Replace the text between two markers on a page.

    Raises:
        ValueError: If the page does not contain each marker once, the first before the second.
    """
    head, begin, rest = page.read_text(encoding="utf-8").partition(BEGIN)
    _, end, tail = rest.partition(END)
    if not (begin and end) or BEGIN in rest or END in tail:
        raise ValueError(f"{page} must contain the line {BEGIN} and after it the line {END}, each once")
    page.write_text(f"{head}{BEGIN}\n\n{text}\n\n{END}{tail}", encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
