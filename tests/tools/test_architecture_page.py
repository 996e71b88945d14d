"""The page of the architecture: what counts as a call between packages, and that the page shows today's packages."""

from __future__ import annotations

import importlib
import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FILES = {
    "low/__init__.py": "",
    "low/part/__init__.py": "",
    "low/part/values.py": '''
class Value:
    """A number that is kept."""
    def __init__(self, number):
        self.number = number
    def __eq__(self, other):
        return self.number == other.number
    @property
    def double(self):
        """Twice the number."""
        return 2 * self.number
def twice(value):
    """Return twice a value.

    More.
    """
    return _hidden(value)
def _hidden(value):
    return value.double
''',
    "high/__init__.py": "from low.part.values import Value\nWHILE_IMPORTING = Value(0)\n",
    "high/work.py": """
from low.part.values import Value, twice
def run():
    value = Value(1)
    assert value == Value(1)
    def nested(): ...
    return sorted([twice(value), twice(value)], key=lambda v: helper(v))
def helper(v):
    return v
""",
}


@pytest.fixture
def made(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "tools"))
    return importlib.import_module("architecture_page")


def test_first_calls_between_packages_are_noted_once_with_their_purpose(made, tmp_path, monkeypatch):
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    monkeypatch.syspath_prepend(str(tmp_path))
    tracer = made.Tracer(home=tmp_path)
    sys.setprofile(tracer)
    try:
        importlib.import_module("high.work").run()
    finally:
        sys.setprofile(None)
    value = made.Call("high", "low", "part.values", "Value", "A number that is kept.")
    assert list(tracer.calls.values()) == [value], "one call for each part that a package calls; none while importing"


def test_a_command_that_fails_is_no_way(made, capsys):
    with pytest.raises(RuntimeError, match="better evl ended with 2"):
        made.traced("evl")
    assert "Did you mean 'eval'" in capsys.readouterr().err


def test_a_bar_in_a_docstring_does_not_break_the_table(made):
    call = made.Call("cli", "tasks", "words", "split", "Return a|b.")
    text = made.page([made.Way("w", "The way", "better x", [call])])
    assert "| cli | `tasks.words.split` | Return a\\|b. |" in text


def test_the_page_is_of_the_modules_of_today():
    """`tools/architecture_page.py` makes it anew."""
    page = (ROOT / "docs" / "architecture.md").read_text()
    for place in re.findall(r"^\| \w+ \| `([\w.]+)` \|", page, flags=re.MULTILINE):
        parts = place.split(".")
        found = next(
            (
                "/".join(parts[:n])
                for n in range(len(parts) - 1, 0, -1)
                if (ROOT / "src/betterbench" / "/".join(parts[:n])).with_suffix(".py").is_file()
                or (ROOT / "src/betterbench" / "/".join(parts[:n]) / "__init__.py").is_file()
            ),
            None,
        )
        assert found is not None, place
        module = importlib.import_module("betterbench." + found.replace("/", "."))
        thing = module
        for name in parts[len(found.split("/")) :]:
            thing = getattr(thing, name, None)
        assert thing is not None, f"{place} is gone: run tools/architecture_page.py"
