"""What the command line prints: tables or one JSON document on standard output, messages on standard error."""

from __future__ import annotations

import json
import sys
import textwrap
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from rich.console import Console

if TYPE_CHECKING:
    from rich.progress import Progress

OUT = Console(highlight=False, emoji=False)
ERR = Console(stderr=True, highlight=False, emoji=False)


def print_json(document: object) -> None:
    """Print one JSON document on standard output."""
    sys.stdout.write(json.dumps(document, indent=2, ensure_ascii=False, sort_keys=False) + "\n")


def print_listing(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print rows whose last column is prose: each in a line of its own, with the prose below it, indented."""
    widths = [max(map(len, column)) for column in zip(columns[:-1], *(row[:-1] for row in rows), strict=True)]
    for number, (*cells, prose) in enumerate((columns, *rows)):
        line = "  ".join(cell.ljust(width) for cell, width in zip(cells, widths, strict=True)).rstrip()
        OUT.print(line, markup=False, style="bold" if not number else None)
        for part in textwrap.wrap(prose, max(20, OUT.width - 4)) if number else ():
            OUT.print(f"    {part}", markup=False, style="dim")


def print_table(columns: Sequence[str], rows: Sequence[Sequence[str]], *, title: str | None = None) -> None:
    """Print a table for people."""
    from rich.table import Table

    table = Table(title=title, title_justify="left", box=None, pad_edge=False, header_style="bold")
    for i, column in enumerate(columns):
        table.add_column(column, overflow="fold", no_wrap=i == 0)
    for row in rows:
        table.add_row(*(cell.replace("[", "\\[") for cell in row))
    OUT.print(table)


def say(text: str) -> None:
    """Print a message on standard error."""
    ERR.print(text, markup=False)


@contextmanager
def progress_bar(what: str, total: int, *, estimate: bool = True) -> Iterator[tuple[Progress, Any]]:
    """Show a bar on standard error while long work runs.

    Without ``estimate``, the time taken and the time left give way to the note, which says them.
    """
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(bar_width=40 if estimate else 8),
        MofNCompleteColumn(),
        *((TimeElapsedColumn(), TextColumn("left"), TimeRemainingColumn()) if estimate else ()),
        TextColumn("{task.fields[note]}", markup=False),
    )
    with Progress(*columns, console=ERR, disable=not ERR.is_terminal) as bar:
        yield bar, bar.add_task(what, total=total, note="")
