"""``better list``: list suites, tasks, variations, policies, assets and templates."""

from __future__ import annotations

from typing import Annotated, Literal

import tyro

from betterbench.cli.console import OUT, print_json, print_listing, print_table

What = Literal["suites", "tasks", "variations", "policies", "assets", "templates"]


def list_command(
    what: Annotated[What, tyro.conf.Positional, tyro.conf.arg(metavar="WHAT")],
    *,
    tasks: tuple[str, ...] = (),
    json: bool = False,
) -> None:
    """List suites, tasks, variations, policies, assets or templates.

    Example: better list variations

    Args:
        what: Kind of list: suites, tasks, variations, policies, assets or templates.
        tasks: Tasks to list, or tasks for which to list the variations; default: all loaded tasks.
        json: Print one JSON document instead of a table.
    """
    columns, rows = _table(what, tasks)
    if json:
        print_json([dict(zip(columns, row, strict=True)) for row in rows])
        return
    if what == "tasks":
        shown = [[*row[:3], *row[4:6], f"{row[3]}: {row[6]}"] for row in rows]
        print_listing(["task", "suite", "title", "training", "variations", ""], shown)
    elif what == "suites":
        print_table([*columns[:2], *columns[3:]], [[suite, world, *rest] for suite, world, _, *rest in rows])
        absent = list(dict.fromkeys(world for _, world, installed, *_ in rows if installed == "no"))
        if absent:
            OUT.print(f"\nnot installed here: {', '.join(absent)}. To install one:", markup=False)
            OUT.print(f"better worlds install {absent[0]}", markup=False)
    elif what == "templates":
        print_listing(
            [*columns[:2], ""],
            [[name, title, f"{said} Objects: {counts}. Tasks: {tasks}."] for name, title, tasks, said, counts in rows],
        )
    elif what == "variations":
        print_table(["variation", *columns[2:]], [[name, *rest] for name, _, *rest in rows])
        axes = {name.split("/")[1][0]: axis.replace("_", " ") for name, axis, *_ in rows}
        letters = [row[0].split("/")[1][0] for row in rows]
        counts = ", ".join(f"{letters.count(letter)} {letter}" for letter in "LROT")
        OUT.print(f"\n{len(rows)} variations: {counts}", markup=False)
        OUT.print(", ".join(f"{letter}: {axes[letter]}" for letter in "LROT" if letter in axes), markup=False)
    else:
        print_table(columns, rows)
    if what == "variations":
        OUT.print(
            "support: whether the training demonstrations contain every pose that the variation needs", markup=False
        )
    elif what == "policies":
        OUT.print("\nzoo: faulty policies; each has one known fault that the diagnosis must find", markup=False)


def _table(what: What, names: tuple[str, ...]) -> tuple[list[str], list[list[str]]]:
    """Return the column titles and the rows of a list."""
    if what == "suites":
        return ["suite", "world", "installed", "tasks", "what it is"], _suites()
    if what == "policies":
        from betterbench.policies.kinds import known_policies

        policies = [[p.address, "state" if p.privileged else "observations", p.summary] for p in known_policies()]
        return ["policy", "sees", "what it does"], policies
    if what == "assets":
        from betterbench.sim.assets import categories, colors, looks

        assets = [[name, str(len(looks(name))), ", ".join(colors(name))] for name in categories()]
        return ["asset", "looks", "colors"], assets
    from betterbench.tasks import TEMPLATES, all_tasks, get_task, suite_of

    tasks = [get_task(name) for name in names] if names else all_tasks()
    if what == "tasks":
        return ["task", "suite", "title", "template", "training", "variations", "description"], [
            [
                *(t.id, suite_of(t.id) or "", t.title, t.template.title),
                *(str(len(t.training)), str(len(t.variations)), t.description),
            ]
            for t in tasks
        ]
    if what == "templates":
        known = list(TEMPLATES.values())
        for task in tasks:
            if task.template not in known:
                known.append(task.template)
        return ["template", "title", "tasks", "challenge", "objects"], [
            [
                *(t.name, t.title, ", ".join(task.id for task in tasks if task.template == t), t.challenge),
                ", ".join(f"{group.counts} {group.group_id}" for group in t.groups),
            ]
            for t in known
        ]
    return ["variation", "axis", "from", "expected", "support", "what changes"], [
        [f"{t.id}/{v.name}", v.axis.value, v.base, v.expected.value, v.support.value, v.title]
        for t in tasks
        for v in t.variations
    ]


def _suites() -> list[list[str]]:
    """Return a row for each suite of every world. The row states whether the simulator of the world is installed."""
    from betterbench.sim.worlds import all_worlds

    return [
        [suite.name, world.name, "yes" if world.is_ready else "no", str(suite.tasks), suite.summary]
        for world in all_worlds()
        for suite in world.facts.suites.values()
    ]
