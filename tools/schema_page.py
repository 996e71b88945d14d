"""Write the page of the documentation with the JSON forms of tasks, templates and suites, and their JSON schemas.

Example:
    python tools/schema_page.py
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from betterbench.generation.growth.quotas import quotas_schema
from betterbench.tasks.authoring.task_form import task_schema
from betterbench.tasks.authoring.template_form import template_schema
from betterbench.tasks.suite_folder import suite_schema

SCHEMAS = {"task": task_schema, "template": template_schema, "suite": suite_schema, "quotas": quotas_schema}
"""Functions that return the schemas, by the name of their file."""

_INTRODUCTION = """\
# Forms of tasks and suites

A task, a template and a suite can be written as JSON (see [your task in your own file](own-tasks.md)). The tables list
all fields. A field without a default is required, and unknown fields are rejected. The schemas
[task.json](schemas/task.json), [template.json](schemas/template.json), [suite.json](schemas/suite.json) and
[quotas.json](schemas/quotas.json) (JSON Schema, draft 2020-12) are for editors and for programs that write tasks. A
schema cannot express that names exist, that conditions follow their template, or that a regime does not contain tests.
`task_from_json` also checks these conditions."""

_SECTIONS = {
    "task": "One JSON file per task. Lengths are in meters, angles in radians, positions in the world frame.",
    "template": "The field `template` of a task contains the name of a packaged template or this form.",
    "suite": "The file `suite.json` of a [suite in a folder](own-tasks.md#a-suite-as-a-folder).",
    "quotas": "A YAML or JSON file for `better generate --until --quotas`, see [growth](generating.md#grow-a-suite).",
}

_CHOICES = {
    "Expected": "`succeed`, `refuse`, `stay_still` or `ambiguous`",
    "Support": "`seen` or `novel`",
    "State": "`on the table`, `at the target` or `absent`",
    "Horizon": "`short` or `long`",
}
"""Types with few values, in words."""

_TEXTS = {
    "Task": {
        "schema_version": "version of the form",
        "id": "name of the task",
        "version": "version of its behavior; increase it with every change",
        "title": "title of its card",
        "description": "one sentence on its card",
        "template": "name of a packaged template, or the form of a template",
        "slots": "start positions on the table",
        "objects": "all objects of conditions and operations; fields refer to them by name",
        "training": "training conditions; they are named `train1`, `train2`, … in this order",
        "variations": "test conditions",
        "notes": "further notes for its card",
        "regimes": "further sets of conditions for demonstrations, see `--regime`",
        "robot": "name of the robot that can reach the slots",
        "matrices": "diagnostic matrices whose cells are conditions of the task",
    },
    "Slot": {
        "name": "name of the slot",
        "x": "center",
        "y": "center",
        "yaw": "heading of an object in the slot",
        "jitter_m": "half width of the uniform position jitter",
        "yaw_jitter": "half width of the uniform heading jitter",
    },
    "Object": {
        "name": "name in the scene; it has no meaning",
        "kind": "noun in instructions",
        "category": "category of its asset, see `better list assets`",
        "color": "color of its asset; null lets the generator choose",
        "role": "role in the template",
        "fixed": "whether it cannot be moved",
        "mount": "for a drawer, the cabinet and the region in which the drawer slides",
    },
    "Place": {"target": "name of an object", "region": "region of the object, if it has several"},
    "Condition": {
        "objects": "names of the objects in the scene",
        "layout": "slot by object, for objects that start on the table",
        "instruction": "instruction with its steps",
        "preplaced": "target by object, for objects that start at a target",
        "opened": "opening by drawer; other drawers are closed",
        "expected": "expected behavior",
        "mid_task_look": "whether the initial state looks like the middle of a demonstration",
        "premise_broken": "whether a premise of the instruction is deliberately false",
        "cloth": "color of the tablecloth; without it, the table top of the room is shown",
        "watch_steps": "control steps for which the episode continues after the goal is met; a grasp attempt in this "
        "time is a failure",
    },
    "Instruction": {
        "text": "text for the policy",
        "subgoals": "steps",
        "ordered": "whether the order of the steps is part of the goal",
    },
    "Subgoal": {
        "name": "name of the step",
        "relation": "relation that must hold, see [templates](templates.md)",
        "reference": "object of the step",
        "target": "name of the target object",
        "word": "word of the instruction that refers to the object",
        "count": "2 for the second object of the same kind, and so on",
        "region": "region of the target, if it has several",
    },
    "Reference": {
        "kind": "any object of this kind; give a kind or a slot",
        "slot": "the object that starts in this slot",
    },
    "Variation": {
        "name": "letter of the axis (L, R, O, T) and a number",
        "do": 'operations, applied in order: {"operation": "swap", "a": "apple", "b": "orange"}',
        "title": "difference from training in a few words",
        "hypothesis": "ability that a success demonstrates",
        "base": "training condition of the counterfactual twin",
        "expected": "expected behavior",
        "support": "whether all poses lie inside the training distribution",
        "mid_task_look": "whether the initial state looks like the middle of a demonstration",
        "premise_broken": "whether a premise of the instruction is deliberately false",
        "watch_steps": "control steps for which the episode continues after the goal is met; a grasp attempt in this "
        "time is a failure",
    },
    "Regime": {
        "conditions": "conditions; they are named `balanced1` or `diverse1` and so on. None may be a test",
        "crossed": "crossed and tied factors, one line each",
        "slots": "slots that only these conditions use",
    },
    "Matrix": {
        "horizon": "matrix of the paper",
        "rows": "object whose states define the rows",
        "columns": "object whose states define the columns",
        "cells": "nine cells, row by row",
    },
    "Cell": {
        "row": "initial state of the object of the rows",
        "column": "initial state of the object of the columns",
        "conditions": "names of the conditions in the cell",
        "paper": "outcome in the paper",
    },
    "Template": {
        "schema_version": "version of the form",
        "meta": "description in words",
        "object_groups": "groups of objects that a scenario fills",
        "relations": "relations that steps may use, the main one first",
        "exclusive": "whether only requested objects may satisfy the relation at the end",
        "order": "order of the steps: free, as named, or forced by construction",
        "regions": "regions of a target's asset",
        "tolerances": "thresholds of the relations",
        "protocol": "time limits of an episode",
    },
    "Meta": {
        "name": "name of the template",
        "title": "title",
        "description": "the task in one sentence",
        "challenge": "difficulty",
        "goal": "state at the end of a successful episode",
        "premise": "state at the start",
    },
    "Group": {
        "group_id": "name of the group",
        "description": "meaning of the group",
        "allowed_types": "allowed semantic categories",
        "count_range": "minimum and maximum number of objects",
        "role": "role of its objects in a scene",
    },
    "Protocol": {
        "dwell_s": "time for which the goal must stay true [s]",
        "base_steps": "control steps in addition to those per step of the instruction",
        "steps_per_subgoal": "control steps per step of the instruction",
        "still_steps": "control steps for which a policy that must stay still is watched",
    },
    "Suite": {
        "schema_version": "version of the form",
        "name": "name of the suite without its digest",
        "tasks": "SHA-256 by task, of the file `tasks/NAME.json`",
    },
    "Quotas": {
        "template": "amount of tasks by template: the least (`20%`, `5`), or the least and the largest (`10%-30%`)",
        "axis": "share of the variations by axis: `spatial`, `recomposition`, `object` or `temporal`",
        "context": "amount of tasks by context",
        "difficulty": "amount of tasks by difficulty: `easy`, `medium` or `hard`",
    },
}
"""Meaning of each field, by part of a form."""


def write(out: Path) -> None:
    """Write the page and the schemas below the folder of the documentation."""
    for name, text in files().items():
        (out / name).parent.mkdir(exist_ok=True)
        (out / name).write_text(text, encoding="utf-8")


def files() -> dict[str, str]:
    """Return the text of the page and of each schema, by the path below the folder of the documentation."""
    found = {"task-form.md": page()}
    for name, schema in SCHEMAS.items():
        found[f"schemas/{name}.json"] = json.dumps(schema(), indent=1) + "\n"
    return found


def page() -> str:
    """Return the page."""
    lines = [_INTRODUCTION]
    for name, schema in SCHEMAS.items():
        form = schema()
        lines += ["", f"## {form['title']}", "", _SECTIONS[name], "", *_table(form["title"], form)]
        for part, inner in form.get("$defs", {}).items():
            if "properties" in inner:
                lines += ["", f"### {part}", "", *_table(part, inner)]
    return "\n".join([*lines, ""])


def _table(part: str, schema: Mapping[str, Any]) -> Iterator[str]:
    yield "| field | value | default | meaning |"
    yield "|---|---|---|---|"
    required = set(schema.get("required", ()))
    for name, field in schema["properties"].items():
        default = "" if name in required else f"`{json.dumps(field['default'])}`" if "default" in field else "empty"
        yield f"| `{name}` | {_type(field)} | {default} | {_TEXTS[part][name]} |"


def _type(field: Mapping[str, Any]) -> str:
    """Return the type of a field in words."""
    if "$ref" in field:
        name = field["$ref"].rpartition("/")[2]
        return _CHOICES.get(name) or f"[{name}](#{name.lower()})"
    if "anyOf" in field:
        return " or ".join(map(_type, field["anyOf"]))
    if "const" in field:
        return f"`{json.dumps(field['const'])}`"
    if "enum" in field:
        return ", ".join(f"`{value}`" for value in field["enum"])
    match field.get("type"):
        case "array":
            return f"list of {_type(field['items'])}" if "items" in field else "list of two numbers"
        case "object":
            inner = field.get("additionalProperties")
            return f"{_type(inner)} by name" if isinstance(inner, dict) else "object"
        case "integer" | "number":
            return f"{field['type']}{_range(field)}"
        case "string":
            pattern = field.get("pattern")
            return f"text like `{pattern}`" if pattern not in (None, "\\S") else "text"
    return str(field.get("type", "any"))


def _range(field: Mapping[str, Any]) -> str:
    words = {"minimum": "≥ {}", "exclusiveMinimum": "> {}", "maximum": "≤ {}", "exclusiveMaximum": "< {}"}
    bounds = [text.format(f"{field[name]:g}") for name, text in words.items() if name in field]
    return f", {', '.join(bounds)}" if bounds else ""


if __name__ == "__main__":
    write(Path("docs"))
