"""``better list``: what exists."""

from __future__ import annotations

from typing import Annotated, Literal

import tyro

from betterbench.cli.console import OUT, print_json, print_table

What = Literal["tasks", "variations", "policies", "assets", "templates"]


def list_command(what: Annotated[What, tyro.conf.Positional], *, json: bool = False) -> None:
    """List tasks, variations, policies, assets or templates.

    Example: better list variations

    Args:
        what: What to list.
        json: Print one JSON document instead of a table.
    """
    columns, rows = {
        "tasks": _tasks,
        "variations": _variations,
        "policies": _policies,
        "assets": _assets,
        "templates": _templates,
    }[what]()
    if json:
        print_json([dict(zip(columns, row, strict=True)) for row in rows])
        return
    print_table(columns, rows)
    if what == "variations":
        letters = [row[0].split("/")[1][0] for row in rows]
        counts = ", ".join(f"{letters.count(letter)} {letter}" for letter in "LROT")
        OUT.print(f"\n{len(rows)} variations: {counts}", markup=False)


def _tasks() -> tuple[list[str], list[list[str]]]:
    from betterbench.tasks import all_tasks

    rows = [
        [t.id, t.title, t.template.title, str(len(t.training)), str(len(t.variations)), t.description]
        for t in all_tasks()
    ]
    return ["task", "title", "template", "training", "variations", "description"], rows


def _variations() -> tuple[list[str], list[list[str]]]:
    from betterbench.tasks import all_tasks

    rows = [
        [f"{t.id}/{v.name}", v.axis.value, v.base, v.expected.value, v.support.value, v.title]
        for t in all_tasks()
        for v in t.variations
    ]
    return ["variation", "axis", "from", "expected", "support", "what changes"], rows


def _policies() -> tuple[list[str], list[list[str]]]:
    from betterbench.evaluation import known_policies

    rows = [[p.address, "state" if p.privileged else "observations", p.summary] for p in known_policies()]
    return ["policy", "sees", "what it does"], rows


def _assets() -> tuple[list[str], list[list[str]]]:
    from betterbench.assets import categories, colors, looks

    rows = [[name, str(len(looks(name))), ", ".join(colors(name))] for name in categories()]
    return ["asset", "looks", "colors"], rows


def _templates() -> tuple[list[str], list[list[str]]]:
    from betterbench.tasks import TEMPLATES, all_tasks

    rows = [
        [t.name, t.title, ", ".join(task.id for task in all_tasks() if task.template is t), t.challenge]
        for t in TEMPLATES.values()
    ]
    return ["template", "title", "tasks", "challenge"], rows
