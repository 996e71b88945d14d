"""Measurements of the code below ``src/betterbench``, read from the syntax trees without importing anything.

Rules of counting:

- A line is a physical line of a ``.py`` file, blank lines and comments included.
- A docstring line is a line of a string that is a statement by itself. These are the docstrings of modules, classes and
  functions, and the strings below fields and constants.
- A function's length runs from its ``def`` to its last line, docstring included. A nested function counts by
  itself and also as lines of the function around it.
- A function is pure data if its body, after the docstring, is one ``return`` or one assignment whose value consists
  only of literals, names, attributes, containers, f-strings and calls. Arithmetic, comparisons, conditions,
  comprehensions and lambdas make it code, except for the sign of a number. Pure data may be of any length.
- A function's nesting is the largest number of ``if``, ``for``, ``while``, ``with``, ``try`` and ``match`` statements
  around one of its statements. An ``elif`` is as deep as its ``if``, and so is an ``else`` that contains only one
  ``if``. A nested function is measured by itself.
- A public name is a function, class or type alias at the top level of a file, without a leading underscore. A type
  alias is ``type Name = ...`` or an assignment to a name in CamelCase, type variables included. Constants and variables
  are not counted. Every further file that defines the name counts, scripts with a ``main`` included.
"""

from __future__ import annotations

import ast
import re
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

PACKAGE = "betterbench"
ASSETS = ("mug", "stapler", "coffee_machine")
"""Categories whose files are measured one by one: a simple, a jointed and a large asset."""

FunctionNode = ast.FunctionDef | ast.AsyncFunctionDef
CAMEL_CASE = re.compile(r"[A-Z]+[a-z]\w*")
BLOCKS = (ast.If, ast.For, ast.AsyncFor, ast.While, ast.With, ast.AsyncWith, ast.Try, ast.TryStar, ast.Match)
DATA = (
    ast.Constant,
    ast.Name,
    ast.Attribute,
    ast.Tuple,
    ast.List,
    ast.Set,
    ast.Dict,
    ast.Starred,
    ast.Call,
    ast.keyword,
    ast.JoinedStr,
    ast.FormattedValue,
    ast.UnaryOp,
    ast.USub,
    ast.UAdd,
    ast.expr_context,
)


@dataclass(frozen=True)
class Function:
    """A function or method.

    Attributes:
        name: Module and qualified name without the package name, such as ``tasks.goal.Goal.step``.
        lines: Lines from ``def`` to the end.
        nesting: Deepest nesting among its statements.
        data: Whether the function is pure data.
    """

    name: str
    lines: int
    nesting: int
    data: bool


@dataclass(frozen=True)
class SourceFile:
    """A parsed file.

    Attributes:
        path: Path relative to the package, such as ``tasks/goal.py``.
        lines: Number of lines.
        tree: Syntax tree.
    """

    path: Path
    lines: int
    tree: ast.Module

    @property
    def module(self) -> str:
        """Dotted name without the package name, such as ``tasks.goal``; empty for the package's ``__init__``."""
        return ".".join(part for part in self.path.with_suffix("").parts if part != "__init__")

    @property
    def package(self) -> str:
        """First part of the dotted name: a subpackage, or a module at the top."""
        return self.module.partition(".")[0]


@dataclass(frozen=True)
class Package:
    """A subpackage, or a module at the top of the package.

    Attributes:
        name: Its name.
        purpose: First line of its docstring.
        files: Number of files.
        lines: Number of lines.
        imports: Subpackages that it imports, inside functions too, from the top layer down.
        upward: Imports in ``imports`` that the layers forbid.
    """

    name: str
    purpose: str
    files: int
    lines: int
    imports: tuple[str, ...]
    upward: tuple[str, ...]


@dataclass(frozen=True)
class Shape:
    """Everything measured in one checkout.

    Attributes:
        files: Number of files.
        lines: Number of lines.
        docstring_lines: Number of lines that are docstrings.
        functions: All functions and methods.
        repeated: Public names that several files define, with those files.
        tasks: Number of lines in each of the suite's task files.
        assets: Number of lines in each file with a name in ``ASSETS``.
        packages: Subpackages from the top layer down; subpackages in no layer come last.
    """

    files: int
    lines: int
    docstring_lines: int
    functions: tuple[Function, ...]
    repeated: dict[str, tuple[str, ...]]
    tasks: dict[str, int]
    assets: dict[str, int]
    packages: tuple[Package, ...]


def measure(root: Path) -> Shape:
    """Measure a checkout.

    Args:
        root: Folder that contains ``src/betterbench`` and ``pyproject.toml``.

    Raises:
        FileNotFoundError: If ``root`` contains no such package.
    """
    files = read_files(root)
    return Shape(
        files=len(files),
        lines=sum(f.lines for f in files),
        docstring_lines=sum(docstring_lines(f.tree) for f in files),
        functions=tuple(function for f in files for function in functions_of(f)),
        repeated=repeated_names(files),
        tasks={
            f.path.name: f.lines for f in files if f.path.parent == Path("tasks/suite") and f.path.stem != "__init__"
        },
        assets={str(f.path): f.lines for f in files if "assets" in f.path.parts and f.path.stem in ASSETS},
        packages=packages_of(files, read_layers(root)),
    )


def read_files(root: Path) -> list[SourceFile]:
    """Parse every file of the package, sorted by path."""
    home = root / "src" / PACKAGE
    paths = sorted(home.rglob("*.py"))
    if not paths:
        raise FileNotFoundError(f"no Python files below {home}")
    texts = [path.read_text(encoding="utf-8") for path in paths]
    return [
        SourceFile(path.relative_to(home), len(text.splitlines()), ast.parse(text))
        for path, text in zip(paths, texts, strict=True)
    ]


# ------------------------------------------------------------------------------------------------------- functions


def docstring_lines(tree: ast.Module) -> int:
    """Count the lines of strings that are statements of their own."""
    return sum(_length(node) for node in ast.walk(tree) if isinstance(node, ast.stmt) and _is_docstring(node))


def _is_docstring(node: ast.stmt) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)


def _length(node: ast.stmt) -> int:
    return (node.end_lineno or node.lineno) - node.lineno + 1


def functions_of(file: SourceFile) -> Iterator[Function]:
    """Yield the functions and methods of a file, nested ones too."""
    for name, node in _named_functions(file.tree, file.module):
        yield Function(name, _length(node), max(map(_depth, node.body)), is_data(node))


def _named_functions(node: ast.AST, prefix: str) -> Iterator[tuple[str, FunctionNode]]:
    for child in ast.iter_child_nodes(node):
        if isinstance(child, FunctionNode | ast.ClassDef):
            name = f"{prefix}.{child.name}" if prefix else child.name
            if isinstance(child, FunctionNode):
                yield name, child
            yield from _named_functions(child, name)
        else:
            yield from _named_functions(child, prefix)


def _depth(node: ast.AST) -> int:
    """Return the number of blocks nested at ``node``, including ``node`` itself."""
    if isinstance(node, FunctionNode | ast.ClassDef):
        return 0
    if isinstance(node, ast.If) and _is_elif(node.orelse):
        return max(1 + max(map(_depth, node.body)), _depth(node.orelse[0]))
    return int(isinstance(node, BLOCKS)) + max(map(_depth, ast.iter_child_nodes(node)), default=0)


def _is_elif(otherwise: Sequence[ast.stmt]) -> bool:
    """Return whether an ``else`` contains exactly one ``if``.

    The syntax tree does not distinguish this from an ``elif``.
    """
    return len(otherwise) == 1 and isinstance(otherwise[0], ast.If)


def is_data(function: FunctionNode) -> bool:
    """Return whether a function is pure data, by the rule at the top of this file."""
    body = [statement for statement in function.body if not _is_docstring(statement)]
    if len(body) != 1 or not isinstance(body[0], ast.Return | ast.Assign | ast.AnnAssign):
        return False
    value = body[0].value
    return value is not None and all(isinstance(node, DATA) for node in ast.walk(value))


# ----------------------------------------------------------------------------------------------------------- names


def repeated_names(files: Sequence[SourceFile]) -> dict[str, tuple[str, ...]]:
    """Return the public names that more than one file defines, with those files, the most frequent name first."""
    homes: dict[str, list[str]] = {}
    for file in files:
        for name in sorted(public_names(file.tree)):
            homes.setdefault(name, []).append(str(file.path))
    several = {name: tuple(paths) for name, paths in homes.items() if len(paths) > 1}
    return dict(sorted(several.items(), key=lambda item: (-len(item[1]), item[0])))


def public_names(tree: ast.Module) -> set[str]:
    """Return the public functions, classes and type aliases of a file."""
    names = {name for statement in tree.body for name in _defined(statement)}
    return {name for name in names if not name.startswith("_")}


def _defined(statement: ast.stmt) -> Iterator[str]:
    if isinstance(statement, FunctionNode | ast.ClassDef):
        yield statement.name
    targets = statement.targets if isinstance(statement, ast.Assign) else [_single_target(statement)]
    for target in targets:
        if isinstance(target, ast.Name) and CAMEL_CASE.fullmatch(target.id):
            yield target.id


def _single_target(statement: ast.stmt) -> ast.expr | None:
    """Return the name defined by ``name: type = ...``, or by ``type name = ...`` (Python 3.12 or newer)."""
    if isinstance(statement, ast.AnnAssign):
        return statement.target
    name = getattr(statement, "name", None)
    return name if isinstance(name, ast.Name) else None


# -------------------------------------------------------------------------------------------------------- packages


def read_layers(root: Path) -> list[list[str]]:
    """Return the layers contract of ``pyproject.toml``, from the top down: the packages of each line.

    Packages of one line must not import each other.

    Raises:
        FileNotFoundError: If ``pyproject.toml`` does not exist.
        ValueError: If it contains no contract of type ``layers``.
    """
    settings = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))
    for contract in settings.get("tool", {}).get("importlinter", {}).get("contracts", []):
        if contract["type"] == "layers":
            return [re.findall(r"\w+", line) for line in contract["layers"]]
    raise ValueError(f"{root / 'pyproject.toml'} contains no import contract of type layers")


def packages_of(files: Sequence[SourceFile], layers: Sequence[Sequence[str]]) -> tuple[Package, ...]:
    """Return the packages from the top layer down, each with its imports."""
    level = {name: number for number, line in enumerate(layers) for name in line}
    names = sorted({f.package for f in files} - {""}, key=lambda name: (level.get(name, len(layers)), name))
    return tuple(_package(name, names, files, level) for name in names)


def _package(name: str, names: Sequence[str], files: Sequence[SourceFile], level: dict[str, int]) -> Package:
    own = [f for f in files if f.package == name]
    found = {target for f in own for target in imported(f)} - {name}
    purpose = next((ast.get_docstring(f.tree) or "" for f in own if f.module == name), "")
    return Package(
        name=name,
        purpose=purpose.partition("\n")[0],
        files=len(own),
        lines=sum(f.lines for f in own),
        imports=tuple(n for n in names if n in found),
        upward=tuple(n for n in names if n in found and _is_upward(name, n, level)),
    )


def _is_upward(name: str, target: str, level: dict[str, int]) -> bool:
    """Return whether the layers forbid an import.

    A package that is not in any layer may neither import nor be imported.
    """
    return name not in level or target not in level or level[target] <= level[name]


def imported(file: SourceFile) -> set[str]:
    """Return the packages below ``betterbench`` that a file names in its import statements."""
    dotted: set[str] = set()
    for node in ast.walk(file.tree):
        if isinstance(node, ast.Import):
            dotted |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module is not None and node.level == 0:
            dotted |= {f"{node.module}.{alias.name}" for alias in node.names}
    return {parts[1] for parts in (name.split(".") for name in dotted) if parts[0] == PACKAGE and len(parts) > 1}
