"""The shape of the code is measured by the rules it states, on small packages written for each test."""

from __future__ import annotations

import ast
import importlib
import re
import textwrap
from pathlib import Path

import pytest

TOOLS = Path(__file__).resolve().parents[2] / "tools"
LAYERS = """
[[tool.importlinter.contracts]]
type = "forbidden"
[[tool.importlinter.contracts]]
type = "layers"
layers = ["(cli)", "(report) | (diagnosis)", "(tasks) | (assets)", "errors"]
"""
LONG_BODY = "    x = 1 + 1\n"


@pytest.fixture
def shape(monkeypatch):
    monkeypatch.syspath_prepend(TOOLS)
    return importlib.import_module("shape")


@pytest.fixture
def measures(monkeypatch):
    monkeypatch.syspath_prepend(TOOLS)
    return importlib.import_module("code_measures")


@pytest.fixture
def write(tmp_path):
    """Write a checkout: files below src/betterbench, and a pyproject.toml with four layers."""

    def checkout(files: dict[str, str], name: str = "new") -> Path:
        root = tmp_path / name
        for path, text in {"__init__.py": "", **files}.items():
            file = root / "src" / "betterbench" / path
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(textwrap.dedent(text), encoding="utf-8")
        (root / "pyproject.toml").write_text(LAYERS, encoding="utf-8")
        return root

    return checkout


def one_task() -> dict[str, str]:
    """Returns the files of a small checkout: one task, three assets, one module of errors."""
    assets = {f"assets/procedural/{name}.py": "" for name in ("mug", "stapler", "coffee_machine")}
    return {"errors.py": '"""Errors."""\n', "tasks/suite/lunch.py": "A = 1\n" * 65, **assets}


def only_function(text: str) -> ast.FunctionDef:
    (function,) = ast.parse(textwrap.dedent(text)).body
    assert isinstance(function, ast.FunctionDef)
    return function


# ---------------------------------------------------------------------------------------------------------- measures


def test_lines_files_and_docstrings_are_counted(measures, write):
    text = '''\
    """One line."""

    A = 1
    """Two
    lines."""


    def f() -> str:
        """One."""
        return """no
        docstring"""
    '''
    found = measures.measure(write({"errors.py": text}))
    assert (found.files, found.lines, found.docstring_lines) == (2, 11, 4)


def test_functions_are_named_and_measured_with_nested_ones_inside(measures, write):
    text = """\
    class Goal:
        @property
        def done(self):
            def inner():
                return 1
            return inner()


    async def later():
        pass
    """
    found = measures.measure(write({"tasks/goal.py": text, "tasks/__init__.py": "def here(): pass\n"}))
    assert {f.name: f.lines for f in found.functions} == {
        "tasks.here": 1,
        "tasks.goal.Goal.done": 4,
        "tasks.goal.Goal.done.inner": 2,
        "tasks.goal.later": 2,
    }


@pytest.mark.parametrize(
    ("body", "depth"),
    [
        ("return 1", 0),
        ("if a:\n  return 1", 1),
        ("for x in a:\n  with x:\n    while x:\n      pass", 3),
        ("if a:\n  pass\nelif b:\n  pass\nelif c:\n  pass", 1),
        ("if a:\n  pass\nelif b:\n  for x in b:\n    pass", 2),
        ("if a:\n  pass\nelse:\n  for x in b:\n    pass", 2),
        ("try:\n  pass\nexcept E:\n  if a:\n    pass", 2),
        ("match a:\n  case 1:\n    if b:\n      pass", 2),
        ("def inner():\n  if a:\n    for x in a:\n      pass\nreturn inner", 0),
    ],
)
def test_nesting_counts_the_blocks_around_a_statement(measures, write, body, depth):
    text = "def outer(a, b, c):\n" + textwrap.indent(body, "  ") + "\n"
    found = measures.measure(write({"errors.py": text}))
    assert next(f.nesting for f in found.functions if f.name == "errors.outer") == depth


@pytest.mark.parametrize(
    ("body", "data"),
    [
        ("return Task('lunch', steps=(swap(A, B), *MORE), limits={'x': [-0.1, +0.2]})", True),
        ("'''Documented.'''\n  return 1", True),
        ("TABLE[0] = (1, 2)", True),
        ("return f'{NAME} is ready'", True),
        ("size: float = 0.1", True),
        ("return 2 * SIZE", False),
        ("return [f(x) for x in y]", False),
        ("return A if B else C", False),
        ("return lambda: 1", False),
        ("return not A", False),
        ("x = 1\n  return x", False),
        ("size: float", False),
        ("return", False),
        ("'''Only documented.'''", False),
        ("if A:\n    return 1", False),
    ],
)
def test_pure_data_is_one_statement_of_literals_and_calls(measures, body, data):
    assert measures.is_data(only_function(f"def f():\n  {body}\n")) is data


def test_public_names_are_functions_classes_and_type_aliases(measures, write):
    text = """\
    from elsewhere import Imported
    LIMIT = 1
    logger = 2
    Vector = tuple[float, ...]
    Matrix: object = tuple
    _Hidden = int
    class Task: ...
    class _Private: ...
    def act():
        def inner(): ...
    async def wait(): ...
    """
    tree = ast.parse(textwrap.dedent(text))
    assert measures.public_names(tree) == {"Vector", "Matrix", "Task", "act", "wait"}


def test_a_name_counts_once_per_file_and_main_counts_too(measures, write):
    files = {
        "cli/a.py": "def main(): ...\ndef once(): ...\ndef once(): ...\n",
        "cli/b.py": "def main(): ...\nclass Finding: ...\n",
        "report/c.py": "def main(): ...\nFinding = str\n",
    }
    assert measures.measure(write(files)).repeated == {
        "main": ("cli/a.py", "cli/b.py", "report/c.py"),
        "Finding": ("cli/b.py", "report/c.py"),
    }


def test_packages_come_from_the_top_down_with_imports_and_those_against_the_layers(measures, write):
    files = {
        "__init__.py": "from betterbench.tasks import Task\n",
        "errors.py": '"""Errors a user can meet.\n\nMore."""\n',
        "tasks/__init__.py": '"""Tasks."""\nfrom betterbench.errors import E\nimport betterbench.assets.mug\n',
        "tasks/goal.py": "def f():\n    from betterbench import report\n    import numpy\n",
        "assets/mug.py": "from betterbench.assets import body\nfrom betterbench import __version__\n",
        "report/__init__.py": "import betterbench.tasks\n",
        "vqa/__init__.py": "from betterbench.errors import E\n",
    }
    packages = measures.measure(write(files)).packages
    assert [p.name for p in packages] == ["report", "assets", "tasks", "errors", "vqa"]
    by_name = {p.name: p for p in packages}
    assert by_name["errors"] == measures.Package("errors", "Errors a user can meet.", 1, 3, (), ())
    assert (by_name["tasks"].files, by_name["tasks"].lines) == (2, 6)
    assert by_name["tasks"].imports == ("report", "assets", "errors")
    assert by_name["tasks"].upward == ("report", "assets")
    assert (by_name["report"].imports, by_name["report"].upward) == (("tasks",), ())
    assert by_name["assets"].imports == ()
    assert by_name["vqa"].upward == ("errors",)


# ------------------------------------------------------------------------------------------------------------ output


def test_no_number_fails_a_checkout(shape, write, capsys):
    """Whoever changes code must not be led by a number of lines."""
    files = {"report/long.py": "def f():\n" + LONG_BODY * 300, "errors.py": "import betterbench.tasks\n"}
    assert shape.main(["--root", str(write({**one_task(), **files}))]) == 0
    out = capsys.readouterr().out
    assert re.search(r"lines of the longest function +301 +report\.long\.f", out)
    assert re.search(r"imports against the layers +1 +errors → tasks", out)


def test_functions_of_pure_data_are_marked(shape, write, capsys):
    data = "def table():\n    return [\n" + "        1,\n" * 90 + "    ]\n"
    assert shape.main(["--root", str(write({**one_task(), "report/data.py": data}))]) == 0
    assert "report.data.table  93     pure data" in capsys.readouterr().out


def test_a_folder_without_the_package_is_one_clear_line(shape, tmp_path, capsys):
    assert shape.main(["--root", str(tmp_path)]) == 2
    assert capsys.readouterr().err == f"error: no Python files below {tmp_path / 'src' / 'betterbench'}\n"


def test_before_and_after_stand_side_by_side(shape, write, capsys):
    old = write({**one_task(), "report/gone.py": "A = 1\n" * 1000}, "old")
    new = write({**one_task(), "cli/came.py": "import betterbench.tasks\n"}, "new")
    assert shape.main(["--root", str(new), "--against", str(old), "--markdown"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert "| measure | value before | value after | where |" in lines
    assert "| lines | 1,066 | 67 |  |" in lines
    assert "| lines of all task files | 65 | 65 |  |" in lines
    assert "| `cli` | – | 1 | 1 | tasks |  |" in lines
    assert "| `report` | 1,000 | – |  |  |  |" in lines


def test_text_columns_are_aligned(shape):
    table = shape.Table("Files", ("file", "lines", "kind"), {"a.py": ("1", "data"), "longer.py": ("100", "")})
    assert shape.as_text([table]) == "Files\n  file       lines  kind\n  a.py       1      data\n  longer.py  100"
    assert shape.as_text([shape.Table("Files", ("file", "lines"), {})]) == "Files\n  none"


def test_markdown_escapes_bars(shape):
    table = shape.Table("Kinds", ("a|b", "c"), {"x y": ("p | q",)})
    assert shape.as_markdown([table]).splitlines()[2:] == ["| a\\|b | c |", "|---|---|", "| `x y` | p \\| q |"]


def test_the_page_is_rewritten_between_its_markers_only(shape, write):
    root = write(one_task())
    page = root / "docs" / "contributing.md"
    page.parent.mkdir()
    page.write_text(f"Above.\n\n{shape.BEGIN}\nold\n{shape.END}\n\nBelow.\n", encoding="utf-8")
    assert shape.main(["--root", str(root), "--write-docs"]) == 0
    first = page.read_text(encoding="utf-8")
    assert first.startswith(f"Above.\n\n{shape.BEGIN}\n\n### Summary\n")
    assert first.endswith(f"|\n\n{shape.END}\n\nBelow.\n")
    assert "old" not in first
    assert shape.main(["--root", str(root), "--write-docs"]) == 0
    assert page.read_text(encoding="utf-8") == first


@pytest.mark.parametrize("text", ["", "{begin}", "{end}{begin}", "{begin}{begin}{end}", "{begin}{end}{end}"])
def test_a_page_without_its_two_markers_is_refused(shape, tmp_path, text):
    page = tmp_path / "page.md"
    page.write_text(text.format(begin=shape.BEGIN, end=shape.END), encoding="utf-8")
    with pytest.raises(ValueError, match="each once"):
        shape.write_docs(page, "new")


# ---------------------------------------------------------------------------------------------------- start-up times


@pytest.mark.parametrize(
    "usage",
    [
        "usage: better [-h] {list,audit-paper} ...",
        "usage: better [-h]\n              {list,\n               audit-paper}",
        "usage: better [-h] \\x1b[1m{list,audit-paper}\\x1b[0m\\n {not,these}",
    ],
)
def test_verbs_come_from_the_help_of_the_checkout(shape, write, usage):
    root = write({"cli/__init__.py": "", "cli/__main__.py": f"print('''{usage}''')\n"})
    assert shape.verbs(root) == ["list", "audit-paper"]


def test_help_without_verbs_is_an_error(shape, write):
    with pytest.raises(ValueError, match="lists no verbs in braces"):
        shape.verbs(write({"cli/__main__.py": "print('usage: better')\n"}))


def test_every_verb_is_timed(shape, write, capsys):
    root = write({**one_task(), "cli/__init__.py": "", "cli/__main__.py": "print('{list,eval}')\n"})
    assert shape.main(["--root", str(root), "--times", "--markdown"]) == 0
    rows = capsys.readouterr().out.partition("### Start-up time of --help")[2].splitlines()[4:]
    assert [row.split(" | ")[0] for row in rows] == ["| `better`", "| `better list`", "| `better eval`"]
    assert all(float(row.strip("|").split("|")[1]) >= 0 for row in rows)
