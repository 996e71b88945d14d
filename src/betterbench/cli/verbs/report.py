"""``better report``: write a page with the results of policies and the reasons for their failures."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro

from betterbench.cli.console import OUT


def report_command(
    run: Annotated[tuple[Path, ...], tyro.conf.Positional],
    *,
    name: tyro.conf.UseAppendAction[tuple[str, ...]] = (),
    twins: tyro.conf.UseAppendAction[tuple[Path, ...]] = (),
    out: Path | None = None,
    latex: bool = True,
    films: int = 40,
    overwrite: bool = False,
) -> None:
    """Write one self-contained HTML page, and its tables as CSV and LaTeX in the same folder.

    An unfinished run can be reported too: the page says how many trials are done and counts only those trials.

    Example: better report runs/expert

    Args:
        run: Run folder; several runs are compared on one page.
        name: Name of each run on the page, in the order of the runs; default: the policy names.
        twins: For LIBERO-PRO runs: for each run, the same policy's run of the base suite, in the same order.
        out: Report folder; RUN/report if not given.
        latex: Write LaTeX tables too.
        films: Maximum number of trials shown as videos; other failures are shown as one image. 0 renders nothing.
        overwrite: Write even to a folder that `better report` did not make, and replace files with the same names
            there.
    """
    from betterbench.api.report import report_into
    from betterbench.cli.output.page import LISTENER, print_verdicts
    from betterbench.records import RunFolder

    page, verdicts = report_into(
        [RunFolder.open(path) for path in run],
        out,
        names=name,
        twins=twins,
        latex=latex,
        films=films,
        overwrite=overwrite,
        listener=LISTENER,
    )
    OUT.print(str(page), markup=False, soft_wrap=True)
    print_verdicts(verdicts)
