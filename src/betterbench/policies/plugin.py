"""Plain Python policies: ``python:module:Class`` or ``python:path/to/file.py:Class``."""

from __future__ import annotations

import importlib
import importlib.util
import sys
from pathlib import Path
from types import ModuleType

from betterbench.errors import InvalidInputError
from betterbench.interface import Policy


def load_plugin(address: str) -> Policy:
    """Return an instance of a class that a user wrote.

    Args:
        address: "module:Class" or "file.py:Class"; the class is called without arguments.

    Raises:
        InvalidInputError: If the module, the class or one of the methods is missing.
    """
    where, separator, name = address.rpartition(":")
    if not separator or not where or not name:
        raise InvalidInputError(
            f"policy python:{address}", "it names no class", "Write python:module:Class or python:file.py:Class"
        )
    module = _load_file(Path(where)) if where.endswith(".py") else _load_module(where)
    try:
        made = getattr(module, name)
    except AttributeError:
        raise InvalidInputError(
            f"policy python:{address}", f"{where} has no {name!r}", "Name a class of that module"
        ) from None
    policy = made()
    for needed in ("info", "reset", "act"):
        if not hasattr(policy, needed):
            raise InvalidInputError(
                f"policy python:{address}", f"{name} has no {needed!r}", "Give it info, reset(start) and act(observation)"
            )
    return policy  # type: ignore[no-any-return]


def _load_module(name: str) -> ModuleType:
    if str(Path.cwd()) not in sys.path:
        sys.path.insert(0, str(Path.cwd()))
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise InvalidInputError(
            f"policy python:{name}", f"the module cannot be imported ({error})", "Install it or run beside it"
        ) from error


def _load_file(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"betterbench_plugin_{path.stem}", path)
    if spec is None or spec.loader is None or not path.is_file():
        raise InvalidInputError(f"policy python:{path}", "there is no such file", "Name an existing Python file")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
