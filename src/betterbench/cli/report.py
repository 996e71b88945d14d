"""``better report``: one page that says what a policy does and why."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import tyro

from betterbench.cli.console import OUT, progress_bar, say
from betterbench.diagnosis import RunDiagnosis, diagnose_run
from betterbench.errors import MissingDependencyError, RecordError
from betterbench.evaluation import Shot, render_shots
from betterbench.recording import RunFolder
from betterbench.report import Film, Frame, trials_worth_showing, write_report


def report(
    run: Annotated[tuple[Path, ...], tyro.conf.Positional],
    *,
    out: Path | None = None,
    latex: bool = True,
    films: int = 40,
) -> None:
    """Write one self-contained HTML page, with its tables as CSV and LaTeX beside it.

    Example: better report runs/expert

    Args:
        run: Folder of a run; several are put side by side.
        out: Folder of the report; RUN/report if not given.
        latex: Write LaTeX tables too.
        films: Largest number of trials to show as film strips; 0 for none.
    """
    runs = [RunFolder.open(path) for path in run]
    page = build_report(runs, out or runs[0].report_path, latex=latex, films=films)
    OUT.print(str(page), markup=False)
