"""``better premise``: check whether LIBERO and LIBERO-Plus scenes match the premises of their instructions."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from betterbench.cli.console import OUT, print_json, print_table, say
from betterbench.errors import InvalidInputError

if TYPE_CHECKING:
    from betterbench.sim.worlds.premises import PremiseEntry


def premise_command(
    world: Annotated[Literal["libero", "libero_plus"], tyro.conf.Positional],
    *,
    suites: tuple[str, ...] = (),
    out: Path | None = None,
    overwrite: bool = False,
    json: bool = False,
) -> None:
    """Check every initial state of LIBERO against its instruction, in the installed simulator.

    The objects settle as at the beginning of a run. LIBERO then evaluates each relation in the task file that connects
    an object named in the instruction to another object. An update of the simulator can break scenes, so repeat this
    check after each update. Checking a task takes about half a minute. Running the command again resumes the job where
    it stopped. In LIBERO-Plus, each new layout and initial robot pose has one initial state, which is checked in a few
    seconds if its assets are installed.

    Example: better premise libero --suites libero_spatial

    Args:
        world: World whose scenes are checked: libero or libero_plus.
        suites: Suites to check; default: the spatial, object, goal and 10 suites of the world.
        out: File of JSON lines for the results; premises-libero.jsonl, or premises-libero_plus.jsonl, if not given.
        overwrite: Replace a file at --out that contains other data.
        json: Print one JSON document instead of a table.
    """
    from betterbench.jobs.durable import write_durably
    from betterbench.jobs.outputs import OutputFile
    from betterbench.sim.worlds import WorldProcess, world_named
    from betterbench.sim.worlds.premises import check_premises, entries_bytes, is_premise_file, read_entries
    from betterbench.tasks.worlds.libero import PLUS_SUITES, suite_named

    chosen = suites or tuple(f"{world}_{name}" for name in ("spatial", "object", "goal", "10"))
    for name in chosen:
        if (suite_named(name).name in PLUS_SUITES) != (world == "libero_plus"):
            raise InvalidInputError(
                "--suites",
                f"{name} is not a suite of the world {world}",
                "Pass suites of this world, or choose the other world",
            )
    path = out or Path(f"premises-{world}.jsonl")
    found: list[PremiseEntry] = []
    with OutputFile(path, "premise", overwrite=overwrite, is_ours=is_premise_file), ExitStack() as stack:
        known = read_entries(path) if not overwrite or is_premise_file(path) else ()
        kept: list[PremiseEntry] = list(known)
        process = stack.enter_context(WorldProcess(world_named(world).start_command()))
        for name in chosen:
            for entry in check_premises(process, name, known=known):
                found.append(entry)
                if entry not in known:
                    kept.append(entry)
                    write_durably(path, entries_bytes(kept))
                say(f"{entry.suite} {_task(entry)}: {len(entry.broken_states)} of {entry.states} states broken")
    if json:
        print_json([entry.to_json() for entry in found])
        return
    shown = found if world == "libero" else [e for e in found if e.broken or e.jumps]
    rows = [
        [e.suite, _task(e).removeprefix("task "), f"{len(e.broken_states)}/{e.states}", _said(e), e.instruction]
        for e in shown
    ]
    print_table(["suite", "task", "broken", "false relations and jumps", "instruction"], rows)
    OUT.print(f"engine: {found[0].engine if found else 'none'}", markup=False, soft_wrap=True)


def _task(entry: PremiseEntry) -> str:
    from betterbench.tasks.worlds.libero_plus import read_variant

    return f"task {entry.task}" + (f" {read_variant(entry.variant).condition}" if entry.variant else "")


def _said(entry: PremiseEntry) -> str:
    said = [f"{name} in {_states(states)}" for name, states in entry.broken.items()]
    said += [f"{name} moves while settling in {_states(states)}" for name, states in entry.jumps.items()]
    return "; ".join(said)


def _states(states: list[int]) -> str:
    shown = ", ".join(map(str, states[:5]))
    return shown + (f" and {len(states) - 5} more" if len(states) > 5 else "")
