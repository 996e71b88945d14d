"""``better real status``: show the progress of a protocol and the next trial."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Annotated, Any

import tyro

from betterbench.cli.console import print_item, print_json, print_table

_TITLES = {
    "attempt": "try",
    "late_steps": "late",
    "held_steps": "held",
    "limited_steps": "limited",
    "late_frames": "frames",
    "agreement": "match",
    "overridden": "forced",
    "operators": "entry",
}
"""Short column titles, so that the table fits into 80 characters."""
_STEPS = ("late_steps", "held_steps", "limited_steps", "late_frames")
"""Columns that are omitted to save space if the condition and the policy are shown."""


def status_command(
    folder: Annotated[Path, tyro.conf.Positional], *, open_codes: bool = False, json: bool = False
) -> None:
    """Show the progress of a protocol: finished trials, entries, repeated attempts, and late frames.

    The condition and the policy of each trial code are hidden, so that operators and judges can use this command.
    --open-codes shows them.

    Example: better real status bench

    Args:
        folder: Folder of the protocol.
        open_codes: Show the condition and the policy of each finished trial.
        json: Print one JSON document instead of tables.
    """
    from betterbench.real.record import read_run

    run = read_run(folder)
    rows = []
    for trial in run.trials:
        header, films = trial.header, trial.header.films.values()
        rows.append(
            {
                "code": trial.code,
                "attempt": header.attempt,
                "steps": header.steps,
                "late_steps": header.late_steps,
                "held_steps": header.held_steps,
                "limited_steps": header.limited_steps,
                "late_frames": sum(film.late for film in films),
                "agreement": header.agreement,
                "overridden": header.overridden,
                "operators": len(trial.seen_by("operator")),
                "judges": len(trial.seen_by("judge")),
                **({"condition": trial.planned.condition, "policy": trial.planned.policy} if open_codes else {}),
            }
        )
    states = Counter(progress.state for progress in run.states.values())
    following = next((t.code for t in run.plan.trials if run.states[t.code].state != "done"), None)
    aborted = [{"code": e.code, "attempt": e.attempt, "event": e.event, "reason": e.reason} for e in run.aborted]
    counts = {"planned": len(run.plan.trials), **{name: states[name] for name in ("done", "running", "open")}}
    if json:
        damaged = [{"code": t.code, "attempt": t.attempt, "problem": t.problem} for t in run.damaged]
        print_json({**counts, "next": following, "trials": rows, "damaged": damaged, "aborted": aborted})
        return
    title = f"{counts['done']} of {counts['planned']} trials are done" + (f"; next: {following}" if following else "")
    if not rows:
        print_item(title)
    else:
        columns = [name for name in rows[0] if not (open_codes and name in _STEPS)]
        cells = [[_cell(row[name]) for name in columns] for row in rows]
        print_table([_TITLES.get(name, name) for name in columns], cells, title=title)
    for bad in run.damaged:
        print_item(f"{bad.code} is damaged: {bad.problem}")
    if aborted:
        table = [[str(each[c]) for c in ("code", "attempt", "event", "reason")] for each in aborted]
        print_table(["code", "attempt", "event", "reason"], table, title="attempts that do not count")


def _cell(value: Any) -> str:  # noqa: ANN401 - of a row
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else ""
    return f"{value:.2f}" if isinstance(value, float) else str(value)
