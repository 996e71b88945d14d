"""Functions that print information about a set of demonstrations: progress, variety and acceptance."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from betterbench.cli.console import OUT, passing_bar, print_json, print_table, progress_bar

if TYPE_CHECKING:
    from betterbench.demonstrations.making.production import SetProgress
    from betterbench.demonstrations.making.variety import TaskVariety
    from betterbench.records import RunFolder


def bar_note(progress: SetProgress) -> str:
    """Return the note of the progress bar: the number of attempts, and the initial state of the last attempt."""
    last = "" if progress.last is None else f", {progress.last.trial}"
    return f"{progress.attempts} attempts{last}"


def tell_variety(variety: Sequence[TaskVariety], sources: Sequence[TaskVariety] = ()) -> None:
    """Print the variety of a set of demonstrations, i.e. the differences between them.

    If the set was generated from source demonstrations, the variety of the sources is printed too.
    """
    from betterbench.demonstrations.making.variety import SPREADS, variety_rows

    if variety:
        title = "variety: mean difference between two demonstrations [cm, s, °]"
        # the header has no units, so that the table fits into 80 columns
        headings = (heading.split(" [")[0] for heading in SPREADS.values())
        print_table(("task", "of", *headings), variety_rows(variety, sources), title=title)


def tell_acceptance(run: RunFolder, *, films: bool, json: bool) -> None:
    """Write the acceptance report of a set of demonstrations, and print its summary and the attempts per hour."""
    from betterbench.demonstrations.making.acceptance import acceptance_of, write_acceptance
    from betterbench.demonstrations.making.failure_films import film_failures
    from betterbench.demonstrations.making.paths import draw_paths

    with passing_bar("comparing the demonstrations") as told:
        found = acceptance_of(run, on_progress=told)
    rendered: dict[tuple[str, str], str] = {}
    failures = sum(len(task.examples) for task in found.tasks)
    if films and failures:
        with progress_bar("film failures", failures, stays=False) as (bar, shown):
            rendered = film_failures(run, found, on_progress=lambda done, _: bar.update(shown, completed=done))
    pictures: dict[str, str] = {}
    if films:
        with passing_bar("drawing the paths") as told:
            pictures = draw_paths(run, on_progress=told)
    page = write_acceptance(run, found, rendered, pictures)
    if json:
        print_json(found.to_json())
        return
    rows = [
        (
            t.task,
            str(t.attempts),
            str(t.starts),
            f"{t.steps / max(1, t.attempts.accepted):.0f}",
            ", ".join(f"{kind} {count}" for kind, count in t.failures.items()) or "none",
        )
        for t in found.tasks
    ]
    print_table(("task", "attempts accepted", "starts solved", "mean steps", "failures"), rows)
    tell_variety(found.variety, found.sources)
    walls = [entry.wall for entry in run.entries()]
    seconds, attempts = sum(w.get("total_s", 0.0) for w in walls), sum(t.attempts.attempts for t in found.tasks)
    per_hour = f"{3600.0 * attempts / seconds:,.0f} attempts per hour and worker" if seconds else "no attempt yet"
    OUT.print(f"{found.demonstrations} demonstrations, {per_hour}", markup=False)
    OUT.print(f"hash of the set {found.sha256}\nreport          {page}", markup=False, soft_wrap=True)
