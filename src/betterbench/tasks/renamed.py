"""Translation of former module names in users' files that were written before packages were renamed.

Runs and checkpoints identify their task or learner file by the SHA-256 of its text, so the file must not be edited when
an imported module moves. Instead, the imports in the file are translated when it is loaded.
"""

from __future__ import annotations

import ast
import importlib.util
from collections.abc import Iterator, Mapping

_PACKAGE = "betterbench"

_MOVED = (
    ("", "interface", "state"),
    ("tasks", "tasks.authoring", "operations registry task template template_form templates training_distribution"),
    ("tasks", "tasks.authoring", "variation"),
    ("tasks", "tasks.judging", "attempts goal harm motion picked_slots premise restraint targets"),
    ("tasks", "tasks.interventions", "listed_regimes balanced"),
    ("tasks", "tasks.regimes", "diverse_confounded"),
    ("", "tasks", "interventions"),
    ("", "tasks.worlds", "calvin"),
    ("worlds", "tasks.worlds", "libero libero_plus"),
    ("recording", "jobs", "durable line_journal lock places outputs item_threads retries worker_process"),
    ("", "sim", "assets robots scenes worlds graphics"),
    ("", "policies", "experts learned"),
    ("experts", "policies", "faulty decisions"),
    ("", "demonstrations", "teleop shortcuts export recipes"),
    ("", "learning", "training study"),
    ("", "comparison", "across"),
    ("", "vqa", "llm"),
    ("diagnosis", "diagnosis.analysis", "trace approaches episode_analysis halts harm collisions"),
    ("diagnosis", "diagnosis.measures", "metrics confusion forms power_matrix standing"),
)
"""Former package, present package, and names of the modules that moved between them without being renamed."""

MODULES: Mapping[str, str] = {
    **{f"{old}.{name}".lstrip("."): f"{new}.{name}" for old, new, names in _MOVED for name in names.split()},
    "recording": "records",
    "worlds.regime": "tasks.worlds.libero_training",
    "materialization": "sim.modalities",
    "demonstrations": "demonstrations.making",
    "datasets": "demonstrations.sets",
}
"""Present name of each module that has moved, by its former name. Submodules move with their module.

Names are relative to ``betterbench``.
"""

NAMES: Mapping[tuple[str, str], str] = {
    ("recording", "LineJournal"): "jobs",
    ("recording", "RunLock"): "jobs",
    ("recording", "RetryLedger"): "jobs",
    ("recording", "write_durably"): "jobs",
    ("worlds", "PLUS_SUITES"): "tasks.worlds.libero",
    ("worlds", "PROTOCOLS"): "tasks.worlds.libero",
    ("worlds", "SUITES"): "tasks.worlds.libero",
    ("worlds", "CHAIN_SUITES"): "tasks.worlds.calvin",
    ("episodes", "AnyPolicy"): "interface.state",
    ("evaluation", "PolicyEntry"): "policies.kinds",
    ("evaluation", "known_policies"): "policies.kinds",
    ("evaluation", "check_policy"): "policies.factory",
}
"""Present module of each public name that moved, by the former package and the name.

Names that moved together with their package are not listed.
"""


def with_present_names(source: str | bytes, path: str) -> ast.Module:
    """Return the syntax tree of a user's file, with former names in imports replaced by present names.

    Line numbers are kept. Names that still exist are not changed.

    Raises:
        SyntaxError: If the text is not valid Python.
    """
    tree: ast.Module = _Renaming().visit(ast.parse(source, path))
    return ast.fix_missing_locations(tree)


def present_name(module: str) -> str:
    """Return the present name of a module, relative to ``betterbench``. The name is unchanged if it did not move."""
    parts = module.split(".")
    for count in range(len(parts), 0, -1):
        moved = MODULES.get(".".join(parts[:count]))
        if moved is not None and not _exists(module):
            return ".".join([moved, *parts[count:]])
    return module


class _Renaming(ast.NodeTransformer):
    """Translator of import statements to present module names."""

    def visit_Import(self, node: ast.Import) -> ast.Import:
        for alias in node.names:
            package, _, module = alias.name.partition(".")
            if package == _PACKAGE and module and alias.asname:
                alias.name = f"{_PACKAGE}.{present_name(module)}"
        return node

    def visit_ImportFrom(self, node: ast.ImportFrom) -> list[ast.ImportFrom]:
        package, _, module = (node.module or "").partition(".")
        if package != _PACKAGE or node.level:
            return [node]
        return [ast.copy_location(made, node) for made in _statements(module, node.names)]


def _statements(module: str, names: list[ast.alias]) -> Iterator[ast.ImportFrom]:
    """Split an import from a betterbench module into one import statement for each imported name."""
    for alias in names:
        inner = f"{module}.{alias.name}".lstrip(".")
        if (module, alias.name) in NAMES:
            home, name = NAMES[module, alias.name], alias.name
        elif present_name(inner) != inner and inner in MODULES:
            home, _, name = present_name(inner).rpartition(".")
        else:
            home, name = present_name(module) if module else "", alias.name
        renamed = ast.alias(name, alias.asname or (alias.name if name != alias.name else None))
        yield ast.ImportFrom(f"{_PACKAGE}.{home}".rstrip("."), [renamed], 0)


def _exists(module: str) -> bool:
    """Return whether ``betterbench`` has a module with this name."""
    try:
        return importlib.util.find_spec(f"{_PACKAGE}.{module}") is not None
    except ModuleNotFoundError:  # the package does not exist either
        return False
