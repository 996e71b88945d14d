"""``better compare``: which of several policies is better, where, and what their trials cannot tell."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro

from betterbench.cli.console import print_json, progress_bar


def compare_command(
    runs: Annotated[tuple[Path, ...], tyro.conf.Positional],
    *,
    name: tyro.conf.UseAppendAction[tuple[str, ...]] = (),
    alpha: float = 0.05,
    sequential: bool = False,
    allow_mixed: bool = False,
    fail_if_worse: bool = False,
    json: bool = False,
) -> None:
    """Compare policies, two by two, on the trials that their runs share.

    Example: better compare runs/pi05 runs/gr00t

    Args:
        runs: Folders of the runs, or files of better export; two or more.
        name: Name of a run in the tables, once per run and in their order; that of its policy if not given.
        alpha: Level of the tests; intervals have confidence 1 - alpha.
        sequential: Also print tests that stay valid however often you look at runs that are still going.
        allow_mixed: Compare runs of different versions or engines all the same.
        fail_if_worse: Exit with status 1 if the first run is told apart from another one over all variations and is the
            worse of the two; for continuous integration.
        json: Print one JSON document instead of sentences and tables.
    """
    from betterbench.cli.output.comparison import print_comparison
    from betterbench.comparison import compare, load_sides

    with progress_bar("diagnosing", 0, stays=False) as (bar, task):

        def told(run: str, done: int, planned: int) -> None:
            bar.update(task, description=f"diagnosing {run}", completed=done, total=planned)

        sides = load_sides(runs, names=name, allow_mixed=allow_mixed, on_progress=told)
    result = compare(sides, alpha=alpha, sequential=sequential, allow_mixed=allow_mixed)
    if json:
        print_json(result.to_json())
    else:
        print_comparison(result)
    if fail_if_worse and result.first_is_worse:
        raise SystemExit(1)
