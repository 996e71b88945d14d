"""Progress display for long-running work: a one-line bar on a terminal, or occasional progress lines elsewhere."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, NamedTuple

from rich import filesize
from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, RenderableType, RenderResult
from rich.measure import Measurement
from rich.progress import Progress, ProgressColumn, Task, TaskID
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

LEAST_BAR, MOST_BAR = 8, 24
NOTE_ROOM = 36
"""Number of columns reserved for the note, so that the bar keeps its width when the note changes."""

LEAST_WHAT, LEAST_NOTE = 16, 16

ECHO = 3
"""Number of free columns at the end of the line, so that the ^C printed by the terminal does not cause a line break."""

FIRST_LINE_S, NEXT_LINE_S = 10.0, 60.0
"""Time until the first progress line without a terminal, and interval between later lines [s]."""


class _Widths(NamedTuple):
    """Widths of the parts of the progress line that can be shortened, in columns. An omitted part has width 0."""

    what: int
    bar: int
    note: int


def _widths_of(room: int, what: int, note: int, *, note_first: bool) -> _Widths:
    """Divide the remaining columns of the progress line among the name of the work, the bar and the note.

    All parts except the first include a leading space.

    Args:
        room: Number of columns that are not used by counts and times.
        what: Width of the work's name in columns.
        note: Width of the note in columns.
        note_first: Whether the note has priority over the bar and the name. If not, the note is shortened first.
    """
    if not note:
        bar = min(MOST_BAR, max(LEAST_BAR, room - what - 1))
        named = min(what, room - bar - 1)
        return _Widths(named, bar, 0) if named >= min(what, LEAST_WHAT) else _Widths(min(what, room), 0, 0)
    if note_first:
        bar = min(MOST_BAR, room - what - note - 2)
        if bar >= LEAST_BAR:
            return _Widths(what, bar, note)
        named = min(what, max(LEAST_WHAT, room - note - 1))
        return _Widths(named, 0, max(0, min(note, room - named - 1)))
    named = max(0, min(what, max(LEAST_WHAT, room - LEAST_BAR - LEAST_NOTE - 2)))
    bar = min(MOST_BAR, max(LEAST_BAR, room - named - NOTE_ROOM - 2))
    if room - named - bar - 2 < LEAST_NOTE:
        bar = 0
    left = room - named - (bar + 1 if bar else 0) - 1
    return _Widths(named, bar, max(0, min(note, left)))


def _clock(seconds: float) -> str:
    """Return a duration as "0:04:12"."""
    whole = int(seconds)
    return f"{whole // 3600}:{whole // 60 % 60:02d}:{whole % 60:02d}"


def took(seconds: float, size: int) -> str:
    """Format the size of a data set and the time spent in this session: "1.1 GB on disk, 0:22:55 in this session".

    The time of earlier sessions of a resumed job is not included.
    """
    return f"{filesize.decimal(size)} on disk, {_clock(seconds)} in this session"


def _count_text(task: Task) -> str:
    """Format the amount of finished work ("  7/120"). Return an empty string while the total is unknown."""
    if task.total is None:
        return ""
    total = f"{int(task.total)}"
    return f"{int(task.completed):>{len(total)}}/{total}"


def _time_text(task: Task) -> str:
    """Format the time left ("0:04:12 left"), or the elapsed time if the work has ended or its total is unknown."""
    left = None if task.finished else task.time_remaining
    return f"{_clock(task.elapsed or 0.0)}     " if left is None else f"{_clock(left)} left"


class _Line:
    """Progress line that is shortened to the width of the terminal."""

    def __init__(self, task: Task, *, timed: bool) -> None:
        self.task, self.timed = task, timed

    def __rich_measure__(self, console: Console, options: ConsoleOptions) -> Measurement:
        return Measurement(1, max(1, options.max_width - ECHO))

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        task, note = self.task, str(self.task.fields["note"])
        figures = [text for text in (_count_text(task), _time_text(task) if self.timed or not note else "") if text]
        room = options.max_width - sum(len(text) + 1 for text in figures)
        width = _widths_of(room, cell_len(task.description), cell_len(note), note_first=not self.timed)
        bar = ProgressBar(task.total, task.completed, width.bar, task.total is None, animation_time=task.get_time())
        name: tuple[RenderableType, int] = Text(task.description), width.what
        parts = [name, (bar, width.bar), *((Text(text), len(text)) for text in figures)]
        table = Table.grid(padding=(0, 1, 0, 0), pad_edge=False)
        shown = [(part, columns) for part, columns in (*parts, (Text(note), width.note)) if columns > 0]
        for _, columns in shown:
            table.add_column(width=columns, no_wrap=True, overflow="ellipsis")
        table.add_row(*(part for part, _ in shown))
        yield table


class _LineColumn(ProgressColumn):
    def __init__(self, *, timed: bool) -> None:
        super().__init__()
        self._timed = timed

    def render(self, task: Task) -> Any:  # noqa: ANN401 - whatever rich can draw
        return _Line(task, timed=self._timed)


class WorkProgress(Progress):
    """One-line progress bar on a terminal, or log lines elsewhere.

    Args:
        console: Console on which the bar is drawn, if it is a terminal.
        timed: Whether to show the elapsed or remaining time. If not, the elapsed time is shown only while the note is
            empty.
        stays: Whether the bar remains after the work has ended.
        log: Function that receives the progress lines if there is no terminal. If it is None, no lines are printed.
    """

    def __init__(self, console: Console, *, timed: bool, stays: bool, log: Callable[[str], None] | None) -> None:
        super().__init__(
            _LineColumn(timed=timed), console=console, disable=not console.is_terminal, transient=not stays
        )
        self._log = None if console.is_terminal else log
        self._next_line = time.monotonic() + FIRST_LINE_S

    def update(self, task_id: TaskID, **changes: Any) -> None:  # noqa: ANN401 - the arguments of rich
        """Update the progress. The arguments are the same as for :meth:`rich.progress.Progress.update`."""
        super().update(task_id, **changes)
        if self._log is not None and time.monotonic() >= self._next_line:
            self._next_line = time.monotonic() + NEXT_LINE_S
            self._log(_logged(self._tasks[task_id]))

    def advance(self, task_id: TaskID, advance: float = 1) -> None:
        """Increase the amount of finished work."""
        self.update(task_id, advance=advance)


def _logged(task: Task) -> str:
    left = "" if task.finished or task.time_remaining is None else f"{_clock(task.time_remaining)} left"
    parts = [text for text in (_count_text(task).strip(), left, str(task.fields["note"])) if text]
    return f"{task.description}: {', '.join(parts)}"
