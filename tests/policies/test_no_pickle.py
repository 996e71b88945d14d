"""Nothing in the package can unpickle: names, records and replies come from strangers."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import betterbench

UNPICKLING = {"pickle", "cPickle", "_pickle", "dill", "cloudpickle", "joblib", "shelve", "marshal"}
FILES = sorted(Path(betterbench.__file__).parent.rglob("*.py"))


def naming(*words: str) -> dict[str, ast.Module]:
    """Return the syntax trees of the files that name one of some words, by the file's name."""
    named = re.compile("|".join(words))
    texts = {str(file): file.read_text() for file in FILES}
    return {name: ast.parse(text) for name, text in texts.items() if named.search(text)}


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
    assert len(FILES) > 100
    found = {name: sorted(imported(tree) & UNPICKLING) for name, tree in naming(*UNPICKLING).items()}
    assert {name: names for name, names in found.items() if names} == {}


def test_no_reader_is_told_to_unpickle():
    for name, tree in naming("allow_pickle", "weights_only", "torch").items():
        for function, option, value in options(tree):
            assert value is (option == "weights_only"), f"{name}: {function}({option}={value})"
        for node in ast.walk(tree):
            if (
                isinstance(node, ast.Call)
                and isinstance(node.func, ast.Attribute)
                and isinstance(node.func.value, ast.Name)
            ) and (node.func.value.id, node.func.attr) == ("torch", "load"):
                assert any(k.arg == "weights_only" for k in node.keywords), f"{name}: torch.load"


def test_the_check_sees_what_it_looks_for():
    assert imported(ast.parse("import pickle")) & UNPICKLING
    assert imported(ast.parse("def f():\n    from dill import loads")) & UNPICKLING
    assert imported(ast.parse("import importlib\nimportlib.import_module('pickle')")) & UNPICKLING
    assert options(ast.parse("np.load(f, allow_pickle=True)")) == [("load", "allow_pickle", True)]
