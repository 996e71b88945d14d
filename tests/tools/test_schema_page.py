"""The page of the JSON forms and the schemas are current, and the schemas accept the tasks of the suite."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

from betterbench.tasks import get_task, task_to_json

sys.path.insert(0, str(Path(__file__).parents[2] / "tools"))

import schema_page

DOCS = Path(__file__).parents[2] / "docs"


@pytest.mark.parametrize("name", schema_page.files())
def test_a_file_is_current(name):
    said = "run python tools/schema_page.py"
    assert (DOCS / name).read_text(encoding="utf-8") == schema_page.files()[name], said


def test_every_field_has_a_meaning_and_no_meaning_is_left_over():
    parts = {}
    for schema in (make() for make in schema_page.SCHEMAS.values()):
        parts |= {schema["title"]: schema, **schema.get("$defs", {})}
    fields = {part: set(form["properties"]) for part, form in parts.items() if "properties" in form}
    assert fields == {part: set(texts) for part, texts in schema_page._TEXTS.items()}


def problems(value, schema, root, at=""):
    """Yield where a value differs from a schema: required, unknown and wrongly typed fields, ranges and patterns."""
    if "$ref" in schema:
        schema = root["$defs"][schema["$ref"].rpartition("/")[2]]
    if "anyOf" in schema:
        tried = [list(problems(value, option, root, at)) for option in schema["anyOf"]]
        yield from [] if [] in tried else tried[0]
        return
    types = {"object": dict, "array": list, "string": str, "boolean": bool, "null": type(None)}
    number = isinstance(value, int | float) and not isinstance(value, bool)
    kind = schema.get("type")
    right = number if kind in ("number", "integer") else kind is None or isinstance(value, types[kind])
    if not right or value not in schema.get("enum", [value]) or value != schema.get("const", value):
        yield at
    elif kind == "object":
        known, rest = schema.get("properties", {}), schema.get("additionalProperties", True)
        yield from (f"{at}.{name}" for name in schema.get("required", ()) if name not in value)
        for name, inner in value.items():
            if name in known or isinstance(rest, dict):
                yield from problems(inner, known.get(name, rest), root, f"{at}.{name}")
            elif not rest:
                yield f"{at}.{name}"
    elif kind == "array" and "items" in schema:
        for i, inner in enumerate(value):
            yield from problems(inner, schema["items"], root, f"{at}[{i}]")
    elif kind == "string":
        yield from [] if re.search(schema.get("pattern", ""), value) else [at]
    elif number and not schema.get("minimum", value) <= value <= schema.get("maximum", value):
        yield at


def test_the_schema_accepts_the_tasks_of_the_suite_and_names_wrong_fields():
    schema = schema_page.task_schema()
    form = task_to_json(get_task("morning_coffee"))
    assert list(problems(form, schema, schema)) == []
    del form["title"]
    form["slots"][0]["x"] = 3.0
    form["regimes"]["balanced"]["conditions"][1]["expected"] = "win"
    found = {".title", ".slots[0].x", ".regimes.balanced.conditions[1].expected"}
    assert set(problems(form, schema, schema)) == found
