"""``better premise``: whether the scenes of a foreign world show what their sentences presuppose."""

from __future__ import annotations

import json as json_lines
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from betterbench.cli.console import OUT, print_json, print_table, say

if TYPE_CHECKING:
    from betterbench.worlds.premises import PremiseEntry


def premise_command(
    world: Annotated[Literal["libero"], tyro.conf.Positional],
    *,
    suites: tuple[str, ...] = ("libero_spatial", "libero_object", "libero_goal", "libero_10"),
    out: Path | None = None,
    json: bool = False,
) -> None:
    """Check every initial state of LIBERO against its sentence, on the engine at hand.

    Each state settles as in a run, and every relation of the task's file between a thing that the sentence is about and
    another object is asked of LIBERO itself. An update of the engine breaks scenes. A task takes about half a minute;
    the same command goes on where it was interrupted.

    Example: better premise libero --suites libero_spatial

    Args:
        world: libero.
        suites: The suites to check.
        out: File of JSON lines that keeps the entries; premises-libero.jsonl if not given.
        json: Print one JSON document instead of a table.
    """
    from betterbench.recording.durable import write_durably
    from betterbench.worlds import WorldProcess, suite_named, world_named
    from betterbench.worlds.premises import check_premises, read_entries

    for name in suites:
        suite_named(name)
    path = out or Path("premises-libero.jsonl")
    known = read_entries(path)
    kept: list[PremiseEntry] = list(known)
    found: list[PremiseEntry] = []
    with WorldProcess(world_named(world).command()) as process:
        for name in suites:
            for entry in check_premises(process, name, known=known):
                found.append(entry)
                if entry not in known:
                    kept.append(entry)
                    write_durably(path, "".join(json_lines.dumps(e.to_json()) + "\n" for e in kept).encode())
                say(f"{entry.suite} task {entry.task}: {len(entry.broken_states)} of {entry.states} states broken")
    if json:
        print_json([entry.to_json() for entry in found])
        return
    rows = [[e.suite, str(e.task), f"{len(e.broken_states)}/{e.states}", _said(e), e.instruction] for e in found]
    print_table(["suite", "task", "broken", "what does not hold, or jumps", "sentence"], rows)
    OUT.print(f"engine: {found[0].engine if found else 'none'}", markup=False, soft_wrap=True)


def _said(entry: PremiseEntry) -> str:
    said = [f"{name} in {_states(states)}" for name, states in entry.broken.items()]
    said += [f"{name} moves while settling in {_states(states)}" for name, states in entry.jumps.items()]
    return "; ".join(said)


def _states(states: list[int]) -> str:
    shown = ", ".join(map(str, states[:5]))
    return shown + (f" and {len(states) - 5} more" if len(states) > 5 else "")
