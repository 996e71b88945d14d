"""Results page of a protocol: one HTML file without scripts, which works offline and links to the videos."""

from __future__ import annotations

import os
from pathlib import Path
from urllib.parse import quote

from betterbench.jobs.outputs import mark_of
from betterbench.real.outcomes import OUTCOMES
from betterbench.real.results import RealResults
from betterbench.report.html import environment, write
from betterbench.report.legend import LEGEND
from betterbench.report.tables.matrices import Cell


def write_real_page(results: RealResults, path: Path) -> Path:
    """Write the results page of a protocol, and return its path."""
    run = results.run
    page = (
        environment()
        .get_template("real.html.jinja")
        .render(
            title=f"{run.plan.task.replace('_', ' ').capitalize()} on the real arm",
            run=run.folder.name,
            task=run.plan.task,
            done=len(run.trials) + len(run.damaged),
            planned=len(run.plan.trials),
            results=results,
            contradictions=[trial for trial in results.trials if trial.label.contradiction],
            legend={label.value: mode for label, mode in LEGEND.items()},
            titles={outcome.name: outcome.title for outcome in OUTCOMES},
            films={trial.code: _film(trial.folder, sorted(trial.header.films), path.parent) for trial in run.trials},
            tone=_tone,
            mark=mark_of("real report"),
        )
    )
    return write(path, page)


def _tone(cell: Cell) -> str:
    """Return the CSS class for the color of a matrix cell.

    The color shows whether all, some or none of the trials succeeded.
    """
    if cell.success.k == cell.success.n:
        return "good"
    return "poor" if cell.success.k == 0 else "mixed"


def _film(folder: Path, cameras: list[str], page: Path) -> str:
    """Return the path of a trial's first video relative to the page; empty if there is no video."""
    if not cameras:
        return ""
    return quote(Path(os.path.relpath(folder / f"{cameras[0]}.mp4", page)).as_posix())
