"""Output of the command line: tables or one JSON document on standard output, messages on standard error."""

from __future__ import annotations

import codecs
import contextlib
import io
import os
import re
import sys
import textwrap
from collections.abc import Collection, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Any, TextIO

from rich.console import Console

from betterbench.errors import one_line, printable
from betterbench.installation import as_started_here
from betterbench.quoting import json_text

if TYPE_CHECKING:
    from rich.progress import Progress

    from betterbench.jobs import OnCount

LONGEST_MESSAGE = 20_000
"""Maximum length of a message or table cell [characters]. Only text from files and servers can be longer."""

NUMBER = re.compile(r"[-+]?\d[\d,]*(\.\d+)?( ?%)?|–")
"""Pattern of a numeric cell. Numeric columns are right-aligned."""


class Terminal(Console):
    """Console that strips control characters from its output, because printed strings may come from an untrusted file.

    ``better`` commands that a message recommends are rewritten to match how this program was started.
    """

    def print(self, *objects: Any, **options: Any) -> None:  # noqa: ANN401 - the options of rich
        """Print with rich, without control characters.

        ``better`` commands are rewritten to match how this program was started.

        Brackets are interpreted as styles only if ``markup`` is set.
        """
        options.setdefault("markup", False)
        super().print(*(as_started_here(_printable(o)) if isinstance(o, str) else o for o in objects), **options)

    def on_broken_pipe(self) -> None:
        """Exit without an error if the reader of standard output closed it, as in ``better list tasks | head``."""
        if self.stderr:
            super().on_broken_pipe()
        self.quiet = True
        with contextlib.suppress(OSError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        raise SystemExit(0)


OUT = Terminal(highlight=False, emoji=False)
ERR = Terminal(stderr=True, highlight=False, emoji=False)

_PLAIN = {
    **{ord(c): "-" for c in "\u2010\u2011\u2012\u2013\u2014\u2212\u2500\u2501"},
    **{ord(c): " " for c in "\u00a0\u2009\u202f"},
    **{ord(c): "'" for c in "\u2018\u2019"},
    **{ord(c): '"' for c in "\u201c\u201d"},
    **{ord(c): "|" for c in "\u2502\u2503"},
    **{ord(c): "*" for c in "\u2022\u00b7"},
    ord("\u2026"): "...",
    ord("\u2192"): "->",
    ord("\u00d7"): "x",
    ord("\u2265"): ">=",
    ord("\u2264"): "<=",
    ord("\u00b1"): "+-",
    ord("\u0394"): "Delta",
}
"""Replacements for characters that some terminals do not support.

Other unsupported characters become a question mark.
"""


def _replaced(problem: UnicodeError) -> tuple[str, int]:
    """Error handler for characters that an output stream cannot encode.

    Returns:
        The replacement for these characters, and the position at which encoding continues.
    """
    if not isinstance(problem, UnicodeEncodeError):
        raise problem
    text = problem.object[problem.start : problem.end].translate(_PLAIN)
    return text.encode("ascii", "replace").decode("ascii"), problem.end


def make_streams_patient() -> None:
    """Configure standard output and standard error to replace characters that they cannot encode.

    An ASCII terminal, for example, cannot encode a dash or a degree sign.
    """
    codecs.register_error(_STAND_IN, _replaced)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper) and "utf" not in stream.encoding.lower():
            stream.reconfigure(errors=_STAND_IN)


_STAND_IN = "betterbench-stand-in"

_documents: list[TextIO] = []  # the stream reserved for the JSON document


@contextmanager
def document_alone() -> Iterator[None]:
    """Reserve standard output for :func:`print_json`.

    All other output, including the output of policies, goes to standard error.
    """
    out = sys.stdout
    out.flush()
    with ExitStack() as stack:
        document = out
        with contextlib.suppress(OSError):  # standard output is closed
            kept = os.dup(1)
            stack.callback(os.close, kept)
            if _number_of(out) == 1:
                document = open(kept, "w", encoding=out.encoding, errors=out.errors, closefd=False)  # noqa: SIM115
                stack.callback(document.close)
            os.dup2(2, 1)
            stack.callback(os.dup2, kept, 1)
        _documents.append(document)
        stack.callback(_documents.pop)
        with contextlib.redirect_stdout(sys.stderr):
            yield


def _number_of(stream: TextIO) -> int | None:
    """Return the file descriptor of a stream, or None if the stream is not a file, as in a test or a notebook."""
    try:
        return stream.fileno()
    except (OSError, ValueError):
        return None


def print_json(document: object) -> None:
    """Print one JSON document on standard output, with control characters escaped."""
    out = _documents[-1] if _documents else sys.stdout
    plain = "utf" not in (getattr(out, "encoding", None) or "utf-8").lower()  # escape non-ASCII letters
    out.write(json_text(document, indent=2, ascii_only=plain) + "\n")
    out.flush()


def print_listing(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print each row on one line.

    The last cell of each row is printed as an indented paragraph below that line.
    """
    widths = [max(map(len, column)) for column in zip(columns[:-1], *(row[:-1] for row in rows), strict=True)]
    for number, (*cells, prose) in enumerate((columns, *rows)):
        line = "  ".join(cell.ljust(width) for cell, width in zip(cells, widths, strict=True)).rstrip()
        OUT.print(line, markup=False, style="bold" if not number else None)
        for part in textwrap.wrap(prose, max(20, OUT.width - 4)) if number else ():
            OUT.print(f"    {part}", markup=False, style="dim")


def print_table(
    columns: Sequence[str], rows: Sequence[Sequence[str]], *, title: str | None = None, whole: Collection[int] = ()
) -> None:
    """Print a table with right-aligned numeric columns.

    Brackets in cells are printed literally, not interpreted as rich styles. On a narrow terminal, the cells of
    the first column stay on one line, or those of the columns whose positions are in ``whole`` if it is given.
    """
    from rich.table import Table
    from rich.text import Text

    shown = None if title is None else Text(_printable(title))
    table = Table(title=shown, title_justify="left", box=None, pad_edge=False, header_style="bold")
    for i, column in enumerate(columns):
        numbers = i > 0 and bool(rows) and all(NUMBER.fullmatch(row[i]) for row in rows)
        header = Text(_printable(column))
        least = max(len(row[i]) for row in rows) if i in whole else None
        table.add_column(
            header,
            overflow="fold",
            no_wrap=not whole and i == 0,
            min_width=least,
            justify="right" if numbers else "left",
        )
    for row in rows:
        table.add_row(*(Text(_printable(cell)) for cell in row))
    OUT.print(table)


def print_item(text: str, *, indent: int = 0) -> None:
    """Print a list item. On a terminal, the item is wrapped at words with a hanging indent.

    A number and its percent sign stay on the same line.
    """
    line = " " * indent + one_line(text, most=LONGEST_MESSAGE)
    if OUT.is_terminal:
        whole = line.replace(" %", "\N{NO-BREAK SPACE}%")
        folded = textwrap.wrap(whole, OUT.width, subsequent_indent=" " * (indent + 2), break_on_hyphens=False)
        line = "\n".join(folded).replace("\N{NO-BREAK SPACE}%", " %")
    OUT.print(line, markup=False, soft_wrap=True)


def say(text: str, *, whole: bool = False) -> None:
    """Print a message on standard error, wrapped at words on a terminal.

    If ``whole`` is set, the message is not wrapped, so that a path in the message can be copied.
    """
    ERR.print(text, markup=False, soft_wrap=whole or not ERR.is_terminal)


def complain(problem: str) -> None:
    """Print an error message on one line of standard error, even if a name in the message contains line breaks."""
    from rich.text import Text

    ERR.print(
        Text.assemble(("error:", "bold red"), " ", as_started_here(_printable(" ".join(problem.split("\n"))))),
        soft_wrap=not ERR.is_terminal,
    )


def styled_text(text: str) -> str:
    """Escape untrusted text, so that rich does not interpret its brackets as styles."""
    from rich.markup import escape

    return escape(one_line(text, most=LONGEST_MESSAGE))


def _printable(text: str) -> str:
    return printable(text, most=LONGEST_MESSAGE)


@contextmanager
def passing_bar(what: str) -> Iterator[OnCount]:
    """Show a progress bar that disappears at the end, and yield a callback ``(done, total)`` that updates the bar."""
    with progress_bar(what, 0, stays=False) as (bar, task):
        yield lambda done, planned: bar.update(task, completed=done, total=planned)


@contextmanager
def progress_bar(what: str, total: int, *, estimate: bool = True, stays: bool = True) -> Iterator[tuple[Progress, Any]]:
    """Show a progress bar on standard error, or print occasional progress lines if standard error is not a terminal.

    Args:
        what: Short description of the work.
        total: Amount of work; 0 if it is not known yet.
        estimate: Whether to show the elapsed or remaining time, and to print progress lines if standard error is not a
            terminal. Set it to False if the note next to the bar already contains these times.
        stays: Whether the bar stays on the screen after the work has ended. It then shows the elapsed time.
    """
    from betterbench.cli.progress import WorkProgress

    with WorkProgress(ERR, timed=estimate, stays=stays, log=say if estimate else None) as bar:
        yield bar, bar.add_task(one_line(what, most=100), total=total or None, note="")
