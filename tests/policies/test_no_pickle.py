"""Nothing in the package can unpickle: names, records and replies come from strangers."""

from __future__ import annotations

import ast
import functools
from pathlib import Path

import betterbench

UNPICKLING = {"pickle", "cPickle", "_pickle", "dill", "cloudpickle", "joblib", "shelve", "marshal"}
PACKAGE = Path(betterbench.__file__).parent


@functools.cache
def tree(file: Path) -> ast.Module:
    """Return the syntax tree of a file."""
    return ast.parse(file.read_text())


def imported(tree: ast.Module) -> set[str]:
    """Return the top-level names of all modules that a file imports, wherever in it."""
    names = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names.add(node.module.split(".")[0])
        elif isinstance(node, ast.Call) and node.args and isinstance(node.args[0], ast.Constant):
            called = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            if called in ("import_module", "__import__") and isinstance(node.args[0].value, str):
                names.add(node.args[0].value.split(".")[0])
    return names


def options(tree: ast.Module) -> list[tuple[str, str, object]]:
    """Return (function, option, value) of every keyword argument that decides about unpickling."""
    return [
        (node.func.attr if isinstance(node.func, ast.Attribute) else "", k.arg or "", getattr(k.value, "value", None))
        for node in ast.walk(tree)
        if isinstance(node, ast.Call)
        for k in node.keywords
        if k.arg in ("allow_pickle", "weights_only")
    ]


def test_the_package_imports_no_pickle():
    files = sorted(PACKAGE.rglob("*.py"))
    assert len(files) > 100
    found = {f.name: sorted(imported(tree(f)) & UNPICKLING) for f in files}
    assert {name: names for name, names in found.items() if names} == {}


def test_no_reader_is_told_to_unpickle():
    for file in PACKAGE.rglob("*.py"):
        for function, option, value in options(tree(file)):
            assert value is (option == "weights_only"), f"{file.name}: {function}({option}={value})"
        for node in ast.walk(tree(file)):
            if (
                isinstance(node, ast.Call)
                and isinstance(node.func, ast.Attribute)
                and isinstance(node.func.value, ast.Name)
            ) and (node.func.value.id, node.func.attr) == ("torch", "load"):
                assert any(k.arg == "weights_only" for k in node.keywords), f"{file.name}: torch.load"


def test_the_check_sees_what_it_looks_for():
    assert imported(ast.parse("import pickle")) & UNPICKLING
    assert imported(ast.parse("def f():\n    from dill import loads")) & UNPICKLING
    assert imported(ast.parse("import importlib\nimportlib.import_module('pickle')")) & UNPICKLING
    assert options(ast.parse("np.load(f, allow_pickle=True)")) == [("load", "allow_pickle", True)]
